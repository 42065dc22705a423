"""Hands the newest frame of a camera to any number of threads that wait for it."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Frame:
    """A picture. `stamp_ns` is when the camera took it, in ROS time; `number` counts up within its stream."""

    data: bytes  # a JPEG file, or a serialized message with one
    stamp_ns: int
    number: int


class NewestFrame:
    """Keeps one frame. A reader that is slower than the camera gets the newest and skips those between."""

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
        """Wake all who wait; no frame follows."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def number(self) -> int:
        """The number of the newest frame; 0 before the first."""
        return self._number

    def after(self, number: int, timeout_s: float) -> Frame | None:
        """The newest frame, once there is one of a higher number; None where none comes in time or no more will."""
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while self._frame is None or self._frame.number <= number:
                remaining_s = deadline_s - time.monotonic()
                if self._closed or remaining_s <= 0 or not self._changed.wait(remaining_s):
                    return None
            return self._frame
