"""Words, numbers and signs of what a person said or typed."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

MAX_TOKENS = 60  # of a command; a longer one is talk

# A minus that is lost would turn a goal around, so a sign is dropped only inside a word: "tag-5" is a name, "y-1" and "y - 1"
# are not. The e-stop is one word where it is typed as one.
_TOKEN = re.compile(
    r"""(?P<number>(?:(?:(?<!\w)|(?<=\b[xy])|(?<=\d[xy]))[-+])?\d+(?:[.,]\d+)?|(?<!\w)[-+]?[.,]\d+)
    |   (?P<word>e-stop\b|[^\W\d_]+(?:'[^\W\d_]+)*)
    |   (?P<sign>[%°/]|[-+](?=\s+[.,]?\d))""",
    re.VERBOSE | re.IGNORECASE,
)
_SIGNS = {"%": "percent", "°": "degrees", "/": "per", "-": "minus", "+": "plus"}
_THOUSANDS = re.compile(r"[-+]?\d{1,3},\d{3}")
QUOTES = frozenset('"“”„«»‟')  # not the apostrophe


@dataclass(frozen=True)
class Token:
    """A word in lower case, or a number as its digits with a point; `start` and `end` are its place in the text."""

    text: str
    start: int
    end: int


def clean_text(text: str) -> str:
    """Return a text in composed characters, with one form of the apostrophe and of the minus."""
    return unicodedata.normalize("NFKC", text).translate({ord("’"): "'", ord("−"): "-"})


def tokenize(text: str) -> tuple[Token, ...]:
    """Return the tokens of a cleaned text. "1,000" is no number: it is one thousand here, and one in the Netherlands."""
    found = []
    for match in _TOKEN.finditer(text):
        word = match.group().lower()
        if match["number"] and not _THOUSANDS.fullmatch(word):
            word = word.replace(",", ".")
        found.append(Token(_SIGNS.get(word, word), match.start(), match.end()))
    return tuple(found)
