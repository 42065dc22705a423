"""Builds a RunLog from the messages of a recording."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, yaw_from_quaternion
from lupin_runtime.gridmap import GridMap
from lupin_runtime.laser_scan import TiltedLaser, scan_geometry
from lupin_runtime.report.clearance import clearance_m
from lupin_runtime.report.link import LinkBuilder
from lupin_runtime.report.run_log import (
    CameraImage,
    ClockSample,
    DiscoveryEntry,
    LidarScan,
    LoggedFlower,
    LoggedPot,
    LogLine,
    MissionSample,
    ObservationEntry,
    Point,
    RunLog,
    TagPlacement,
    TwinTag,
)
from lupin_runtime.report.trajectory import TrajectoryBuilder
from lupin_runtime.transforms import Transform, frame_name
from lupin_runtime.twin.health import in_natural_unit

# The reader drops messages above these rates before it deserializes them.
RATES_HZ = {
    graph.ODOM.name: 5.0,
    graph.CMD_VEL_SINK_SIM.name: 5.0,
    graph.CMD_VEL_SINK_ROBOT.name: 5.0,
    graph.DISCOVERED_TAGS.name: 2.0,
    graph.BATTERY.name: 0.5,
}

OBSERVATION_KINDS = ("tag_reading", "flower", "anomaly")
OBSERVATION_STATUSES = ("ok", "unreachable", "scan_failed", "skipped")
_WARN = 30  # rcl_interfaces/Log
_SCAN_PERIOD_S = 1.0  # of the scans that are kept
_CLEARANCE_PERIOD_S = 0.2
_CLOCK_PERIOD_S = 1.0


class LogBuilder:
    """Collects messages, which must be added in the order of the recording."""

    def __init__(self) -> None:
        self.log = RunLog()
        self._path = TrajectoryBuilder()
        self._link = LinkBuilder()
        self._clearance_due_s = -math.inf
        self._started = False
        self._mount = Transform()
        self._handlers: dict[str, Callable[[float, Any], None]] = {
            graph.TF.name: self._add_transforms,
            graph.TF_STATIC.name: self._add_transforms,
            graph.MISSION_STATE.name: self._add_mission_state,
            graph.OBSERVATIONS.name: self._add_observation,
            graph.DISCOVERED_TAGS.name: self._add_discovered_tags,
            graph.TWIN_STATE.name: self._add_twin_state,
            graph.MAP.name: self._add_map,
            graph.BATTERY.name: self._add_battery,
            graph.ODOM.name: self._add_odometry,
            graph.CMD_VEL_SINK_SIM.name: self._add_command,
            graph.CMD_VEL_SINK_ROBOT.name: self._add_command,
            graph.ROSOUT.name: self._add_log_line,
            graph.SCAN.name: self._add_scan,
            graph.compressed(graph.BODY_IMAGE_SIM).name: self._add_body_image,
            graph.compressed(graph.BODY_IMAGE_ROBOT).name: self._add_body_image,
            graph.compressed(graph.GRIPPER_IMAGE).name: self._add_gripper_image,
        }

    @property
    def topics(self) -> frozenset[str]:
        """The topics that the report needs."""
        return frozenset(self._handlers)

    def add(self, topic: str, log_ns: int, publish_ns: int, message: Any) -> None:
        """Add a message. At its arrival, `log_ns` was ROS time and `publish_ns` the wall clock."""
        if not self._started:
            self._started = True
            self.log.start_ns = log_ns
        t_s = (log_ns - self.log.start_ns) / 1e9
        self.log.end_s = max(self.log.end_s, t_s)
        self._add_clocks(ClockSample(t_s, log_ns / 1e9, publish_ns / 1e9))
        handler = self._handlers.get(topic)
        if handler is not None:
            handler(t_s, message)

    def begin_recording(self) -> None:
        """Note that what is added from now on is of another recording."""
        self._link.interrupt()

    def build(self) -> RunLog:
        """Return the completed log."""
        self.log.trajectory = self._path.build()
        self.log.link = self._link.build(self.log.end_s)
        return self.log

    def _add_clocks(self, sample: ClockSample) -> None:
        clocks = self.log.clocks
        if not clocks or sample.wall_s - clocks[-1].wall_s >= _CLOCK_PERIOD_S:
            clocks.append(sample)

    # -- motion --------------------------------------------------------------------------------------------------------
    def _add_transforms(self, t_s: float, message: Any) -> None:
        for item in message.transforms:
            edge = (frame_name(item.header.frame_id), frame_name(item.child_frame_id))
            if edge not in _TRANSFORMS:
                continue
            t, q = item.transform.translation, item.transform.rotation
            pose = Pose2(t.x, t.y, yaw_from_quaternion(q.x, q.y, q.z, q.w))
            if not _finite(pose.x, pose.y, pose.yaw):
                continue
            if edge == _TRANSFORMS[0]:
                self._path.map_from_odom(t_s, pose)
            elif edge == _TRANSFORMS[1]:
                stamp_s = _stamp_s(item.header.stamp)
                self._path.odom_from_base(t_s, stamp_s, pose)
                self._link.pose(t_s, stamp_s - self.log.start_ns / 1e9, pose.x, pose.y)
            else:
                self.log.base_from_laser = pose
                self._mount = Transform((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))

    def _add_odometry(self, t_s: float, message: Any) -> None:
        self.log.speed.append((t_s, *_speed(message.twist.twist)))

    def _add_command(self, t_s: float, message: Any) -> None:
        self.log.command.append((t_s, *_speed(message)))

    def _add_scan(self, t_s: float, message: Any) -> None:
        self._link.scan(t_s, _stamp_s(message.header.stamp) - self.log.start_ns / 1e9)
        if self._clearance_due_s - _CLEARANCE_PERIOD_S <= t_s < self._clearance_due_s - 1e-6:
            return
        self._clearance_due_s = t_s + _CLEARANCE_PERIOD_S
        try:
            seen = scan_geometry(message, self._mount)
        except TiltedLaser:
            return
        ranges = np.array(message.ranges, dtype=np.float32)
        ranges[~((ranges >= seen.range_min_m) & (ranges <= seen.range_max_m))] = np.nan
        scan = LidarScan(t_s, seen.angle_min_rad, seen.angle_step_rad, ranges)
        if not self.log.scans or not 0.0 <= t_s - self.log.scans[-1].t_s < _SCAN_PERIOD_S - 1e-6:
            self.log.scans.append(scan)
        if self.log.base_from_laser is not None:
            nearest_m = clearance_m(scan.ranges, scan.angle_min, scan.angle_step, self.log.base_from_laser)
            if nearest_m is not None:
                self.log.clearance.append((t_s, nearest_m))

    def _add_map(self, t_s: float, message: Any) -> None:
        info = message.info
        cells = np.array(message.data, dtype=np.int8)
        if cells.size != info.width * info.height or not cells.size:
            return
        try:
            grid = GridMap(
                cells.reshape(info.height, info.width), info.resolution, info.origin.position.x, info.origin.position.y
            )
        except ValueError:
            return
        self.log.map = grid
        self.log.map_history.add(t_s, grid)
        self.log.known_area.append((t_s, float((cells >= 0).sum()) * grid.resolution_m**2))

    # -- mission -------------------------------------------------------------------------------------------------------
    def _add_mission_state(self, t_s: float, message: Any) -> None:
        log = self.log
        if message.mission_id:
            log.mission_id, log.mission_type = message.mission_id, message.mission_type
            log.totals = {
                "total": message.targets_total,
                "completed": message.targets_completed,
                "failed": message.targets_failed,
                "unreachable": message.targets_unreachable,
                "skipped": message.targets_skipped,
                "discovered": message.tags_discovered,
                "goal": message.discovery_goal,
            }
        sample = MissionSample(
            t_s,
            message.lifecycle_state,
            message.mission_phase,
            message.current_target,
            message.paused,
            message.estop_engaged,
            message.battery_low,
            message.last_error,
            message.last_event,
            message.last_event_severity,
        )
        if not log.mission or _without_time(sample) != _without_time(log.mission[-1]):
            log.mission.append(sample)

    def _add_observation(self, t_s: float, message: Any) -> None:
        kind = _name(OBSERVATION_KINDS, message.kind)
        flower = _pot_observation(message.flower) if kind == "flower" else None
        tag_id = message.flower.tag_id if flower is not None else message.tag_reading.tag_id
        if flower is not None:
            self.log.first_flower_s.setdefault(tag_id, t_s)
            if flower.footprint:
                self.log.first_box_s.setdefault(tag_id, t_s)
        self.log.observations.append(
            ObservationEntry(
                t_s,
                kind,
                _name(OBSERVATION_STATUSES, message.status),
                message.status_detail,
                message.source,
                tag_id or (self.log.mission[-1].target if self.log.mission else ""),
                _readings(message.tag_reading.readings),
                flower,
                _tag_pose(message.tag_pose_in_map),
            )
        )

    def _add_discovered_tags(self, t_s: float, message: Any) -> None:
        for tag in message.tags:
            before = self.log.discovered.get(tag.tag_id)
            self.log.discovered[tag.tag_id] = DiscoveryEntry(
                before.first_t_s if before is not None else t_s,
                _tag_pose(tag.pose_in_map),
                int(tag.sightings),
                tag.species,
                float(tag.species_confidence),
                bool(tag.anomaly),
            )

    def _add_twin_state(self, t_s: float, message: Any) -> None:
        for tag in message.tags:
            has_flowers = tag.species or tag.anomaly or tag.flowers or tag.flower_count or tag.bug_count
            footprint = _polygon(tag.box_footprint)
            if footprint:
                self.log.boxes[tag.tag_id] = footprint
                self.log.first_box_s.setdefault(tag.tag_id, t_s)
            if has_flowers:
                self.log.first_flower_s.setdefault(tag.tag_id, t_s)
            self.log.twin[tag.tag_id] = TwinTag(
                _tag_pose(tag.pose),
                _pot_observation(tag, tag.species_confidence) if has_flowers else None,
                _readings(tag.readings),
            )

    # -- other topics --------------------------------------------------------------------------------------------------
    def _add_battery(self, t_s: float, message: Any) -> None:
        if math.isfinite(message.percentage) and message.percentage >= 0.0:
            fraction = message.percentage / 100.0 if message.percentage > 1.0 else message.percentage
            self.log.battery.append((t_s, min(1.0, float(fraction))))

    def _add_log_line(self, t_s: float, message: Any) -> None:
        if message.level >= _WARN:
            self.log.lines.append(LogLine(t_s, int(message.level), message.name, message.msg))

    def _add_body_image(self, t_s: float, message: Any) -> None:
        self.log.body_images.append(CameraImage(t_s, bytes(message.data)))

    def _add_gripper_image(self, t_s: float, message: Any) -> None:
        self.log.gripper_images.append(CameraImage(t_s, bytes(message.data)))


_TRANSFORMS = (
    (graph.MAP_FRAME, graph.ODOM_FRAME),
    (graph.ODOM_FRAME, graph.BASE_FRAME),
    (graph.BASE_FRAME, graph.LASER_FRAME),
)


def _without_time(sample: MissionSample) -> tuple[Any, ...]:
    return tuple(getattr(sample, name) for name in sample.__dataclass_fields__ if name != "t_s")


def _stamp_s(stamp: Any) -> float:
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def _finite(*values: float) -> bool:
    return all(math.isfinite(value) for value in values)


def _name(names: tuple[str, ...], code: int) -> str:
    return names[code] if code < len(names) else f"unknown {code}"


def _speed(twist: Any) -> tuple[float, float]:
    """Return (linear speed in m/s, turn rate in rad/s)."""
    return math.hypot(twist.linear.x, twist.linear.y), float(twist.angular.z)


def _readings(readings: Any) -> tuple[tuple[str, float], ...]:
    return tuple((item.name, in_natural_unit(item.name, float(item.value))) for item in readings)


def _tag_pose(pose: Any) -> TagPlacement | None:
    """Convert a tag's pose, whose +z points out of the marker; None if its orientation marks it as unknown (w = 0)."""
    p, q = pose.position, pose.orientation
    if not q.w or not _finite(p.x, p.y, p.z, q.x, q.y, q.z, q.w):
        return None
    nx, ny = 2.0 * (q.x * q.z + q.w * q.y), 2.0 * (q.y * q.z - q.w * q.x)
    return TagPlacement(p.x, p.y, p.z, math.atan2(ny, nx) if math.hypot(nx, ny) >= 1e-6 else None)


def _polygon(polygon: Any) -> tuple[Point, ...]:
    points = tuple((float(p.x), float(p.y)) for p in polygon.points)
    return points if len(points) >= 3 and _finite(*(v for point in points for v in point)) else ()


def _pot_observation(message: Any, confidence: float | None = None) -> LoggedPot:
    placed = tuple(
        LoggedFlower(
            float(f.position.x), float(f.position.y), f.species, float(f.confidence), bool(f.anomaly), float(f.height_m)
        )
        for f in message.flowers
        if _finite(f.position.x, f.position.y)
    )
    return LoggedPot(
        message.species,
        float(message.confidence if confidence is None else confidence),
        bool(message.anomaly),
        int(message.flower_count),
        int(message.bug_count),
        placed,
        _polygon(message.box_footprint),
    )
