"""Scans and odometry out of an MCAP recording of the robot's graph.

The one place outside nodes that needs rclpy: messages were recorded as the middleware's bytes, and its type support reads them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, yaw_from_quaternion
from lupin_runtime.slam.files import MalformedFile
from lupin_runtime.slam.offline import OfflineScan
from lupin_runtime.slam.scan import Beams
from lupin_runtime.transforms import Transform, TransformTree, TransformUnavailable

# Transforms of the whole recording are kept: scans are placed when all of it is read.
_WHOLE_RECORDING_S = 1e8


@dataclass(frozen=True)
class Recording:
    """Scans with the odometry of their moment, and what could not be used."""

    scans: list[OfflineScan]
    problems: list[str]


def pose2_of(transform: Transform) -> Pose2:
    """A transform as seen from above."""
    return Pose2(transform.translation[0], transform.translation[1], yaw_from_quaternion(*transform.rotation))


def read_recording(path: Path, range_min_m: float = 0.25, range_max_m: float = 12.0) -> Recording:
    """Read `/scan`, `/tf_static` and the odometry (its topic, or `/tf`) of a recording.

    Raises MalformedFile where the file is no MCAP or lacks one of them, OSError.
    """
    from mcap.exceptions import McapError
    from mcap.reader import make_reader

    tree = TransformTree(keep_s=_WHOLE_RECORDING_S)
    scans: list[Any] = []
    problems: list[str] = []
    topics = [graph.SCAN.name, graph.TF.name, graph.TF_STATIC.name, graph.ODOM.name]
    has_odometry = False
    try:
        with path.open("rb") as stream:
            for schema, channel, record in make_reader(stream).iter_messages(topics=topics):
                message = _decode(schema.name if schema else "", record.data)
                if channel.topic == graph.SCAN.name:
                    scans.append(message)
                elif channel.topic == graph.ODOM.name:
                    has_odometry = True
                    pose = message.pose.pose
                    _insert(tree, graph.ODOM_FRAME, graph.BASE_FRAME, message.header.stamp, pose.position, pose.orientation)
                else:
                    for item in message.transforms:
                        if channel.topic == graph.TF.name and (item.header.frame_id != graph.ODOM_FRAME or has_odometry):
                            continue  # other frames do not matter here, and the odometry topic goes first
                        t = item.transform
                        _insert(
                            tree, item.header.frame_id, item.child_frame_id, item.header.stamp, t.translation, t.rotation,
                            channel.topic == graph.TF_STATIC.name,
                        )  # fmt: skip
    except (McapError, EOFError) as error:
        raise MalformedFile(path, None, f"expected an MCAP recording: {error}") from None
    if not scans:
        raise MalformedFile(path, None, f"the recording has no {graph.SCAN.name}")
    result = []
    for message in scans:
        try:
            result.append(_scan(tree, message, range_min_m, range_max_m))
        except (TransformUnavailable, ValueError) as error:
            problems.append(str(error))
    if not result:
        raise MalformedFile(path, None, f"no scan can be placed: {problems[0]}")
    return Recording(result, problems)


def _decode(type_name: str, data: bytes) -> Any:
    from rclpy.serialization import deserialize_message

    from lupin_runtime.ros.node import interface

    return deserialize_message(data, interface(type_name))


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _insert(tree: TransformTree, parent: str, child: str, stamp: Any, t: Any, q: Any, static: bool = False) -> None:
    tree.insert(parent, child, _ns(stamp), Transform((t.x, t.y, t.z), (q.x, q.y, q.z, q.w)), static)


def _scan(tree: TransformTree, message: Any, range_min_m: float, range_max_m: float) -> OfflineScan:
    stamp = _ns(message.header.stamp)
    odom = tree.lookup(graph.ODOM_FRAME, graph.BASE_FRAME, stamp)
    mount = tree.lookup(graph.BASE_FRAME, message.header.frame_id)
    beams = Beams(
        float(message.angle_min),
        float(message.angle_increment),
        len(message.ranges),
        pose2_of(mount),
        max(range_min_m, float(message.range_min)),
        min(range_max_m, float(message.range_max)),
    )
    seconds, rest = divmod(stamp, 1_000_000_000)
    return OfflineScan(f"{seconds}.{rest:09d}", stamp / 1e9, pose2_of(odom), np.asarray(message.ranges, dtype=float), beams)
