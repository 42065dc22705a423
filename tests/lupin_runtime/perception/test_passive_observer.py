"""Readings of discovered tags while no mission runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.perception.passive_observer import ReadingPlan

if TYPE_CHECKING:
    from lupin_msgs.srv import GetTagReading_Response

    from tests.conftest import GraphHost

SECOND = 1_000_000_000


def test_each_tag_is_requested_once() -> None:
    plan = ReadingPlan()
    assert plan.due(["1", "2"], 0) == ["1", "2"]
    assert plan.due(["1", "2", "3"], 1) == ["3"]
    for tag_id in ("1", "2", "3"):
        plan.answered(tag_id, 2)
    assert plan.due(["1", "2", "3"], 10**15) == []


def test_failed_or_unanswered_call_is_repeated() -> None:
    plan = ReadingPlan()
    plan.due(["1", "2"], 0)
    plan.failed("1")
    assert plan.due(["1", "2"], SECOND) == ["1"]
    assert plan.due(["1", "2"], 5 * SECOND) == ["2"]


def test_tags_are_read_again_after_the_period() -> None:
    plan = ReadingPlan(refresh_s=10.0)
    plan.due(["1"], 0)
    plan.answered("1", SECOND)
    assert plan.due(["1"], 10 * SECOND) == []
    assert plan.due(["1"], 11 * SECOND) == ["1"]


@pytest.mark.graph
def test_discovered_tag_is_read_once_while_the_mission_is_idle(graph_host: GraphHost) -> None:
    from geometry_msgs.msg import Pose
    from lupin_msgs.msg import MissionState, SensorReading
    from lupin_msgs.srv import GetTagReading

    from lupin_runtime.perception.passive_observer import PassiveObserver
    from lupin_runtime.perception.pose_messages import transform_pose_message
    from lupin_runtime.perception.registry import KnownTag
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.transforms import Transform

    asked: list[str] = []
    received: list[Any] = []

    def answer(request: Any, response: GetTagReading_Response) -> GetTagReading_Response:
        asked.append(request.tag_id)
        if request.tag_id == "9":
            response.status = GetTagReading.Response.STATUS_UNKNOWN_TAG
            return response
        response.reading.tag_id = request.tag_id
        response.reading.readings = [SensorReading(name="co2", value=400.0)]
        return response

    bridge = LupinNode("bridge")
    bridge.service(graph.GET_TAG_READING, answer)
    bridge.subscription(graph.OBSERVATIONS, received.append)
    graph_host.add(bridge)
    node = LupinNode("observer")
    observer = PassiveObserver(node)
    graph_host.add(node)
    tags = [KnownTag(t, Transform((1.0, 2.0, 0.1)), 3, 0, 0.0) for t in ("7", "9")]
    graph_host.until(observer._bridge.service_is_ready, what="the bridge")
    observer.tick(MissionState(lifecycle_state="MONITORING"), tags)
    assert asked == []
    for _ in range(3):
        observer.tick(MissionState(lifecycle_state="READY"), tags)
    graph_host.until(lambda: received, what="an observation")
    graph_host.until(lambda: len(asked) == 2, what="both requests")
    observer.tick(None, tags)
    assert sorted(asked) == ["7", "9"]
    (message,) = received
    assert (message.tag_reading.tag_id, message.kind, message.status) == ("7", message.KIND_TAG_READING, message.STATUS_OK)
    assert message.tag_pose_in_map == transform_pose_message(Transform((1.0, 2.0, 0.1))) != Pose()
