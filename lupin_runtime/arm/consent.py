"""Asks the computer that started this program whether the arm may still be moved.

A program that a remote computer started runs on after that computer was switched off, or its link was lost. It therefore
prints QUESTION just before it moves the arm, and the other computer answers with the line ANSWER.
"""

from __future__ import annotations

import os
import select

QUESTION = "may the arm be moved now?"
ANSWER = b"yes\n"
# The longest time for an answer: a link that roams is silent for some seconds.
ANSWER_LIMIT_S = 10.0


class Consent:
    """One question after the other, on standard output; the answers arrive on `descriptor`."""

    def __init__(self, descriptor: int = 0) -> None:
        self._descriptor = descriptor
        self._received = b""
        self.is_refused = False  # no answer can arrive any more

    def ask(self) -> None:
        """Print the question; what was received before answers nothing."""
        self._receive()
        self._received = b""
        try:
            print(QUESTION, flush=True)
        except OSError:
            self.is_refused = True

    def is_given(self) -> bool:
        """Return, without waiting, whether the answer has arrived."""
        self._receive()
        return not self.is_refused and self._received == ANSWER

    def _receive(self) -> None:
        while not self.is_refused and len(self._received) <= len(ANSWER) and select.select([self._descriptor], [], [], 0.0)[0]:
            try:
                data = os.read(self._descriptor, len(ANSWER))
            except OSError:
                data = b""
            self._received += data
            self.is_refused = not data
