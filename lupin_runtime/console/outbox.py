"""The bounded queue of frames for one client.

A client that reads slowly must not slow others down or fill the memory. Of a sensor's samples only the newest few are kept.
State and answers are never dropped, because a client could not know that it missed one; a client that reads them too slowly is
disconnected instead, and gets the latest state when it connects again.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from dataclasses import dataclass

MAX_BYTES = 4_000_000  # of frames that may not be dropped
MAX_SAMPLE_BYTES = 3_000_000  # of sensor samples on all topics
SAMPLES_PER_TOPIC = 4


@dataclass(frozen=True)
class Frame:
    """One WebSocket message. `stream` is the topic of a sample that may be dropped; empty for all other frames."""

    data: bytes
    binary: bool = False
    stream: str = ""
    depth: int = SAMPLES_PER_TOPIC


class Outbox:
    """Frames in sending order. Not thread-safe: used on the event loop only."""

    def __init__(self) -> None:
        self._frames: OrderedDict[int, Frame] = OrderedDict()
        self._streams: dict[str, deque[int]] = {}  # the numbers of each stream's waiting frames
        self._next = 0
        self._bytes = 0
        self._sample_bytes = 0
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def overflowed(self) -> bool:
        """Whether frames that may not be dropped exceed their limit, so that the client must be disconnected."""
        return self._bytes > MAX_BYTES

    @property
    def waiting_bytes(self) -> int:
        """Bytes of all waiting frames."""
        return self._bytes + self._sample_bytes

    def put(self, frame: Frame) -> None:
        """Append a frame, dropping the oldest samples if there are too many. The newest sample is always kept."""
        number, self._next = self._next, self._next + 1
        if frame.stream:
            while len(self._streams.get(frame.stream, ())) >= max(1, frame.depth):
                self._remove(self._streams[frame.stream][0])
                self.dropped += 1
            while self._streams and self._sample_bytes + len(frame.data) > MAX_SAMPLE_BYTES:
                self._remove(min(numbers[0] for numbers in self._streams.values()))
                self.dropped += 1
            self._streams.setdefault(frame.stream, deque()).append(number)
            self._sample_bytes += len(frame.data)
        else:
            self._bytes += len(frame.data)
        self._frames[number] = frame

    def take(self) -> Frame | None:
        """Remove and return the next frame; None if none is waiting."""
        return self._remove(next(iter(self._frames))) if self._frames else None

    def _remove(self, number: int) -> Frame:
        frame = self._frames.pop(number)
        if not frame.stream:
            self._bytes -= len(frame.data)
            return frame
        numbers = self._streams[frame.stream]
        numbers.popleft()
        if not numbers:
            del self._streams[frame.stream]
        self._sample_bytes -= len(frame.data)
        return frame
