"""The five controllers of ros2_control, each of which must be loaded and active."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.facts.graph import GRAPH, Graph
from lupin_runtime.graph import (
    CMD_VEL_SINK_ROBOT,
    CMD_VEL_SINK_SIM,
    CONTROLLERS,
    JOINT_STATES,
    LIST_CONTROLLERS,
    ODOM,
    SCAN,
    TF,
)

# A graph on which none of these is published contains no robot; other checks report that.
ROBOT_TOPICS = (SCAN.name, ODOM.name, TF.name)
# Silence and missing subscribers that dead controllers explain. A silent lidar has another cause.
CONTROLLER_CONSEQUENCES = frozenset(
    {
        *(f"topic-silent:{row.name}" for row in (ODOM, JOINT_STATES, TF)),
        *(f"drive-sink-unheard:{row.name}" for row in (CMD_VEL_SINK_ROBOT, CMD_VEL_SINK_SIM)),
    }
)


def has_robot(graph: Graph) -> bool:
    """Return whether a robot publishes on the graph."""
    return any(topic and topic.publishers for topic in map(graph.topic, ROBOT_TOPICS))


def visited_graphs(snapshot: Snapshot) -> tuple[Graph, ...]:
    """Return every graph that the doctor joined and that has nodes or topics."""
    seen = snapshot.laptop.get(GRAPH)
    return seen.alive if seen else ()


def find_inactive_controllers(snapshot: Snapshot) -> Iterator[Finding]:
    """A controller is not loaded or not active."""
    for graph in visited_graphs(snapshot):
        if graph.controllers is None:
            continue
        states = {controller.name: controller.state for controller in graph.controllers}
        by_state: dict[str, list[str]] = {}
        for name in CONTROLLERS:
            if (state := states.get(name, "not loaded")) != "active":
                by_state.setdefault(state, []).append(name)
        if not by_state:
            continue
        count = sum(map(len, by_state.values()))
        groups = [f"{_subject(names)} {state}" for state, names in by_state.items()]
        yield make_finding(
            "controllers-not-active",
            where=graph.machine,
            cause=f"{count} of {len(CONTROLLERS)} controllers do not work: {'; '.join(groups)}",
            evidence=(f"{LIST_CONTROLLERS.name} on {graph.name}:", *(controller.line() for controller in graph.controllers)),
            command="lupin play heal",
            explains=CONTROLLER_CONSEQUENCES,
        )


def _subject(names: list[str]) -> str:
    if len(names) == len(CONTROLLERS):
        return "all are"
    return f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"


def find_controller_manager_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The controller manager is missing, or does not answer while other services do."""
    for graph in visited_graphs(snapshot):
        call = next((call for call in graph.calls if call.service == LIST_CONTROLLERS.name), None)
        if call is None and has_robot(graph):
            published = [f"{name}: published" for name in ROBOT_TOPICS if (topic := graph.topic(name)) and topic.publishers]
            yield make_finding(
                "controller-manager-missing",
                where=graph.machine,
                cause="no node serves the controllers: controller_manager died or never started",
                evidence=(f"{LIST_CONTROLLERS.name}: no server on {graph.name}", *published),
                command="lupin sync-clock",
                explains=CONTROLLER_CONSEQUENCES | {"controllers-not-active", "oneshot-failed"},
            )
        elif call is not None and call.round_trip_s is None and any(other.round_trip_s is not None for other in graph.calls):
            yield make_finding(
                "controller-manager-silent",
                where=graph.machine,
                cause="controller_manager runs but does not answer, while other services do: it hangs, as after a clock step",
                evidence=(each.line() for each in graph.calls),
                command="lupin sync-clock",
                explains=CONTROLLER_CONSEQUENCES | {"oneshot-failed"},
            )


CHECKS = (
    Check("controllers.states", find_inactive_controllers, laptop=(GRAPH,)),
    # One call may go unanswered because the machine is busy: the second visit decides.
    Check("controllers.manager", find_controller_manager_faults, laptop=(GRAPH,), followup_laptop=(GRAPH,)),
)
