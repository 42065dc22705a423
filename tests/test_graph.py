"""The graph as data: no name twice, no name that looks right but is dead, every type importable."""

from __future__ import annotations

from collections import Counter

import pytest

from lupin_runtime import graph


def test_no_topic_service_or_action_stands_twice() -> None:
    for rows in (graph.topics(), graph.services(), graph.actions()):
        assert [name for name, count in Counter(row.name for row in rows).items() if count > 1] == []


def test_names_that_are_dead_on_the_robot_are_absent() -> None:
    names = {topic.name for topic in graph.topics()}
    assert not names & {"/battery_state", "/imu/data", "/mirte_base_controller/cmd_vel_unstamped"}


def test_drive_sinks_are_best_effort_on_both_targets() -> None:
    assert not graph.CMD_VEL_SINK_SIM.qos.reliable
    assert not graph.CMD_VEL_SINK_ROBOT.qos.reliable


def test_state_snapshots_are_latched_one_deep_and_observations_fifty() -> None:
    for topic in (graph.TWIN_STATE, graph.DISCOVERED_TAGS, graph.MISSION_STATE, graph.AMCL_POSE, graph.MAP):
        assert topic.qos == graph.LATCHED1
    assert graph.OBSERVATIONS.qos == graph.LATCHED50


@pytest.mark.graph
def test_every_type_of_the_graph_imports() -> None:
    from lupin_runtime.ros.node import interface

    for row in (*graph.topics(), *graph.services(), *graph.actions()):
        assert interface(row.type) is not None
