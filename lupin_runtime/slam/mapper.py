"""The mapping core: every scan is matched against a local map, some become keyframes of a pose graph that closes its loops.

Without ROS: it takes odometry and ranges and returns poses. The map's origin is the robot's pose at the first scan. The cost of
a scan does not grow with time: local maps, searches and re-drawing are bounded, and in known space the robot refers to old
keyframes instead of adding new ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.scan_health import ScanHealth, ScanJudge
from lupin_runtime.slam.keyframes import KeyframeGraph
from lupin_runtime.slam.local_map import FieldShape, LocalMap
from lupin_runtime.slam.loop_closure import LoopCloser, LoopSettings, information_at_head
from lupin_runtime.slam.occupancy import OccupancyMap, OccupancySettings
from lupin_runtime.slam.pose_graph import Limits, edge_chi2, optimize
from lupin_runtime.slam.scan import MIN_POINTS, Beams, ScanPoints, ScanReader
from lupin_runtime.slam.scan_matching import Match, Window, match
from lupin_runtime.slam.se2 import compose, relative_pose, rotate_information

Array = NDArray[np.floating]
Index = NDArray[np.int64]

# Kernel widths (sigma) of the closures, wide to narrow: graduated non-convexity, so that a true closure with a large correction
# moves the graph before it can be rejected (Yang et al., RA-L 2020).
KERNELS = (30.0, 10.0, 4.0)
SURPRISE_M = 0.1
AGREES_M = 0.03
KEYFRAMES_PER_WAIT = 200
# A closure that the graph contradicts by more than this is dropped (chi2 of 3 degrees of freedom: p < 1e-6).
CONTRADICTED_CHI2 = 31.0
# Drawn scans that may be moved per processed scan: about a millisecond.
MOVES_PER_SCAN = 10


@dataclass(frozen=True)
class MotionNoise:
    """Standard deviations of odometry: floors per scan, shares of travel and of turning, turning per meter."""

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
    """When a mapper adds keyframes, accepts matches and ignores odometry. Distances in meters, angles in radians.

    Within `revisit_m` of an old keyframe none is added (0: always add). A scan that fits nowhere becomes a keyframe only
    `lost_m` or `lost_rad` from the last one: a crowd around the robot is no new room.
    Odometry faster than `max_speed_mps` or `max_turn_radps` has jumped; stamps count as at least `min_interval_s` apart.
    With `lost_is_far` an unmatched stretch separates the map in two, until closures join it again.
    """

    keyframe_m: float = 0.3
    keyframe_rad: float = 0.3
    keyframe_interval_s: float = 0.5
    revisit_m: float = 0.2
    local_keyframes: int = 24
    local_path_m: float = 8.0
    local_radius_m: float = 10.0
    min_score: float = 0.35
    min_overlap: float = 0.3
    slip_window: Window = field(default_factory=lambda: Window(1.2, 0.8))
    leap_window: Window = field(default_factory=lambda: Window(1.2, 0.8))
    slip_score: float = 0.4
    slip_fit: float = 0.6
    max_speed_mps: float = 3.0
    max_turn_radps: float = 4.0
    min_interval_s: float = 0.0
    lost_m: float = 1.0
    lost_rad: float = 1.0
    lost_is_far: bool = False
    use_matching: bool = True
    noise: MotionNoise = field(default_factory=MotionNoise)
    field_shape: FieldShape = field(default_factory=FieldShape)
    loops: LoopSettings | None = field(default_factory=LoopSettings)
    occupancy: OccupancySettings | None = field(default_factory=OccupancySettings)


@dataclass(frozen=True)
class ScanResult:
    """The result of one scan: the robot's pose (3,) in the map, its covariance (3, 3), and what the scan was used for."""

    pose: Array
    covariance: Array
    health: ScanHealth
    matched: bool
    keyframe: int | None = None
    closed_loop: bool = False
    odometry_jumped: bool = False


@dataclass(frozen=True)
class AnchoredPose:
    """A pose that moves with the graph: a keyframe, and the pose (3,) in its frame."""

    keyframe: int
    offset: Array


