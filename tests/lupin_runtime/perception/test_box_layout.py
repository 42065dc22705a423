"""Registration of a layout's boxes in the map by the discovered tags."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.layout import Layout, Table, TagLocation, load_layout
from lupin_runtime.perception.box_geometry import BoxSize, read_boxes
from lupin_runtime.perception.box_layout import boxes_of, register, registered
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.conftest import GraphHost

TABLE = Table(1.0, 2.0, 0.0, 0.25)
FAR = Table(1.0, 1.25, 3.0, 4.1)


def layout(**tags: tuple[float, float]) -> Layout:
    return Layout({"a": TABLE, "b": FAR}, {name: TagLocation(*at) for name, at in tags.items()})


@pytest.mark.parametrize(
    ("tag", "yaw", "size", "on_face"),
    [
        ((1.3, 0.05), -math.pi / 2, (1.0, 0.25), (1.3, 0.0)),
        ((1.3, 0.2), math.pi / 2, (1.0, 0.25), (1.3, 0.25)),
        ((2.05, 0.1), 0.0, (0.25, 1.0), (2.0, 0.1)),
        ((0.98, 0.12), math.pi, (0.25, 1.0), (1.0, 0.12)),
        ((1.2, 3.5), 0.0, (1.1, 0.25), (1.25, 3.5)),
    ],
)
def test_box_faces_the_side_nearest_to_its_tag(
    tag: tuple[float, float], yaw: float, size: tuple[float, float], on_face: tuple[float, float]
) -> None:
    box = boxes_of(layout(x=tag), 0.3)["x"]
    assert wrap_angle(box.center.yaw - yaw) == pytest.approx(0.0)
    assert (box.size.width, box.size.depth) == pytest.approx(size)
    assert box.tag == pytest.approx(on_face)


def test_layout_without_tables_has_no_boxes() -> None:
    assert boxes_of(Layout({}, {"1": TagLocation(0.0, 0.0)}), 0.3) == {}


BOXES = boxes_of(layout(p=(1.2, 0.0), q=(1.9, 0.25), r=(1.0, 3.4), s=(1.25, 4.0)), 0.3)


@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(-3.1, 3.1))
def test_discovered_tags_register_the_layout_in_the_map(x: float, y: float, yaw: float) -> None:
    motion = Pose2(x, y, yaw)
    found = {name: motion.apply(*box.tag) for name, box in BOXES.items()}
    got = register(BOXES, {**found, "77": (0.0, 0.0)})
    assert got is not None
    assert got.distance_to(motion) < 1e-6 and abs(wrap_angle(got.yaw - yaw)) < 1e-9
    box = read_boxes(json.dumps(registered(BOXES, got)))["p"]
    assert box.origin == pytest.approx(motion.apply(1.5, 0.0), abs=1e-6)
    assert box.size == BoxSize(1.0, 0.25, 0.3)


def test_tag_far_from_its_layout_location_is_left_out() -> None:
    motion = Pose2(3.0, 1.0, 0.7)
    found = {name: motion.apply(*box.tag) for name, box in BOXES.items()}
    found["q"] = (found["q"][0] + 2.0, found["q"][1])
    assert present(register(BOXES, found)).distance_to(motion) < 1e-6


def test_too_few_or_too_close_tags_register_nothing() -> None:
    assert register(BOXES, {}) is None
    assert register(BOXES, {"p": (0.0, 0.0)}) is None
    near = boxes_of(layout(p=(1.2, 0.0), q=(1.3, 0.0)), 0.3)
    assert register(near, {"p": (0.0, 0.0), "q": (0.1, 0.0)}) is None
    assert register(BOXES, {"p": (0.0, 0.0), "r": (9.0, 9.0)}) is None


@pytest.mark.graph
def test_node_publishes_boxes_when_two_tags_agree_or_move(graph_host: GraphHost) -> None:
    from lupin_msgs.msg import DiscoveredTag, DiscoveredTags

    from lupin_runtime.perception.node import BoxLayoutPublisher
    from lupin_runtime.ros import LupinNode

    received: list[Any] = []
    world = LupinNode("world")
    tags = world.publisher(graph.DISCOVERED_TAGS)
    world.subscription(graph.BOX_GEOMETRY, received.append)
    graph_host.add(world)
    graph_host.add(BoxLayoutPublisher())
    graph_host.until(tags.get_subscription_count, what="the subscription")
    packaged = boxes_of(load_layout(), 0.3)

    def publish_tags(motion: Pose2, *ids: str) -> None:
        message = DiscoveredTags(tags=[DiscoveredTag(tag_id=i) for i in ids])
        for tag in message.tags:
            tag.pose_in_map.position.x, tag.pose_in_map.position.y = motion.apply(*packaged[tag.tag_id].tag)
        tags.publish(message)

    publish_tags(Pose2(), "1")
    first, second = Pose2(2.0, 1.0, 0.5), Pose2(2.5, 1.0, 0.5)
    publish_tags(first, "1", "21", "3")
    graph_host.until(lambda: received, what="boxes")
    publish_tags(first, "1", "21", "3")
    publish_tags(second, "1", "21", "3")
    graph_host.until(lambda: len(received) == 2, what="moved boxes")
    before, after = (read_boxes(message.data) for message in received)
    assert len(before) == len(packaged) == 29
    assert after["1"].origin[0] - before["1"].origin[0] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.usefixtures("graph_host")
def test_corrupt_layout_stops_the_node_from_starting(tmp_path: Path) -> None:
    from lupin_runtime.perception.node import BoxLayoutPublisher

    path = tmp_path / "layout.json"
    path.write_text("{\n]")
    with pytest.raises(ValueError, match=r"layout\.json:2: not JSON"):
        BoxLayoutPublisher({"layout_file": str(path)})
