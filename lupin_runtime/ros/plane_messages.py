"""Messages of plane poses and grids, which several nodes publish."""

from __future__ import annotations

from array import array

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2, quaternion_from_yaw
from lupin_runtime.ros.stamps import stamp_from_ns


def plane_pose_message(pose: Pose2, time_ns: int, frame: str) -> PoseStamped:
    """Convert a plane pose to a PoseStamped."""
    message = PoseStamped()
    message.header.stamp = stamp_from_ns(time_ns)
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = pose.x, pose.y
    q = message.pose.orientation
    q.x, q.y, q.z, q.w = quaternion_from_yaw(pose.yaw)
    return message


def grid_message(
    cells: NDArray[np.int8], resolution_m: float, origin: tuple[float, float], frame: str, time_ns: int
) -> OccupancyGrid:
    """Convert cells (height, width) to an OccupancyGrid; `origin` is the outer corner of cell (0, 0), m."""
    message = OccupancyGrid()
    message.header.frame_id = frame
    message.header.stamp = message.info.map_load_time = stamp_from_ns(time_ns)
    message.info.resolution = resolution_m
    message.info.height, message.info.width = cells.shape
    message.info.origin.position.x, message.info.origin.position.y = origin
    message.info.origin.orientation.w = 1.0
    data = array("b")
    data.frombytes(np.ascontiguousarray(cells).tobytes())
    message.data = data
    return message
