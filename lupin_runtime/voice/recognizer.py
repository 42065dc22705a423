"""Speech to text for commands: what was said, or the command that it was meant to be, if that is nearly as likely.

A small recognizer writes "Calibrations targets" where "calibration status" was said. Among the sentences that the grammar
knows it finds the right one, and tells by how much that is less likely than what it wrote. What is no command is far less
likely to be any of them: it stays as it was written, and is asked again.
"""

from __future__ import annotations

import importlib.util
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from lupin_runtime.voice.endpointer import SAMPLE_BYTES, SAMPLE_RATE_HZ
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.grammar import has_stop_word, parse
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.speech import SpeechUnavailable
from lupin_runtime.voice.tokens import clean_text, tokenize
from lupin_runtime.voice.utterance import Call, Confirmation, Context, Question

if TYPE_CHECKING:
    from lupin_runtime.voice.moonshine import Moonshine
    from lupin_runtime.voice.sentence_graph import SentenceGraph

Meaning = Call | Confirmation | Question

WINDOW_S = 1.5  # in 2.5 s there were more false stops, and no more true ones
# The sound is also heard as if it was spoken slower: what is right is likely each time, and what is wrong seldom twice.
_SLOWNESSES = (1.0, 1.12, 1.25)
_MAX_LETTERS = 200  # of a command
_SENTENCES = 8  # that are found in each,
_SEARCHED = 12.0  # by how much less likely than what was heard there, as a logarithm
# Logarithms of ratios of probabilities, chosen on other sentences than those of `bench_voice`.
MAX_DOUBT = 7.0  # by which a command may be less likely than what was heard
PART_DOUBT = 0.5  # the same, if it leaves out a word that denies, or words around it
MIN_MARGIN = 0.7  # by which the command must be likelier than another one,
VALUE_MARGIN = 2.5  # and than the same one with another number or name, which sounds alike
_MAX_HALT_DOUBT = 10.0  # of a single word; "halt" had 9.7 at most, "heart" 3.9, and most words 12 to 20
_PER_TOKEN = 0.6  # so that "no" is not likelier than a sentence only because it is short

MISSING_PACKAGES = "speech recognition needs packages that are not installed; type: pip install 'lupin[voice]'"
_COMMIT = Call("calibrate_arm", {"action": "commit"})
_PACKAGES = ("onnxruntime", "moonshine_voice")  # the second is not imported: only its model is used


class Recognizer(Protocol):
    """Speech to text."""

    def transcribe(self, sound: bytes) -> str:
        """Return what was said; empty if nothing was."""

    def transcribe_window(self, sound: bytes) -> str:
        """Return roughly what was said in at most WINDOW_S of speech, in a part of the time."""

    def may_be_halt(self, word: bytes) -> bool:
        """Return whether a single word may be "halt"."""


def missing_packages() -> str:
    """Return what to type if the packages of the recognizer are missing, without importing them; empty if they are there."""
    return "" if all(importlib.util.find_spec(name) for name in _PACKAGES) else MISSING_PACKAGES


