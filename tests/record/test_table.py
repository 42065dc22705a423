from __future__ import annotations

import pytest

from lupin_runtime import graph
from lupin_runtime.record.table import BODY_CAMERAS, GRIPPER_CAMERA, STANDARD, Recorded, cameras, chosen


def test_no_topic_is_recorded_twice_and_each_is_of_the_graph():
    names = [row.topic.name for row in STANDARD + cameras("always", "scanning", 1.0, 2.0)]
    assert len(names) == len(set(names))
    assert set(names) <= {topic.name for topic in graph.topics()}


@pytest.mark.parametrize("row", STANDARD, ids=lambda row: row.topic.name)
def test_a_subscription_never_asks_for_more_than_is_offered(row):
    asked, offered = row.qos(), row.topic.qos
    assert asked.reliable <= offered.reliable
    assert asked.latched <= offered.latched


def test_a_fast_topic_survives_a_busy_recorder():
    assert Recorded(graph.ODOM).qos().depth >= 4 * graph.ODOM.rate_hz
    assert Recorded(graph.CMD_VEL_SINK_SIM).qos().depth >= 80


def test_a_throttled_topic_keeps_only_the_newest():
    assert Recorded(graph.IMU, max_rate_hz=10.0).qos().depth == 1


def test_latched_topics_stay_latched_and_two_that_come_at_once_are_both_kept():
    assert Recorded(graph.OBSERVATIONS).qos() == graph.LATCHED50
    state = Recorded(graph.MISSION_STATE).qos()
    assert state.latched and state.depth >= 20


def test_cameras_by_mode():
    rows = {row.topic.name: row for row in cameras("always", "scanning", 1.0, 2.0)}
    assert set(rows) == {topic.name for topic in (*BODY_CAMERAS, GRIPPER_CAMERA)}
    assert not rows["/camera/image_raw/compressed"].while_scanning
    assert rows[GRIPPER_CAMERA.name].while_scanning
    assert cameras("off", "off", 1.0, 2.0) == ()
    with pytest.raises(ValueError, match=r"always \| scanning \| off"):
        cameras("sometimes", "off", 1.0, 2.0)


def test_topics_can_be_chosen_also_outside_the_standard_ones():
    rows = chosen("/scan, /local_costmap/costmap,/scan", STANDARD)
    assert [row.topic for row in rows] == [graph.SCAN, graph.LOCAL_COSTMAP]
    assert chosen("", STANDARD) == STANDARD


def test_an_unknown_topic_is_refused_with_the_nearest():
    with pytest.raises(ValueError, match=r"/scann is no topic of the graph; nearest: /scan"):
        chosen("/scann", STANDARD)
