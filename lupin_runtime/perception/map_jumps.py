"""Detects when the map moves under the robot, and how far each part of the robot's path has moved.

A tag is placed in the map of that moment. When SLAM closes a loop, the poses of the loop shift, each by its own amount, and
tags seen from them have to shift, too. The graph shows only the shift of the newest pose (`map` -> `odom` jumps), but the path
since the first visit of the recognized place is known, and so are the errors of odometry: the shift spreads over that path
as over a chain of equally uncertain motions with fixed ends (Lu & Milios 1997, linearised).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2, wrap_angle

Array = NDArray[np.float64]

PATH_STEP_M = 0.2
TURN_LEVER_M = 0.3  # a turn in place counts as this many meters per radian: wheels slip in turns, too
MAX_PATH = 2000

# Scan matching corrects the newest pose by centimeters, which is tracking; only a closed loop moves old places.
JUMP_M = 0.08
JUMP_RAD = 0.03
# Slipping wheels, or a table that holds the robot, make odometry wrong by up to the motion it reports, and SLAM corrects that:
# only the robot's pose was wrong, not the map. A contact turns the robot by up to a radian for this many meters.
SLIP_WINDOW_S = 0.6
SLIP_LEVER_M = 0.5
# A larger correction than usual means that the robot's pose was wrong, and may still be wrong for a moment.
USUAL_CORRECTION_M = 0.03
UNREST_WINDOW_S = 1.0
# Larger than any loop closure: the map was cleared, or the robot was carried elsewhere.
NEW_MAP_M = 3.0
NEW_MAP_RAD = 1.0

LOOP_MIN_M = 3.0  # of path between a place and its second visit
LOOP_REACH_M = 4.0  # a lidar recognizes a place from this distance
# Odometry's uncertainty per meter: ratio of turning (rad) to sliding (m). Only the ratio matters.
TURN_SIGMA, SLIDE_SIGMA = 0.02, 0.03


@dataclass(frozen=True, eq=False)
class MapJump:
    """One jump of the map: how far each part of the path moved.

    `stations` are ascending path lengths, m. Nothing moves before the first; after the last everything moves as at the last.
    """

    stations: Array
    x: Array
    y: Array
    shift_x: Array
    shift_y: Array
    turn: Array
    whole: Pose2 | None = None
    # A correction that may be the robot's own error: nothing moves, but earlier sightings may be wrong by this much.
    doubt_m: float = 0.0

    def motion_at(self, traveled: float) -> Pose2:
        """Return new_map_from_old_map for sightings from the path at `traveled` meters."""
        if self.whole is not None:
            return self.whole
        if self.doubt_m > 0.0:
            return Pose2()
        x, y, dx, dy, turn = (
            float(np.interp(traveled, self.stations, values))
            for values in (self.x, self.y, self.shift_x, self.shift_y, self.turn)
        )
        # Turn about the robot's place, then shift.
        c, s = math.cos(turn), math.sin(turn)
        return Pose2(x + dx - c * x + s * y, y + dy - s * x - c * y, turn)


class MapMotion:
    """Follows the robot's path in the map, and detects jumps of the map."""

    def __init__(self) -> None:
        self.traveled = 0.0
        self._map_from_odom: Pose2 | None = None
        self._last_odom: Pose2 | None = None
        self._stations: list[float] = []
        self._path: list[Pose2] = []
        self._last_jump = 0.0
        self._steps: deque[tuple[float, float, float]] = deque()
        self._corrections: deque[tuple[float, float]] = deque()

    def restart(self) -> None:
        """Begin again with the next transforms, after the robot was lost: the map, and what is placed in it, has not moved."""
        self._map_from_odom = self._last_odom = None
        self._steps.clear()
        self._corrections.clear()
        self._last_jump = self.traveled

    def update(self, time_s: float, map_from_odom: Pose2, odom_from_base: Pose2) -> MapJump | None:
        """Process the newest transforms, both of about `time_s`; returns a jump if the map has, or may have, moved."""
        if self._last_odom is not None:
            step = self._last_odom.inverse() @ odom_from_base
            self.traveled += math.hypot(step.x, step.y) + TURN_LEVER_M * abs(step.yaw)
            self._steps.append((time_s, math.hypot(step.x, step.y), abs(step.yaw)))
        while self._steps and not 0.0 <= time_s - self._steps[0][0] <= SLIP_WINDOW_S:
            self._steps.popleft()
        self._last_odom = odom_from_base
        while self._corrections and not 0.0 <= time_s - self._corrections[0][0] <= UNREST_WINDOW_S:
            self._corrections.popleft()
        before, self._map_from_odom = self._map_from_odom, map_from_odom
        jump = None
        if before is not None:
            was, now = before @ odom_from_base, map_from_odom @ odom_from_base
            turned = wrap_angle(now.yaw - was.yaw)
            shift = was.distance_to(now)
            self._corrections.append((time_s, shift))
            if shift > JUMP_M or abs(turned) > JUMP_RAD:
                jump = self._doubt(shift) if self._may_be_slip(shift, turned) else self._jump(was, now, turned)
                self._follow(jump)
        self._extend(map_from_odom @ odom_from_base)
        return jump

    def _extend(self, pose: Pose2) -> None:
        if not self._stations or self.traveled - self._stations[-1] >= PATH_STEP_M:
            self._stations.append(self.traveled)
            self._path.append(pose)
        if len(self._path) > MAX_PATH:
            del self._path[: MAX_PATH // 4], self._stations[: MAX_PATH // 4]

    @property
    def unrest_m(self) -> float:
        """The extra uncertainty of the robot's pose in meters, by the largest recent correction."""
        return max(0.0, max((shift for _, shift in self._corrections), default=0.0) - USUAL_CORRECTION_M)

    def _may_be_slip(self, shift_m: float, turned: float) -> bool:
        slid, spun = (sum(step[k] for step in self._steps) for k in (1, 2))
        return shift_m <= JUMP_M + slid and abs(turned) <= JUMP_RAD + spun + slid / SLIP_LEVER_M

    @staticmethod
    def _doubt(shift_m: float) -> MapJump:
        empty = np.zeros(1)
        return MapJump(empty, empty, empty, empty, empty, empty, doubt_m=shift_m)

    def _jump(self, was: Pose2, now: Pose2, turned: float) -> MapJump:
        empty = np.zeros(1)
        if was.distance_to(now) > NEW_MAP_M or abs(turned) > NEW_MAP_RAD or len(self._path) < 2:
            return MapJump(empty, empty, empty, empty, empty, empty, whole=now @ was.inverse())
        first = self._first_moved(now)
        stations = np.array([*self._stations[first:], self.traveled])
        poses = [*self._path[first:], was]
        x, y = np.array([p.x for p in poses]), np.array([p.y for p in poses])
        length = np.maximum(np.diff(stations), 1e-6)
        # Edge k has its error at its middle: a slide, and a turn about it. At the end of the path the errors add up to the
        # jump; the most likely errors that do are the pose graph's solution.
        mx, my = (x[:-1] + x[1:]) / 2.0, (y[:-1] + y[1:]) / 2.0
        slide, turn = SLIDE_SIGMA**2 * length, TURN_SIGMA**2 * length
        rx, ry = -(y[-1] - my), x[-1] - mx
        normal = np.array(
            [
                [np.sum(slide + turn * rx * rx), np.sum(turn * rx * ry), np.sum(turn * rx)],
                [np.sum(turn * rx * ry), np.sum(slide + turn * ry * ry), np.sum(turn * ry)],
                [np.sum(turn * rx), np.sum(turn * ry), np.sum(turn)],
            ]
        )
        multipliers = np.linalg.solve(normal, np.array([now.x - was.x, now.y - was.y, turned]))
        slide_x, slide_y = slide * multipliers[0], slide * multipliers[1]
        turns = turn * (rx * multipliers[0] + ry * multipliers[1] + multipliers[2])
        total = np.concatenate([[0.0], np.cumsum(turns)])
        # Shift of station i: all slides before it, and every earlier turn's lever arm to it.
        lever_x = np.concatenate([[0.0], np.cumsum(turns * my)]) - total * y
        lever_y = total * x - np.concatenate([[0.0], np.cumsum(turns * mx)])
        shift_x = np.concatenate([[0.0], np.cumsum(slide_x)]) + lever_x
        shift_y = np.concatenate([[0.0], np.cumsum(slide_y)]) + lever_y
        self._last_jump = self.traveled
        return MapJump(stations, x, y, shift_x, shift_y, total)

    def _first_moved(self, now: Pose2) -> int:
        """Index of the first pose that moves: the older visit nearest to the robot's corrected pose."""
        old = [i for i, station in enumerate(self._stations) if station <= self.traveled - LOOP_MIN_M]
        if old:
            nearest = min(old, key=lambda i: self._path[i].distance_to(now))
            if self._path[nearest].distance_to(now) <= LOOP_REACH_M:
                return min(nearest, len(self._path) - 2)
        # No loop: the error arose since the map last moved.
        since = next((i for i, station in enumerate(self._stations) if station >= self._last_jump), 0)
        return min(since, len(self._path) - 2)

    def _follow(self, jump: MapJump) -> None:
        self._path = [jump.motion_at(station) @ pose for station, pose in zip(self._stations, self._path)]
