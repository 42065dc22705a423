"""Localization on a saved map, under AMCL's name, topics and parameters."""

from __future__ import annotations

import math
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan

from lupin_runtime import graph
from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.geometry import Pose2, quaternion_from_yaw, yaw_from_quaternion
from lupin_runtime.gridmap import GridMap
from lupin_runtime.ros import LupinNode, TransformBroadcaster, TransformListener, stamp_from_ns, stamp_ns
from lupin_runtime.ros.lifecycle import serve_state
from lupin_runtime.ros.tf import to_message
from lupin_runtime.scan_health import ScanHealth, ScanJudge
from lupin_runtime.slam.amcl import Amcl, AmclSettings, Belief
from lupin_runtime.slam.likelihood_field import LikelihoodFieldParameters
from lupin_runtime.slam.lost_robot import LostRobot, lost_belief
from lupin_runtime.slam.relocation import Relocation, relocate
from lupin_runtime.slam.saved_localization import SAVE_PERIOD_S, SavedLocalization, load_localization
from lupin_runtime.slam.scan import MIN_POINTS, ScanReader, beams_of
from lupin_runtime.slam.slam_node import CLOCK_STEP_NS
from lupin_runtime.transforms import Transform, TransformTree, TransformUnavailable, frame_name

Array = NDArray[np.floating]

# Nav2's covariance of an initial pose without one (m², m², rad²).
INITIAL_COVARIANCE = np.diag([0.25, 0.25, 0.068])
# Scans that are used after an initial pose although the robot has not moved, so that a resting robot is localized too.
FIRST_SCANS = 4
# A lost robot is searched for this often, and only while it moves less than this between two scans.
SEARCH_PERIOD_NS = 2_000_000_000
REST_M, REST_RAD = 0.01, 0.01
# How well a found robot's pose is known (m², m², rad²); its next scans refine it.
FOUND_COVARIANCE = np.diag([0.05**2, 0.05**2, 0.03**2])


