"""The mission's values as messages of the graph, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from geometry_msgs.msg import Pose, PoseStamped
from lupin_msgs.msg import MissionState, Observation, SensorReading

from lupin_runtime.geometry import Pose2, quaternion_from_yaw
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.approach import TagPose
from lupin_runtime.mission.ports import MissionSnapshot, ObservationRecord, Reading
from lupin_runtime.ros import stamp_from_ns, stamp_ns

# Entries of the row-major 6x6 covariance that measure a planar pose: x, y, yaw.
_PLANAR_VARIANCES = (0, 7, 35)
# A pose whose orientation.w is 0 means "not known" on this graph. A half turn has w = 0 too: it gets this much instead.
_SMALLEST_W = 1e-9


def snapshot_message(snapshot: MissionSnapshot, now_ns: int, frame_id: str) -> MissionState:
    """MissionState of a snapshot; the field names are the same."""
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
    """The observation of a tag: its pose is zero, w included, where none is attached."""
    message = Observation()
    message.header.stamp = stamp_from_ns(now_ns)
    message.header.frame_id = frame_id
    message.mission_id = record.mission_id
    message.source = record.source
    message.kind = Observation.KIND_TAG_READING
    message.status = record.status
    message.status_detail = record.detail
    # Also where there is no reading: nothing else says which tag it was.
    message.tag_reading.tag_id = record.tag_id
    if record.reading is not None:
        message.tag_reading.stamp = stamp_from_ns(record.reading.stamp_ns)
        message.tag_reading.sim_time_of_day_seconds = record.reading.sim_time_s
        message.tag_reading.readings = [SensorReading(name=n, value=v) for n, v in record.reading.values]
    message.tag_pose_in_map = pose_message(record.pose)
    return message


def pose_message(pose: TagPose | None) -> Pose:
    """A pose, or the zero pose that means "not known"."""
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


def tag_pose(message: Pose) -> TagPose:
    """A geometry_msgs/Pose as a value."""
    p, q = message.position, message.orientation
    return TagPose(p.x, p.y, p.z, q.x, q.y, q.z, q.w)


def planar_variances(message: Any) -> tuple[float, ...]:
    """The variances of x, y and yaw of a PoseWithCovarianceStamped."""
    return tuple(float(message.pose.covariance[index]) for index in _PLANAR_VARIANCES)


def goal_message(pose: Pose2, now_ns: int, frame_id: str) -> PoseStamped:
    """A navigation goal."""
    message = PoseStamped()
    message.header.stamp = stamp_from_ns(now_ns)
    message.header.frame_id = frame_id
    message.pose.position.x, message.pose.position.y = pose.x, pose.y
    q = message.pose.orientation
    q.x, q.y, q.z, q.w = quaternion_from_yaw(pose.yaw)
    return message


def reading(response: Any) -> Reading:
    """What a GetTagReading response says."""
    tag = response.reading
    return Reading(
        int(response.status),
        response.error_message,
        tuple((sensor.name, float(sensor.value)) for sensor in tag.readings),
        stamp_ns(tag.stamp),
        float(tag.sim_time_of_day_seconds),
    )


def grid_map(message: Any) -> GridMap | None:
    """The map of an OccupancyGrid; None for one that is empty, too short for its size, or has no usable scale."""
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
