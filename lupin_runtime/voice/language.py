"""What the grammar must know of a language: its words, and its phrases for each rule."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lupin_runtime.voice.spoken_numbers import NumberWords


@dataclass(frozen=True)
class Language:
    """The words and phrases of one language. Phrases and patterns are those of `phrases.py`.

    `units` has, by quantity, the factor of each unit to the quantity's own: m, s, degrees, percent. `choices` has, by slot, the
    words for its values. `phrases` has, by the name of a rule of the grammar, the patterns of sentences that mean it. `agree`
    and `refuse` answer a read-back. `examples` are sentences that the grammar understands, for its questions.
    """

    numbers: NumberWords
    units: Mapping[str, Mapping[str, float]]
    per_second: tuple[str, ...]
    choices: Mapping[str, Mapping[str, Any]]
    phrases: Mapping[str, tuple[str, ...]]
    agree: tuple[str, ...]
    refuse: tuple[str, ...]
    articles: frozenset[str]
    fillers: frozenset[str]  # removed from both ends of a sentence
    hesitations: frozenset[str]  # removed everywhere
    negations: frozenset[str]
    conjunctions: frozenset[str]
    homophones: Mapping[str, tuple[str, ...]]
    examples: tuple[str, ...]
    usual_names: tuple[str, ...] = ()  # that operators give, with {number} for a small one: a recognizer may expect them
