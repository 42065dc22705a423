"""The recorder's topics, their QoS and queues."""

from __future__ import annotations

import pytest

from lupin_runtime import graph
from lupin_runtime.record.recorded_topics import BODY_CAMERAS, GRIPPER_CAMERA, STANDARD, Recorded, camera_topics, select_topics
from tests.support.optional import present


def test_recorded_topics_are_unique_topics_of_the_graph() -> None:
    names = [row.topic.name for row in STANDARD + camera_topics("always", "scanning", 1.0, 2.0)]
    assert len(names) == len(set(names))
    assert set(names) <= {topic.name for topic in graph.topics()}


@pytest.mark.parametrize("row", STANDARD, ids=lambda row: row.topic.name)
def test_recorder_qos_is_compatible_with_the_publisher(row: Recorded) -> None:
    asked, offered = row.qos(), row.topic.qos
    assert asked.reliable <= offered.reliable
    assert asked.latched <= offered.latched


def test_queue_of_a_fast_topic_bridges_a_busy_recorder() -> None:
    assert Recorded(graph.ODOM).qos().depth >= 4 * present(graph.ODOM.rate_hz)
    assert Recorded(graph.CMD_VEL_SINK_SIM).qos().depth >= 80


def test_throttled_topic_queues_only_the_newest_message() -> None:
    assert Recorded(graph.IMU, max_rate_hz=10.0).qos().depth == 1


def test_latched_topics_stay_latched_with_a_deep_queue() -> None:
    assert Recorded(graph.OBSERVATIONS).qos() == graph.LATCHED50
    state = Recorded(graph.MISSION_STATE).qos()
    assert state.latched and state.depth >= 20


def test_camera_topics_follow_their_mode() -> None:
    rows = {row.topic.name: row for row in camera_topics("always", "scanning", 1.0, 2.0)}
    assert set(rows) == {topic.name for topic in (*BODY_CAMERAS, GRIPPER_CAMERA)}
    assert not rows["/camera/image_raw/compressed"].while_scanning
    assert rows[GRIPPER_CAMERA.name].while_scanning
    assert camera_topics("off", "off", 1.0, 2.0) == ()
    with pytest.raises(ValueError, match=r"always \| scanning \| off"):
        camera_topics("sometimes", "off", 1.0, 2.0)


def test_any_topic_of_the_graph_can_be_selected() -> None:
    rows = select_topics("/scan, /local_costmap/costmap,/scan", STANDARD)
    assert [row.topic for row in rows] == [graph.SCAN, graph.LOCAL_COSTMAP]
    assert select_topics("", STANDARD) == STANDARD


def test_unknown_topic_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(ValueError, match=r"/scann is no topic of the graph; nearest: /scan"):
        select_topics("/scann", STANDARD)
