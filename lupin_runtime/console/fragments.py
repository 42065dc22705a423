"""Reassembles the messages that a client sends in fragments."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

MAX_CHARACTERS = 16_000_000  # of all unfinished messages of one client
MAX_FRAGMENTS = 10_000
MAX_MESSAGES = 32
FRAGMENT_CHARACTERS = 64  # what a fragment counts in addition to its text: it takes memory even if it is empty
TIMEOUT_S = 60.0


class BadFragment(ValueError):
    """A fragment that is malformed or does not belong to its message."""


@dataclass
class _Unfinished:
    total: int
    started_s: float
    parts: dict[int, str] = field(default_factory=dict)
    size: int = 0


class Defragmenter:
    """The unfinished messages of one client. The oldest are dropped if there are too many, and each one after TIMEOUT_S."""

    def __init__(self) -> None:
        self._messages: OrderedDict[str, _Unfinished] = OrderedDict()

    @property
    def waiting_characters(self) -> int:
        """Characters of all unfinished messages, including FRAGMENT_CHARACTERS for each fragment."""
        return sum(message.size for message in self._messages.values())

    def add(self, fragment: dict[str, Any], now_s: float) -> str | None:
        """Add a `fragment` message; returns the whole text if no fragment is missing now. Raises BadFragment."""
        identifier, data, number, total = (fragment.get(key) for key in ("id", "data", "num", "total"))
        integers = all(isinstance(value, int) and not isinstance(value, bool) for value in (number, total))
        if not isinstance(identifier, (str, int, float)) or not isinstance(data, str) or not integers:
            raise BadFragment("a fragment needs id (text or a number), data (text), num and total (integers)")
        assert isinstance(number, int) and isinstance(total, int)  # for the type checker
        if not 0 < total <= MAX_FRAGMENTS or not 0 <= number < total:
            raise BadFragment(f"fragment {number} of {total}: expected 0 to total - 1, of at most {MAX_FRAGMENTS}")
        self._drop_expired(now_s)
        key = repr(identifier)
        message = self._messages.setdefault(key, _Unfinished(total, now_s))
        if message.total != total or number in message.parts:
            raise BadFragment(f"fragment {number} of {total} does not fit the earlier ones with its id")
        message.parts[number] = data
        message.size += len(data) + FRAGMENT_CHARACTERS
        if len(message.parts) == total:
            del self._messages[key]
            return "".join(message.parts[index] for index in range(total))
        while len(self._messages) > MAX_MESSAGES or self.waiting_characters > MAX_CHARACTERS:
            self._messages.popitem(last=False)
        return None

    def _drop_expired(self, now_s: float) -> None:
        for key, message in list(self._messages.items()):
            if now_s - message.started_s > TIMEOUT_S:
                del self._messages[key]
