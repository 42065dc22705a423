"""Shortens what clients send for messages and the command journal."""

from __future__ import annotations

import reprlib
from itertools import islice
from typing import Any


class _ShortRepr(reprlib.Repr):
    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxdict, self.maxlist, self.maxstring, self.maxother = 6, 20, 20, 200, 200

    def repr_dict(self, x: dict[Any, Any], level: int) -> str:
        """Convert a dict in its own order: the base class would sort all keys first, of which a client may send a million."""
        if level <= 0:
            return "{...}"
        items = [f"{self.repr1(key, level - 1)}: {self.repr1(x[key], level - 1)}" for key in islice(x, self.maxdict)]
        return "{" + ", ".join([*items, "..."] if len(x) > self.maxdict else items) + "}"


_SHORT = _ShortRepr()


def short_repr(value: Any, length: int = 100) -> str:
    """Return the first `length` characters of a value's Python notation.

    Only the beginning of the value is converted: `repr` takes long for a large one, and raises RecursionError for one that is
    nested some hundred levels deep.
    """
    return _SHORT.repr(value)[:length]
