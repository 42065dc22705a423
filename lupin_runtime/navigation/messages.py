"""Converts ROS messages to the core's values and back."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import OccupancyGrid, Path
from numpy.typing import NDArray
from visualization_msgs.msg import Marker, MarkerArray

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, yaw_from_quaternion
from lupin_runtime.gridmap import GridMap
from lupin_runtime.laser_scan import scan_geometry
from lupin_runtime.navigation.costmap import Costmap, RangeScan
from lupin_runtime.navigation.costmap.costs import OCCUPANCY_OF_COST
from lupin_runtime.navigation.planning.paths import headings
from lupin_runtime.ros import stamp_from_ns, stamp_ns
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.ros.markers import make_marker, marker_array
from lupin_runtime.ros.plane_messages import grid_message, plane_pose_message
from lupin_runtime.transforms import Transform

_MAX_CELLS = 64_000_000


def pose_from_message(message: PoseStamped) -> Pose2:
    """Return the pose in the message's frame. Raises ValueError for non-finite numbers or an invalid orientation."""
    p, q = message.pose.position, message.pose.orientation
    values = (p.x, p.y, q.x, q.y, q.z, q.w)
    if not all(map(math.isfinite, values)):
        raise ValueError(f"position ({p.x}, {p.y}) and orientation ({q.x}, {q.y}, {q.z}, {q.w}) must be finite")
    norm = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    if not 0.5 < norm < 2.0:
        raise ValueError(f"orientation ({q.x}, {q.y}, {q.z}, {q.w}) must be a unit quaternion")
    return Pose2(p.x, p.y, yaw_from_quaternion(q.x / norm, q.y / norm, q.z / norm, q.w / norm))


def path_message(points: NDArray[np.float64], goal_yaw: float, time_ns: int, stride: int = 1) -> Path:
    """Return a Path in the map frame with every `stride`-th point and the last one. It ends with the goal's heading."""
    kept = points[np.append(np.arange(0, len(points) - 1, stride), len(points) - 1)]
    message = Path()
    message.header.stamp = stamp_from_ns(time_ns)
    message.header.frame_id = graph.MAP_FRAME
    yaws = headings(kept)
    yaws[-1] = goal_yaw
    message.poses = [
        plane_pose_message(Pose2(float(x), float(y), float(yaw)), time_ns, graph.MAP_FRAME) for (x, y), yaw in zip(kept, yaws)
    ]
    return message


def twist_message(vx: float, vy: float, wz: float) -> Twist:
    """Return a Twist in the plane."""
    message = Twist()
    message.linear.x, message.linear.y, message.angular.z = vx, vy, wz
    return message


def duration_message(seconds: float) -> Duration:
    """Convert to a Duration; negative and non-finite values become zero."""
    if not math.isfinite(seconds) or seconds < 0.0:
        return Duration()
    whole = int(seconds)
    return Duration(sec=whole, nanosec=int((seconds - whole) * 1e9))


def scan_from_message(message: Any, base_from_laser: Transform) -> RangeScan:
    """Convert a LaserScan to a RangeScan. Raises TiltedLaser."""
    count = len(message.ranges)
    seen = scan_geometry(message, base_from_laser)
    return RangeScan(
        np.frombuffer(message.ranges, np.float32) if count else np.zeros(0, np.float32),
        seen.angle_min_rad,
        seen.angle_step_rad,
        seen.range_min_m,
        seen.range_max_m,
        stamp_ns(message.header.stamp),
        max(0.0, float(message.time_increment) * max(count - 1, 0)),
    )


def map_from_message(message: OccupancyGrid) -> GridMap:
    """Convert an OccupancyGrid. Raises ValueError if its sizes do not match, or its origin is rotated."""
    info = message.info
    cells = info.width * info.height
    if cells == 0 or cells > _MAX_CELLS or len(message.data) != cells:
        raise ValueError(f"{info.width} x {info.height} cells announced, {len(message.data)} sent")
    q = info.origin.orientation
    if abs(yaw_from_quaternion(q.x, q.y, q.z, q.w)) > 1e-3:
        raise ValueError("a map with a rotated origin is not supported; set the third value of origin in its YAML file to 0")
    grid = np.frombuffer(message.data, np.int8).reshape(info.height, info.width)
    return GridMap(grid, float(info.resolution), float(info.origin.position.x), float(info.origin.position.y))


def goal_markers(poses: Sequence[Pose2], time_ns: int) -> MarkerArray:
    """Return arrows at the poses of a goal, the last one opaque; they replace those of the goal before."""
    arrows = []
    for index, pose in enumerate(poses):
        opacity = 1.0 if index == len(poses) - 1 else 0.5
        arrow = make_marker("goal", index, Marker.ARROW, (0.35, 0.06, 0.06), (0.96, 0.65, 0.26, opacity))
        arrow.pose = plane_pose_message(pose, time_ns, graph.MAP_FRAME).pose
        arrows.append(arrow)
    return marker_array(graph.MAP_FRAME, stamp_from_ns(time_ns), arrows)


def raw_costmap_message(costmap: Costmap, frame: str, time_ns: int) -> Any:
    """Return a nav2_msgs/Costmap: the costs as they are."""
    message = interface("nav2_msgs/msg/Costmap")()
    message.header.frame_id = frame
    message.header.stamp = message.metadata.update_time = stamp_from_ns(time_ns)
    message.metadata.layer = "master"  # as Nav2 names the sum of its layers
    message.metadata.resolution = costmap.resolution_m
    message.metadata.size_y, message.metadata.size_x = costmap.cost.shape
    origin = message.metadata.origin
    origin.position.x, origin.position.y, origin.orientation.w = costmap.origin_x, costmap.origin_y, 1.0
    data = array("B")
    data.frombytes(np.ascontiguousarray(costmap.cost).tobytes())
    message.data = data
    return message


def costmap_message(costmap: Costmap, frame: str, time_ns: int) -> OccupancyGrid:
    """Return an OccupancyGrid of costs, scaled like those of Nav2's costmap publisher."""
    origin = (costmap.origin_x, costmap.origin_y)
    return grid_message(OCCUPANCY_OF_COST[costmap.cost], costmap.resolution_m, origin, frame, time_ns)
