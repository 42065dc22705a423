"""Finds the name that was meant among the names that exist: by its letters, then by how it sounds, with a margin."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

# Letters that a recognizer exchanges, as they sound alike in English: "sync" for "sink", "blew" for "blue".
_ALIKE = (
    (r"ph", "f"), (r"ck|c(?![eiyh])|q", "k"), (r"c(?=[eiy])", "s"), (r"z", "s"), (r"y", "i"), (r"wh", "w"), (r"wr", "r"),
    (r"ew\b|ue\b|oo", "u"), (r"ea|ee|ie", "e"), (r"gh", ""), (r"x", "ks"), (r"(.)\1", r"\1"),
)  # fmt: skip
_LETTERS_PER_ERROR = 5  # one letter of a word may differ in five; none in a shorter word
_MARGIN = 1  # by how many letters the next name must be farther away


@dataclass(frozen=True)
class FoundName:
    """A name that exists, and by how many letters it differs from what was said."""

    name: str
    distance: int


@dataclass(frozen=True)
class NoName:
    """No name fits what was said, or several do, which are the `candidates`."""

    heard: str
    candidates: tuple[str, ...] = ()


def name_tokens(name: str, digits: Mapping[str, int]) -> tuple[str, ...]:
    """Return the words of a name, with numbers as digits: "Tag_5" and "tag five" are the same."""
    return tuple(str(digits.get(word, word)) for word in re.findall(r"[^\W\d_]+|\d+", name.lower()))


def find_name(heard: str, names: Iterable[str], digits: Mapping[str, int]) -> FoundName | NoName:
    """Return the name that was meant. Numbers in it must be the same: "tag 5" is never "tag 6"."""
    said = name_tokens(heard, digits)
    exact, near = [], []
    for name in names:
        known = name_tokens(name, digits)
        if "".join(known) == "".join(said):
            exact.append(name)
        elif (distance := _words_distance(known, said)) is not None:
            near.append((distance, name))
    if exact:
        return FoundName(exact[0], 0) if len(exact) == 1 else NoName(heard, tuple(exact))
    if not near:
        return NoName(heard)
    near.sort()
    best = near[0][0]
    rivals = tuple(name for distance, name in near if distance - best < _MARGIN)
    return FoundName(rivals[0], best + 1) if len(rivals) == 1 else NoName(heard, rivals)


def _words_distance(known: tuple[str, ...], said: tuple[str, ...]) -> int | None:
    """Return by how many letters the words differ in sound; None if one differs too much, or a number at all."""
    if len(known) != len(said):
        return None
    total = 0
    for one, other in zip(known, said):
        if one.isdigit() or other.isdigit():
            distance, allowed = int(one != other), 0
        else:
            sounds = _sound(one), _sound(other)
            allowed = min(map(len, sounds)) // _LETTERS_PER_ERROR
            # Words of other lengths differ by as many letters at least: a word of a thousand letters is not compared.
            distance = allowed + 1 if abs(len(sounds[0]) - len(sounds[1])) > allowed else _distance(*sounds)
        if distance > allowed:
            return None
        total += distance
    return total


def _sound(word: str) -> str:
    for pattern, replacement in _ALIKE:
        word = re.sub(pattern, replacement, word)
    return word


def _distance(one: str, other: str) -> int:
    """Return how many letters must be added, left out, changed or swapped with their neighbor (optimal string alignment)."""
    before: list[int] = []
    row = list(range(len(other) + 1))
    for i, letter in enumerate(one, 1):
        before, last, row = row, before, [i]
        for j, against in enumerate(other, 1):
            cost = min(before[j] + 1, row[j - 1] + 1, before[j - 1] + (letter != against))
            if i > 1 and j > 1 and letter == other[j - 2] and one[i - 2] == against:
                cost = min(cost, last[j - 2] + 1)
            row.append(cost)
    return row[-1]
