"""Transforms as the messages and plane poses that the perception nodes exchange."""

from __future__ import annotations

from geometry_msgs.msg import Point, Pose, Quaternion

from lupin_runtime.geometry import Pose2, yaw_from_quaternion
from lupin_runtime.transforms import Transform


def pose_message(transform: Transform) -> Pose:
    """A geometry_msgs Pose."""
    (x, y, z), (qx, qy, qz, qw) = transform.translation, transform.rotation
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def pose_on_floor(transform: Transform) -> Pose2:
    """The transform's part in the plane."""
    x, y, _ = transform.translation
    return Pose2(x, y, yaw_from_quaternion(*transform.rotation))
