"""The state of the robot: recent transforms, velocity, lidar and local costmap."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.serialization import deserialize_message

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2
from lupin_runtime.laser_scan import TiltedLaser
from lupin_runtime.navigation.costmap import BeamPoses, Costmap, LocalCostmap, RangeScan
from lupin_runtime.navigation.lidar_monitor import LidarMonitor
from lupin_runtime.navigation.messages import scan_from_message
from lupin_runtime.navigation.recoveries import STANDSTILL, Velocity
from lupin_runtime.ros import LupinNode, TransformListener
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.transforms import TransformTree, TransformUnavailable

# A scan's stamp may be this much later than the newest received odometry.
_AHEAD_NS = 200_000_000

# Two periods of the odometry: long enough to average its jitter, short enough to follow the acceleration limits.
_VELOCITY_NS = 40_000_000


class _FreshTransform:
    """One chain of moving transforms; fresh while its newest stamp changes.

    The node's own clock measures the time between changes. Stamps are not compared with it: the robot's clock may differ,
    and a stamp from before a clock jump would look new forever.
    """

    def __init__(self, listener: TransformListener, target: str, source: str, timeout_s: float) -> None:
        self._tree = listener.tree
        self._target, self._source = target, source
        self._timeout_s = timeout_s
        self._newest: int | None = None
        self._changed_s = 0.0

    def pose(self, now_s: float) -> Pose2 | None:
        """Return the newest pose; None if it is unknown or has stopped changing."""
        try:
            newest = self._tree.newest_ns(self._target, self._source)
            transform = self._tree.lookup(self._target, self._source)
        except TransformUnavailable:
            return None
        if newest != self._newest or newest is None:
            self._newest, self._changed_s = newest, now_s
        return transform.to_pose2() if now_s - self._changed_s <= self._timeout_s else None


class RobotState:
    """Subscribes to /tf and /scan. Scans stay serialized until they are used, since more arrive than are used."""

    def __init__(
        self,
        node: LupinNode,
        local: LocalCostmap,
        now_s: Callable[[], float],
        transform_timeout_s: float,
        scan_timeout_s: float,
        velocity_threshold: float,
    ) -> None:
        self._node = node
        self._local = local
        self._now_s = now_s
        self._threshold = velocity_threshold
        self._listener = TransformListener(node)
        self._odometry_pose = _FreshTransform(self._listener, graph.ODOM_FRAME, graph.BASE_FRAME, transform_timeout_s)
        self._correction = _FreshTransform(self._listener, graph.MAP_FRAME, graph.ODOM_FRAME, transform_timeout_s)
        self._lost_since_s: float | None = None
        self._lidar = LidarMonitor(scan_timeout_s)
        self._scan_bytes: bytes | None = None
        self._scan_type = interface(graph.SCAN.type)
        self.local: Costmap | None = None
        node.subscription(graph.SCAN, self._on_scan, graph.BEST1, raw=True)

    @property
    def tree(self) -> TransformTree:
        """The transform tree."""
        return self._listener.tree

    def _on_scan(self, data: bytes) -> None:
        self._scan_bytes = data

    # -- the robot -----------------------------------------------------------------------------------------------------
    def odom_from_base(self) -> Pose2 | None:
        """Return the robot's pose in the odometry frame, if it is fresh."""
        pose = self._odometry_pose.pose(self._now_s())
        self._clear_stale_transforms(pose)
        return pose

    def map_from_odom(self) -> Pose2 | None:
        """Return the localization's correction, if it is fresh."""
        return self._correction.pose(self._now_s())

    def map_from_base(self) -> Pose2 | None:
        """Return the robot's pose in the map, if it is fresh."""
        correction, odometry = self.map_from_odom(), self.odom_from_base()
        return None if correction is None or odometry is None else correction @ odometry

    def velocity(self) -> Velocity:
        """Return the robot's velocity over the last _VELOCITY_NS of odometry; standstill if unknown.

        It comes from the transforms, which are needed anyway: a subscription to the odometry topic would wake the executor
        another fifty times a second.
        """
        tree = self._listener.tree
        try:
            newest = tree.newest_ns(graph.ODOM_FRAME, graph.BASE_FRAME)
            if newest is None:
                return STANDSTILL
            now = tree.lookup(graph.ODOM_FRAME, graph.BASE_FRAME, newest).to_pose2()
            before = tree.lookup(graph.ODOM_FRAME, graph.BASE_FRAME, newest - _VELOCITY_NS).to_pose2()
        except TransformUnavailable:
            return STANDSTILL
        motion = before.inverse() @ now
        # In the frame halfway through the turn, the chord of the arc has the direction of the body's velocity.
        half = Pose2(0.0, 0.0, -0.5 * motion.yaw).apply(motion.x, motion.y)
        scale = 1e9 / _VELOCITY_NS
        vx, vy, wz = (v if abs(v) >= self._threshold else 0.0 for v in (half[0] * scale, half[1] * scale, motion.yaw * scale))
        return vx, vy, wz

    def lidar_fault(self) -> str | None:
        """Return why the lidar cannot be trusted, or None."""
        return self._lidar.reason(self._now_s())

    def scan_age_s(self) -> float:
        """Return the age of the scan in the local costmap."""
        return self._lidar.age_s(self._now_s())

    def _clear_stale_transforms(self, pose: Pose2 | None) -> None:
        """Clear the tree after half a second without a fresh pose: after a clock jump its newest stamps are in the future."""
        now_s = self._now_s()
        if pose is not None:
            self._lost_since_s = None
        elif self._lost_since_s is None:
            self._lost_since_s = now_s
        elif now_s - self._lost_since_s > 0.5:
            self._listener.tree.clear()
            self._lost_since_s = now_s

    # -- the lidar -----------------------------------------------------------------------------------------------------
    def update_local(self) -> tuple[RangeScan, BeamPoses] | None:
        """Add the newest scan to the local costmap. Return it with the laser's poses in the odometry frame, or None."""
        base = self.odom_from_base()
        if base is None:
            return None
        self._local.roll_to(base.x, base.y)
        used = self._newest_scan(base)
        if used is not None:
            self._local.observe(*used)
        self.local = self._local.snapshot(base)
        return used

    def _newest_scan(self, base: Pose2) -> tuple[RangeScan, BeamPoses] | None:
        data, self._scan_bytes = self._scan_bytes, None
        if data is None:
            self._lidar.note_silence()
            return None
        message = deserialize_message(data, self._scan_type)
        frame = message.header.frame_id
        try:
            scan = scan_from_message(message, self._listener.tree.lookup(graph.BASE_FRAME, frame))
        except (TransformUnavailable, TiltedLaser) as error:
            self._lidar.refuse(str(error))
            return None
        try:
            first = self._sensor_pose(frame, scan.stamp_ns)
            last = self._sensor_pose(frame, scan.stamp_ns + int(scan.duration_s * 1e9)) if scan.duration_s > 0.0 else first
        except TransformUnavailable as error:
            # Before it is judged: the costmap stays without it, so the last good scan grows older.
            self._lidar.refuse(str(error))
            self._node.get_logger().warning(f"scan not used: {error}", throttle_duration_sec=5.0)
            return None
        return (scan, BeamPoses(first, last)) if self._lidar.accept(scan, base, self._now_s()) else None

    def _sensor_pose(self, frame: str, stamp_ns: int) -> Pose2:
        tree = self._listener.tree
        newest = tree.newest_ns(graph.ODOM_FRAME, frame)
        if newest is not None and newest < stamp_ns <= newest + _AHEAD_NS:
            stamp_ns = newest
        return tree.lookup(graph.ODOM_FRAME, frame, stamp_ns).to_pose2()
