"""A listener whose recognizer knows sounds by their loudest sample; as a program, it is the console's real listener otherwise.

`sound_of(word)` is a frame that it takes for one of SOUNDS. It hangs on "hang".
"""

from __future__ import annotations

import sys
import threading

from lupin_runtime.voice.endpointer import FRAME_BYTES
from lupin_runtime.voice.listener import run
from lupin_runtime.voice.slots import Names

COMMAND = (sys.executable, "-m", "tests.support.fake_listener")
SPOKEN_DRIVE = "drive forward for one second at 0.2 metres per second"
SOUNDS = {
    "stop": 16_000,
    "hang": 15_000,
    "what is the battery": 14_000,
    "yes": 12_000,
    SPOKEN_DRIVE: 11_000,
    "hold": 10_000,  # a "halt", which the spotter's windows do not show
}
SILENCE = bytes(FRAME_BYTES)


def sound_of(text: str) -> bytes:
    """Return a frame of a sound."""
    return SOUNDS[text].to_bytes(2, "little") * (FRAME_BYTES // 2)


class LoudnessRecognizer:
    """Knows sounds by their loudest sample."""

    names = Names()

    def expect(self, names: Names) -> None:
        """Note the names that commands may have."""
        self.names = names

    def transcribe(self, sound: bytes) -> str:
        """Return what was said."""
        text = self._find(sound)
        return "halt" if text == "hold" else text

    def transcribe_window(self, sound: bytes) -> str:
        """Return what was said in the newest seconds."""
        return self._find(sound)

    def may_be_halt(self, word: bytes) -> bool:
        """Return whether a word is "halt": none is, here."""
        return not word

    def _find(self, sound: bytes) -> str:
        loudest = max(memoryview(sound).cast("h"), default=0)
        text = next((text for text, level in SOUNDS.items() if level == loudest), "")
        if text == "hang":
            threading.Event().wait()
        return text


if __name__ == "__main__":
    run(LoudnessRecognizer, sys.stdin.buffer, sys.stdout.buffer)
