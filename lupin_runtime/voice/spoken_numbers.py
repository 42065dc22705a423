"""Numbers as people say them: "two", "minus one point five", "half a", "two and a half", "1.5"."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

_DIGITS = re.compile(r"[-+]?(?:\d+(?:\.\d+)?|\.\d+)")
HOMOPHONE_COST = 1


@dataclass(frozen=True)
class NumberWords:
    """The words for numbers in a language.

    `small` has those that are one word; `tens` of them are followed by one of 1 to 9 ("twenty five"), if the
    language says so. `fractions` stand before a unit, `and_fractions` after a whole number. `homophones` are what a
    recognizer writes for a number; they count only where the sentence fits in no other way.
    """

    small: Mapping[str, int]
    tens: frozenset[str]
    hundred: str
    joiner: str
    point: frozenset[str]
    minus: frozenset[str]
    plus: frozenset[str]
    fractions: Mapping[tuple[str, ...], float]
    and_fractions: Mapping[tuple[str, ...], float]
    homophones: Mapping[str, int]


class Parsed(NamedTuple):
    """A value that ends before the token `end`; `cost` counts doubtful words, `is_signed` says that a sign was said."""

    value: float
    end: int
    cost: int = 0
    is_signed: bool = False


def parse_numbers(tokens: tuple[str, ...], start: int, words: NumberWords) -> Iterator[Parsed]:
    """Yield every number that begins at a token: "two hundred" is 2, and 200."""
    if start >= len(tokens):
        return
    first = tokens[start]
    if _DIGITS.fullmatch(first):
        yield Parsed(float(first), start + 1, 0, first[0] in "+-")
        if first.isdigit():
            yield from _extend_with(tokens, start + 1, float(first), 0, words.and_fractions)
        if first in ("100", "200", "300") and tokens[start + 1 : start + 2] == (words.joiner,):
            # Recognizers write "one hundred and eighty" as "100 and 80".
            rest = tokens[start + 2] if start + 2 < len(tokens) else ""
            if rest.isdigit() and int(rest) < 100:
                yield Parsed(float(first) + int(rest), start + 3)
    elif first in words.minus | words.plus:
        sign = -1.0 if first in words.minus else 1.0
        for found in parse_numbers(tokens, start + 1, words):
            if not found.is_signed:
                yield Parsed(sign * found.value, found.end, found.cost, True)
    else:
        yield from _unsigned(tokens, start, words)


def _unsigned(tokens: tuple[str, ...], start: int, words: NumberWords) -> Iterator[Parsed]:
    yield from _extend_with(tokens, start, 0.0, 0, words.fractions)
    if tokens[start] in words.point:
        yield from _decimals(tokens, start + 1, 0.0, 0, words)
    for whole in _whole_numbers(tokens, start, words):
        yield whole
        yield from _extend_with(tokens, whole.end, whole.value, whole.cost, words.and_fractions)
        if whole.end < len(tokens) and tokens[whole.end] in words.point:
            yield from _decimals(tokens, whole.end + 1, whole.value, whole.cost, words)


def _extend_with(
    tokens: tuple[str, ...], start: int, whole: float, cost: int, fractions: Mapping[tuple[str, ...], float]
) -> Iterator[Parsed]:
    for phrase, value in fractions.items():
        if tokens[start : start + len(phrase)] == phrase:
            yield Parsed(whole + value, start + len(phrase), cost)


def _decimals(tokens: tuple[str, ...], start: int, whole: float, cost: int, words: NumberWords) -> Iterator[Parsed]:
    """Yield the numbers with one to four spoken decimals: "point two five", or "point 25"."""
    digits = ""
    for end in range(start, min(start + 4, len(tokens))):
        token = tokens[end]
        if token.isdigit():
            digits += token
        elif token in words.small and words.small[token] < 10:
            digits += str(words.small[token])
        elif token in words.homophones:
            digits += str(words.homophones[token])
            cost += HOMOPHONE_COST
        else:
            return
        yield Parsed(whole + float(f"0.{digits}"), end + 1, cost)


def _whole_numbers(tokens: tuple[str, ...], start: int, words: NumberWords) -> Iterator[Parsed]:
    for below in _below_hundred(tokens, start, words):
        yield below
        if 1 <= below.value <= 9 and below.end < len(tokens) and tokens[below.end] == words.hundred:
            yield from _hundreds(tokens, below.end + 1, below.value * 100, below.cost, words)
    if tokens[start] == words.hundred:
        yield from _hundreds(tokens, start + 1, 100.0, 0, words)


def _hundreds(tokens: tuple[str, ...], end: int, value: float, cost: int, words: NumberWords) -> Iterator[Parsed]:
    yield Parsed(value, end, cost)
    rest = end + 1 if tokens[end : end + 1] == (words.joiner,) else end
    for below in _below_hundred(tokens, rest, words):
        yield Parsed(value + below.value, below.end, cost + below.cost)


def _below_hundred(tokens: tuple[str, ...], start: int, words: NumberWords) -> Iterator[Parsed]:
    if start >= len(tokens):
        return
    token = tokens[start]
    if token in words.homophones:
        yield Parsed(float(words.homophones[token]), start + 1, HOMOPHONE_COST)
    if token not in words.small:
        return
    value = float(words.small[token])
    yield Parsed(value, start + 1)
    if token in words.tens and start + 1 < len(tokens) and 1 <= words.small.get(tokens[start + 1], 0) <= 9:
        yield Parsed(value + words.small[tokens[start + 1]], start + 2)
