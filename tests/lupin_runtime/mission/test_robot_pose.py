"""Transforms that are looked up on demand."""

from __future__ import annotations

import math
import time
from typing import Any

import pytest

from lupin_runtime import graph
from lupin_runtime.geometry import quaternion_from_yaw
from lupin_runtime.mission.transform_age import TransformAge
from lupin_runtime.transforms import Transform


def test_transform_age_depends_on_changes_not_stamps() -> None:
    age = TransformAge()
    assert age.age_s(10, 100.0) == 0.0
    assert age.age_s(10, 101.5) == 1.5
    assert age.age_s(5, 102.0) == 0.0  # a stamp that went back is a change too
    assert age.age_s(5, 103.0) == 1.0
    assert age.age_s(None, 200.0) == 0.0


pytestmark = pytest.mark.graph


class TransformRig:
    def __init__(self, host: Any) -> None:
        from lupin_runtime.mission.robot_pose import PolledTransform
        from lupin_runtime.ros import LupinNode, TransformBroadcaster

        self.host = host
        self.node = host.add(LupinNode("frames"))
        self.broadcaster = TransformBroadcaster(self.node)
        listener = host.add(LupinNode("listener"))
        self.robot = PolledTransform(listener, "map", "base_link")
        host.until(lambda: self.node.count_subscribers(graph.TF.name), what="the subscription")

    def send(self, parent: str, child: str, transform: Transform, static: bool = False) -> None:
        from lupin_runtime.ros.tf import to_message

        message = to_message(parent, child, self.node.now_ns(), transform)
        (self.broadcaster.send_static if static else self.broadcaster.send)(message)


@pytest.fixture
def frames(graph_host: Any) -> TransformRig:
    return TransformRig(graph_host)


def test_lookup_chains_newest_transforms(frames: TransformRig) -> None:
    assert frames.robot.lookup() is None
    frames.send("mount", "base_link", Transform((0.0, 0.0, 0.1)), static=True)
    began_s = time.monotonic()
    for x in range(5):
        frames.send("map", "odom", Transform((10.0, 0.0, 0.0), quaternion_from_yaw(math.pi / 2)))
        frames.send("camera", "tag_7", Transform((9.0, 9.0, 9.0)))
        frames.send("odom", "mount", Transform((float(x), 0.0, 0.0)))

    def found() -> tuple[Transform, float] | None:
        pose = frames.robot.lookup()
        return pose if pose is not None and pose[0].translation == pytest.approx((10.0, 4.0, 0.1)) else None

    _, age_s = frames.host.until(found, what="the newest pose")
    assert 0.0 <= age_s < time.monotonic() - began_s


def test_lookup_after_flood_returns_newest(frames: TransformRig) -> None:
    from lupin_runtime.ros.tf import to_message

    for x in range(400):
        pair = [
            to_message("map", "odom", frames.node.now_ns(), Transform()),
            to_message("odom", "base_link", frames.node.now_ns(), Transform((float(x), 0.0, 0.0))),
        ]
        frames.broadcaster.send(*pair)
    frames.host.until(lambda: (look := frames.robot.lookup()) and look[0].translation[0] == 399.0, what="the newest pose")


def test_nan_transforms_and_frame_loops_give_no_pose(frames: TransformRig) -> None:
    frames.send("map", "base_link", Transform((math.nan, 0.0, 0.0)))
    frames.send("map", "other", Transform())
    frames.host.until(lambda: frames.robot.lookup() is None and "other" in frames.robot._edges, what="the transforms")
    assert "base_link" not in frames.robot._edges
    frames.send("a", "base_link", Transform())
    frames.send("base_link", "a", Transform())
    frames.host.until(lambda: frames.robot.lookup() is None and "a" in frames.robot._edges, what="both transforms")


def test_frames_of_works_in_both_byte_orders() -> None:
    from rclpy.serialization import serialize_message
    from tf2_msgs.msg import TFMessage

    from lupin_runtime.mission.robot_pose import frames_of
    from lupin_runtime.ros.tf import to_message

    def data(parent: str, child: str, x: float = 0.0) -> bytes:
        return bytes(serialize_message(TFMessage(transforms=[to_message(parent, child, 5, Transform((x, 0.0, 0.0)))])))

    assert frames_of(data("map", "odom", 1.0)) == frames_of(data("map", "odom", 2.0))
    kinds = {frames_of(data(*pair)) for pair in (("map", "odom"), ("odom", "base_link"), ("map", "odom2"), ("ma", "odom"))}
    assert len(kinds) == 4
    assert frames_of(serialize_message(TFMessage())) == b""
    big_endian = (
        bytes([0, 0, 0, 0, 0, 0, 0, 1]) + bytes(8) + bytes([0, 0, 0, 4]) + b"map\0" + bytes([0, 0, 0, 2]) + b"o\0" + bytes(60)
    )
    assert frames_of(big_endian).startswith(b"map\0") and frames_of(big_endian).endswith(b"o\0")
