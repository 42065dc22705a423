"""The graph's rows: unique names, importable types, and columns that agree with the stack table and the nodes."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime import graph
from lupin_runtime.record.recorded_topics import STANDARD
from lupin_runtime.stack import graph_session
from lupin_runtime.stack.table import TABLE

RUNTIME = Path(graph.__file__).parent
# Topics that a node publishes through a shared helper, not by `publisher(graph.NAME)` in its own package.
SHARED = (graph.TF, graph.TF_STATIC)
PROCESSES = {row.name: {Path(*node.path.split(".")[1:-1]).name for node in row.nodes} for row in TABLE if row.nodes}


def names(topics: Any) -> set[str]:
    return {topic.name for topic in topics}


def published_in(package: str) -> set[str]:
    """Return the topics in the arguments of the package's calls `….publisher(…)`."""
    found = set()
    for path in (RUNTIME / package).glob("*.py"):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr == "publisher":
                for node in ast.walk(call):
                    row = getattr(graph, node.attr, None) if isinstance(node, ast.Attribute) else None
                    found |= {row.name} if isinstance(row, graph.Topic) else set()
    return found


def test_every_topic_service_and_action_is_defined_once() -> None:
    for rows in (graph.topics(), graph.services(), graph.actions()):
        assert [name for name, count in Counter(row.name for row in rows).items() if count > 1] == []


def test_names_that_the_robot_lacks_are_absent() -> None:
    assert not names(graph.topics()) & {"/battery_state", "/imu/data", "/mirte_base_controller/cmd_vel_unstamped"}


def test_drive_sinks_are_best_effort_on_both_targets() -> None:
    assert not graph.CMD_VEL_SINK_SIM.qos.reliable
    assert not graph.CMD_VEL_SINK_ROBOT.qos.reliable


def test_state_topics_are_latched_one_deep_and_observations_50() -> None:
    for topic in (graph.TWIN_STATE, graph.DISCOVERED_TAGS, graph.MISSION_STATE, graph.AMCL_POSE, graph.MAP):
        assert topic.qos == graph.LATCHED1
    assert graph.OBSERVATIONS.qos == graph.LATCHED50


def test_lists_of_topics_are_columns_of_the_table() -> None:
    """Which topics these are is pinned by docs/topics.md, whose table is generated and checked."""
    topics = graph.topics()
    assert {row.topic: row.max_rate_hz for row in STANDARD} == {
        topic: None if topic.recorded_hz == graph.ALL else topic.recorded_hz for topic in topics if topic.recorded_hz
    }
    assert not any(row.while_scanning for row in STANDARD)
    assert set(graph_session.PROBED_TOPICS) == {topic for topic in topics if topic.repeats or topic.probed}
    assert set(graph_session.ROBOT_TOPICS) == {topic for topic in topics if topic.repeats and topic.from_vendor}


def test_a_repeating_topic_has_a_rate() -> None:
    assert all(topic.rate_hz for topic in graph.topics() if topic.repeats)


@pytest.mark.parametrize("topic", graph.topics(), ids=lambda topic: topic.name)
def test_publishers_are_processes_that_publish_the_topic(topic: graph.Topic) -> None:
    assert topic.publishers
    assert set(topic.publishers) <= {row.name for row in TABLE} | set(graph.EXTERNAL_PUBLISHERS)
    if topic in SHARED:
        return
    constant = next((name for name, row in vars(graph).items() if row is topic), "")
    for process in set(topic.publishers) & set(PROCESSES):
        sources = [
            path.read_text(encoding="utf-8") for package in PROCESSES[process] for path in (RUNTIME / package).glob("*.py")
        ]
        assert any(f"graph.{constant}" in source for source in sources), process


@pytest.mark.parametrize("package", sorted({package for packages in PROCESSES.values() for package in packages}))
def test_a_package_publishes_topics_of_its_processes_only(package: str) -> None:
    processes = {name for name, packages in PROCESSES.items() if package in packages}
    allowed = {topic.name for topic in graph.topics() if processes & set(topic.publishers)}
    # A recorder replays /clock; it does not publish it in a run.
    assert published_in(package) - {graph.CLOCK.name if package == "record" else ""} <= allowed


@pytest.mark.graph
def test_every_type_of_the_graph_imports() -> None:
    from lupin_runtime.ros.interfaces import interface

    rows: list[graph.Topic | graph.Service | graph.Action] = [*graph.topics(), *graph.services(), *graph.actions()]
    for row in rows:
        assert interface(row.type) is not None


# What the session in control may send although nothing of it moves the robot by itself.
MOVES_NOTHING = {
    "/initialpose",
    "/lupin/arm/library/delete",
    "/lupin/arm/library/record",  # makes the arm limp
    "/lupin/arm/library/save_pose",
    "/lupin/arm/set_torque",
    "/lupin/hmi/estop",
    "/lupin/leds/auto",
    "/lupin/leds/set",
    "/lupin/nav/clear_map",
    "/mission/pause",
    "/mission/reset",
    "/slam_toolbox/save_map",
    "/slam_toolbox/serialize_map",
}


def test_every_command_is_known_to_move_the_robot_or_not() -> None:
    rows: list[graph.Topic | graph.Service | graph.Action] = [*graph.topics(), *graph.services(), *graph.actions()]
    commands = {row.name: row.moves for row in rows if row.console == graph.BY_OPERATOR}
    assert {name for name, moves in commands.items() if not moves} == MOVES_NOTHING
    assert not [row.name for row in rows if row.moves and row.console != graph.BY_OPERATOR]
