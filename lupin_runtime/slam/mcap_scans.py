"""Reads scans and odometry from an MCAP recording of the robot's graph.

Recorded messages are serialized by the middleware: reading them needs its type support, and so rclpy.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from lupin_runtime import graph
from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.record.reader import NotARecording
from lupin_runtime.record.runs import RecordedRun, run_at
from lupin_runtime.slam.offline import OfflineScan
from lupin_runtime.slam.scan import beams_of
from lupin_runtime.transforms import Transform, TransformTree, TransformUnavailable, frame_name

# The tree keeps the transforms of the whole recording, since poses are looked up after all of it is read.
_WHOLE_RECORDING_S = 1e8


@dataclass(frozen=True)
class RecordedScans:
    """Scans with the odometry at their time, and the problems of those that could not be used."""

    scans: list[OfflineScan]
    problems: list[str]


def read_recording(path: Path, range_min_m: float = 0.25, range_max_m: float = 12.0) -> RecordedScans:
    """Read `/scan`, its mount (`/tf_static` or `/tf`) and the odometry (its topic, or `/tf`) of a recording.

    A damaged one is read as far as it is readable.
    `path` is a file, or the folder of a run or of rosbag2. Raises OSError, and MalformedFile if there is no MCAP, or it lacks
    one of the topics.
    """
    tree = TransformTree(keep_s=_WHOLE_RECORDING_S)
    scans: list[Any] = []
    problems: list[str] = []
    has_odometry = False
    fixed: set[str] = set()  # frames with a transform on /tf_static, which takes precedence over /tf
    moving: dict[str, list[Any]] = {}  # transforms of /tf by their child, of which only those of the lidar are needed
    try:
        run = run_at(path) or RecordedRun(path, (path,))
        recordings = run.open()
    except NotARecording as error:
        raise MalformedFile(path, None, str(error)) from None
    topics = (graph.SCAN.name, graph.TF.name, graph.TF_STATIC.name, graph.ODOM.name)
    for topic, _, _, message in chain.from_iterable(recording.messages(topics) for recording in recordings):
        if topic == graph.SCAN.name:
            scans.append(message)
            continue
        try:
            if topic == graph.ODOM.name:
                has_odometry = True
                pose = message.pose.pose
                _insert(tree, graph.ODOM_FRAME, graph.BASE_FRAME, message.header.stamp, pose.position, pose.orientation)
                continue
            static = topic == graph.TF_STATIC.name
            for item in message.transforms:
                t, parent = item.transform, frame_name(item.header.frame_id)
                child = frame_name(item.child_frame_id)
                # The odometry's own topic takes precedence over /tf.
                if static:
                    fixed.add(child)
                if static or (parent == graph.ODOM_FRAME and not has_odometry):
                    _insert(tree, parent, child, item.header.stamp, t.translation, t.rotation, static)
                elif child not in (graph.ODOM_FRAME, graph.BASE_FRAME):
                    moving.setdefault(child, []).append(item)
        except ValueError as error:
            problems.append(str(error))
    problems = run.damage() + [text for recording in recordings for text in recording.damage] + problems
    if not scans:
        raise MalformedFile(path, None, f"the recording has no {graph.SCAN.name}{_summary(problems)}")
    problems += _insert_mounts(
        tree,
        {child: items for child, items in moving.items() if child not in fixed},
        {frame_name(message.header.frame_id) for message in scans},
    )
    result = []
    for message in scans:
        try:
            result.append(_scan(tree, message, range_min_m, range_max_m))
        except (TransformUnavailable, ValueError) as error:
            problems.append(str(error))
    if not result:
        raise MalformedFile(path, None, f"no scan can be placed{_summary(problems)}")
    return RecordedScans(result, problems)


def _insert_mounts(tree: TransformTree, moving: dict[str, list[Any]], frames: set[str]) -> list[str]:
    """Insert the transforms of /tf by which `frames` are mounted, and return what is wrong with any."""
    problems = []
    wanted = set(frames)
    while wanted:
        for item in moving.pop(wanted.pop(), ()):
            t, parent = item.transform, frame_name(item.header.frame_id)
            wanted.add(parent)
            try:
                _insert(tree, parent, item.child_frame_id, item.header.stamp, t.translation, t.rotation)
            except ValueError as error:
                problems.append(str(error))
    return problems


def _summary(problems: list[str]) -> str:
    return f": {problems[0]}" if problems else ""


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _insert(tree: TransformTree, parent: str, child: str, stamp: Any, t: Any, q: Any, static: bool = False) -> None:
    tree.insert(parent, child, _ns(stamp), Transform((t.x, t.y, t.z), (q.x, q.y, q.z, q.w)), static)


def _scan(tree: TransformTree, message: Any, range_min_m: float, range_max_m: float) -> OfflineScan:
    stamp = _ns(message.header.stamp)
    odom = tree.lookup(graph.ODOM_FRAME, graph.BASE_FRAME, stamp)
    mount = tree.lookup(graph.BASE_FRAME, message.header.frame_id, stamp)
    beams = beams_of(message, mount, range_min_m, range_max_m)
    seconds, rest = divmod(stamp, 1_000_000_000)
    return OfflineScan(f"{seconds}.{rest:09d}", stamp / 1e9, odom.to_pose2(), np.asarray(message.ranges, dtype=float), beams)