class CommandRecognizer:
    """Moonshine tiny.en, whose model is a part of the package moonshine-voice. Raises SpeechUnavailable if that is missing."""

    def __init__(self, names: Names | None = None, *, threads: int = 2) -> None:
        package = importlib.util.find_spec("moonshine_voice")
        try:
            from lupin_runtime.voice.moonshine import ENCODER, Moonshine
        except ImportError as error:
            raise SpeechUnavailable(MISSING_PACKAGES) from error
        if package is None or package.origin is None:
            raise SpeechUnavailable(MISSING_PACKAGES)
        folder = Path(package.origin).parent / "assets" / "tiny-en"
        if not (folder / ENCODER).is_file():
            raise SpeechUnavailable(f"{folder} has no model; type: pip install --force-reinstall 'lupin[voice]'")
        self._model: Moonshine = Moonshine(folder, threads=threads)
        self._names = names or Names()
        self._graph: tuple[Names, SentenceGraph] | None = None

    def expect(self, names: Names) -> None:
        """Let commands have these names from now on."""
        if names != self._names:
            self._names = names

    def transcribe(self, sound: bytes) -> str:
        """Return what was said; empty if nothing was."""
        from lupin_runtime.voice.sentence_graph import build_graph

        if not sound:
            return ""
        encoded = [self._model.encode_sound(sound, slowness) for slowness in _SLOWNESSES]
        written = [self._model.write(each, _seconds(sound) * slowness) for each, slowness in zip(encoded, _SLOWNESSES)]
        heard = [each.text for each in written]
        stops = [text for text in heard if has_stop_word(text)]
        if stops and (heard[0] in stops or len(stops) > 1):
            return stops[0]
        if stops or len(heard[0]) > _MAX_LETTERS:
            return heard[0]
        names = self._names  # which may change meanwhile
        if self._graph is None or self._graph[0] != names:
            self._graph = names, build_graph(ENGLISH, names, self._model.encode_text)
        graph = self._graph[1]
        found = [
            sentence.text
            for each, first in zip(encoded, written)
            for sentence in self._model.search(each, graph, first.log_probability - _SEARCHED, _SENTENCES)
        ]
        sentences = list(dict.fromkeys(found))
        if not sentences:
            return heard[0]
        gains = [_gains(self._model.score(each, [*sentences, *heard]), len(sentences)) for each in encoded]
        return choose(heard, dict(zip(sentences, map(statistics.fmean, zip(*gains)))), names)

    def may_be_halt(self, word: bytes) -> bool:
        """Return whether a single word may be "halt", which this model writes as "old", "all" or "piled"."""
        encoded = self._model.encode_sound(word)
        written = self._model.write(encoded, _seconds(word)).text
        [gain] = _gains(self._model.score(encoded, ["Halt.", written]), 1)
        return gain >= -_MAX_HALT_DOUBT

    def transcribe_window(self, sound: bytes) -> str:
        """Return what was said in at most WINDOW_S of speech, without a search for commands."""
        return self._model.write(self._model.encode_sound(sound), _seconds(sound)).text


def _gains(scores: Sequence[tuple[float, int]], count: int) -> list[float]:
    """Return by how much each of the first `count` texts is likelier than the likeliest of the others."""
    values = [logarithm + _PER_TOKEN * tokens for logarithm, tokens in scores]
    return [value - max(values[count:]) for value in values[:count]]


def choose(heard: Sequence[str], gains: Mapping[str, float], names: Names) -> str:
    """Return the sentence that was meant, or what was heard if none is likely enough, or two are that mean different things.

    `heard` has what was written of the sound, and of slower ones. `gains` has, by sentence, the logarithm of how much likelier
    it is than what was heard. What may confirm a read-back is never chosen: a yes, or "commit".
    """
    meanings = {sentence: parse(sentence, Context(names)) for sentence in gains}
    best = max(gains, key=gains.__getitem__)
    is_part = any(_leaves_out(best, text) for text in heard)
    max_doubt = PART_DOUBT if is_part else MAX_DOUBT
    is_clear = gains[best] >= -max_doubt and all(
        gains[best] - gains[sentence] >= _margin(meanings[best], meaning) for sentence, meaning in meanings.items()
    )
    answer = parse(best, Context(names, pending=_COMMIT))
    may_confirm = isinstance(answer, Confirmation) and answer.agrees
    return best if is_clear and not may_confirm else heard[0]


def _margin(one: Meaning, other: Meaning) -> float:
    if one == other:
        return 0.0
    has_other_value = isinstance(one, Call) and isinstance(other, Call) and one.tool == other.tool
    return VALUE_MARGIN if has_other_value else MIN_MARGIN


def _leaves_out(sentence: str, text: str) -> bool:
    """Return whether a sentence leaves out a word of a text that denies, or is only a part of the text."""
    kept, words = _words(sentence), _words(text)
    is_part = len(kept) < len(words) and any(
        words[start : start + len(kept)] == kept for start in range(len(words) - len(kept) + 1)
    )
    return is_part or bool(ENGLISH.negations.intersection(words).difference(kept))


def _words(text: str) -> list[str]:
    return [token.text for token in tokenize(clean_text(text))]


def _seconds(sound: bytes) -> float:
    return len(sound) / (SAMPLE_RATE_HZ * SAMPLE_BYTES)
