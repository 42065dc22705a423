"""The slots of phrases: quantities with their units, words for values, and names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from lupin_runtime.arm.presets import PRESETS
from lupin_runtime.voice.known_names import FoundName, NoName, find_name
from lupin_runtime.voice.language import Language
from lupin_runtime.voice.spoken_numbers import Parsed, parse_numbers
from lupin_runtime.voice.tokens import Token

PROBLEM_COST = 1000  # of a slot with a problem: a question about it is asked only if nothing else fits
_MAX_NAME_TOKENS = 6
_MAX_NEW_NAME_TOKENS = 3

SlotValue = tuple[Any, int, int]


@dataclass(frozen=True)
class Names:
    """The names that exist."""

    locations: tuple[str, ...] = ()
    poses: tuple[str, ...] = ()
    sequences: tuple[str, ...] = ()

    def of(self, kind: str) -> tuple[str, ...]:
        """Return the names of a kind: location, pose, sequence or preset. The built-in poses are presets, not poses."""
        if kind == "pose":
            return tuple(name for name in self.poses if name.strip().lower() not in PRESETS)
        return {"location": self.locations, "sequence": self.sequences, "preset": tuple(PRESETS)}[kind]


class Slots:
    """Parses the slots of one sentence."""

    def __init__(self, tokens: Sequence[Token], text: str, language: Language, names: Names) -> None:
        self._tokens = tokens
        self._words = tuple(token.text for token in tokens)
        self._text = text
        self._language = language
        self._names = names
        self._digits = language.numbers.small

    def parse(self, kind: str, start: int) -> Iterator[SlotValue]:
        """Yield value, next token and cost of each slot of this kind that begins at a token."""
        if kind in QUANTITIES:
            yield from self._quantity(kind, start)
        elif kind in ("share", "factor"):
            yield from self._ratio(kind, start)
        elif kind == "number":
            yield from ((number.value, number.end, number.cost) for number in self._numbers(start))
        elif kind in ("location", "pose", "sequence", "preset"):
            yield from self._known_name(kind, start)
        elif kind.startswith("new_"):
            yield from self._new_name(kind.removeprefix("new_"), start)
        elif kind == "text":
            if start < len(self._tokens):
                yield self._text[self._tokens[start].start :].strip(), len(self._tokens), 0
        elif kind == "color":
            yield from self._color(start)
        else:
            yield from self._choice(kind, start)

    def _numbers(self, start: int) -> Iterator[Parsed]:
        return parse_numbers(self._words, start, self._language.numbers)

    def _quantity(self, kind: str, start: int) -> Iterator[SlotValue]:
        unit_kind, is_rate = QUANTITIES[kind]
        for number in self._numbers(start):
            if kind == "signed_angle" and not number.is_signed:
                continue
            for factor, end, cost in self._phrase(self._language.units[unit_kind], number.end):
                if not is_rate:
                    yield number.value * factor, end, number.cost + cost
                    continue
                for _, after, more in self._phrase(dict.fromkeys(self._language.per_second, 1.0), end):
                    yield number.value * factor, after, number.cost + cost + more

    def _ratio(self, kind: str, start: int) -> Iterator[SlotValue]:
        """Yield a share or a factor: 1 is all, or the recorded speed."""
        yield from self._choice(f"{kind}_word", start)
        for number in self._numbers(start):
            for _, end, cost in self._phrase(self._language.units["percent"], number.end):
                yield number.value / 100, end, number.cost + cost
            if kind == "factor":
                for _, end, cost in self._phrase(self._language.units["times"], number.end):
                    yield number.value, end, number.cost + cost
            else:
                yield number.value, number.end, number.cost

    def _choice(self, kind: str, start: int) -> Iterator[SlotValue]:
        yield from self._phrase(self._language.choices[kind], start)

    def _phrase(self, values: Any, start: int) -> Iterator[SlotValue]:
        """Yield the values of the phrases that stand at a token, also as a recognizer writes them."""
        for phrase, value in values.items():
            for variant, cost in self._variants(phrase):
                if self._words[start : start + len(variant)] == variant:
                    yield value, start + len(variant), cost

    def _variants(self, phrase: str) -> Iterator[tuple[tuple[str, ...], int]]:
        yield tuple(phrase.split()), 0
        for variant in self._language.homophones.get(phrase, ()):
            yield tuple(variant.split()), 1

    def _color(self, start: int) -> Iterator[SlotValue]:
        colors = self._language.choices["color"]
        if start < len(self._words):
            found = find_name(self._words[start], colors, self._digits)
            if isinstance(found, FoundName):
                yield colors[found.name], start + 1, found.distance

    def _known_name(self, kind: str, start: int) -> Iterator[SlotValue]:
        names = self._names.of(kind)
        if self._words[start : start + 1] and self._words[start] in self._language.articles:
            return  # it is left out, and the name begins after it
        for end in range(start + 1, min(start + _MAX_NAME_TOKENS, len(self._words)) + 1):
            heard = " ".join(self._words[start:end])
            found = find_name(heard, names, self._digits)
            if isinstance(found, FoundName):
                yield found.name, end, found.distance
                continue
            if number := self._language.numbers.homophones.get(self._words[end - 1]):
                corrected = find_name(f"{' '.join(self._words[start : end - 1])} {number}", names, self._digits)
                if isinstance(corrected, FoundName):
                    yield corrected.name, end, corrected.distance + 1
            if kind != "preset":  # an arm's pose that is not built in may be a stored one
                yield found, end, PROBLEM_COST

    def _new_name(self, kind: str, start: int) -> Iterator[SlotValue]:
        """Yield the names of one to three words that may be saved; one that sounds like a name that exists is that name."""
        if self._words[start : start + 1] and self._words[start] in self._language.articles:
            return  # it is left out, and the name begins after it
        modes = {word for phrase in self._language.choices["mode"] for word in phrase.split()}
        reserved = self._language.negations | self._language.conjunctions | modes
        for end in range(start + 1, min(start + _MAX_NEW_NAME_TOKENS, len(self._words)) + 1):
            words = self._words[start:end]
            if words[-1] in reserved:
                return
            parts = (str(self._digits.get(word, word)) if index else word for index, word in enumerate(words))
            name = (" " if kind == "location" else "_").join(parts)  # the arm's names have no spaces
            found = find_name(name, self._names.of(kind), self._digits)
            if isinstance(found, NoName) and found.candidates:
                yield found, end, PROBLEM_COST
            else:
                yield found.name if isinstance(found, FoundName) else name, end, 0


QUANTITIES = {
    "distance": ("length", False),
    "duration": ("time", False),
    "angle": ("angle", False),
    "signed_angle": ("angle", False),
    "percent": ("percent", False),
    "speed": ("length", True),
    "rate": ("angle", True),
}
