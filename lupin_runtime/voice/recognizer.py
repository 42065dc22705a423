"""Speech to text for commands: what was said, or the command that it was meant to be, if that is nearly as likely.

A small recognizer writes "Calibrations targets" where "calibration status" was said. Among the sentences that the grammar
knows it finds the right one, and tells by how much that is less likely than what it wrote. What is no command is far less
likely to be any of them: it stays as it was written, and is asked again.
"""

from __future__ import annotations

import importlib.util
import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from lupin_runtime.voice.endpointer import SAMPLE_BYTES, SAMPLE_RATE_HZ
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.grammar import has_stop_word, is_doubtful_stop, may_be_asked, parse
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.speech import SpeechUnavailable
from lupin_runtime.voice.tokens import clean_text, tokenize
from lupin_runtime.voice.tools import BY_NAME
from lupin_runtime.voice.usual_numbers import rate_numbers
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
ACTING_DOUBT = 4.0  # the same, if it acts without a yes
ASKED_DOUBT = 9.0  # the same, if it is asked whether it was meant
PART_DOUBT = 0.5  # the same, if it leaves out a word that denies, or words around it
MIN_MARGIN = 0.7  # by which the command must be likelier than another one,
VALUE_MARGIN = 2.5  # and than the same one with another number or name, which sounds alike
# Of a single word that may be "halt", in seven voices: halt had 9.7 at most, heart 3.1 to 11, and most words 12 to 20.
_MAX_HALT_DOUBT = 10.0
_HALT_RIVAL = "Help."  # by which halt was likelier or, at worst, 1.5 less likely; of help itself it was 3.8 to 8.3 less likely
_MAX_RIVAL_MARGIN = 2.5
_PER_TOKEN = 0.6  # so that "no" is not likelier than a sentence only because it is short

MISSING_PACKAGES = "speech recognition needs packages that are not installed; type: pip install 'lupin[voice]'"
_SPEED_CAP = 0.5  # with which "slower" and "faster" are commands
_COMMIT = Call("calibrate_arm", {"action": "commit"})
_NAMING_TOOLS = ("save_named_location", "arm_save_pose", "arm_record")
_MOTION = Call("rotate", {"angle_deg": 90.0})  # as another call that is read back
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
        names = self._names  # which may change meanwhile
        if stops or may_confirm(heard[0], names):
            return agreed_answer(heard, names)
        if len(heard[0]) > _MAX_LETTERS:
            return heard[0]
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
            return choose(dict.fromkeys(heard, 0.0), {}, names)
        texts = [*sentences, *heard]
        gains = [_gains(self._model.score(each, texts), len(sentences)) for each in encoded]
        means = list(map(statistics.fmean, zip(*gains)))
        return choose(dict(zip(heard, means[len(sentences) :])), dict(zip(sentences, means)), names)

    def may_be_halt(self, word: bytes) -> bool:
        """Return whether a single word may be "halt", which this model writes as "old", "all" or "piled"."""
        encoded = self._model.encode_sound(word)
        written = self._model.write(encoded, _seconds(word)).text
        halt, rival = _gains(self._model.score(encoded, ["Halt.", _HALT_RIVAL, written]), 2)[:2]
        return halt >= -_MAX_HALT_DOUBT and halt >= rival - _MAX_RIVAL_MARGIN

    def transcribe_window(self, sound: bytes) -> str:
        """Return what was said in at most WINDOW_S of speech, without a search for commands.

        It is empty if a stop in it is doubtful, and not clear either as the sound is heard slower.
        """
        text = self._write(sound)
        if not is_doubtful_stop(text):
            return text
        slower = self._write(sound, _SLOWNESSES[1])
        return text if has_stop_word(slower) and not is_doubtful_stop(slower) else ""

    def _write(self, sound: bytes, slowness: float = 1.0) -> str:
        return self._model.write(self._model.encode_sound(sound, slowness), _seconds(sound) * slowness).text


def _gains(scores: Sequence[tuple[float, int]], count: int) -> list[float]:
    """Return by how much each text is likelier than the likeliest of those after the first `count`."""
    values = [logarithm + _PER_TOKEN * tokens for logarithm, tokens in scores]
    return [value - max(values[count:]) for value in values]


def choose(heard: Mapping[str, float], gains: Mapping[str, float], names: Names) -> str:
    """Return the sentence that was meant; with a question mark, if it only may have been, so that it is read back.

    `heard` has what was written of the sound, and then of slower ones. `gains` has the sentences of the grammar. Both have the
    logarithm of how much likelier a text is than the likeliest that was written. What was written counts as it is, if no
    sentence is likely enough. What may confirm a read-back is never chosen: a yes, or "commit".
    """
    written, meanings = next(iter(heard)), {text: _meaning(text, names) for text in heard}
    meanings |= {text: _meaning(text.rstrip("?"), names) for text in gains}

    def is_clear(text: str, gain: float, rivals: Mapping[str, float]) -> bool:
        others = [(meanings[rival], other) for rival, other in rivals.items() if meanings[rival] != meanings[text]]
        return all(gain - other >= _margin(meanings[text], meaning) for meaning, other in others)

    best = max(gains, key=gains.__getitem__, default=written)
    commands = {
        text: gain
        for text, gain in heard.items()
        if not isinstance(meanings[text], Question) and not _differ_by_new_name(meanings[text], meanings[best])
    }
    readings = {**commands, **gains}
    if best in gains and not may_confirm(best.rstrip("?"), names):
        max_doubt = PART_DOUBT if _leaves_out(best, heard) else _max_doubt(meanings[best])
        if gains[best] >= -max_doubt and is_clear(best, gains[best], readings):
            return _question(best) if "?" in written and may_be_asked(meanings[best]) else best
    if written in commands and not _leaves_out(written, heard):
        # It counts if the likeliest sentence means the same, or it is clearly likelier than all that mean something else.
        rivals = commands if meanings[written] == meanings[best] else readings
        if is_clear(written, heard[written], rivals):
            return written
    supposed = _supposed(written, commands, gains, meanings)
    if supposed and not _leaves_out(supposed, [written]):
        is_other_name = _differ_by_new_name(meanings[written], meanings[supposed])
        return written if is_other_name and gains.get(supposed, 0.0) < -MAX_DOUBT else _question(supposed)
    return _unclear((*commands, best), names) if written in commands else written


