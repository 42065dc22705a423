"""Text from the robot for a model: quoted as data, since a name or a message could hold an instruction."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from itertools import islice
from typing import Any

MAX_TEXT = 300
MAX_ITEMS = 100
_MAX_READ = 10 * MAX_TEXT  # characters of a text that are looked at


def quote(text: Any) -> dict[str, str]:
    """Return a text as data: `{"untrusted": ...}`, cleaned and shortened."""
    return {"untrusted": clean(text)}


def quote_all(texts: Iterable[Any]) -> list[dict[str, str]]:
    """Return the first MAX_ITEMS texts as data."""
    return [quote(text) for text in islice(texts, MAX_ITEMS)]


def clean(text: Any) -> str:
    """Return a text on one line without characters that are not printed, such as controls and bidirectional marks."""
    words = "".join(" " if each.isspace() else each for each in str(text)[:_MAX_READ] if each.isspace() or _is_shown(each))
    line = " ".join(words.split())
    return line if len(line) <= MAX_TEXT else f"{line[: MAX_TEXT - 1]}…"


def _is_shown(character: str) -> bool:
    return not unicodedata.category(character).startswith("C")
