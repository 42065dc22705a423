"""Converts the mission's values to ROS messages and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from geometry_msgs.msg import Pose
from lupin_msgs.msg import MissionState, Observation, SensorReading

from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.records import ClimateReading, MapPose, MissionSnapshot, ObservationRecord
from lupin_runtime.ros import stamp_from_ns, stamp_ns

# A pose whose orientation.w is 0 means "unknown" on this graph. A half turn has w = 0 too, and gets this value instead.
_SMALLEST_W = 1e-9


def snapshot_message(snapshot: MissionSnapshot, now_ns: int, frame_id: str) -> MissionState:
    """Convert a snapshot to MissionState, whose fields have the same names."""
    message = MissionState()
    message.header.stamp = stamp_from_ns(now_ns)
    message.header.frame_id = frame_id
    for name, value in vars(snapshot).items():
        if name == "started_at_ns":
            message.started_at = stamp_from_ns(value)
        else:
            setattr(message, name, value)
    return message


def observation_message(record: ObservationRecord, now_ns: int, frame_id: str) -> Observation:
    """Convert an observation; without a pose, all fields of the message's pose are zero, including orientation.w."""
    message = Observation()
    message.header.stamp = stamp_from_ns(now_ns)
    message.header.frame_id = frame_id
    message.mission_id = record.mission_id
    message.source = record.source
    message.kind = Observation.KIND_TAG_READING
    message.status = record.status
    message.status_detail = record.detail
    # Set even without a reading: no other field holds the tag's id.
    message.tag_reading.tag_id = record.tag_id
    if record.reading is not None:
        message.tag_reading.stamp = stamp_from_ns(record.reading.stamp_ns)
        message.tag_reading.sim_time_of_day_seconds = record.reading.sim_time_s
        message.tag_reading.readings = [SensorReading(name=n, value=v) for n, v in record.reading.values]
    message.tag_pose_in_map = map_pose_message(record.pose)
    return message


def map_pose_message(pose: MapPose | None) -> Pose:
    """Convert a pose; None becomes the zero pose, which means "unknown"."""
    message = Pose()
    p, q = message.position, message.orientation
    if pose is None:
        q.w = 0.0
        return message
    p.x, p.y, p.z = pose.x, pose.y, pose.z
    q.x, q.y, q.z, q.w = pose.qx, pose.qy, pose.qz, pose.qw
    if q.x == q.y == q.z == q.w == 0.0:
        q.w = 1.0
    elif abs(q.w) < _SMALLEST_W:
        q.w = _SMALLEST_W
    return message


def map_pose(message: Pose) -> MapPose:
    """Convert a geometry_msgs/Pose."""
    p, q = message.position, message.orientation
    return MapPose(p.x, p.y, p.z, q.x, q.y, q.z, q.w)


def climate_reading(response: Any) -> ClimateReading:
    """Convert a GetTagReading response."""
    tag = response.reading
    return ClimateReading(
        int(response.status),
        response.error_message,
        tuple((sensor.name, float(sensor.value)) for sensor in tag.readings),
        stamp_ns(tag.stamp),
        float(tag.sim_time_of_day_seconds),
    )


def grid_map(message: Any) -> GridMap | None:
    """Convert an OccupancyGrid; None if it is empty, has fewer cells than announced, or an invalid resolution."""
    info = message.info
    cells = np.frombuffer(message.data, np.int8) if len(message.data) else np.empty(0, np.int8)
    if info.width * info.height == 0 or cells.size < info.width * info.height:
        return None
    try:
        return GridMap(
            cells[: info.width * info.height].reshape(info.height, info.width),
            float(info.resolution),
            float(info.origin.position.x),
            float(info.origin.position.y),
        )
    except ValueError:
        return None
