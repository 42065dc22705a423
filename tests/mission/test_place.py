"""Where the robot is, looked up only when asked."""

from __future__ import annotations

import math

import pytest

from lupin_runtime import graph
from lupin_runtime.geometry import quaternion_from_yaw
from lupin_runtime.mission.freshness import Freshness
from lupin_runtime.transforms import Transform


def test_freshness_is_judged_by_going_on_not_by_the_stamps_value():
    freshness = Freshness()
    assert freshness.age_s(10, 100.0) == 0.0
    assert freshness.age_s(10, 101.5) == 1.5
    assert freshness.age_s(5, 102.0) == 0.0  # a clock that was set back is news too
    assert freshness.age_s(5, 103.0) == 1.0
    assert freshness.age_s(None, 200.0) == 0.0


pytestmark = pytest.mark.graph


class Frames:
    def __init__(self, host) -> None:
        from lupin_runtime.mission.place import Place
        from lupin_runtime.ros import LupinNode, TransformBroadcaster

        self.host = host
        self.node = host.add(LupinNode("frames"))
        self.broadcaster = TransformBroadcaster(self.node)
        self.asker = host.add(LupinNode("asker"))
        self.place = Place(self.asker, "map", "base_link")
        host.until(lambda: self.node.count_subscribers(graph.TF.name), what="the subscription")

    def send(self, parent, child, transform, static=False):
        from lupin_runtime.ros.tf import to_message

        message = to_message(parent, child, self.node.now_ns(), transform)
        (self.broadcaster.send_static if static else self.broadcaster.send)(message)


@pytest.fixture
def frames(graph_host):
    return Frames(graph_host)


def test_the_newest_step_of_each_kind_makes_the_chain(frames):
    assert frames.place.look() is None
    frames.send("mount", "base_link", Transform((0.0, 0.0, 0.1)), static=True)
    for x in range(5):
        frames.send("map", "odom", Transform((10.0, 0.0, 0.0), quaternion_from_yaw(math.pi / 2)))
        frames.send("camera", "tag_7", Transform((9.0, 9.0, 9.0)))
        frames.send("odom", "mount", Transform((float(x), 0.0, 0.0)))

    def found():
        look = frames.place.look()
        return look is not None and look[0].translation == pytest.approx((10.0, 4.0, 0.1)) and look

    _, age_s = frames.host.until(found, what="the newest place")
    assert age_s < 1.0


def test_a_flood_between_two_looks_loses_the_old_and_keeps_the_new(frames):
    from lupin_runtime.ros.tf import to_message

    for x in range(400):
        pair = [
            to_message("map", "odom", frames.node.now_ns(), Transform()),
            to_message("odom", "base_link", frames.node.now_ns(), Transform((float(x), 0.0, 0.0))),
        ]
        frames.broadcaster.send(*pair)
    frames.host.until(lambda: (look := frames.place.look()) and look[0].translation[0] == 399.0, what="the newest place")


def test_a_transform_that_is_no_number_and_a_loop_of_frames_give_no_place(frames):
    frames.send("map", "base_link", Transform((math.nan, 0.0, 0.0)))
    frames.send("map", "other", Transform())
    frames.host.until(lambda: frames.place.look() is None and "other" in frames.place._edges, what="the transforms")
    assert "base_link" not in frames.place._edges
    frames.send("a", "base_link", Transform())
    frames.send("base_link", "a", Transform())
    frames.host.until(lambda: frames.place.look() is None and "a" in frames.place._edges, what="the loop")


def test_kinds_are_told_apart_in_either_byte_order():
    from rclpy.serialization import serialize_message
    from tf2_msgs.msg import TFMessage

    from lupin_runtime.mission.place import kind_of
    from lupin_runtime.ros.tf import to_message

    def data(parent, child, x=0.0):
        return serialize_message(TFMessage(transforms=[to_message(parent, child, 5, Transform((x, 0.0, 0.0)))]))

    assert kind_of(data("map", "odom", 1.0)) == kind_of(data("map", "odom", 2.0))
    kinds = {kind_of(data(*pair)) for pair in (("map", "odom"), ("odom", "base_link"), ("map", "odom2"), ("ma", "odom"))}
    assert len(kinds) == 4
    assert kind_of(serialize_message(TFMessage())) == b""
    big_endian = (
        bytes([0, 0, 0, 0, 0, 0, 0, 1]) + bytes(8) + bytes([0, 0, 0, 4]) + b"map\0" + bytes([0, 0, 0, 2]) + b"o\0" + bytes(60)
    )
    assert kind_of(big_endian).startswith(b"map\0") and kind_of(big_endian).endswith(b"o\0")
