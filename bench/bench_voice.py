"""Offline voice on synthetic speech: commands that are understood, motions that nobody asked for, and stops that are spotted.

The speech is espeak-ng's, in three voices with two noises: it says how the parts work together, not how well a person is
understood in a greenhouse. Limits: 90 % of 60 commands, no motion from 60 other sentences, no other motion than was said; a
spoken stop is spotted within 700 ms after the end of its word (p95), and at most one stop an hour is spotted in other speech;
listening to silence takes at most 1 % of a core. A sentence that is asked whether it was meant counts as understood if it was,
and a motion that is read back as one that waits for a yes.

Needs the extra lupin[voice] and espeak-ng.
"""

from __future__ import annotations

import functools
import itertools
import random
import re
import statistics
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bench.runner import Figures, benchmark, note
from lupin_runtime.voice.endpointer import (
    BEFORE_MS,
    FRAME_BYTES,
    FRAME_MS,
    SAMPLE_RATE_HZ,
    Edge,
    Endpointer,
    EndpointerSettings,
    split_frames,
)
from lupin_runtime.voice.grammar import has_stop_word, parse
from lupin_runtime.voice.recognizer import CommandRecognizer
from lupin_runtime.voice.speech import Speaker, SpeechUnavailable
from lupin_runtime.voice.spotting_endpointer import MAX_WORD_MS, WORD_PAUSE_MS, SpottingEndpointer
from lupin_runtime.voice.stop_spotter import AGREEING_WINDOWS, HALT, STEP_S, StopSpotter
from lupin_runtime.voice.tools import BY_NAME, Effect
from lupin_runtime.voice.utterance import Call, Question
from tests.support.paths import ROOT
from tests.support.spoken_commands import COMMANDS, CONTEXT, NAMES, NO_MOTION

VOICES = (("en-gb", 160), ("en-us+f3", 150), ("en-gb-scotland", 145))  # with words per minute
NOISES = ("white", "hum")
SPEECH_LEVEL = 0.1
NOISE_LEVEL = 0.006  # 24 dB below the speech
LEAD_S, TAIL_S = 0.4, 1.2
SILENCE_S = 40.0
MIN_UNDERSTOOD = 0.9
MAX_STOP_MS = 700.0
MAX_IDLE_SHARE = 0.01
# What is said before, the word that stops, and what is said after.
STOPS = (
    ("", "stop", ""), ("", "halt", ""), ("", "stop robot", ""), ("please", "stop", "the robot"), ("", "stop", "stop stop"),
    ("go to the sink no", "stop", ""), ("drive forward two metres and then", "stop", "at the door"),
)  # fmt: skip
# Words that sound like one that stops.
ALIKE = (
    "the shop is on top of the step", "drop the stock", "start the clock", "hold it", "help", "a lot of hops",
    "we need to knit",
)  # fmt: skip

Samples = NDArray[np.float64]


