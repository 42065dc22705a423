"""The twin's node on a ROS graph."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from lupin_runtime import graph

pytestmark = pytest.mark.graph

Box = tuple[float, float, float, float]


class TwinRig:
    """Publishes the twin's inputs and receives its outputs."""

    def __init__(self, host: Any) -> None:
        from lupin_runtime.ros import LupinNode
        from lupin_runtime.twin.node import TwinNode

        self.host = host
        self.node = LupinNode("twin_rig")
        self.observations = self.node.publisher(graph.OBSERVATIONS)
        self.discovered = self.node.publisher(graph.DISCOVERED_TAGS)
        self.boxes = self.node.publisher(graph.BOX_GEOMETRY)
        self.states: list[Any] = []
        self.node.subscription(graph.TWIN_STATE, self.states.append)
        self.field_client = self.node.client(graph.GET_FIELD)
        host.add(self.node)
        self.twin = host.add(TwinNode({"state_publish_rate_hz": 20.0}))
        for publisher in (self.observations, self.discovered, self.boxes):
            host.until(lambda p=publisher: p.get_subscription_count(), what="the twin's subscriptions")

    def observation(
        self,
        tag_id: str = "7",
        kind: int = 0,
        status: int = 0,
        frame: str = "map",
        pose: tuple[float, float] | None = None,
        readings: Sequence[tuple[str, float]] = (),
        **fields: int,
    ) -> Any:
        from lupin_msgs.msg import Observation, SensorReading

        from lupin_runtime.ros import stamp_from_ns

        message = Observation(kind=kind, status=status, source="test")
        message.header.frame_id = frame
        message.header.stamp = stamp_from_ns(fields.get("time_ns", self.node.now_ns()))
        message.tag_reading.tag_id = tag_id
        message.tag_reading.readings = [SensorReading(name=n, value=v) for n, v in readings]
        message.tag_pose_in_map.orientation.w = 0.0
        if pose is not None:
            message.tag_pose_in_map.position.x, message.tag_pose_in_map.position.y = pose
            message.tag_pose_in_map.orientation.w = 1.0
        return message

    def tag(self, tag_id: str = "7", condition: Callable[[Any], bool] = lambda _tag: True) -> Any:
        def find() -> Any:
            tags = {t.tag_id: t for t in self.states[-1].tags} if self.states else {}
            return tags[tag_id] if tag_id in tags and condition(tags[tag_id]) else None

        return self.host.until(find, what=f"tag {tag_id} in the twin's state")

    def field(self, sensor: str = "co2", resolution: float = 0.5, box: Box = (0.0, 0.0, 2.0, 1.0)) -> Any:
        from lupin_msgs.srv import GetField

        request = GetField.Request(sensor_type=sensor, resolution=resolution)
        request.bbox_min_x, request.bbox_min_y, request.bbox_max_x, request.bbox_max_y = box
        self.host.until(self.field_client.service_is_ready, what="the field service")
        future = self.field_client.call_async(request)
        self.host.until(future.done, what="a field")
        return future.result()


@pytest.fixture
def rig(graph_host: Any) -> TwinRig:
    return TwinRig(graph_host)


def test_empty_state_is_published_at_start(rig: TwinRig) -> None:
    rig.host.until(lambda: rig.states)
    assert rig.states[0].header.frame_id == "map" and list(rig.states[0].tags) == []


def test_reading_is_published_with_pose_and_age(rig: TwinRig) -> None:
    past_ns = rig.node.now_ns() - int(30e9)
    rig.observations.publish(rig.observation(pose=(1.0, 2.0), readings=[("co2", 420.0)], time_ns=past_ns))
    tag = rig.tag()
    assert [(r.name, r.value) for r in tag.readings] == [("co2", 420.0)]
    assert (tag.pose.position.x, tag.pose.position.y, tag.pose.orientation.w) == (1.0, 2.0, 1.0)
    assert 30.0 <= tag.stale_seconds < 40.0


def test_failed_scan_is_published_without_pose(rig: TwinRig) -> None:
    past_ns = rig.node.now_ns() - int(30e9)
    rig.observations.publish(rig.observation(readings=[("co2", 420.0)], time_ns=past_ns))
    rig.observations.publish(rig.observation(status=2, pose=(5.0, 5.0)))
    rig.observations.publish(rig.observation("8", status=1))
    assert rig.tag("8").pose.orientation.w == 0.0
    tag = rig.tag()
    assert tag.stale_seconds >= 30.0 and tag.pose.orientation.w == 0.0
    assert [r.value for r in tag.readings] == [420.0]


def test_flowers_are_published_with_positions_and_box(rig: TwinRig) -> None:
    from geometry_msgs.msg import Point32
    from lupin_msgs.msg import FlowerPoint

    message = rig.observation("", kind=1, pose=(1.0, 2.0))
    flower = message.flower
    flower.tag_id, flower.species, flower.confidence, flower.anomaly = "7", "tulip_pink", 0.75, True
    flower.flower_count, flower.bug_count = 3, 1
    flower.flowers = [FlowerPoint(species="tulip_pink", height_m=0.4), FlowerPoint(height_m=0.4)]
    flower.flowers[1].position.x = math.nan
    flower.box_footprint.points = [Point32(x=float(k), y=0.0) for k in range(4)]
    rig.observations.publish(message)
    tag = rig.tag()
    assert (tag.species, tag.anomaly, tag.flower_count, tag.bug_count) == ("tulip_pink", True, 3, 1)
    assert tag.species_confidence == pytest.approx(0.75)
    assert len(tag.flowers) == 1  # the one with a finite position
    assert [p.x for p in tag.box_footprint.points] == [0.0, 1.0, 2.0, 3.0]


