"""What the node knows of the robot and its surroundings: transforms with their freshness, speed, lidar, local costmap."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.serialization import deserialize_message

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import BeamPoses, Costmap, LocalCostmap, Scan
from lupin_runtime.navigation.messages import plane_pose, scan_from_message
from lupin_runtime.navigation.recoveries import STANDSTILL, Velocity
from lupin_runtime.navigation.scan_health import ScanHealth
from lupin_runtime.ros import LupinNode, TransformListener
from lupin_runtime.ros.node import interface
from lupin_runtime.transforms import TransformUnavailable

# A scan may be stamped a little later than the newest odometry that has come.
_AHEAD_NS = 200_000_000

# Two periods of the odometry: long enough to average its jitter, short enough to follow the acceleration limits.
_VELOCITY_NS = 40_000_000


class _Watched:
    """One chain of moving transforms; fresh while its newest stamp goes on.

    Whether it goes on is judged by the node's own clock, not by comparing stamps with it: the robot's clock may differ, and
    a stamp from before a jump of the clock would look new for ever.
    """

    def __init__(self, listener: TransformListener, target: str, source: str, patience_s: float) -> None:
        self._tree = listener.tree
        self._target, self._source = target, source
        self._patience_s = patience_s
        self._newest: int | None = None
        self._moved_s = 0.0

    def pose(self, now_s: float) -> Pose2 | None:
        """The newest pose, or None where there is none or it no longer goes on."""
        try:
            newest = self._tree.newest_ns(self._target, self._source)
            transform = self._tree.lookup(self._target, self._source)
        except TransformUnavailable:
            return None
        if newest != self._newest or newest is None:
            self._newest, self._moved_s = newest, now_s
        return plane_pose(transform) if now_s - self._moved_s <= self._patience_s else None


class Surroundings:
    """Subscribes to /tf and /scan. Scans are kept as bytes and read when they are needed: they come more often than that."""

    def __init__(
        self,
        node: LupinNode,
        local: LocalCostmap,
        now_s: Callable[[], float],
        transform_patience_s: float,
        scan_patience_s: float,
        velocity_threshold: float,
    ) -> None:
        self._node = node
        self._local = local
        self._now_s = now_s
        self._threshold = velocity_threshold
        self._listener = TransformListener(node)
        self._odometry_pose = _Watched(self._listener, graph.ODOM_FRAME, graph.BASE_FRAME, transform_patience_s)
        self._correction = _Watched(self._listener, graph.MAP_FRAME, graph.ODOM_FRAME, transform_patience_s)
        self._lost_since_s: float | None = None
        self._health = ScanHealth(scan_patience_s)
        self._scan_bytes: bytes | None = None
        self._scan_type = interface(graph.SCAN.type)
        self.local: Costmap | None = None
        node.subscription(graph.SCAN, self._take_scan, graph.BEST1, raw=True)

    @property
    def tree(self) -> Any:
        """The transform tree."""
        return self._listener.tree

    def _take_scan(self, data: bytes) -> None:
        self._scan_bytes = data

    # -- the robot -----------------------------------------------------------------------------------------------------
    def odom_from_base(self) -> Pose2 | None:
        """Where odometry says the robot is, if that is fresh."""
        pose = self._odometry_pose.pose(self._now_s())
        self._forget_a_past(pose)
        return pose

    def map_from_odom(self) -> Pose2 | None:
        """The localisation's correction, if that is fresh."""
        return self._correction.pose(self._now_s())

    def map_from_base(self) -> Pose2 | None:
        """Where the robot is on the map."""
        correction, odometry = self.map_from_odom(), self.odom_from_base()
        return None if correction is None or odometry is None else correction @ odometry

    def velocity(self) -> Velocity:
        """The body's velocity over the last _VELOCITY_NS of odometry; standstill where that is not known.

        Taken from the transforms, which have to be heard anyway: the odometry's own topic would wake the executor another
        fifty times a second for nothing else.
        """
        tree = self._listener.tree
        try:
            newest = tree.newest_ns(graph.ODOM_FRAME, graph.BASE_FRAME)
            if newest is None:
                return STANDSTILL
            now = plane_pose(tree.lookup(graph.ODOM_FRAME, graph.BASE_FRAME, newest))
            before = plane_pose(tree.lookup(graph.ODOM_FRAME, graph.BASE_FRAME, newest - _VELOCITY_NS))
        except TransformUnavailable:
            return STANDSTILL
        motion = before.inverse() @ now
        # Seen from halfway through the turn, the motion along the arc points where the body did.
        half = Pose2(0.0, 0.0, -0.5 * motion.yaw).apply(motion.x, motion.y)
        scale = 1e9 / _VELOCITY_NS
        vx, vy, wz = (v if abs(v) >= self._threshold else 0.0 for v in (half[0] * scale, half[1] * scale, motion.yaw * scale))
        return vx, vy, wz

    def blind(self) -> str | None:
        """Why the lidar can't be trusted, or None."""
        return self._health.reason(self._now_s())

    def scan_age_s(self) -> float:
        """How old the local costmap's picture is."""
        return self._health.age_s(self._now_s())

    def _forget_a_past(self, pose: Pose2 | None) -> None:
        """After a jump of the clock backwards the tree's newest transforms are from a future that never comes."""
        now_s = self._now_s()
        if pose is not None:
            self._lost_since_s = None
        elif self._lost_since_s is None:
            self._lost_since_s = now_s
        elif now_s - self._lost_since_s > 0.5:
            self._listener.tree.clear()
            self._lost_since_s = now_s

    # -- the lidar -----------------------------------------------------------------------------------------------------
    def update_local(self) -> tuple[Scan, BeamPoses] | None:
        """Take the newest scan into the local costmap; returns it with its poses in the odometry frame, if it was good."""
        base = self.odom_from_base()
        if base is None:
            return None
        self._local.roll_to(base.x, base.y)
        taken = self._newest_scan(base)
        if taken is not None:
            self._local.observe(*taken)
        self.local = self._local.snapshot(base)
        return taken

    def _newest_scan(self, base: Pose2) -> tuple[Scan, BeamPoses] | None:
        data, self._scan_bytes = self._scan_bytes, None
        if data is None:
            self._health.silent()
            return None
        message = deserialize_message(data, self._scan_type)
        scan = scan_from_message(message)
        if not self._health.take(scan, base, self._now_s()):
            return None
        try:
            frame = message.header.frame_id
            first = self._sensor_pose(frame, scan.stamp_ns)
            last = self._sensor_pose(frame, scan.stamp_ns + int(scan.duration_s * 1e9)) if scan.duration_s > 0.0 else first
        except TransformUnavailable as error:
            self._node.get_logger().warning(f"scan not used: {error}", throttle_duration_sec=5.0)
            return None
        return scan, BeamPoses(first, last)

    def _sensor_pose(self, frame: str, stamp_ns: int) -> Pose2:
        tree = self._listener.tree
        newest = tree.newest_ns(graph.ODOM_FRAME, frame)
        if newest is not None and newest < stamp_ns <= newest + _AHEAD_NS:
            stamp_ns = newest
        return plane_pose(tree.lookup(graph.ODOM_FRAME, frame, stamp_ns))
