"""Provides a camera's newest frame to any number of waiting threads."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Frame:
    """An image. `stamp_ns` is the ROS time when the camera took it; `number` counts the stream's frames."""

    data: bytes  # a JPEG file, or a serialized message with an image
    stamp_ns: int
    number: int


class NewestFrame:
    """Keeps one frame. A reader that is slower than the camera gets the newest one and skips those in between."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._frame: Frame | None = None
        self._number = 0
        self._closed = False

    def put(self, data: bytes, stamp_ns: int = 0) -> None:
        """Replace the frame."""
        with self._changed:
            self._number += 1
            self._frame = Frame(data, stamp_ns, self._number)
            self._changed.notify_all()

    def close(self) -> None:
        """Wake all waiting threads; no more frames follow."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def number(self) -> int:
        """The number of the newest frame; 0 before the first."""
        return self._number

    def after(self, number: int, timeout_s: float) -> Frame | None:
        """Wait for a frame after `number`, and return the newest; None after the timeout, or if it is closed."""
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while self._frame is None or self._frame.number <= number:
                remaining_s = deadline_s - time.monotonic()
                if self._closed or remaining_s <= 0 or not self._changed.wait(remaining_s):
                    return None
            return self._frame
