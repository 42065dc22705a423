"""Numbers as the streams of C++ read them, for text that programs in C++ write and read."""

from __future__ import annotations

import re

# Neither 1_000 nor 0x10 nor 1:30, which Python or YAML would take.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?\.?(nan|inf|infinity)", re.IGNORECASE)


def parse_number(text: str) -> float | None:
    """Return the number; NaN or infinity for their usual spellings, which callers refuse by name; None for other text."""
    if _NOT_FINITE.fullmatch(text):
        return float(text.replace(".", ""))
    return float(text) if _NUMBER.fullmatch(text) else None
