"""The mapping core on the graph, under slam_toolbox's name, topics, services and parameters."""

from __future__ import annotations

import math
from array import array
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, quaternion_from_yaw, yaw_from_quaternion
from lupin_runtime.gridmap import GridMap
from lupin_runtime.ros import LupinNode, TransformBroadcaster, TransformListener, stamp_from_ns, stamp_ns
from lupin_runtime.ros.tf import to_message
from lupin_runtime.slam.files import MalformedFile
from lupin_runtime.slam.map_io import save_map
from lupin_runtime.slam.mapper import Mapper, Step
from lupin_runtime.slam.parameters import TABLE, mapper_settings
from lupin_runtime.slam.scan import Beams, Health
from lupin_runtime.slam.session import Session, load_session, save_session
from lupin_runtime.transforms import Transform, TransformTree, TransformUnavailable

Array = NDArray[np.floating]

SESSION_PERIOD_S = 5.0
# A clock that steps back further than this has been set; less is jitter between publishers.
CLOCK_STEP_NS = 200_000_000
# What a path out of a request may end in: no such user, no name, no space, no file of that kind.
_UNUSABLE_PATH = (OSError, ValueError, RuntimeError)
# More than the mapper moves per scan, since a map that is about to be seen should be whole.
MOVES_PER_MAP = 60


def grid_message(grid: GridMap, frame: str, time_ns: int) -> OccupancyGrid:
    """An OccupancyGrid of a grid."""
    message = OccupancyGrid()
    message.header.frame_id = frame
    message.header.stamp = message.info.map_load_time = stamp_from_ns(time_ns)
    message.info.resolution = grid.resolution_m
    message.info.width, message.info.height = grid.width, grid.height
    message.info.origin.position.x, message.info.origin.position.y = grid.origin_x, grid.origin_y
    message.info.origin.orientation.w = 1.0
    cells = array("b")
    cells.frombytes(np.ascontiguousarray(grid.cells).tobytes())
    message.data = cells
    return message


def pose2_of(transform: Transform) -> Pose2:
    """A transform as seen from above."""
    return Pose2(transform.translation[0], transform.translation[1], yaw_from_quaternion(*transform.rotation))


class LaserMount:
    """Reads scans as beams on the robot: where the laser sits comes from TF, once per frame."""

    def __init__(self, tree: TransformTree, base_frame: str) -> None:
        self._tree, self._base_frame = tree, base_frame
        self._mounts: dict[str, Pose2] = {}

    def beams(self, scan: LaserScan, range_min_m: float, range_max_m: float) -> Beams:
        """The beams of a scan. Raises TransformUnavailable for a frame that nobody publishes, ValueError for no angles."""
        frame = scan.header.frame_id
        if frame not in self._mounts:
            self._mounts[frame] = pose2_of(self._tree.lookup(self._base_frame, frame))
        return Beams(
            float(scan.angle_min),
            float(scan.angle_increment),
            len(scan.ranges),
            self._mounts[frame],
            max(range_min_m, float(scan.range_min)),
            min(range_max_m, float(scan.range_max)) if scan.range_max > 0.0 else range_max_m,
        )


