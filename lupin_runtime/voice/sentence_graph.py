"""The sentences that a language's phrases allow, as a graph of a recognizer's tokens.

A recognizer that searches only in this graph writes "go to tag five" for what it would otherwise write "blotter tark fave". The
graph allows more than the grammar understands, such as a number out of range, so what comes of it is parsed as any sentence.
A text to speak is not in the graph, and of new names only the usual ones.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from lupin_runtime.voice.language import Language
from lupin_runtime.voice.phrases import Choice, Sequence, Slot, Word, compile_pattern
from lupin_runtime.voice.slots import QUANTITIES, Names
from lupin_runtime.voice.spoken_numbers import NumberWords

_EMPTY = -2
_DIGITS = "0123456789"
_SMALL = 20
_MAX_DIGITS, _MAX_DECIMALS = 4, 2
MAX_KEPT = 4096  # sets of states: numbers allow so many that a listener of a whole day would keep them without end

Encode = Callable[[str], list[int]]
"""Returns the tokens of a text that stands as it is: with its space, if one comes before it."""


class SentenceGraph:
    """States are numbers, 0 is the start. `arcs` has, by state and token, the states that follow; `ends` where one may end."""

    def __init__(self, arcs: Mapping[int, Mapping[int, set[int]]], ends: Iterable[int]) -> None:
        self._arcs = arcs
        self._ends = frozenset(ends)
        self._closures: dict[int, frozenset[int]] = {}
        self._followed: dict[tuple[frozenset[int], int], frozenset[int]] = {}
        self._allowed: dict[frozenset[int], frozenset[int]] = {}
        self.start = self._closure(0)

    def allowed(self, states: frozenset[int]) -> frozenset[int]:
        """Return the tokens that may come next."""
        if states not in self._allowed:
            _make_room(self._allowed)
            self._allowed[states] = frozenset().union(*(self._arcs.get(state, ()) for state in states)) - {_EMPTY}
        return self._allowed[states]

    def follow(self, states: frozenset[int], token: int) -> frozenset[int]:
        """Return the states after a token."""
        key = (states, token)
        if key not in self._followed:
            _make_room(self._followed)
            arcs = [self._arcs.get(state, {}) for state in states]
            after = set[int]().union(*(each.get(token, ()) for each in arcs))
            self._followed[key] = frozenset().union(*map(self._closure, after))
        return self._followed[key]

    def may_end(self, states: frozenset[int]) -> bool:
        """Return whether a sentence may end in one of the states."""
        return not self._ends.isdisjoint(states)

    def _closure(self, state: int) -> frozenset[int]:
        """Return a state, and those that are reached from it without a token."""
        if state not in self._closures:
            found, waiting = {state}, [state]
            while waiting:
                new = self._arcs.get(waiting.pop(), {}).get(_EMPTY, set()) - found
                found |= new
                waiting.extend(new)
            self._closures[state] = frozenset(found)
        return self._closures[state]


def _make_room(kept: dict[Any, Any]) -> None:
    if len(kept) >= MAX_KEPT:
        kept.clear()


class _Builder:
    """Adds parts between states; a word is preceded by a space."""

    def __init__(self, language: Language, names: Names, encode: Encode) -> None:
        self._language = language
        self._names = names
        self._encode = encode
        self._arcs: dict[int, dict[int, set[int]]] = defaultdict(lambda: defaultdict(set))
        self._count = 1

    def state(self) -> int:
        self._count += 1
        return self._count - 1

    def arc(self, start: int, token: int, end: int) -> None:
        self._arcs[start][token].add(end)

    def text(self, start: int, text: str, end: int) -> None:
        """Add a text that stands as it is."""
        *first, last = self._encode(text)
        for token in first:
            middle = self.state()
            self.arc(start, token, middle)
            start = middle
        self.arc(start, last, end)

    def word(self, start: int, word: str, end: int) -> None:
        """Add a word with its spellings, and the comma that may follow it."""
        spoken = self.state()
        for spelling in {word, word.capitalize(), *(("LED" + word[3:],) if word.startswith("led") else ())}:
            self.text(start, f" {spelling}", spoken)
        self.arc(spoken, _EMPTY, end)
        self.text(spoken, ",", end)

    def words(self, start: int, words: Iterable[str], end: int) -> None:
        for word in words:
            after = self.state()
            self.word(start, word, after)
            start = after
        self.arc(start, _EMPTY, end)

    def one_of(self, start: int, phrases: Iterable[str], end: int) -> None:
        for phrase in phrases:
            self.words(start, phrase.replace("_", " ").split(), end)

    def pattern(self, start: int, part: Sequence | Word | Slot | Choice, end: int) -> None:
        if isinstance(part, Sequence):
            for each in part.parts:
                after = self.state()
                self.pattern(start, each, after)
                start = after
            self.arc(start, _EMPTY, end)
        elif isinstance(part, Choice):
            for option in part.options:
                self.pattern(start, option, end)
        else:
            named = self.state()
            self.arc(start, _EMPTY, named)
            self.one_of(start, self._language.articles, named)
            if isinstance(part, Word):
                self.word(named, part.text, end)
            else:
                self.slot(named, part.kind, end)

    def slot(self, start: int, kind: str, end: int) -> None:
        language = self._language
        if kind in QUANTITIES:
            unit, is_rate = QUANTITIES[kind]
            number, united = self.state(), self.state()
            self.number(start, number)
            self.one_of(number, language.units[unit], united)
            if unit == "percent":
                self.text(number, "%", united)
            self.one_of(united, language.per_second, end) if is_rate else self.arc(united, _EMPTY, end)
        elif kind in ("share", "factor"):
            self.one_of(start, language.choices[f"{kind}_word"], end)
            number = self.state()
            self.number(start, number)
            self.one_of(number, language.units["percent"], end)
            self.text(number, "%", end)
            self.one_of(number, language.units["times"], end) if kind == "factor" else self.arc(number, _EMPTY, end)
        elif kind == "number":
            self.number(start, end)
        elif kind in ("location", "pose", "sequence", "preset"):
            self.name(start, kind, end)
        elif kind == "text":
            return  # free text is not a part of the graph
        elif kind.startswith("new_"):
            self.name(start, kind.removeprefix("new_"), end)
            self.usual_names(start, end)
        else:
            self.one_of(start, language.choices[kind], end)

    def name(self, start: int, kind: str, end: int) -> None:
        spoken = {value: word for word, value in self._language.numbers.small.items()}
        for name in self._names.of(kind):
            states = start
            for word in name.replace("_", " ").replace("-", " ").lower().split():
                after = self.state()
                self.word(states, word, after)
                if word.isascii() and word.isdigit() and len(word) < _MAX_DIGITS and int(word) in spoken:
                    self.word(states, spoken[int(word)], after)
                states = after
            self.arc(states, _EMPTY, end)

    def usual_names(self, start: int, end: int) -> None:
        """Add the names that operators give."""
        for name in self._language.usual_names:
            *words, last = name.split()
            before = self.state()
            self.words(start, words, before)
            if last == "{number}":
                self.small_number(before, end)
            else:
                self.word(before, last, end)

    def small_number(self, start: int, end: int) -> None:
        """Add 0 to 19, as words and as digits."""
        for word, value in self._language.numbers.small.items():
            if value < _SMALL:
                self.word(start, word, end)
                self.text(start, f" {value}", end)

    def number(self, start: int, end: int) -> None:
        """Add the numbers, as words and as digits, and the comma that may follow them."""
        words = self._language.numbers
        number = self.state()
        self.arc(number, _EMPTY, end)
        self.text(number, ",", end)
        end = number
        signed = self.state()
        self.arc(start, _EMPTY, signed)
        self.one_of(start, words.minus | words.plus, signed)
        self.text(start, " -", negative := self.state())
        self.digits(negative, end, space="")
        self.digits(signed, end)
        self.one_of(signed, map(" ".join, words.fractions), end)
        whole = self.state()
        self.whole(signed, whole, words)
        self.arc(whole, _EMPTY, end)
        self.one_of(whole, map(" ".join, words.and_fractions), end)
        decimals = self.state()
        self.one_of(whole, words.point, decimals)
        self.one_of(signed, words.point, decimals)
        for _ in range(_MAX_DECIMALS):
            after = self.state()
            self.one_of(decimals, (word for word, value in words.small.items() if value < 10), after)
            self.arc(after, _EMPTY, end)
            decimals = after

    def whole(self, start: int, end: int, words: NumberWords) -> None:
        self.below_hundred(start, end, words)
        hundred, joined = self.state(), self.state()
        self.one_of(start, (f"{word} {words.hundred}" for word, value in words.small.items() if 1 <= value <= 9), hundred)
        self.one_of(start, (words.hundred,), hundred)
        self.arc(hundred, _EMPTY, end)
        self.arc(hundred, _EMPTY, joined)
        self.one_of(hundred, (words.joiner,), joined)
        self.below_hundred(joined, end, words)

    def below_hundred(self, start: int, end: int, words: NumberWords) -> None:
        tens = self.state()
        self.one_of(start, words.small, end)
        self.one_of(start, words.tens, tens)
        self.one_of(tens, (word for word, value in words.small.items() if 1 <= value <= 9), end)

    def digits(self, start: int, end: int, space: str = " ") -> None:
        """Add 0 to 9999 with up to two decimals."""
        first = self.state()
        for digit in _DIGITS:
            self.text(start, f"{space}{digit}", first)
        point = self.state()
        for place in range(_MAX_DIGITS):
            self.arc(first, _EMPTY, end)
            self.text(first, ".", point)
            if place + 1 < _MAX_DIGITS:
                after = self.state()
                self.each_digit(first, after)
                first = after
        for _ in range(_MAX_DECIMALS):
            after = self.state()
            self.each_digit(point, after)
            self.arc(after, _EMPTY, end)
            point = after

    def each_digit(self, start: int, end: int) -> None:
        for digit in _DIGITS:
            self.arc(start, self._encode(digit)[0], end)

    def build(self, ends: Iterable[int]) -> SentenceGraph:
        return SentenceGraph(self._arcs, ends)


def build_graph(language: Language, names: Names, encode: Encode) -> SentenceGraph:
    """Return the graph of a language's commands. Yes is not among them: it must be heard as it is."""
    builder = _Builder(language, names, encode)
    begin, spoken, end = builder.state(), builder.state(), builder.state()
    builder.arc(0, _EMPTY, begin)
    builder.one_of(0, language.fillers, begin)
    for patterns in (*language.phrases.values(), language.refuse):
        for pattern in patterns:
            builder.pattern(begin, compile_pattern(pattern), spoken)
    builder.arc(spoken, _EMPTY, end)
    builder.one_of(spoken, language.fillers, end)
    closed = builder.state()
    for mark in ".!?":
        builder.text(end, mark, closed)
    return builder.build((end, closed))
