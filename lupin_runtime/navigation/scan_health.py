"""Whether a lidar can be trusted: one that is silent, blind or frozen must stop the robot, not guide it."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.navigation.costmap import Scan

# A delay is judged by the promptest scan of so many seconds: a clock's rate differs by far less in that time.
_MEMORY_S = 10.0
# No scan is that late: a clock has jumped.
_JUMP_S = 2.0


class ScanHealth:
    """Feed it every scan that is looked at; `reason` says why the last second's scans were no good, or None.

    A real lidar never measures the same twice; a simulated one without noise does while the robot stands. So equal scans
    are frozen only once the robot has moved under them, and then at once, since it drives by an old picture.
    """

    def __init__(
        self,
        patience_s: float = 1.0,
        nearest_m: float = 0.25,
        least_beams: float = 0.05,
        still_m: float = 0.1,
        still_rad: float = 0.15,
    ) -> None:
        self._patience_s = patience_s
        self._nearest_m = nearest_m
        self._least_beams = least_beams
        self._still_m, self._still_rad = still_m, still_rad
        self._last: NDArray[np.float32] | None = None
        self._last_stamp_ns: int | None = None
        self._changed_at: Pose2 | None = None
        self._good_s: float | None = None
        self._complaint = "no scan has come yet"
        self._frozen = False
        self._delays_s: deque[tuple[float, float]] = deque()
        self._late_s = 0.0

    def take(self, scan: Scan, odom_from_base: Pose2, now_s: float) -> bool:
        """Judge a scan; returns whether the costmaps may have it."""
        if scan.stamp_ns == self._last_stamp_ns:
            self._complaint = "the scan's stamp stands still"
            return False
        self._last_stamp_ns = scan.stamp_ns
        self._compare(now_s - scan.stamp_ns * 1e-9, now_s)
        ranges = scan.ranges_m
        low = max(self._nearest_m, scan.range_min_m)
        usable = int(np.count_nonzero((ranges >= low) & (ranges <= min(scan.range_max_m, 1e6))))
        if usable < self._least_beams * max(len(ranges), 1):
            self._complaint = f"{usable} of {len(ranges)} beams measure anything from {low:.2f} m on"
            return False
        if self._last is not None and np.array_equal(self._last, ranges, equal_nan=True):
            mark = self._changed_at or odom_from_base
            turned = abs(wrap_angle(odom_from_base.yaw - mark.yaw))
            if odom_from_base.distance_to(mark) > self._still_m or turned > self._still_rad:
                self._complaint = "the scans repeat while the robot moves: the lidar is frozen"
                self._frozen = True
                return False
        else:
            self._last, self._changed_at = ranges, odom_from_base
            self._frozen = False
        self._good_s = now_s
        return True

    def _compare(self, delay_s: float, now_s: float) -> None:
        """Note how late a scan came: later than the promptest, since the two clocks need not agree."""
        delays = self._delays_s
        if delays and abs(delay_s - delays[-1][1]) > _JUMP_S:
            delays.clear()
        delays.append((now_s, delay_s))
        while now_s - delays[0][0] > _MEMORY_S:
            delays.popleft()
        self._late_s = delay_s - min(delay for _, delay in delays)

    def age_s(self, now_s: float) -> float:
        """How old the picture is that the last good scan left: the time since it was taken in, and how late it came."""
        return 0.0 if self._good_s is None else now_s - self._good_s + self._late_s

    def reason(self, now_s: float) -> str | None:
        """Why the robot is blind, or None while it is not."""
        if self._frozen:
            return self._complaint
        if self._good_s is None:
            return self._complaint
        age_s = now_s - self._good_s
        if age_s <= self._patience_s:
            return None
        return f"no usable scan for {age_s:.1f} s ({self._complaint})"

    def silent(self) -> None:
        """Note that nothing came, for the complaint."""
        self._complaint = "nothing comes on /scan"
