"""Decides whether the lidar can be trusted: if it is silent, blind or frozen, the robot must stop."""

from __future__ import annotations

from collections import deque

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import RangeScan
from lupin_runtime.scan_health import ScanHealth, ScanJudge

# A scan's delay is compared with the shortest of the last seconds, in which two clocks drift apart by far less.
_DELAY_WINDOW_S = 10.0
# A delay that changes by more than this does not mean a late scan: a clock has jumped.
_CLOCK_JUMP_S = 2.0


class LidarMonitor:
    """Judges every scan; `reason` says why the lidar cannot be trusted, or is None.

    A silent or blind lidar is distrusted after `timeout_s`, a frozen one at once, since the robot is driving on an old scan.
    A scan is blind if fewer than the share `min_usable_share` of its beams measure at least `nearest_m`.
    """

    def __init__(
        self,
        timeout_s: float = 1.0,
        nearest_m: float = 0.25,
        min_usable_share: float = 0.05,
        still_m: float = 0.1,
        still_rad: float = 0.15,
    ) -> None:
        self._timeout_s = timeout_s
        self._nearest_m = nearest_m
        self._min_usable_share = min_usable_share
        self._judge = ScanJudge(still_m, still_rad)
        self._last_stamp_ns: int | None = None
        self._good_s: float | None = None
        self._problem = "no scan has arrived yet"
        self._frozen = False
        self._delays_s: deque[tuple[float, float]] = deque()
        self._late_s = 0.0

    def accept(self, scan: RangeScan, odom_from_base: Pose2, now_s: float) -> bool:
        """Judge a scan and return whether the costmaps may use it."""
        if scan.stamp_ns == self._last_stamp_ns:
            self._problem = "the scan's stamp does not change"
            return False
        self._last_stamp_ns = scan.stamp_ns
        self._note_delay(now_s - scan.stamp_ns * 1e-9, now_s)
        ranges = scan.ranges_m
        low = max(self._nearest_m, scan.range_min_m)
        usable = int(np.count_nonzero((ranges >= low) & (ranges <= min(scan.range_max_m, 1e6))))
        enough = usable >= self._min_usable_share * max(len(ranges), 1)
        health = self._judge.judge(ranges, enough, odom_from_base)
        if health is ScanHealth.BLIND:
            self._problem = f"only {usable} of {len(ranges)} beams measure {low:.2f} m or more"
            return False
        if health is ScanHealth.FROZEN:
            self._problem = "the scans repeat while the robot moves: the lidar is frozen"
            self._frozen = True
            return False
        if health is ScanHealth.GOOD:
            self._frozen = False
        self._good_s = now_s
        return True

    def _note_delay(self, delay_s: float, now_s: float) -> None:
        """Note how late a scan is, relative to the least delayed one, since the two clocks need not agree."""
        delays = self._delays_s
        if delays and abs(delay_s - delays[-1][1]) > _CLOCK_JUMP_S:
            delays.clear()
        delays.append((now_s, delay_s))
        while now_s - delays[0][0] > _DELAY_WINDOW_S:
            delays.popleft()
        self._late_s = delay_s - min(delay for _, delay in delays)

    def age_s(self, now_s: float) -> float:
        """Return the age of the last good scan: the time since it was accepted, plus its delay."""
        return 0.0 if self._good_s is None else now_s - self._good_s + self._late_s

    def reason(self, now_s: float) -> str | None:
        """Return why the lidar cannot be trusted, or None."""
        if self._frozen or self._good_s is None:
            return self._problem
        age_s = now_s - self._good_s
        if age_s <= self._timeout_s:
            return None
        return f"no usable scan for {age_s:.1f} s ({self._problem})"

    def refuse(self, problem: str) -> None:
        """Note why a scan cannot be used: as long as none can, the lidar is not trusted."""
        self._problem = problem

    def note_silence(self) -> None:
        """Note that no scan arrived."""
        self._problem = "no message arrives on /scan"
