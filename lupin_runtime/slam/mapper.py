"""The mapping core: every scan is matched against a local map, some become keyframes of a pose graph that closes its loops.

Pure: fed with odometry and ranges, it returns poses. The map's origin is the robot's pose at the first scan. What a scan costs
does not grow with time: local maps, searches and re-drawing are bounded, and where the robot comes by again it stands on old
keyframes instead of adding new ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.slam.keyframes import KeyframeGraph, composed, relative, turned
from lupin_runtime.slam.local_map import FieldShape, LocalMap
from lupin_runtime.slam.loop_closure import LoopCloser, LoopSettings, information_at_head
from lupin_runtime.slam.matching import Match, Window, match
from lupin_runtime.slam.occupancy import OccupancyMap, OccupancySettings
from lupin_runtime.slam.pose_graph import Limits, edge_chi2, optimise
from lupin_runtime.slam.scan import Beams, Health, Scan, ScanHealth, ScanReader

Array = NDArray[np.floating]
Index = NDArray[np.int64]

# Kernel widths (sigma) of the closures, wide to narrow: graduated non-convexity, so that a true closure that comes as a
# surprise may pull before it is judged (Yang et al., RA-L 2020).
KERNELS = (30.0, 10.0, 4.0)
SURPRISE_M = 0.1
AGREES_M = 0.03
KEYFRAMES_PER_WAIT = 200
# A closure that the graph contradicts by more than this is dropped (chi2 of 3 degrees of freedom: p < 1e-6).
CONTRADICTED_CHI2 = 31.0
# Drawn scans that may be moved while one scan is taken: about a millisecond.
MOVES_PER_SCAN = 10


@dataclass(frozen=True)
class MotionNoise:
    """Standard deviations of odometry: floors per scan, shares of travel and of turning, turning per metre."""

    floor_m: float = 0.004
    floor_rad: float = 0.003
    travel: float = 0.1
    turn: float = 0.1
    turn_per_m: float = 0.05

    def covariance(self, motion: Array) -> Array:
        """(3, 3) over x, y, yaw, in the robot's axes, of a motion (3,)."""
        distance, angle = math.hypot(motion[0], motion[1]), abs(motion[2])
        place = self.floor_m + self.travel * distance
        yaw = self.floor_rad + self.turn * angle + self.turn_per_m * distance
        return np.diag([place * place, place * place, yaw * yaw])


@dataclass(frozen=True)
class MapperSettings:
    """What a mapper does when. Distances in metres, angles in radians.

    `revisit_m` lets the robot stand on a keyframe that is this near instead of adding one; 0 keeps every keyframe. A scan that
    fits nowhere becomes a keyframe only `lost_m` or `lost_rad` from the last one: a crowd around the robot is no new room.
    Odometry that is faster than `fastest_m_s` or `fastest_rad_s` has leapt; stamps count as at least `least_interval_s` apart.
    With `lost_is_far` what was not matched parts the map: closures must join it again.
    """

    keyframe_m: float = 0.3
    keyframe_rad: float = 0.3
    keyframe_interval_s: float = 0.5
    revisit_m: float = 0.2
    local_keyframes: int = 24
    local_path_m: float = 8.0
    local_radius_m: float = 10.0
    least_score: float = 0.35
    least_overlap: float = 0.3
    slip_window: Window = field(default_factory=lambda: Window(1.2, 0.8))
    leap_window: Window = field(default_factory=lambda: Window(1.2, 0.8))
    slip_score: float = 0.4
    slip_fit: float = 0.6
    fastest_m_s: float = 3.0
    fastest_rad_s: float = 4.0
    least_interval_s: float = 0.0
    lost_m: float = 1.0
    lost_rad: float = 1.0
    lost_is_far: bool = False
    use_matching: bool = True
    noise: MotionNoise = field(default_factory=MotionNoise)
    field_shape: FieldShape = field(default_factory=FieldShape)
    loops: LoopSettings | None = field(default_factory=LoopSettings)
    occupancy: OccupancySettings | None = field(default_factory=OccupancySettings)


@dataclass(frozen=True)
class Step:
    """What became of one scan: the robot's pose (3,) in the map and its covariance, and what was found on the way."""

    pose: Array
    covariance: Array
    health: Health
    matched: bool
    keyframe: int | None = None
    closed_loop: bool = False
    odometry_jumped: bool = False


