"""Conversion between the arm's trajectories and their messages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from lupin_runtime.arm.trajectory import VELOCITY_HINT, Point
from lupin_runtime.graph import ARM_JOINTS


def trajectory_message(path: Sequence[Point]) -> JointTrajectory:
    """Return the message of a path of all four joints."""
    message = JointTrajectory(joint_names=list(ARM_JOINTS))
    for point in path:
        row = JointTrajectoryPoint(positions=list(point.arm), velocities=[VELOCITY_HINT] * len(point.arm))
        row.time_from_start.sec = int(point.t_s)
        row.time_from_start.nanosec = min(999_999_999, round((point.t_s - int(point.t_s)) * 1e9))
        message.points.append(row)
    return message


def poses_of(message: Any) -> list[tuple[float, ...]]:
    """Return the positions (rad) of a JointTrajectory's points, as they are: a message from the network may have any number.

    They are in the order of ARM_JOINTS if the message has exactly these joints.
    """
    names = list(message.joint_names)
    order = [names.index(joint) for joint in ARM_JOINTS] if sorted(names) == sorted(ARM_JOINTS) else []
    poses = []
    for point in message.points:
        positions = tuple(point.positions)
        poses.append(tuple(positions[i] for i in order) if len(positions) == len(order) else positions)
    return poses


def path_of(message: Any) -> tuple[Point, ...]:
    """Return the path of a JointTrajectory; empty if it is not one of all four joints, or has times that do not increase."""
    poses = poses_of(message)
    times_s = [point.time_from_start.sec + point.time_from_start.nanosec / 1e9 for point in message.points]
    if any(len(pose) != len(ARM_JOINTS) or not all(map(math.isfinite, pose)) for pose in poses):
        return ()
    if sorted(message.joint_names) != sorted(ARM_JOINTS) or any(a >= b for a, b in zip((0.0, *times_s), times_s)):
        return ()
    return tuple(Point(t_s, (pan, lift, elbow, wrist)) for t_s, (pan, lift, elbow, wrist) in zip(times_s, poses))