class Voices:
    """Speaks in three voices, with noise."""

    def __init__(self, seed: int) -> None:
        self._speakers = [Speaker(voice, words_per_minute) for voice, words_per_minute in VOICES]
        self._random = np.random.default_rng(seed)

    def say(self, voice: int, text: str) -> Samples:
        """Return the sound of a text at the level of speech, without the silence around it."""
        samples = np.frombuffer(self._speakers[voice].synthesize(text), "<i2") / 32768.0
        loud = np.flatnonzero(np.abs(samples) > 0.01)
        samples = samples[loud[0] : loud[-1] + 1]
        scaled: Samples = samples * (SPEECH_LEVEL / np.sqrt(np.mean(samples**2)))
        return scaled

    def noise(self, kind: str, count: int) -> Samples:
        """Return white noise, or the hum of a fan: low frequencies, with a tone of 100 Hz."""
        samples = self._random.normal(size=count)
        if kind == "hum":
            spectrum = np.fft.rfft(samples) / np.maximum(1.0, np.arange(count // 2 + 1) * SAMPLE_RATE_HZ / max(count, 1) / 50.0)
            tone = np.sin(2 * np.pi * 100 * np.arange(count) / SAMPLE_RATE_HZ)
            samples = np.fft.irfft(spectrum, count)
            samples = samples / np.sqrt(np.mean(samples**2)) + tone
        scaled: Samples = samples * (NOISE_LEVEL / np.sqrt(np.mean(samples**2)))
        return scaled

    def scene(self, kind: str, *parts: Samples) -> bytes:
        """Return the parts one after the other, in noise that begins before and ends after them."""
        speech = np.concatenate([np.zeros(int(LEAD_S * SAMPLE_RATE_HZ)), *parts, np.zeros(int(TAIL_S * SAMPLE_RATE_HZ))])
        return pcm(speech + self.noise(kind, len(speech)))


def pcm(samples: Samples) -> bytes:
    """Return samples as PCM-16."""
    return bytes(np.clip(np.rint(samples * 32768.0), -32768, 32767).astype("<i2").tobytes())


def utterances(sound: bytes) -> Iterator[bytes]:
    """Yield what the endpointer takes for utterances."""
    endpointer = Endpointer()
    for frame in split_frames(sound):
        if endpointer.push(frame) is Edge.END:
            yield endpointer.utterance
    if endpointer.is_speaking:
        yield endpointer.utterance


def measure_sentences(voices: Voices, recognizer: CommandRecognizer, share: float) -> dict[str, Any]:
    """Speak the commands and the other sentences, and count what comes of them."""
    draw = random.Random(1)
    outcomes: dict[str, Counter[str]] = {"commands": Counter(), "others": Counter()}
    wrong: list[str] = []
    cpu_s: list[float] = []
    # A question mark and quotes are not spoken.
    spoken = [text for text in (*COMMANDS, *NO_MOTION) if not set(text) & set('?"')]
    for text, voice, noise in itertools.product(spoken, range(len(VOICES)), NOISES):
        if draw.random() >= share:
            continue
        began = time.process_time()
        heard = " ".join(recognizer.transcribe(sound) for sound in utterances(voices.scene(noise, voices.say(voice, text))))
        cpu_s.append(time.process_time() - began)
        result = parse(heard.removesuffix("."), CONTEXT)
        expected = Call(*COMMANDS[text]) if text in COMMANDS else None
        meant = result.meant if isinstance(result, Question) else None
        if result == expected:
            outcome = "right"
        elif meant is not None:
            outcome = "right after a yes" if meant == expected else "waits for a yes"
        elif isinstance(result, Call) and BY_NAME[result.tool].sentence(result.arguments):
            outcome = "waits for a yes"  # read back in any case
        elif isinstance(result, Call):
            outcome = "wrong motion" if BY_NAME[result.tool].effect is Effect.MOTION else "other call"
        else:
            outcome = "asked again"
        if outcome not in ("right", "right after a yes") and (expected is not None or outcome != "asked again"):
            wrong.append(f"{outcome}, {VOICES[voice][0]}, {noise}: {text!r} was heard as {heard!r}")
            note(wrong[-1])
        outcomes["commands" if expected is not None else "others"][outcome] += 1
    commands = outcomes["commands"]
    return {
        "understood": round((commands["right"] + commands["right after a yes"]) / max(1, commands.total()), 4),
        "commands": dict(commands),
        "others": dict(outcomes["others"]),
        "cpu_s_median": round(statistics.median(cpu_s), 2),
        "not_right": wrong,
    }


def measure_stops(voices: Voices, recognizer: CommandRecognizer, repeats: int) -> dict[str, Any]:
    """Say stops in real time, and measure from the end of the word to the call of the spotter."""
    delays_ms: list[float] = []
    missed: list[str] = []
    for (before, word, after), voice, noise in itertools.product(STOPS * repeats, range(len(VOICES)), NOISES):
        parts = [voices.say(voice, text) for text in (before, word, after) if text]
        lead = LEAD_S + sum(len(part) for part in (parts[:2] if before else parts[:1])) / SAMPLE_RATE_HZ
        spotted_s = play(voices.scene(noise, *parts), recognizer)
        if spotted_s is None:
            missed.append(f"{VOICES[voice][0]}, {noise}: {before} {word} {after}".strip())
        else:
            delays_ms.append((spotted_s - lead) * 1e3)
    return {
        "stops": len(delays_ms) + len(missed),
        "missed": missed,
        "median_ms": round(statistics.median(delays_ms)),
        "p95_ms": round(float(np.percentile(delays_ms, 95))),
        "max_ms": round(max(delays_ms)),
    }


def measure_silence(voices: Voices, recognizer: CommandRecognizer, seconds: float) -> dict[str, float]:
    """Listen to noise at the pace of a microphone, and measure the share of a core that it takes."""
    sounds = [pcm(voices.noise(noise, int(seconds / len(NOISES) * SAMPLE_RATE_HZ))) for noise in NOISES]
    began_s, began = time.process_time(), time.monotonic()
    for sound in sounds:
        play(sound, recognizer)
    return {"core_share": round((time.process_time() - began_s) / (time.monotonic() - began), 4)}


def play(sound: bytes, recognizer: CommandRecognizer) -> float | None:
    """Give a sound to the spotter at the pace of a microphone; return when it stopped, in s from the beginning of the sound."""
    spotted = threading.Event()
    at_s: list[float] = []
    began = time.monotonic()

    def note(_text: str, _utterance: int) -> None:
        at_s.append(time.monotonic() - began)
        spotted.set()

    endpointer = SpottingEndpointer(recognizer, note)
    for index, frame in enumerate(split_frames(sound), 1):
        time.sleep(max(0.0, began + index * FRAME_MS / 1e3 - time.monotonic()))
        endpointer.push(frame)
    endpointer.close()
    return at_s[0] if at_s else None


def other_speech(seed: int) -> Iterator[str]:
    """Yield sentences without a word that stops, in random order and without end: talk, commands, and this project's pages."""
    prose = " ".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "docs").glob("*.md")))
    lines = re.findall(r"(?:^|(?<=[.:] ))[A-Z][a-z ,']{30,140}[.:]", prose, re.MULTILINE)
    sentences = [text for text in (*lines, *COMMANDS, *NO_MOTION, *ALIKE) if "stop" not in text.lower()]
    draw = random.Random(seed)
    while True:
        yield draw.choice(sentences)


