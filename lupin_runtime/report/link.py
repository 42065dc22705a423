"""What the link to the robot did in a run, from what arrived of the robot's odometry and scans, and when."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

# The robot publishes its odometry 50 times a second: a shorter silence is one of a busy computer.
OUTAGE_S = 1.0
# A delay is compared with the shortest of the last seconds: the clocks of two computers differ, and drift apart by far less.
_DELAY_WINDOW_S = 10.0
_MIN_SCANS = 20


@dataclass(frozen=True)
class Outage:
    """A time in which nothing arrived. `moved_m` is how far the robot was from its last known place when it was over."""

    from_s: float
    to_s: float
    moved_m: float | None


@dataclass(frozen=True)
class Link:
    """What a link did.

    Of the scans, which are sent only once: the share that was lost while there was a link, and how much later than the fastest
    ones all but 1 % arrived. None without enough scans.
    """

    outages: tuple[Outage, ...] = ()
    lost_share: float | None = None
    late_s: float | None = None

    @property
    def longest_s(self) -> float:
        """The length of the longest outage; 0 without one."""
        return max((outage.to_s - outage.from_s for outage in self.outages), default=0.0)


class LinkBuilder:
    """Collects what arrived from the robot, in the order of its arrival. Times `t_s` are of the arrival."""

    def __init__(self) -> None:
        self._last_s: float | None = None
        self._silences: list[tuple[float, float]] = []
        self._poses: list[tuple[float, float, float, float]] = []  # arrival s, stamp s, x m, y m
        self._scans: list[tuple[float, float]] = []  # arrival s, stamp s

    def pose(self, t_s: float, stamp_s: float, x: float, y: float) -> None:
        """Add a pose of the odometry, in meters."""
        self._arrive(t_s)
        self._poses.append((t_s, stamp_s, x, y))

    def scan(self, t_s: float, stamp_s: float) -> None:
        """Add a scan."""
        self._arrive(t_s)
        self._scans.append((t_s, stamp_s))

    def interrupt(self) -> None:
        """Note that a gap in the recording follows, such as that between two recordings."""
        self._last_s = None

    def build(self, end_s: float) -> Link:
        """Return what the link did until the end of the recording."""
        if self._last_s is not None:
            self._arrive(end_s)
        poses = np.array(self._poses, dtype=np.float64).reshape(-1, 4)
        outages = tuple(Outage(start_s, stop_s, _moved_m(poses, start_s, stop_s)) for start_s, stop_s in self._silences)
        if len(self._scans) < _MIN_SCANS:
            return Link(outages)
        return Link(outages, self._lost_share(), self._late_s())

    def _arrive(self, t_s: float) -> None:
        if self._last_s is not None and t_s - self._last_s > OUTAGE_S:
            self._silences.append((self._last_s, t_s))
        self._last_s = t_s

    def _lost_share(self) -> float:
        # Of an outage, and of a step of the robot's clock, nothing is counted.
        steps_s = [b[1] - a[1] for a, b in pairwise(self._scans) if b[0] - a[0] <= OUTAGE_S and 0.0 < b[1] - a[1] <= OUTAGE_S]
        period_s = float(np.median(steps_s)) if steps_s else OUTAGE_S
        lost = sum(round(step_s / period_s) - 1 for step_s in steps_s if step_s > period_s)
        return lost / (lost + len(self._scans))

    def _late_s(self) -> float:
        late_s: list[float] = []
        recent: deque[tuple[float, float]] = deque()
        for t_s, stamp_s in self._scans:
            recent.append((t_s, t_s - stamp_s))
            while t_s - recent[0][0] > _DELAY_WINDOW_S:
                recent.popleft()
            late_s.append(t_s - stamp_s - min(delay_s for _, delay_s in recent))
        return float(np.percentile(late_s, 99))


def _moved_m(poses: NDArray[np.float64], start_s: float, stop_s: float) -> float | None:
    """Return the distance between the places at two times, from rows of arrival, stamp, x and y.

    Odometry that the robot sent during an outage may arrive after it: so the stamps count, plus the least delay before.
    """
    recent = poses[(poses[:, 0] <= start_s) & (poses[:, 0] >= start_s - _DELAY_WINDOW_S)]
    if not len(recent):
        return None
    times_s = poses[:, 1] + np.min(recent[:, 0] - recent[:, 1])
    after = np.flatnonzero((times_s >= stop_s) & (poses[:, 0] >= stop_s))
    return float(np.hypot(*(poses[after[0], 2:] - recent[-1, 2:]))) if len(after) else None