def test_discovered_tags_and_boxes_are_published(rig: TwinRig) -> None:
    from lupin_msgs.msg import DiscoveredTag, DiscoveredTags
    from std_msgs.msg import String

    message = DiscoveredTags(tags=[DiscoveredTag(tag_id="7"), DiscoveredTag(tag_id="8")])
    message.tags[0].pose_in_map.position.x = 4.0
    message.tags[0].pose_in_map.orientation.w = 0.0
    message.header.frame_id = "map"
    rig.discovered.publish(message)
    box = {"id": "7", "x": 3.0, "y": 0.0, "yaw": 0.0, "width": 1.0, "depth": 0.5, "height": 0.3}
    rig.boxes.publish(String(data="no boxes"))
    rig.boxes.publish(String(data=json.dumps([box])))
    tag = rig.tag(condition=lambda t: len(t.box_footprint.points) == 4)
    assert (tag.pose.position.x, tag.pose.orientation.w) == (4.0, 1.0)
    assert (tag.last_observed.sec, tag.stale_seconds) == (0, 0.0)
    assert rig.tag("8").tag_id == "8"


def test_unknown_frames_and_kinds_are_dropped(rig: TwinRig) -> None:
    from lupin_msgs.msg import DiscoveredTag, DiscoveredTags

    for message in (
        rig.observation("1", frame="odom"),
        rig.observation("1", kind=2),
        rig.observation("1", kind=9),
        rig.observation(""),
    ):
        rig.observations.publish(message)
    elsewhere = DiscoveredTags(tags=[DiscoveredTag(tag_id="1")])
    elsewhere.header.frame_id = "odom"
    rig.discovered.publish(elsewhere)
    rig.observations.publish(rig.observation("7"))
    rig.tag("7")
    assert [t.tag_id for t in rig.states[-1].tags] == ["7"]


def test_late_twin_receives_earlier_observations(graph_host: Any) -> None:
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.twin.node import TwinNode

    helper = TwinRig.__new__(TwinRig)
    helper.host, helper.node = graph_host, LupinNode("earlier")
    publisher = helper.node.publisher(graph.OBSERVATIONS)
    graph_host.add(helper.node)
    for k in range(20):
        publisher.publish(TwinRig.observation(helper, str(k), readings=[("co2", float(k))]))
    states: list[Any] = []
    helper.node.subscription(graph.TWIN_STATE, states.append)
    graph_host.add(TwinNode({"state_publish_rate_hz": 20.0}))
    graph_host.until(lambda: states and len(states[-1].tags) == 20, what="20 replayed tags")
    assert [t.tag_id for t in states[-1].tags] == [str(k) for k in range(20)]


def test_field_interpolates_readings(rig: TwinRig) -> None:
    rig.observations.publish(rig.observation("1", pose=(0.25, 0.25), readings=[("co2", 400.0)]))
    rig.observations.publish(rig.observation("2", pose=(1.75, 0.75), readings=[("co2", 600.0), ("light", math.nan)]))
    rig.tag("2")
    field = rig.field()
    assert field.ok and (field.width, field.height, field.sample_count) == (4, 2, 2)
    assert (field.origin_x, field.origin_y, field.resolution_used) == (0.0, 0.0, 0.5)
    values = np.array(field.values).reshape(2, 4)
    assert values[0, 0] == 400.0 and values[1, 3] == 600.0
    assert field.value_min == 400.0 and field.value_max == 600.0
    assert np.all(np.diff(values[0]) > 0)
    light = rig.field("light")
    assert light.ok and light.sample_count == 0 and np.isnan(light.values).all()


def test_new_reading_invalidates_cached_field(rig: TwinRig) -> None:
    rig.observations.publish(rig.observation("1", pose=(0.25, 0.25), readings=[("co2", 400.0)]))
    rig.tag("1")
    assert rig.field().value_max == 400.0
    rig.observations.publish(rig.observation("1", readings=[("co2", 500.0)]))
    rig.tag("1", lambda tag: tag.readings[0].value == 500.0)
    assert rig.field().value_max == 500.0


@pytest.mark.parametrize(
    ("sensor", "resolution", "box", "problem"),
    [
        ("", 0.5, (0.0, 0.0, 1.0, 1.0), "sensor_type"),
        ("co2", 0.0, (0.0, 0.0, 1.0, 1.0), "resolution"),
        ("co2", 0.5, (0.0, 0.0, -1.0, 1.0), "below its minimum"),
    ],
)
def test_refused_field_is_zero_with_a_reason(rig: TwinRig, sensor: str, resolution: float, box: Box, problem: str) -> None:
    field = rig.field(sensor, resolution, box)
    assert not field.ok and problem in field.error_message
    assert (field.width, field.height, field.sample_count, len(field.values)) == (0, 0, 0, 0)
    assert (field.origin_x, field.resolution_used, field.value_min, field.value_max) == (0.0, 0.0, 0.0, 0.0)
