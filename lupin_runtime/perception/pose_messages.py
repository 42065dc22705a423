"""Transforms as the messages and plane poses that the perception nodes exchange."""

from __future__ import annotations

from geometry_msgs.msg import Point, Pose, Quaternion

from lupin_runtime.transforms import Transform


def transform_pose_message(transform: Transform) -> Pose:
    """A geometry_msgs Pose."""
    (x, y, z), (qx, qy, qz, qw) = transform.translation, transform.rotation
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))