def measure_false_stops(voices: Voices, recognizer: CommandRecognizer, minutes: float) -> dict[str, Any]:
    """Recognize other speech in the windows of the spotter, but not in real time, and count the stops."""
    total_s = 0.0
    false_stops: list[str] = []
    texts = other_speech(3)
    for index in itertools.count():
        if total_s >= minutes * 60:
            break
        text = next(texts)
        sound = voices.scene(NOISES[index % len(NOISES)], voices.say(index % len(VOICES), text))
        total_s += len(sound) / 2 / SAMPLE_RATE_HZ
        for heard in filter(None, (spot(each, recognizer) for each in utterances(sound))):
            false_stops.append(f"{text!r} was heard as {heard!r}")
            note(f"false stop after {total_s / 60:.1f} min: {false_stops[-1]}")
    return {
        "minutes": round(total_s / 60, 1),
        "false_stops": len(false_stops),
        "false_stops_an_hour": round(len(false_stops) / total_s * 3600, 2),
        "heard": false_stops,
    }


def spot(utterance: bytes, recognizer: CommandRecognizer) -> str:
    """Return what the spotter would hear as a stop in an utterance; empty if nothing.

    Of AGREEING_WINDOWS in a row, one has a number that is divisible by that: only around those that hear a stop, all are heard.
    """
    pause_ms = EndpointerSettings().end_hold_ms
    if len(utterance) // FRAME_BYTES * FRAME_MS - BEFORE_MS - pause_ms <= MAX_WORD_MS:
        word = utterance[: len(utterance) - (pause_ms - WORD_PAUSE_MS) // FRAME_MS * FRAME_BYTES]
        if recognizer.may_be_halt(word):
            return HALT
    step = int(STEP_S * SAMPLE_RATE_HZ) * 2
    count = len(utterance) // step

    @functools.cache
    def heard(number: int) -> str:
        text = recognizer.transcribe_window(StopSpotter.window(utterance[: number * step]))
        return text if has_stop_word(text) else ""

    for middle in range(AGREEING_WINDOWS, count + 1, AGREEING_WINDOWS):
        if heard(middle):
            first = last = middle
            while first > 1 and heard(first - 1):
                first -= 1
            while last < count and heard(last + 1):
                last += 1
            if last - first + 1 >= AGREEING_WINDOWS:
                return heard(middle)
    return ""


@benchmark(
    at_least={"sentences.understood": MIN_UNDERSTOOD},
    at_most={
        "wrong motion": 0,
        "silence.core_share": MAX_IDLE_SHARE,
        "stops.p95_ms": MAX_STOP_MS,
        "stops.missed_count": 0,
        "false_stops_an_hour": 1.0,
    },
    long=True,
)
def main(
    only: Annotated[str, "measure only this", ("", "sentences", "silence", "stops", "false-stops")] = "",
    share: Annotated[float, "share of the sentences that are spoken"] = 1.0,
    repeats: Annotated[int, "how often each stop is said"] = 2,
    minutes: Annotated[float, "length of the other speech"] = 60.0,
    threads: Annotated[int, "threads of the recognizer"] = 2,
) -> Figures:
    """Measure the parts."""
    try:
        voices = Voices(1)
        recognizer = CommandRecognizer(NAMES, threads=threads)
    except SpeechUnavailable as error:
        sys.exit(str(error))
    results: dict[str, Any] = {"speech": "synthetic, by espeak-ng"}
    if only in ("", "sentences"):
        results["sentences"] = found = measure_sentences(voices, recognizer, share)
        for group in ("commands", "others"):
            found[group].setdefault("wrong motion", 0)
    if only in ("", "silence"):
        results["silence"] = measure_silence(voices, recognizer, SILENCE_S)
    if only in ("", "stops"):
        results["stops"] = found = measure_stops(voices, recognizer, repeats)
        found["missed_count"] = len(found["missed"])
    if only in ("", "false-stops"):
        results["false_stops"] = measure_false_stops(voices, recognizer, minutes)
    return results


if __name__ == "__main__":
    sys.exit(main())
