"""Localization on a saved map, under AMCL's name, topics and parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, quaternion_from_yaw, yaw_from_quaternion
from lupin_runtime.gridmap import GridMap
from lupin_runtime.ros import LupinNode, TransformBroadcaster, TransformListener, stamp_from_ns, stamp_ns
from lupin_runtime.ros.tf import to_message
from lupin_runtime.scan_health import ScanHealth, ScanJudge
from lupin_runtime.slam.amcl import Amcl, AmclSettings, Belief
from lupin_runtime.slam.likelihood_field import LikelihoodFieldParameters
from lupin_runtime.slam.scan import MIN_POINTS, ScanReader
from lupin_runtime.slam.slam_node import CLOCK_STEP_NS, LaserMount
from lupin_runtime.transforms import Transform, TransformTree, TransformUnavailable

Array = NDArray[np.floating]

# Nav2's covariance of an initial pose without one (m², m², rad²).
INITIAL_COVARIANCE = np.diag([0.25, 0.25, 0.068])
# Scans that are used after an initial pose although the robot has not moved, so that a resting robot is localized too.
FIRST_SCANS = 4


class AmclNode(LupinNode):
    """Subscribes to `/map`, `/scan` and odom -> base_link; publishes `/amcl_pose` and map -> odom."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("amcl", parameters)
        self._declare()
        self._tree = TransformTree()
        self._mount = LaserMount(self._tree, self._base_frame)
        self._reader, self._judge = ScanReader(), ScanJudge()
        self._grid: GridMap | None = None
        self._filter: Amcl | None = None
        self._start: tuple[Array, Array] | None = None
        self._first_scans = 0
        self._scan: LaserScan | None = None
        self._odom: Pose2 | None = None
        self._map_from_odom: Pose2 | None = None
        self._last_stamp_ns = 0
        self._broadcaster = TransformBroadcaster(self)
        self._pose_publisher = self.publisher(graph.AMCL_POSE)
        if self._initial is not None:
            self._begin(self._initial, INITIAL_COVARIANCE)
        TransformListener(self, self._tree)
        self.subscription(graph.MAP, self._on_map)
        self.subscription(graph.INITIAL_POSE, self._on_initial_pose)
        self.subscription(graph.Topic(self._scan_topic, graph.SCAN.type, graph.SCAN.qos), self._on_scan)
        # A scan arrives before the odometry of its time: try again soon.
        self.create_timer(0.02, self._process_newest)

    def _declare(self) -> None:
        p = self.parameter
        self._base_frame = p("base_frame_id", graph.BASE_FRAME)
        self._map_frame = p("global_frame_id", graph.MAP_FRAME)
        self._odom_frame = p("odom_frame_id", graph.ODOM_FRAME)
        self._scan_topic = p("scan_topic", graph.SCAN.name)
        self._tolerance_ns = int(p("transform_tolerance", 1.0) * 1e9)
        self._tf_broadcast = p("tf_broadcast", True)
        for name, only in (("robot_model_type", "nav2_amcl::OmniMotionModel"), ("laser_model_type", "likelihood_field")):
            if (asked := p(name, only)) != only:
                self.get_logger().warning(f"{name} {asked!r} is not supported: {only} is used")
        self._range_min_m, self._range_max_m = p("laser_min_range", 0.25), p("laser_max_range", 12.0)
        likelihood_field = LikelihoodFieldParameters(
            p("z_hit", 0.5), p("z_rand", 0.5), p("sigma_hit", 0.2), p("laser_likelihood_max_dist", 2.0), self._range_max_m
        )
        self._settings = AmclSettings(
            alpha=(p("alpha1", 0.2), p("alpha2", 0.2), p("alpha3", 0.2), p("alpha4", 0.2), p("alpha5", 0.2)),
            min_particles=p("min_particles", 500),
            max_particles=p("max_particles", 2000),
            max_beams=p("max_beams", 60),
            update_min_d=p("update_min_d", 0.25),
            update_min_a=p("update_min_a", 0.2),
            resample_interval=p("resample_interval", 1),
            pf_err=p("pf_err", 0.05),
            likelihood_field=likelihood_field,
        )
        pose = np.array([p("initial_pose.x", 1.0527), p("initial_pose.y", 0.509611), p("initial_pose.yaw", 0.0)])
        self._initial = pose if p("set_initial_pose", True) else None

    # -- input -----------------------------------------------------------------------------------------------------------

    def _on_map(self, message: OccupancyGrid) -> None:
        try:
            cells = np.frombuffer(message.data, np.int8).reshape(message.info.height, message.info.width).copy()
            at = message.info.origin.position
            grid = GridMap(cells, float(message.info.resolution), at.x, at.y)
        except ValueError as error:
            self.get_logger().error(f"map ignored: {error}")
            return
        if self._grid is not None and self._is_same_map(self._grid, grid):
            return
        self._grid = grid
        self._filter = None
        if self._start is None and self._map_from_odom is not None and self._odom is not None:
            pose = self._map_from_odom @ self._odom
            self._begin(np.array([pose.x, pose.y, pose.yaw]), INITIAL_COVARIANCE)
        self.get_logger().info(f"map of {grid.width} x {grid.height} cells")

    @staticmethod
    def _is_same_map(a: GridMap, b: GridMap) -> bool:
        return (a.origin_x, a.origin_y, a.resolution_m) == (b.origin_x, b.origin_y, b.resolution_m) and np.array_equal(
            a.cells, b.cells
        )

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        if message.header.frame_id not in ("", self._map_frame):
            self.get_logger().error(f"initial pose in frame {message.header.frame_id!r} ignored: expected {self._map_frame!r}")
            return
        at, q = message.pose.pose.position, message.pose.pose.orientation
        stated = np.asarray(message.pose.covariance, float).reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]
        covariance = stated if np.isfinite(stated).all() and stated.trace() > 0.0 else INITIAL_COVARIANCE
        self._begin(np.array([at.x, at.y, yaw_from_quaternion(q.x, q.y, q.z, q.w)]), covariance)

    def _begin(self, pose: Array, covariance: Array) -> None:
        if not np.isfinite(pose).all():
            self.get_logger().error("initial pose ignored: it is not finite")
            return
        self._start = (pose, covariance)

    def _on_scan(self, scan: LaserScan) -> None:
        stamp = stamp_ns(scan.header.stamp)
        if stamp < self._last_stamp_ns - CLOCK_STEP_NS:
            self.get_logger().warning("the clock went back: buffers are cleared, the pose is kept")
            self._tree.clear()
            self._last_stamp_ns = 0
        if stamp > self._last_stamp_ns:
            self._scan = scan
            self._process_newest()

    # -- the filter ------------------------------------------------------------------------------------------------------

    def _process_newest(self) -> None:
        """Use the newest scan once the odometry has reached its time."""
        scan = self._scan
        if scan is None:
            return
        stamp = stamp_ns(scan.header.stamp)
        try:
            newest = self._tree.newest_ns(self._odom_frame, self._base_frame)
            if newest is not None and newest < stamp:
                return
            self._scan = None
            self._localize(scan, stamp)
        except TransformUnavailable as error:
            self.get_logger().warning(f"scan dropped: {error}", throttle_duration_sec=5.0)
        except ValueError as error:
            self._scan = None
            self.get_logger().error(f"scan dropped: {error}", throttle_duration_sec=5.0)

    def _localize(self, scan: LaserScan, stamp: int) -> None:
        self._last_stamp_ns = stamp
        odom = self._tree.lookup(self._odom_frame, self._base_frame, stamp).to_pose2()
        if self._grid is None:
            self.get_logger().warning(f"no {graph.MAP.name} yet", throttle_duration_sec=10.0)
            return
        if self._filter is None:
            self._filter = Amcl(self._grid, self._settings)
        if self._start is not None:
            start, self._start = self._start, None
            self._filter.start(*start)
            self._odom, self._first_scans = odom, FIRST_SCANS
        if not self._filter.started or self._odom is None:
            self.get_logger().warning(f"no initial pose yet: publish {graph.INITIAL_POSE.name}", throttle_duration_sec=10.0)
            return
        step = self._odom.inverse() @ odom
        motion = np.array([step.x, step.y, step.yaw])
        if self._first_scans or self._filter.is_due(motion):
            self._first_scans = max(0, self._first_scans - 1)
            self._filter.predict(motion)
            self._odom = odom
            self._publish(self._update(scan, odom), odom, stamp)
        self._broadcast(stamp)

    def _update(self, scan: LaserScan, odom: Pose2) -> Belief:
        assert self._filter is not None
        beams = self._mount.beams(scan, self._range_min_m, self._range_max_m)
        ranges = np.frombuffer(scan.ranges, np.float32).astype(float)
        points = self._reader.read(beams, ranges)
        health = self._judge.judge(ranges, len(points) >= MIN_POINTS, odom)
        if health in (ScanHealth.GOOD, ScanHealth.REPEATED):
            return self._filter.correct(points.xy)
        self.get_logger().warning(f"using odometry alone: {health.value}", throttle_duration_sec=5.0)
        return self._filter.belief()

    def _publish(self, belief: Belief, odom: Pose2, stamp: int) -> None:
        x, y, yaw = (float(value) for value in belief.pose)
        self._map_from_odom = Pose2(x, y, yaw) @ odom.inverse()
        message = PoseWithCovarianceStamped()
        message.header.frame_id = self._map_frame
        message.header.stamp = stamp_from_ns(stamp)
        message.pose.pose.position.x, message.pose.pose.position.y = x, y
        q = message.pose.pose.orientation
        q.x, q.y, q.z, q.w = quaternion_from_yaw(yaw)
        covariance = np.zeros((6, 6))
        covariance[np.ix_((0, 1, 5), (0, 1, 5))] = belief.covariance
        message.pose.covariance = covariance.ravel()
        self._pose_publisher.publish(message)

    def _broadcast(self, stamp: int) -> None:
        if self._map_from_odom is None or not self._tf_broadcast:
            return
        pose = self._map_from_odom
        transform = Transform((pose.x, pose.y, 0.0), quaternion_from_yaw(pose.yaw))
        self._broadcaster.send(to_message(self._map_frame, self._odom_frame, stamp + self._tolerance_ns, transform))