class Mapper:
    """Simultaneous localization and mapping."""

    def __init__(self, settings: MapperSettings | None = None) -> None:
        self.settings = settings or MapperSettings()
        self.graph = KeyframeGraph()
        self.occupancy = OccupancyMap(self.settings.occupancy) if self.settings.occupancy else None
        self._reader = ScanReader()
        self._judge = ScanJudge()
        self._local = LocalMap(self.settings.field_shape)
        self._local_keyframes = np.zeros(0, np.int64)
        self._local_center: Array | None = None
        self._closer = LoopCloser(self.settings.loops, self.settings.field_shape) if self.settings.loops else None
        self._anchored_pose: AnchoredPose | None = None
        self._drawn_offset: dict[int, Array] = {}
        self._odom: Pose2 | None = None
        self._stamp_s = -math.inf
        self._last_keyframe_s = -math.inf
        self._since_match = np.zeros((3, 3))
        self._unsettled = 0

    @classmethod
    def resumed(cls, settings: MapperSettings | None, graph: KeyframeGraph, pose: Array) -> Mapper:
        """Create a mapper that continues a saved graph, with the robot near `pose` (3,)."""
        mapper = cls(settings)
        mapper.graph = graph
        away = np.hypot(*(graph.poses[:, :2] - pose[:2]).T)
        nearest = int(np.argmin(away))
        mapper._anchored_pose = AnchoredPose(nearest, relative_pose(graph.poses[nearest], pose))
        mapper._since_match = np.diag([0.2**2, 0.2**2, 0.1**2])
        for number in range(len(graph)):
            mapper._draw(number, graph.pool.scan(number), np.zeros(3))
        return mapper

    @property
    def anchored_pose(self) -> AnchoredPose | None:
        """The robot's pose, tied to the graph; None before the first usable scan."""
        return self._anchored_pose

    def pose_of(self, anchored: AnchoredPose) -> Array:
        """The present pose (3,) in the map of an anchored pose."""
        return compose(self.graph.poses[anchored.keyframe], anchored.offset)

    def grid(self) -> GridMap | None:
        """The occupancy grid; None before the first usable scan."""
        return self.occupancy.grid() if self.occupancy is not None else None

    def process(
        self, stamp_s: float, odom: Pose2, ranges: Array, beams: Beams, twist: tuple[float, float, float] | None = None,
        beam_s: float = 0.0,
    ) -> ScanResult:  # fmt: skip
        """Process one scan with the odometry pose at its time; after stamps that jump back the map stays."""
        scan = self._reader.read(beams, ranges, twist, beam_s)
        health = self._judge.judge(ranges, len(scan) >= MIN_POINTS, odom)
        motion, jumped = self._motion(stamp_s, odom)
        if self._anchored_pose is None:
            if health is ScanHealth.GOOD:
                self._add_keyframe(scan, stamp_s, np.zeros(3), None)
            return ScanResult(
                np.zeros(3), np.zeros((3, 3)), health, health is ScanHealth.GOOD, 0 if health is ScanHealth.GOOD else None
            )
        guess = compose(self.pose_of(self._anchored_pose), motion)
        self._since_match = self._since_match + rotate_information(self.settings.noise.covariance(motion), -float(guess[2]))
        if jumped:
            self._since_match = self._since_match + np.diag([0.5**2, 0.5**2, 0.3**2])
        slip = self.settings.leap_window if jumped else self.settings.slip_window
        fit = self._match(scan, guess, slip) if health is ScanHealth.GOOD and self.settings.use_matching else None
        pose = guess if fit is None else fit.pose
        self._anchored_pose = AnchoredPose(
            self._anchored_pose.keyframe, relative_pose(self.graph.poses[self._anchored_pose.keyframe], pose)
        )
        keyframe = self._advance(scan, stamp_s, pose, fit, beams) if health is ScanHealth.GOOD else None
        closed = keyframe is not None and self._close_loops(keyframe)
        covariance = self._since_match if fit is None else fit.covariance
        if fit is not None:
            self._since_match = np.zeros((3, 3))
        if self.occupancy is not None:
            self.occupancy.work(MOVES_PER_SCAN)
        return ScanResult(self.pose_of(self._anchored_pose), covariance, health, fit is not None, keyframe, closed, jumped)

    def _motion(self, stamp_s: float, odom: Pose2) -> tuple[Array, bool]:
        """The motion (3,) since the last scan by odometry, and whether the odometry jumped: then the motion is zero."""
        before, since = self._odom, stamp_s - self._stamp_s
        self._odom, self._stamp_s = odom, stamp_s
        if since < 0.0:
            self._last_keyframe_s = -math.inf
        if before is None:
            return np.zeros(3), False
        step = before.inverse() @ odom
        s, since = self.settings, max(since, self.settings.min_interval_s)
        if math.hypot(step.x, step.y) > 0.5 + s.max_speed_mps * since or abs(step.yaw) > 0.5 + s.max_turn_radps * since:
            return np.zeros(3), True
        return np.array([step.x, step.y, step.yaw]), False

    def _match(self, scan: ScanPoints, guess: Array, slip: Window) -> Match | None:
        """Fit a scan near `guess` (3,): first within the odometry's uncertainty, then within possible wheel slip."""
        self._refresh_local(guess)
        s = self.settings
        spread = self._since_match
        window = Window(
            min(max(3.0 * math.sqrt(max(spread[0, 0], spread[1, 1])), 0.10), slip.half_m),
            min(max(3.0 * math.sqrt(spread[2, 2]), 0.03), slip.half_rad),
        )
        points = scan.thinned(self._local.shape.cell_m)
        found = match(self._local, scan, guess, spread, window, points=points)
        if found is not None and found.score >= s.min_score and found.overlap >= s.min_overlap:
            return found
        spread = spread + np.diag([(slip.half_m / 3) ** 2, (slip.half_m / 3) ** 2, (slip.half_rad / 3) ** 2])
        found = match(self._local, scan, guess, spread, slip, s.slip_score, points=points)
        if found is not None and found.overlap >= s.min_overlap and found.fit >= s.slip_fit:
            return found
        return None

    def _refresh_local(self, guess: Array) -> None:
        """Rebuild the local map if the robot has left its middle, or the graph has changed."""
        assert self._anchored_pose is not None
        if self._local_center is not None and np.hypot(*(self._local_center[:2] - guess[:2])) < 1.0:
            return
        s = self.settings
        poses = self.graph.poses
        near = np.flatnonzero(np.isfinite(self.graph.path_lengths(self._anchored_pose.keyframe, s.local_path_m)))
        away = np.hypot(*(poses[near, :2] - guess[:2]).T)
        order = np.argsort(away, kind="stable")[: s.local_keyframes]
        order = order[(away[order] <= s.local_radius_m) | (away[order] == away.min())]
        self._local_keyframes = near[order]
        self._local.build(
            self.graph.pool, self._local_keyframes, poses[self._local_keyframes], (float(guess[0]), float(guess[1]))
        )
        self._local_center = guess.copy()

    # -- keyframes -----------------------------------------------------------------------------------------------------

    def _advance(self, scan: ScanPoints, stamp_s: float, pose: Array, fit: Match | None, beams: Beams) -> int | None:
        """Add a keyframe, or refer to an old one, if the robot has moved enough; returns a new keyframe's number."""
        assert self._anchored_pose is not None
        s = self.settings
        moved = self._anchored_pose.offset
        if stamp_s - self._last_keyframe_s < s.keyframe_interval_s:
            return None
        if math.hypot(moved[0], moved[1]) < s.keyframe_m and abs(moved[2]) < s.keyframe_rad:
            return None
        if fit is None and s.use_matching and math.hypot(moved[0], moved[1]) < s.lost_m and abs(moved[2]) < s.lost_rad:
            return None
        if fit is not None and (old := self._revisited(pose, beams)) is not None:
            self._anchored_pose = AnchoredPose(old, relative_pose(self.graph.poses[old], pose))
            self._last_keyframe_s = stamp_s
            self._draw(old, scan, self._anchored_pose.offset)
            return None
        return self._add_keyframe(scan, stamp_s, pose, fit)

    def _revisited(self, pose: Array, beams: Beams) -> int | None:
        """The old keyframe that sees the same as a new one at `pose` would; None if there is none."""
        assert self._anchored_pose is not None
        s = self.settings
        others = self._local_keyframes[self._local_keyframes != self._anchored_pose.keyframe]
        if s.revisit_m <= 0.0 or not len(others):
            return None
        poses = self.graph.poses[others]
        # A laser with a full circle of view sees the same at any heading, except for what the robot's body hides.
        turn = math.pi / 3.0 if beams.field_of_view > 1.7 * math.pi else s.keyframe_rad
        away = np.hypot(*(poses[:, :2] - pose[:2]).T)
        off = np.abs((poses[:, 2] - pose[2] + math.pi) % (2.0 * math.pi) - math.pi)
        away[off > turn] = math.inf
        best = int(np.argmin(away))
        return int(others[best]) if away[best] < s.revisit_m else None

    def _add_keyframe(self, scan: ScanPoints, stamp_s: float, pose: Array, fit: Match | None) -> int:
        number = self.graph.add(scan, stamp_s, pose)
        if self._anchored_pose is not None:
            self._join(number, pose, fit)
        self._anchored_pose = AnchoredPose(number, np.zeros(3))
        self._last_keyframe_s = stamp_s
        self._local_center = None
        self._draw(number, scan, np.zeros(3))
        return number

    def _join(self, number: int, pose: Array, fit: Match | None) -> None:
        """Join a new keyframe to the last one, by odometry and match together."""
        assert self._anchored_pose is not None
        information: Array = np.linalg.inv(self._since_match + np.diag([1e-6, 1e-6, 1e-7]))
        if fit is not None:
            information = information + np.linalg.inv(fit.covariance)
        last = self._anchored_pose.keyframe
        motion = relative_pose(self.graph.poses[last], pose)
        self.graph.join(
            last, number, motion, rotate_information(information, float(pose[2])), lost_m=self._lost_m() if fit is None else 0.0
        )

    def _lost_m(self) -> float:
        """The path length whose drift equals the odometry's uncertainty since the last match; 0 without `lost_is_far`.

        It lengthens an unmatched edge, so that closures across it are searched as widely as needed.
        """
        if not self.settings.lost_is_far or self.settings.loops is None:
            return 0.0
        return math.sqrt(float(self._since_match[:2, :2].trace()) / 2.0) / self.settings.loops.drift_m[1]

    def _draw(self, keyframe: int, scan: ScanPoints, offset: Array) -> None:
        """Draw the newest scan of a keyframe on the map, so that changes since its first scan appear."""
        if self.occupancy is not None:
            self._drawn_offset[keyframe] = offset
            self.occupancy.draw(keyframe, scan, compose(self.graph.poses[keyframe], offset))

    # -- closures ------------------------------------------------------------------------------------------------------

    def _close_loops(self, number: int) -> bool:
        closures = self._closer.find_closures(self.graph, number) if self._closer is not None else []
        for closure in closures:
            motion = relative_pose(self.graph.poses[closure.tail], closure.measured)
            self.graph.join(closure.tail, closure.head, motion, information_at_head(closure), closure=True)
        if closures:
            surprise = max(float(np.hypot(*(closure.measured - closure.was)[:2])) for closure in closures)
            self._unsettled += len(closures)
            # Closures that agree with the map are optimized in batches, which grow with the graph: so the number of
            # optimizations per keyframe is bounded.
            if surprise > AGREES_M or self._unsettled > len(self.graph) / KEYFRAMES_PER_WAIT:
                self.optimize(KERNELS if surprise > SURPRISE_M else KERNELS[-1:])
        return bool(closures)

    def optimize(self, kernels: tuple[float, ...] = KERNELS) -> None:
        """Optimize the whole graph, drop closures that it contradicts, and update map and local map."""
        for last in (False, True):
            edges, closures = self.graph.as_edges()
            poses = self.graph.poses.copy()
            for kernel in kernels:
                poses = optimize(
                    poses, edges, robust=closures, robust_scale=kernel, limits=Limits(10, 1e-5), trust_guess=True
                ).poses
            wrong = np.flatnonzero(closures & (edge_chi2(poses, edges) > CONTRADICTED_CHI2))
            self.graph.poses = poses
            if last or not len(wrong):
                break
            self.graph.replace_edges([edge for at, edge in enumerate(self.graph.edges) if at not in set(wrong.tolist())])
        if self._closer is not None:
            self._closer.drop_pending()
        self._unsettled = 0
        self._local_center = None
        if self.occupancy is not None:
            self.occupancy.move({key: compose(self.graph.poses[key], offset) for key, offset in self._drawn_offset.items()})