class AmclNode(LupinNode):
    """Subscribes to `/map`, `/scan` and odom -> base_link; publishes `/amcl_pose` and map -> odom.

    If the map does not explain the scans any more, the robot is lost: `/amcl_pose` has the covariance of any place on the map,
    and map -> odom ends, so whatever needs the robot's place stops. It is searched for at rest.

    A process that replaces another one goes on where that one ended, by `state_file`, or begins with a lost robot: the initial
    pose is that of the run's start, from which the robot has driven away.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("amcl", parameters)
        self._declare()
        self._tree = TransformTree()
        self._reader, self._judge = ScanReader(), ScanJudge()
        self._grid: GridMap | None = None
        self._filter: Amcl | None = None
        self._start: tuple[Array, Array] | None = None
        self._lost_robot = LostRobot()
        self._searcher = ThreadPoolExecutor(1, "relocation")
        self._running: tuple[Future[Relocation], Pose2] | None = None  # a search, and the odometry of its scan
        self._searched_ns = 0
        self._first_scans = 0
        self._scan: LaserScan | None = None
        self._odom: Pose2 | None = None
        self._map_from_odom: Pose2 | None = None
        self._last_stamp_ns = 0
        self._saved_ns = 0  # when the state was saved, on the monotonic clock
        self._broadcaster = TransformBroadcaster(self)
        self._pose_publisher = self.publisher(graph.AMCL_POSE)
        self._replaced = self._load_state()
        if self._initial is not None and self._replaced is None:
            self._begin(self._initial, INITIAL_COVARIANCE)
        TransformListener(self, self._tree)
        self.subscription(graph.MAP, self._on_map)
        self.subscription(graph.INITIAL_POSE, self._on_initial_pose)
        self.subscription(graph.Topic(self._scan_topic, graph.SCAN.type, graph.SCAN.qos), self._on_scan)
        # Clients of Nav2 wait for this before they publish the initial pose, without which there is no localization.
        serve_state(self, graph.AMCL_STATE, lambda: True)
        # A scan arrives before the odometry of its time: try again soon.
        self.create_timer(0.02, self._process_newest)

    def _declare(self) -> None:
        p = self.parameter
        self._base_frame = p("base_frame_id", graph.BASE_FRAME)
        self._map_frame = p("global_frame_id", graph.MAP_FRAME)
        self._odom_frame = p("odom_frame_id", graph.ODOM_FRAME)
        self._scan_topic = p("scan_topic", graph.SCAN.name)
        self._state_file = p("state_file", "")
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
        if frame_name(message.header.frame_id) not in ("", self._map_frame):
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
            self._last_stamp_ns = self._searched_ns = 0
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
            start, self._start, self._replaced = self._start, None, None
            self._lost_robot, self._running = LostRobot(), None
            self._restart(*start, odom)
        elif self._replaced is not None:
            replaced, self._replaced = self._replaced, None
            self._resume(replaced, odom, stamp)
        if not self._filter.started or self._odom is None:
            self.get_logger().warning(f"no initial pose yet: publish {graph.INITIAL_POSE.name}", throttle_duration_sec=10.0)
            return
        step = self._odom.inverse() @ odom
        motion = np.array([step.x, step.y, step.yaw])
        if self._lost_robot.lost:
            self._odom = odom
            self._search(scan, odom, motion, stamp)
            return
        if self._first_scans or self._filter.is_due(motion):
            self._first_scans = max(0, self._first_scans - 1)
            self._filter.predict(motion)
            self._odom = odom
            belief = self._update(scan, odom)
            if self._lost_robot.judge(belief, motion):
                self._searched_ns = stamp
                self.get_logger().error(
                    f"the robot is lost: the map explains {belief.explained:.0%} of the scan. It is searched for while it"
                    f" rests; or show it where it is, on the console's map or by {graph.INITIAL_POSE.name}"
                )
                self._publish(lost_belief(belief, self._filter.field.grid), odom, stamp)
                self._save_state()
                return
            self._publish(belief, odom, stamp)
        if time.monotonic_ns() - self._saved_ns >= SAVE_PERIOD_S * 1e9:
            self._save_state()
        self._broadcast(stamp)

    def _restart(self, pose: Array, covariance: Array, odom: Pose2) -> None:
        assert self._filter is not None
        self._filter.start(pose, covariance)
        self._odom, self._first_scans = odom, FIRST_SCANS
        self._saved_ns = 0  # the next pose is saved at once

    # -- a replaced process ----------------------------------------------------------------------------------------------

    def _load_state(self) -> SavedLocalization | None:
        """Return what the process before this one knew; None if there was none."""
        path = Path(self._state_file)
        if not self._state_file or not path.exists():
            return None
        try:
            return load_localization(path)
        except (MalformedFile, OSError) as error:
            self.get_logger().error(f"the robot's place was not loaded: {error}")
            return SavedLocalization(Pose2(), True, 0)

    def _resume(self, replaced: SavedLocalization, odom: Pose2, stamp: int) -> None:
        """Begin where odometry has led since the process before this one, or with a lost robot."""
        assert self._filter is not None
        usable = replaced.is_usable(time.monotonic_ns())
        pose = replaced.map_from_odom @ odom
        self._lost_robot = LostRobot(lost=not usable)
        self._restart(np.array([pose.x, pose.y, pose.yaw]), INITIAL_COVARIANCE, odom)
        if usable:
            self.get_logger().info(f"localization goes on at ({pose.x:.2f}, {pose.y:.2f}), {math.degrees(pose.yaw):.0f}°")
            return
        self.get_logger().error("the robot is lost since before this process began; it is searched for while it rests")
        self._publish(lost_belief(self._filter.belief(), self._filter.field.grid), odom, stamp)

    def _save_state(self) -> None:
        if not self._state_file or self._map_from_odom is None:
            return
        self._saved_ns = time.monotonic_ns()
        try:
            SavedLocalization(self._map_from_odom, self._lost_robot.lost, self._saved_ns).save(Path(self._state_file))
        except OSError as error:
            self.get_logger().warning(f"the robot's place is not saved: {error}", throttle_duration_sec=60.0)

    # -- the search for a lost robot -------------------------------------------------------------------------------------

    def _search(self, scan: LaserScan, odom: Pose2, motion: Array, stamp: int) -> None:
        """Search for the lost robot while it rests. A search may take seconds on a large map, so it has its own thread."""
        assert self._filter is not None
        self._lost_robot.move(motion)
        self._filter.predict(motion)
        if self._running is not None:
            if self._running[0].done():
                (future, searched_from), self._running = self._running, None
                self._end_search(future.result(), searched_from, stamp)
            return
        rests = float(np.hypot(motion[0], motion[1])) <= REST_M and abs(float(motion[2])) <= REST_RAD
        if not rests or stamp < self._searched_ns + SEARCH_PERIOD_NS:
            return
        self._searched_ns = stamp
        points = self._read(scan, odom)
        if points is not None:
            self._running = self._searcher.submit(relocate, self._filter.field, points, self._lost_robot.expected), odom

    def _end_search(self, found: Relocation, searched_from: Pose2, stamp: int) -> None:
        assert self._filter is not None and self._odom is not None
        if found.refusal:
            self.get_logger().warning(f"the robot is still lost: {found.refusal}", throttle_duration_sec=10.0)
            self._publish(lost_belief(self._filter.belief(), self._filter.field.grid), self._odom, stamp)
            return
        x, y, yaw = found.pose
        self.get_logger().info(
            f"the robot was found at ({x:.2f}, {y:.2f}), {math.degrees(yaw):.0f}°: "
            f"the map explains {found.explained:.0%} of the scan"
        )
        self._lost_robot.found()
        self._restart(found.pose, FOUND_COVARIANCE, searched_from)

    def _read(self, scan: LaserScan, odom: Pose2) -> Array | None:
        """Return the scan's end points (b, 2) in the robot's frame, or None for one that must not be used."""
        mount = self._tree.lookup(self._base_frame, scan.header.frame_id)
        beams = beams_of(scan, mount, self._range_min_m, self._range_max_m)
        ranges = np.frombuffer(scan.ranges, np.float32).astype(float)
        points = self._reader.read(beams, ranges)
        health = self._judge.judge(ranges, len(points) >= MIN_POINTS, odom)
        if health in (ScanHealth.GOOD, ScanHealth.REPEATED):
            return points.xy
        self.get_logger().warning(f"using odometry alone: {health.value}", throttle_duration_sec=5.0)
        return None

    def _update(self, scan: LaserScan, odom: Pose2) -> Belief:
        assert self._filter is not None
        points = self._read(scan, odom)
        return self._filter.belief() if points is None else self._filter.correct(points)

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

    def before_shutdown(self) -> None:
        """Start no further search."""
        self._searcher.shutdown(wait=False, cancel_futures=True)
