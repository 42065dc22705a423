"""Patterns of phrases, and how they match the words of a sentence.

A pattern has words, `[optional parts]`, `(this|that)`, and `{slots}` such as `{side}` or `{x:number}`, with the name before the
colon. It matches a whole sentence or not at all: a word that it does not know is a reason to ask again.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

SlotParser = Callable[[str, int], Iterator[tuple[Any, int, int]]]
"""Yields value, next token and cost of a slot of this kind that begins at a token."""


class PhraseMatch(NamedTuple):
    """The values of a pattern's slots, and the cost of the words that are doubtful."""

    values: dict[str, Any]
    cost: int


class _State(NamedTuple):
    position: int
    values: tuple[tuple[str, Any], ...] = ()
    cost: int = 0


@dataclass(frozen=True)
class Word:
    """A word that must be said."""

    text: str


@dataclass(frozen=True)
class Slot:
    """A value of a kind."""

    name: str
    kind: str


@dataclass(frozen=True)
class Choice:
    """One of several parts."""

    options: tuple[Sequence, ...]


@dataclass(frozen=True)
class Sequence:
    """Parts one after the other."""

    parts: tuple[Word | Slot | Choice, ...]


@dataclass(frozen=True)
class Sentence:
    """The words of a sentence, with what each pattern needs to match them.

    `articles` may stand before any part. `homophones` has, by word, what a recognizer writes for it instead.
    """

    words: tuple[str, ...]
    articles: frozenset[str]
    homophones: Mapping[str, tuple[str, ...]]
    parse_slot: SlotParser

    def match(self, pattern: str) -> Iterator[PhraseMatch]:
        """Yield every way in which the pattern matches the whole sentence."""
        for state in self._match_sequence(compile_pattern(pattern), _State(0)):
            if state.position == len(self.words):
                yield PhraseMatch(dict(state.values), state.cost)

    def _match_sequence(self, sequence: Sequence, state: _State, index: int = 0) -> Iterator[_State]:
        if index == len(sequence.parts):
            yield state
            return
        for after in self._match_part(sequence.parts[index], state):
            yield from self._match_sequence(sequence, after, index + 1)

    def _match_part(self, part: Word | Slot | Choice, state: _State) -> Iterator[_State]:
        if isinstance(part, Choice):
            for option in part.options:
                yield from self._match_sequence(option, state)
            return
        position = state.position
        while True:
            at = state._replace(position=position)
            yield from self._match_word(part, at) if isinstance(part, Word) else self._match_slot(part, at)
            if position >= len(self.words) or self.words[position] not in self.articles:
                return
            position += 1

    def _match_word(self, word: Word, state: _State) -> Iterator[_State]:
        position = state.position
        if position >= len(self.words):
            return
        if self.words[position] == word.text:
            yield state._replace(position=position + 1)
        for variant in self.homophones.get(word.text, ()):
            heard = tuple(variant.split())
            if self.words[position : position + len(heard)] == heard:
                yield state._replace(position=position + len(heard), cost=state.cost + 1)

    def _match_slot(self, slot: Slot, state: _State) -> Iterator[_State]:
        for value, position, cost in self.parse_slot(slot.kind, state.position):
            yield _State(position, (*state.values, (slot.name, value)), state.cost + cost)


@cache
def compile_pattern(pattern: str) -> Sequence:
    """Return the parts of a pattern. Raises ValueError if its brackets do not match."""
    marks = re.findall(r"\{\w+(?::\w+)?\}|[\[\]()|]|[^\s\[\](){}|]+", pattern)
    choice, rest = _read_choice(marks, 0, pattern)
    if rest != len(marks):
        raise ValueError(f"{pattern!r} has a bracket that was not opened")
    return choice.options[0] if len(choice.options) == 1 else Sequence((choice,))


def _read_choice(marks: list[str], index: int, pattern: str) -> tuple[Choice, int]:
    options: list[Sequence] = []
    parts: list[Word | Slot | Choice] = []
    while index < len(marks) and marks[index] not in ("]", ")"):
        mark = marks[index]
        index += 1
        if mark == "|":
            options.append(Sequence(tuple(parts)))
            parts = []
        elif mark in ("[", "("):
            inner, index = _read_choice(marks, index, pattern)
            if marks[index : index + 1] != ["]" if mark == "[" else ")"]:
                raise ValueError(f"{pattern!r} has a bracket that is not closed")
            index += 1
            parts.append(Choice((*inner.options, Sequence(()))) if mark == "[" else inner)
        elif mark.startswith("{"):
            name, _, kind = mark[1:-1].partition(":")
            parts.append(Slot(name, kind or name))
        else:
            parts.append(Word(mark))
    return Choice((*options, Sequence(tuple(parts)))), index
