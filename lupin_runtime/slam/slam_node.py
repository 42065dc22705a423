"""The mapping core on the graph, under slam_toolbox's name, topics, services and parameters."""

from __future__ import annotations

import math
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan

from lupin_runtime import graph
from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.geometry import Pose2, quaternion_from_yaw
from lupin_runtime.gridmap import GridMap
from lupin_runtime.ros import LupinNode, TransformBroadcaster, TransformListener, stamp_ns
from lupin_runtime.ros.lifecycle import serve_state
from lupin_runtime.ros.plane_messages import grid_message
from lupin_runtime.ros.tf import to_message
from lupin_runtime.scan_health import ScanHealth
from lupin_runtime.slam.map_io import save_map
from lupin_runtime.slam.mapper import Mapper, ScanResult
from lupin_runtime.slam.parameters import TABLE, mapper_settings
from lupin_runtime.slam.scan import beams_of
from lupin_runtime.slam.session import MappingSession, load_session, save_session
from lupin_runtime.transforms import Transform, TransformTree, TransformUnavailable

Array = NDArray[np.floating]

SESSION_PERIOD_S = 5.0
# A larger step back means that the clock was set; a smaller one is jitter between publishers.
LEFT_OUT_PERIOD_S = 10.0  # between warnings about scans that are too far away to be drawn
CLOCK_STEP_NS = 200_000_000
# Errors of a path from a request: unknown user (~name), empty name, full disk, malformed file.
_UNUSABLE_PATH = (OSError, ValueError, RuntimeError)
# More than the mapper moves per scan, since a published map should be complete.
MOVES_PER_MAP = 60


def map_message(grid: GridMap, frame: str, time_ns: int) -> OccupancyGrid:
    """Convert a grid to an OccupancyGrid."""
    return grid_message(grid.cells, grid.resolution_m, (grid.origin_x, grid.origin_y), frame, time_ns)


