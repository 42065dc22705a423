"""Finds where speech begins and ends in the sound of a microphone, by its level.

Sound is 16 kHz mono PCM-16, little-endian, in frames of 50 ms. Levels are the root mean square of a frame; 1 is full scale.
"""

from __future__ import annotations

import array
import enum
import math
import sys
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

SAMPLE_RATE_HZ = 16_000
SAMPLE_BYTES = 2
FRAME_MS = 50
FRAME_BYTES = SAMPLE_RATE_HZ * FRAME_MS // 1000 * SAMPLE_BYTES
_FULL_SCALE = 32768.0
BEFORE_MS = 250  # kept before the first loud frame: an "s" or "f" is soft


@dataclass(frozen=True)
class EndpointerSettings:
    """The thresholds; the defaults are those of the page's settings voiceVad*.

    Speech begins with a frame above `start_level`. It ends once no frame has been above `end_level` for `end_hold_ms`, or after
    `max_utterance_ms`.
    """

    start_level: float = 0.02
    end_level: float = 0.012
    end_hold_ms: int = 800
    max_utterance_ms: int = 15_000


class Edge(enum.Enum):
    """What a frame brings about."""

    BEGIN = "begin"
    END = "end"


class Endpointer:
    """Follows the sound frame by frame."""

    def __init__(self, settings: EndpointerSettings | None = None) -> None:
        self._settings = settings or EndpointerSettings()
        self._before: deque[bytes] = deque(maxlen=BEFORE_MS // FRAME_MS)
        self._frames: list[bytes] = []
        self._speech_ms = 0
        self.is_speaking = False
        self.quiet_ms = 0  # since the last loud frame of the utterance

    @property
    def utterance(self) -> bytes:
        """The sound of the present utterance, or of the last one, with a little of what was before it."""
        return b"".join(self._frames)

    def push(self, frame: bytes) -> Edge | None:
        """Take the next frame, and return the edge that it is, if any."""
        level = rms(frame)
        if not self.is_speaking:
            if level <= self._settings.start_level:
                self._before.append(frame)
                return None
            self._frames = [*self._before, frame]
            self._before.clear()
            self.is_speaking, self.quiet_ms, self._speech_ms = True, 0, FRAME_MS
            return Edge.BEGIN
        self._frames.append(frame)
        self._speech_ms += FRAME_MS
        self.quiet_ms = self.quiet_ms + FRAME_MS if level <= self._settings.end_level else 0
        if self.quiet_ms < self._settings.end_hold_ms and self._speech_ms < self._settings.max_utterance_ms:
            return None
        self.is_speaking = False
        return Edge.END


def rms(frame: bytes) -> float:
    """Return the level of a frame, 0 to 1; 0 of an empty one."""
    samples = array.array("h", frame[: len(frame) // SAMPLE_BYTES * SAMPLE_BYTES])
    if sys.byteorder == "big":
        samples.byteswap()
    return math.sqrt(sum(sample * sample for sample in samples) / len(samples)) / _FULL_SCALE if samples else 0.0


def split_frames(sound: bytes) -> Iterator[bytes]:
    """Yield the frames of a sound; the last one is filled with silence."""
    for start in range(0, len(sound), FRAME_BYTES):
        yield sound[start : start + FRAME_BYTES].ljust(FRAME_BYTES, b"\0")
