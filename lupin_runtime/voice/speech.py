"""Text to speech by espeak-ng, which works without a network. Sound is that of `endpointer.py`: 16 kHz mono PCM-16."""

from __future__ import annotations

import re
import shutil
import subprocess

from lupin_runtime.voice.sounds import read_wav

DEFAULT_VOICE = "en-gb"
DEFAULT_WORDS_PER_MINUTE = 165
_SPEAK_TIMEOUT_S = 60.0
_ESPEAK_MARKUP = re.compile(r"[<>\[\]]")

MISSING_ESPEAK = "speech output needs espeak-ng, which is not installed; type: sudo apt install espeak-ng"


class SpeechUnavailable(RuntimeError):
    """Speech cannot be recognized, recorded or spoken on this computer; the text says what to type."""


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