class SlamNode(LupinNode):
    """Subscribes to `/scan` and odom -> base_link; publishes `/map` and map -> odom."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("slam_toolbox", parameters)
        p = {row.name: self.parameter(row.name, row.default) for row in TABLE}
        self._p = p
        self._settings = mapper_settings(p)
        self._odom_frame, self._base_frame, self._map_frame = p["odom_frame"], p["base_frame"], p["map_frame"]
        self._timeout_ns = int(p["transform_timeout"] * 1e9)
        self._tree = TransformTree(keep_s=float(p["tf_buffer_duration"]))
        self._mapper = Mapper(self._settings)
        self._map_from_odom: Pose2 | None = None
        self._waiting: deque[tuple[LaserScan, int]] = deque(maxlen=max(1, int(p["scan_buffer_size"])))
        self._scans = 0
        self._paused = False
        self._newest_ns = 0
        self._last_stamp_ns = 0
        self._step_rad = 0.01
        self._health = ScanHealth.GOOD
        self._map_now = False
        self._session: MappingSession | None = None
        self._resume()
        self._broadcaster = TransformBroadcaster(self)
        self._map_publisher = self.publisher(graph.MAP)
        TransformListener(self, self._tree)
        scans = graph.Topic(p["scan_topic"], graph.SCAN.type, graph.SCAN.qos)
        self.subscription(scans, self._on_scan)
        self.create_timer(p["transform_publish_period"], self._tick)
        self.create_timer(p["map_update_interval"], self._publish_map)
        if p["session_file"]:
            self.create_timer(SESSION_PERIOD_S, self._save_session)
        self.service(graph.SLAM_SAVE_MAP, self._save_map)
        self.service(graph.SLAM_RESET, self._reset)
        self.service(graph.SLAM_PAUSE, self._pause)
        self.service(graph.SLAM_SERIALIZE, self._serialize)
        self.service(graph.SLAM_DESERIALIZE, self._deserialize)
        self.service(graph.SLAM_DYNAMIC_MAP, self._get_map)
        serve_state(self, graph.SLAM_STATE, lambda: True)

    # -- scans -----------------------------------------------------------------------------------------------------------

    def _on_scan(self, scan: LaserScan) -> None:
        self._scans += 1
        if self._paused or self._scans % max(1, int(self._p["throttle_scans"])):
            return
        stamp = stamp_ns(scan.header.stamp)
        if stamp < self._last_stamp_ns - CLOCK_STEP_NS:
            self._clock_stepped(f"a scan is {(self._last_stamp_ns - stamp) / 1e9:.1f} s older than the one before")
        if stamp <= self._last_stamp_ns:
            return
        self._waiting.append((scan, self.elapsed_clock_ns()))
        self._process_waiting()

    def _process_waiting(self) -> None:
        """Map the scans whose time the odometry has reached; drop those that waited too long."""
        while self._waiting:
            scan, since = self._waiting[0]
            stamp = stamp_ns(scan.header.stamp)
            try:
                newest = self._tree.newest_ns(self._odom_frame, self._base_frame)
                missing = "" if newest is None or newest >= stamp else "the odometry does not reach the scan's time"
            except TransformUnavailable as error:
                missing = str(error)
            if missing:
                if self.elapsed_clock_ns() - since > self._timeout_ns:
                    self._waiting.popleft()
                    self.get_logger().warning(f"scan dropped: {missing}", throttle_duration_sec=5.0)
                    continue
                return
            self._waiting.popleft()
            try:
                self._map_scan(scan, stamp)
            except TransformUnavailable as error:
                self.get_logger().error(f"scan in frame {scan.header.frame_id!r} dropped: {error}", throttle_duration_sec=5.0)
            except ValueError as error:
                self.get_logger().error(f"scan dropped: {error}", throttle_duration_sec=5.0)

    def _map_scan(self, scan: LaserScan, stamp: int) -> None:
        mount = self._tree.lookup(self._base_frame, scan.header.frame_id)
        beams = beams_of(scan, mount, self._p["min_laser_range"], self._p["max_laser_range"])
        odom = self._tree.lookup(self._odom_frame, self._base_frame, stamp).to_pose2()
        ranges = np.frombuffer(scan.ranges, np.float32).astype(float)
        beam_s = float(scan.time_increment)
        beam_s = beam_s if math.isfinite(beam_s) and 0.0 < beam_s * beams.count < 1.0 else 0.0
        twist = self._twist(stamp, beam_s * beams.count) if beam_s else None
        if self._session is not None:
            x, y, yaw = (float(value) for value in self._session.map_from_odom)
            pose = Pose2(x, y, yaw) @ odom
            self._mapper = Mapper.resumed(self._settings, self._session.graph, np.array([pose.x, pose.y, pose.yaw]))
            self._session, self._map_now = None, True
        step = self._mapper.process(stamp / 1e9, odom, ranges, beams, twist, beam_s)
        self._last_stamp_ns = stamp
        self._step_rad = abs(beams.angle_step)
        self._log_result(step)
        if self._mapper.anchored_pose is not None:
            x, y, yaw = (float(value) for value in step.pose)
            self._map_from_odom = Pose2(x, y, yaw) @ odom.inverse()
        if step.keyframe == 0 or self._map_now:
            self._map_now = False
            self._publish_map()

    def _twist(self, stamp: int, during_s: float) -> tuple[float, float, float] | None:
        """The robot's velocity during a scan, from the odometry around it; None without odometry."""
        newest = self._tree.newest_ns(self._odom_frame, self._base_frame) or stamp
        end = min(newest, stamp + int(during_s * 1e9))
        begin = stamp if end - stamp > 20_000_000 else stamp - 60_000_000
        try:
            a = self._tree.lookup(self._odom_frame, self._base_frame, begin).to_pose2()
            b = self._tree.lookup(self._odom_frame, self._base_frame, end).to_pose2()
        except TransformUnavailable:
            return None
        motion, seconds = a.inverse() @ b, (end - begin) / 1e9
        return motion.x / seconds, motion.y / seconds, motion.yaw / seconds

    def _log_result(self, step: ScanResult) -> None:
        log = self.get_logger()
        if step.health in (ScanHealth.BLIND, ScanHealth.FROZEN):
            log.warning(f"using odometry alone: {step.health.value}", throttle_duration_sec=5.0)
        elif self._health in (ScanHealth.BLIND, ScanHealth.FROZEN) and step.health is ScanHealth.GOOD:
            log.info("scans are usable again")
        if step.health is not ScanHealth.REPEATED:
            self._health = step.health
        if step.health is ScanHealth.GOOD and not step.matched and self._settings.use_matching:
            log.warning("a scan does not fit the map; using odometry alone", throttle_duration_sec=5.0)
        if step.odometry_jumped:
            log.warning("the odometry jumped; its motion was ignored", throttle_duration_sec=5.0)

    # -- output ----------------------------------------------------------------------------------------------------------

    def _tick(self) -> None:
        now = self.now_ns()
        if now < self._newest_ns - CLOCK_STEP_NS:
            self._clock_stepped(f"the clock went back by {(self._newest_ns - now) / 1e9:.1f} s")
        self._newest_ns = now
        self._process_waiting()
        if self._map_from_odom is None:
            return
        # Dated ahead, as slam_toolbox does, so that a lookup at "now" finds a transform before and one after it.
        pose = self._map_from_odom
        transform = Transform((pose.x, pose.y, 0.0), quaternion_from_yaw(pose.yaw))
        self._broadcaster.send(to_message(self._map_frame, self._odom_frame, now + self._timeout_ns, transform))

    def _publish_map(self) -> None:
        if self._mapper.occupancy is not None:
            self._mapper.occupancy.work(MOVES_PER_MAP)
            if left_out := self._mapper.occupancy.left_out:
                self.get_logger().warning(
                    f"{left_out} scans are not on the map: by their poses they are too far away; is the odometry wrong?",
                    throttle_duration_sec=LEFT_OUT_PERIOD_S,
                )
        grid = self._mapper.grid()
        if grid is not None:
            self._map_publisher.publish(map_message(grid, self._map_frame, self.now_ns()))

    def _clock_stepped(self, what: str) -> None:
        """Clear the buffers, whose stamps are invalid now; keep the map."""
        self.get_logger().warning(f"{what}: buffers are cleared, the map is kept")
        self._tree.clear()
        self._waiting.clear()
        self._last_stamp_ns = 0
        self._newest_ns = 0

    # -- services --------------------------------------------------------------------------------------------------------

    def _save_map(self, request: Any, response: Any) -> Any:
        grid = self._mapper.grid()
        if grid is None:
            response.result = response.RESULT_NO_MAP_RECEIEVD
            return response
        name = request.name.data or "map"
        try:
            save_map(_with_suffix(name, ".yaml"), grid)
            response.result = response.RESULT_SUCCESS
        except _UNUSABLE_PATH as error:
            self.get_logger().error(f"a map cannot be written to {name!r}: {error}")
            response.result = response.RESULT_UNDEFINED_FAILURE
        return response

    def _get_map(self, _request: Any, response: Any) -> Any:
        """Return the present map, not the last one that was published; 0 x 0 cells before the first scan."""
        grid = self._mapper.grid()
        if grid is not None:
            response.map = map_message(grid, self._map_frame, self.now_ns())
        return response

    def _reset(self, request: Any, response: Any) -> Any:
        self._mapper = Mapper(self._settings)
        self._map_from_odom = self._session = None
        self._paused = bool(request.pause_new_measurements)
        if self._p["session_file"]:
            Path(self._p["session_file"]).unlink(missing_ok=True)
        self.get_logger().info("the map was cleared; the next scan starts a new one")
        response.result = response.RESULT_SUCCESS
        return response

    def _pause(self, _request: Any, response: Any) -> Any:
        self._paused = not self._paused
        response.status = self._paused
        return response

    def _serialize(self, request: Any, response: Any) -> Any:
        try:
            self._write_session(_with_suffix(request.filename, ".posegraph"))
            response.result = response.RESULT_SUCCESS
        except _UNUSABLE_PATH as error:
            self.get_logger().error(f"the graph cannot be written: {error}")
            response.result = response.RESULT_FAILED_TO_WRITE_FILE
        return response

    def _deserialize(self, request: Any, response: Any) -> Any:
        """Load a graph. The response has no fields: if that fails, the present map is kept, and only the log says why."""
        try:
            session = load_session(_with_suffix(request.filename, ".posegraph"))
        except _UNUSABLE_PATH as error:
            self.get_logger().error(f"the graph was not loaded: {error}")
            return response
        pose = session.graph.poses[0].copy()
        if request.match_type in (request.START_AT_GIVEN_POSE, request.LOCALIZE_AT_POSE):
            at = request.initial_pose
            pose = np.array([at.x, at.y, at.theta])
        self._mapper = Mapper.resumed(self._settings, session.graph, pose)
        self._map_from_odom = None
        self._map_now = True
        return response

    # -- sessions: mapping resumes after a restart -----------------------------------------------------------------------

    def _write_session(self, path: Path) -> None:
        if self._mapper.anchored_pose is None or self._map_from_odom is None:
            raise ValueError("there is no map yet")
        pose = self._map_from_odom
        save_session(path, self._mapper.graph, np.array([pose.x, pose.y, pose.yaw]), self._step_rad)

    def _save_session(self) -> None:
        try:
            self._write_session(Path(self._p["session_file"]))
        except ValueError:
            return
        except OSError as error:
            self.get_logger().warning(f"the session cannot be saved: {error}", throttle_duration_sec=60.0)

    def _resume(self) -> None:
        """Load the saved session: odometry continued while this node was down, so map -> odom is still valid."""
        path = Path(self._p["session_file"])
        if not self._p["session_file"] or not path.exists():
            return
        try:
            session = load_session(path)
        except (MalformedFile, OSError) as error:
            self.get_logger().error(f"the session was not loaded, mapping starts with an empty map: {error}")
            return
        self._session = session
        self.get_logger().info(f"mapping resumes from {path}: {len(session.graph)} keyframes")


def _with_suffix(name: str, suffix: str) -> Path:
    """Return a request's path with the suffix, which the request may omit. Raises one of _UNUSABLE_PATH."""
    path = Path(name).expanduser()
    return path if path.suffix == suffix else path.with_name(path.name + suffix)
