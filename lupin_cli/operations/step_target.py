"""The target of one step of a playbook: it enforces the step's timeout, and records the output of scripts."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from lupin_cli.connection.base import Output, Target
from lupin_cli.connection.forwarding import ForwardingTarget
from lupin_cli.operations.base import OperationError

RECORDED_CHARACTERS = 64 * 1024  # of one script's output in the journal: its beginning and its end


class StepTarget(ForwardingTarget):
    """Forwards every call to a target, bounded by `deadline`.

    `reserve` reserves a target that several playbook runs share for this one.
    """

    def __init__(self, target: Target, reserve: Callable[[], AbstractContextManager[object]] = nullcontext) -> None:
        super().__init__(target)
        self._reserve = reserve
        self.deadline = float("inf")  # of time.monotonic()
        self.record: Callable[[str], None] | None = None  # receives the output of scripts that change something
        self.on_line: Callable[[str], None] | None = None

    @property
    def unlimited(self) -> Target:
        """The target without the step's timeout, for one short probe."""
        return self._target

    @contextmanager
    def reserved(self) -> Iterator[None]:
        """Keep other runs that share the target from using it. The wait for them does not count against the timeout."""
        start = time.monotonic()
        with self._reserve():
            self.deadline += time.monotonic() - start
            yield

    def remaining(self, timeout_s: float) -> float:
        """Return the remaining time of the step, at most `timeout_s`; raises OperationError if none is left."""
        remaining_s = self.deadline - time.monotonic()
        if remaining_s <= 0:
            raise OperationError("the step's time is up; give it more with 'timeout' in the playbook")
        return min(timeout_s, remaining_s)

    @contextmanager
    def forwarded(self, timeout_s: float) -> Iterator[tuple[Target, float]]:
        yield self._target, self.remaining(timeout_s)

    def run(self, script: str, *, on_line: Callable[[str], None] | None = None, **options: Any) -> Output:
        if self.record is None:
            return super().run(script, on_line=on_line, **options)

        def forward_line(line: str) -> None:
            if on_line is not None:
                on_line(line)
            if self.on_line is not None:
                self.on_line(line)

        output = super().run(script, on_line=forward_line, **options)
        text = output.stdout + (f"\n[errors]\n{output.stderr}" if output.stderr else "")
        if text.strip():
            self.record(_both_ends(text))
        return output


def _both_ends(text: str) -> str:
    if len(text) <= RECORDED_CHARACTERS:
        return text
    half = RECORDED_CHARACTERS // 2
    return f"{text[:half]}\n[{len(text) - 2 * half} characters left out]\n{text[-half:]}"