@dataclass(frozen=True)
class Place:
    """A pose that moves along when the graph does: a keyframe, and the pose in its frame."""

    keyframe: int
    offset: Array


class Mapper:
    """Simultaneous localisation and mapping."""

    def __init__(self, settings: MapperSettings | None = None) -> None:
        self.settings = settings or MapperSettings()
        self.graph = KeyframeGraph()
        self.occupancy = OccupancyMap(self.settings.occupancy) if self.settings.occupancy else None
        self._reader = ScanReader()
        self._health = ScanHealth()
        self._local = LocalMap(self.settings.field_shape)
        self._local_keyframes = np.zeros(0, np.int64)
        self._local_centre: Array | None = None
        self._closer = LoopCloser(self.settings.loops, self.settings.field_shape) if self.settings.loops else None
        self._place: Place | None = None
        self._drawn_offset: dict[int, Array] = {}
        self._odom: Pose2 | None = None
        self._stamp_s = -math.inf
        self._last_keyframe_s = -math.inf
        self._since_match = np.zeros((3, 3))
        self._unsettled = 0

    @classmethod
    def resumed(cls, settings: MapperSettings | None, graph: KeyframeGraph, pose: Array) -> Mapper:
        """A mapper that goes on with a kept graph, the robot standing near `pose` (3,) of it."""
        mapper = cls(settings)
        mapper.graph = graph
        away = np.hypot(*(graph.poses[:, :2] - pose[:2]).T)
        nearest = int(np.argmin(away))
        mapper._place = Place(nearest, relative(graph.poses[nearest], pose))
        mapper._since_match = np.diag([0.2**2, 0.2**2, 0.1**2])
        for number in range(len(graph)):
            mapper._draw(number, graph.pool.scan(number), np.zeros(3))
        return mapper

    @property
    def place(self) -> Place | None:
        """Where the robot stands, tied to the graph; None before the first usable scan."""
        return self._place

    def pose_of(self, place: Place) -> Array:
        """The pose (3,) in the map that a place has now."""
        return composed(self.graph.poses[place.keyframe], place.offset)

    def grid(self) -> GridMap | None:
        """The occupancy grid; None before the first usable scan."""
        return self.occupancy.grid() if self.occupancy is not None else None

    def process(
        self, stamp_s: float, odom: Pose2, ranges: Array, beams: Beams, twist: tuple[float, float, float] | None = None,
        beam_s: float = 0.0,
    ) -> Step:  # fmt: skip
        """Take one scan with the odometry pose of its moment; stamps may jump back, the map stays."""
        scan = self._reader.read(beams, ranges, twist, beam_s)
        health = self._health.judge(ranges, len(scan), odom)
        motion, jumped = self._motion(stamp_s, odom)
        if self._place is None:
            if health is Health.GOOD:
                self._add_keyframe(scan, stamp_s, np.zeros(3), None)
            return Step(np.zeros(3), np.zeros((3, 3)), health, health is Health.GOOD, 0 if health is Health.GOOD else None)
        guess = composed(self.pose_of(self._place), motion)
        self._since_match = self._since_match + turned(self.settings.noise.covariance(motion), -float(guess[2]))
        if jumped:
            self._since_match = self._since_match + np.diag([0.5**2, 0.5**2, 0.3**2])
        slip = self.settings.leap_window if jumped else self.settings.slip_window
        fit = self._match(scan, guess, slip) if health is Health.GOOD and self.settings.use_matching else None
        pose = guess if fit is None else fit.pose
        self._place = Place(self._place.keyframe, relative(self.graph.poses[self._place.keyframe], pose))
        keyframe = self._advance(scan, stamp_s, pose, fit, beams) if health is Health.GOOD else None
        closed = keyframe is not None and self._close_loops(keyframe)
        covariance = self._since_match if fit is None else fit.covariance
        if fit is not None:
            self._since_match = np.zeros((3, 3))
        if self.occupancy is not None:
            self.occupancy.work(MOVES_PER_SCAN)
        return Step(self.pose_of(self._place), covariance, health, fit is not None, keyframe, closed, jumped)

    def _motion(self, stamp_s: float, odom: Pose2) -> tuple[Array, bool]:
        """The odometry since the last scan (3,), and whether it leapt: then it says nothing, and none is assumed."""
        before, since = self._odom, stamp_s - self._stamp_s
        self._odom, self._stamp_s = odom, stamp_s
        if since < 0.0:
            self._last_keyframe_s = -math.inf
        if before is None:
            return np.zeros(3), False
        step = before.inverse() @ odom
        s, since = self.settings, max(since, self.settings.least_interval_s)
        if math.hypot(step.x, step.y) > 0.5 + s.fastest_m_s * since or abs(step.yaw) > 0.5 + s.fastest_rad_s * since:
            return np.zeros(3), True
        return np.array([step.x, step.y, step.yaw]), False

    def _match(self, scan: Scan, guess: Array, slip: Window) -> Match | None:
        """Fit a scan near `guess`: first as far as the odometry may err, then as far as wheels may have slipped."""
        self._refresh_local(guess)
        s = self.settings
        spread = self._since_match
        window = Window(
            min(max(3.0 * math.sqrt(max(spread[0, 0], spread[1, 1])), 0.10), slip.half_m),
            min(max(3.0 * math.sqrt(spread[2, 2]), 0.03), slip.half_rad),
        )
        points = scan.thinned(self._local.shape.cell_m)
        found = match(self._local, scan, guess, spread, window, points=points)
        if found is not None and found.score >= s.least_score and found.overlap >= s.least_overlap:
            return found
        spread = spread + np.diag([(slip.half_m / 3) ** 2, (slip.half_m / 3) ** 2, (slip.half_rad / 3) ** 2])
        found = match(self._local, scan, guess, spread, slip, s.slip_score, points=points)
        if found is not None and found.overlap >= s.least_overlap and found.fit >= s.slip_fit:
            return found
        return None

    def _refresh_local(self, guess: Array) -> None:
        """Rebuild the local map where the robot has left the middle of it, or the graph has changed."""
        assert self._place is not None
        if self._local_centre is not None and np.hypot(*(self._local_centre[:2] - guess[:2])) < 1.0:
            return
        s = self.settings
        poses = self.graph.poses
        near = np.flatnonzero(np.isfinite(self.graph.path_lengths(self._place.keyframe, s.local_path_m)))
        away = np.hypot(*(poses[near, :2] - guess[:2]).T)
        order = np.argsort(away, kind="stable")[: s.local_keyframes]
        order = order[(away[order] <= s.local_radius_m) | (away[order] == away.min())]
        self._local_keyframes = near[order]
        self._local.build(
            self.graph.pool, self._local_keyframes, poses[self._local_keyframes], (float(guess[0]), float(guess[1]))
        )
        self._local_centre = guess.copy()

    # -- keyframes -----------------------------------------------------------------------------------------------------

    def _advance(self, scan: Scan, stamp_s: float, pose: Array, fit: Match | None, beams: Beams) -> int | None:
        """Add a keyframe, or step onto an old one, where the robot has moved on; returns a new keyframe's number."""
        assert self._place is not None
        s = self.settings
        moved = self._place.offset
        if stamp_s - self._last_keyframe_s < s.keyframe_interval_s:
            return None
        if math.hypot(moved[0], moved[1]) < s.keyframe_m and abs(moved[2]) < s.keyframe_rad:
            return None
        if fit is None and s.use_matching and math.hypot(moved[0], moved[1]) < s.lost_m and abs(moved[2]) < s.lost_rad:
            return None
        if fit is not None and (old := self._revisited(pose, beams)) is not None:
            self._place = Place(old, relative(self.graph.poses[old], pose))
            self._last_keyframe_s = stamp_s
            self._draw(old, scan, self._place.offset)
            return None
        return self._add_keyframe(scan, stamp_s, pose, fit)

    def _revisited(self, pose: Array, beams: Beams) -> int | None:
        """A keyframe of the local map that sees what a new one here would see."""
        assert self._place is not None
        s = self.settings
        others = self._local_keyframes[self._local_keyframes != self._place.keyframe]
        if s.revisit_m <= 0.0 or not len(others):
            return None
        poses = self.graph.poses[others]
        # A laser that sees all around sees the same whichever way it looks, but for what the robot's own body hides.
        turn = math.pi / 3.0 if beams.field_of_view > 1.7 * math.pi else s.keyframe_rad
        away = np.hypot(*(poses[:, :2] - pose[:2]).T)
        off = np.abs((poses[:, 2] - pose[2] + math.pi) % (2.0 * math.pi) - math.pi)
        away[off > turn] = math.inf
        best = int(np.argmin(away))
        return int(others[best]) if away[best] < s.revisit_m else None

    def _add_keyframe(self, scan: Scan, stamp_s: float, pose: Array, fit: Match | None) -> int:
        number = self.graph.add(scan, stamp_s, pose)
        if self._place is not None:
            self._join(number, pose, fit)
        self._place = Place(number, np.zeros(3))
        self._last_keyframe_s = stamp_s
        self._local_centre = None
        self._draw(number, scan, np.zeros(3))
        return number

    def _join(self, number: int, pose: Array, fit: Match | None) -> None:
        """Tie a new keyframe to the one the robot stood on, by odometry and match together."""
        assert self._place is not None
        information: Array = np.linalg.inv(self._since_match + np.diag([1e-6, 1e-6, 1e-7]))
        if fit is not None:
            information = information + np.linalg.inv(fit.covariance)
        last = self._place.keyframe
        motion = relative(self.graph.poses[last], pose)
        self.graph.join(
            last, number, motion, turned(information, float(pose[2])), lost_m=self._lost_m() if fit is None else 0.0
        )

    def _lost_m(self) -> float:
        """The way after which drift would be as large as what odometry alone may have missed, where that is asked for.

        So a stretch without a match is no neighbourhood, and the closures over it are looked for as widely as it needs.
        """
        if not self.settings.lost_is_far or self.settings.loops is None:
            return 0.0
        return math.sqrt(float(self._since_match[:2, :2].trace()) / 2.0) / self.settings.loops.drift_m[1]

    def _draw(self, keyframe: int, scan: Scan, offset: Array) -> None:
        """Show the newest scan of a keyframe on the map: what has changed since its first shows."""
        if self.occupancy is not None:
            self._drawn_offset[keyframe] = offset
            self.occupancy.draw(keyframe, scan, composed(self.graph.poses[keyframe], offset))

    # -- closures ------------------------------------------------------------------------------------------------------

    def _close_loops(self, number: int) -> bool:
        closures = self._closer.look(self.graph, number) if self._closer is not None else []
        for closure in closures:
            motion = relative(self.graph.poses[closure.tail], closure.measured)
            self.graph.join(closure.tail, closure.head, motion, information_at_head(closure), closure=True)
        if closures:
            surprise = max(float(np.hypot(*(closure.measured - closure.was)[:2])) for closure in closures)
            self._unsettled += len(closures)
            # Closures that agree with the map may wait for company, the longer the larger the graph: the whole of it is
            # relaxed a bounded number of times for each keyframe.
            if surprise > AGREES_M or self._unsettled > len(self.graph) / KEYFRAMES_PER_WAIT:
                self.optimise(KERNELS if surprise > SURPRISE_M else KERNELS[-1:])
        return bool(closures)

    def optimise(self, kernels: tuple[float, ...] = KERNELS) -> None:
        """Relax the whole graph, drop closures that it contradicts, and let map and local map follow."""
        for last in (False, True):
            edges, closures = self.graph.as_edges()
            poses = self.graph.poses.copy()
            for kernel in kernels:
                poses = optimise(
                    poses, edges, robust=closures, robust_scale=kernel, limits=Limits(10, 1e-5), trust_guess=True
                ).poses
            wrong = np.flatnonzero(closures & (edge_chi2(poses, edges) > CONTRADICTED_CHI2))
            self.graph.poses = poses
            if last or not len(wrong):
                break
            self.graph.replace_edges([edge for at, edge in enumerate(self.graph.edges) if at not in set(wrong.tolist())])
        if self._closer is not None:
            self._closer.moved()
        self._unsettled = 0
        self._local_centre = None
        if self.occupancy is not None:
            self.occupancy.move({key: composed(self.graph.poses[key], offset) for key, offset in self._drawn_offset.items()})