class SlamNode(LupinNode):
    """`/scan` and odom -> base_link in; `/map` and map -> odom out."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("slam_toolbox", parameters)
        p = {row.name: self.parameter(row.name, row.default) for row in TABLE}
        self._p = p
        self._settings = mapper_settings(p)
        self._odom_frame, self._base_frame, self._map_frame = p["odom_frame"], p["base_frame"], p["map_frame"]
        self._timeout_ns = int(p["transform_timeout"] * 1e9)
        self._tree = TransformTree(keep_s=float(p["tf_buffer_duration"]))
        self._mount = LaserMount(self._tree, self._base_frame)
        self._mapper = Mapper(self._settings)
        self._map_from_odom: Pose2 | None = None
        self._waiting: deque[tuple[LaserScan, int]] = deque(maxlen=max(1, int(p["scan_buffer_size"])))
        self._scans = 0
        self._paused = False
        self._newest_ns = 0
        self._last_stamp_ns = 0
        self._step_rad = 0.01
        self._health = Health.GOOD
        self._map_now = False
        self._session: Session | None = None
        self._resume()
        self._broadcaster = TransformBroadcaster(self)
        self._map_publisher = self.publisher(graph.MAP)
        TransformListener(self, self._tree)
        scans = graph.Topic(p["scan_topic"], graph.SCAN.type, graph.SCAN.qos)
        self.subscription(scans, self._take_scan)
        self.create_timer(p["transform_publish_period"], self._tick)
        self.create_timer(p["map_update_interval"], self._publish_map)
        if p["session_file"]:
            self.create_timer(SESSION_PERIOD_S, self._keep_session)
        self.service(graph.SLAM_SAVE_MAP, self._save_map)
        self.service(graph.SLAM_RESET, self._reset)
        self.service(graph.SLAM_PAUSE, self._pause)
        self.service(graph.SLAM_SERIALIZE, self._serialize)
        self.service(graph.SLAM_DESERIALIZE, self._deserialize)

    # -- scans -----------------------------------------------------------------------------------------------------------

    def _take_scan(self, scan: LaserScan) -> None:
        self._scans += 1
        if self._paused or self._scans % max(1, int(self._p["throttle_scans"])):
            return
        stamp = stamp_ns(scan.header.stamp)
        if stamp < self._last_stamp_ns - CLOCK_STEP_NS:
            self._clock_stepped(f"a scan is {(self._last_stamp_ns - stamp) / 1e9:.1f} s older than the one before")
        if stamp <= self._last_stamp_ns:
            return
        self._waiting.append((scan, self.elapsed_clock_ns()))
        self._drain()

    def _drain(self) -> None:
        """Take the scans whose moment the odometry has reached; give up those that waited in vain."""
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
        beams = self._mount.beams(scan, self._p["min_laser_range"], self._p["max_laser_range"])
        odom = pose2_of(self._tree.lookup(self._odom_frame, self._base_frame, stamp))
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
        self._tell(step)
        if self._mapper.place is not None:
            x, y, yaw = (float(value) for value in step.pose)
            self._map_from_odom = Pose2(x, y, yaw) @ odom.inverse()
        if step.keyframe == 0 or self._map_now:
            self._map_now = False
            self._publish_map()

    def _twist(self, stamp: int, during_s: float) -> tuple[float, float, float] | None:
        """The robot's velocity over a scan, from what odometry there is around it."""
        newest = self._tree.newest_ns(self._odom_frame, self._base_frame) or stamp
        end = min(newest, stamp + int(during_s * 1e9))
        begin = stamp if end - stamp > 20_000_000 else stamp - 60_000_000
        try:
            a = pose2_of(self._tree.lookup(self._odom_frame, self._base_frame, begin))
            b = pose2_of(self._tree.lookup(self._odom_frame, self._base_frame, end))
        except TransformUnavailable:
            return None
        motion, seconds = a.inverse() @ b, (end - begin) / 1e9
        return motion.x / seconds, motion.y / seconds, motion.yaw / seconds

    def _tell(self, step: Step) -> None:
        log = self.get_logger()
        if step.health in (Health.BLIND, Health.FROZEN):
            log.warning(f"going by odometry alone: {step.health.value}", throttle_duration_sec=5.0)
        elif self._health in (Health.BLIND, Health.FROZEN) and step.health is Health.GOOD:
            log.info("scans are usable again")
        if step.health is not Health.REPEATED:
            self._health = step.health
        if step.health is Health.GOOD and not step.matched and self._settings.use_matching:
            log.warning("a scan fits nowhere near; going by odometry", throttle_duration_sec=5.0)
        if step.odometry_jumped:
            log.warning("the odometry leapt; its step was left out", throttle_duration_sec=5.0)

    # -- output ----------------------------------------------------------------------------------------------------------

    def _tick(self) -> None:
        now = self.now_ns()
        if now < self._newest_ns - CLOCK_STEP_NS:
            self._clock_stepped(f"the clock went back by {(self._newest_ns - now) / 1e9:.1f} s")
        self._newest_ns = now
        self._drain()
        if self._map_from_odom is None:
            return
        # Dated ahead, as slam_toolbox does: who looks up "now" finds a transform on either side of it.
        pose = self._map_from_odom
        transform = Transform((pose.x, pose.y, 0.0), quaternion_from_yaw(pose.yaw))
        self._broadcaster.send(to_message(self._map_frame, self._odom_frame, now + self._timeout_ns, transform))

    def _publish_map(self) -> None:
        if self._mapper.occupancy is not None:
            self._mapper.occupancy.work(MOVES_PER_MAP)
        grid = self._mapper.grid()
        if grid is not None:
            self._map_publisher.publish(grid_message(grid, self._map_frame, self.now_ns()))

    def _clock_stepped(self, what: str) -> None:
        """Stamps from before mean nothing now: forget the buffers, keep the map."""
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

    def _reset(self, request: Any, response: Any) -> Any:
        self._mapper = Mapper(self._settings)
        self._map_from_odom = self._session = None
        self._paused = bool(request.pause_new_measurements)
        if self._p["session_file"]:
            Path(self._p["session_file"]).unlink(missing_ok=True)
        self.get_logger().info("the map was cleared; the next scan starts a new one")
        response.result = response.RESULT_SUCCESS
        return response

    def _pause(self, request: Any, response: Any) -> Any:
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
        try:
            session = load_session(_with_suffix(request.filename, ".posegraph"))
        except FileNotFoundError:
            response.result = response.RESULT_INVALID_FILENAME
            return response
        except _UNUSABLE_PATH as error:
            self.get_logger().error(str(error))
            response.result = response.RESULT_FAILED_TO_READ_FILE
            return response
        pose = session.graph.poses[0].copy()
        if request.match_type in (request.START_AT_GIVEN_POSE, request.LOCALIZE_AT_POSE):
            at, q = request.initial_pose.position, request.initial_pose.orientation
            pose = np.array([at.x, at.y, yaw_from_quaternion(q.x, q.y, q.z, q.w)])
        self._mapper = Mapper.resumed(self._settings, session.graph, pose)
        self._map_from_odom = None
        self._map_now = True
        response.result = response.RESULT_SUCCESS
        return response

    # -- going on after a restart ------------------------------------------------------------------------------------------

    def _write_session(self, path: Path) -> None:
        if self._mapper.place is None or self._map_from_odom is None:
            raise ValueError("there is no map yet")
        pose = self._map_from_odom
        save_session(path, self._mapper.graph, np.array([pose.x, pose.y, pose.yaw]), self._step_rad)

    def _keep_session(self) -> None:
        try:
            self._write_session(Path(self._p["session_file"]))
        except ValueError:
            return
        except OSError as error:
            self.get_logger().warning(f"the session cannot be kept: {error}", throttle_duration_sec=60.0)

    def _resume(self) -> None:
        """Go on with the kept session: the odometry ran on while this node was away, so map -> odom still holds."""
        path = Path(self._p["session_file"])
        if not self._p["session_file"] or not path.exists():
            return
        try:
            session = load_session(path)
        except (MalformedFile, OSError) as error:
            self.get_logger().error(f"mapping starts anew: {error}")
            return
        self._session = session
        self.get_logger().info(f"mapping goes on from {path}: {len(session.graph)} keyframes")


def _with_suffix(name: str, suffix: str) -> Path:
    """A path from a request, with the suffix that it may leave out. Raises one of _UNUSABLE_PATH."""
    path = Path(name).expanduser()
    return path if path.suffix == suffix else path.with_name(path.name + suffix)