def _max_doubt(meaning: Meaning) -> float:
    """Return by how much a command may be less likely than what was heard: less if it changes something without a yes."""
    if not isinstance(meaning, Call):
        return MAX_DOUBT if isinstance(meaning, Question) else ACTING_DOUBT  # "cancel" may discard a recording
    tool = BY_NAME[meaning.tool]
    is_read_back = bool(tool.read_back.get(meaning.arguments.get("action", "")))
    return MAX_DOUBT if is_read_back or not may_be_asked(meaning) else ACTING_DOUBT


def _supposed(written: str, commands: Mapping[str, float], gains: Mapping[str, float], meanings: Mapping[str, Meaning]) -> str:
    """Return the likeliest reading, if a question mark keeps it from acting; else nothing. Usual numbers count for more.

    A no that was not written is no rival: it is so short that it is near to everything.
    """
    readings = {**commands, **gains}
    if written in readings and not may_be_asked(meanings[written]):
        return ""
    ratings = {
        text: gain + rate_numbers(meaning)
        for text, gain in readings.items()
        if isinstance(meaning := meanings[text], Call) and may_be_asked(meaning)
    }
    likeliest = max(ratings, key=ratings.__getitem__, default=written)
    others = readings.keys() - ratings.keys()
    rivals = [readings[text] for text in others if text in commands or meanings[text] != Confirmation(False)]
    is_likely = likeliest in ratings and readings[likeliest] >= max([-ASKED_DOUBT, *rivals])
    return likeliest if is_likely else ""


def _question(text: str) -> str:
    return f"{text.rstrip(' .!?')}?"


def agreed_answer(heard: Sequence[str], names: Names) -> str:
    """Return what was written of a sound if it is a yes, and so are the slower ones; else what is asked again, or a no.

    A command is asked again, too: one of the slower sounds has a word for stopping.
    """
    meaning = _meaning(heard[0], names)
    if meaning == Confirmation(False) or (isinstance(meaning, Question) and meaning.meant is None):
        return heard[0]
    answers = {tuple(_agrees(text, names)) for text in heard}
    return heard[0] if may_confirm(heard[0], names) and len(answers) == 1 else _unclear(heard, names)


def may_confirm(text: str, names: Names) -> bool:
    """Return whether a text confirms a call that was read back."""
    return any(_agrees(text, names))


def _agrees(text: str, names: Names) -> list[bool]:
    """Return whether a text confirms a motion, and whether it confirms new offsets."""
    answers = [parse(text, Context(names, pending=call)) for call in (_MOTION, _COMMIT)]
    return [isinstance(answer, Confirmation) and answer.agrees for answer in answers]


def _meaning(text: str, names: Names) -> Meaning:
    said = text.rstrip(" .!")  # which a text to speak would have
    answer = parse(said, Context(names, pending=_MOTION))
    return answer if isinstance(answer, Confirmation) else parse(said, Context(names, speed_cap=_SPEED_CAP))


def _unclear(texts: Iterable[str], names: Names) -> str:
    """Return a text that shows what was heard, and is asked again: as a question, it is no command and no yes."""
    text = " or ".join(dict.fromkeys(each.strip(" .,!?") for each in texts)) + "?"
    contexts = (Context(names), Context(names, pending=_MOTION), Context(names, pending=_COMMIT))
    results = [parse(text, context) for context in contexts]
    return text if all(isinstance(result, Question) and result.meant is None for result in results) else ""


def _margin(one: Meaning, other: Meaning) -> float:
    """Return by how much one of two different meanings must be likelier."""
    has_other_value = isinstance(one, Call) and isinstance(other, Call) and one.tool == other.tool
    return VALUE_MARGIN if has_other_value else MIN_MARGIN


def _differ_by_new_name(one: Meaning, other: Meaning) -> bool:
    """Return whether two commands give different new names: any text is one, and the sentences have only the usual ones."""
    if not (isinstance(one, Call) and isinstance(other, Call) and one.tool == other.tool in _NAMING_TOOLS):
        return False
    return one != other and {**one.arguments, "name": ""} == {**other.arguments, "name": ""}


def _leaves_out(sentence: str, heard: Iterable[str]) -> bool:
    """Return whether a sentence leaves out a word that denies of a text that was heard, or is only a part of one."""
    return any(_leaves_out_of(_words(sentence), _words(text)) for text in heard)


def _leaves_out_of(kept: list[str], words: list[str]) -> bool:
    is_part = len(kept) < len(words) and any(
        words[start : start + len(kept)] == kept for start in range(len(words) - len(kept) + 1)
    )
    return is_part or bool(ENGLISH.negations.intersection(words).difference(kept))


def _words(text: str) -> list[str]:
    return [token.text for token in tokenize(clean_text(text))]


def _seconds(sound: bytes) -> float:
    return len(sound) / (SAMPLE_RATE_HZ * SAMPLE_BYTES)
