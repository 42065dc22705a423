"""The five controllers: each must be there and active."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
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

# A graph on which none of these is published has no robot on it: that is another fault.
OF_A_ROBOT = (SCAN.name, ODOM.name, TF.name)
# What controllers say and hear; a lidar that is silent beside them has a cause of its own.
THEIRS = frozenset(
    {
        *(f"topic-silent:{row.name}" for row in (ODOM, JOINT_STATES, TF)),
        *(f"drive-sink-unheard:{row.name}" for row in (CMD_VEL_SINK_ROBOT, CMD_VEL_SINK_SIM)),
    }
)
HEAL = Fix("lupin play heal", playbook="heal")  # moves the arm home: a person says so


def has_robot(graph: Graph) -> bool:
    """Whether the robot's side of the graph is there at all."""
    return any(topic and topic.publishers for topic in map(graph.topic, OF_A_ROBOT))


def graphs(evidence: Evidence) -> tuple[Graph, ...]:
    """Every graph that was visited and has somebody on it."""
    seen = evidence.laptop.get(GRAPH)
    return seen.alive if seen else ()


def stuck(evidence: Evidence) -> Iterator[Finding]:
    """Controllers that are missing from the list or in another state than active."""
    for graph in graphs(evidence):
        if graph.controllers is None:
            continue
        states = {controller.name: controller.state for controller in graph.controllers}
        bad: dict[str, list[str]] = {}
        for name in CONTROLLERS:
            if (state := states.get(name, "not loaded")) != "active":
                bad.setdefault(state, []).append(name)
        if not bad:
            continue
        count = sum(map(len, bad.values()))
        said = [f"{_names(names)} {state}" for state, names in bad.items()]
        yield Finding(
            id="controllers-not-active",
            severity=Severity.PROBLEM,
            where=graph.where,
            symptom="the base doesn't drive, or arm and gripper don't move, and nobody says why",
            cause=f"{count} of {len(CONTROLLERS)} controllers do not work: {'; '.join(said)}",
            evidence=(f"{LIST_CONTROLLERS.name} on {graph.name}:", *(controller.line() for controller in graph.controllers)),
            fix=HEAL,
            explains=THEIRS,
        )


def _names(names: list[str]) -> str:
    if len(names) == len(CONTROLLERS):
        return "all are"
    return f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"


def manager(evidence: Evidence) -> Iterator[Finding]:
    """A robot without a controller manager, or with one that doesn't answer."""
    for graph in graphs(evidence):
        call = next((call for call in graph.calls if call.service == LIST_CONTROLLERS.name), None)
        if call is None and has_robot(graph):
            published = [f"{name}: published" for name in OF_A_ROBOT if (topic := graph.topic(name)) and topic.publishers]
            yield Finding(
                id="controller-manager-missing",
                severity=Severity.PROBLEM,
                where=graph.where,
                symptom="wheels, arm and gripper are dead; the lidar may go on",
                cause="nobody serves the controllers: controller_manager died or never came up",
                evidence=(f"{LIST_CONTROLLERS.name}: no server on {graph.name}", *published),
                fix=Fix("lupin sync-clock", playbook="sync-clock"),
                explains=THEIRS | {"controllers-not-active", "oneshot-failed"},
            )
        elif call is not None and call.round_trip_s is None and any(other.round_trip_s is not None for other in graph.calls):
            yield Finding(
                id="controller-manager-silent",
                severity=Severity.PROBLEM,
                where=graph.where,
                symptom="wheels, arm and gripper are dead although every topic is listed",
                cause="controller_manager is there and does not answer, while others do: it hangs, as after a clock step",
                evidence=tuple(each.line() for each in graph.calls),
                fix=Fix("lupin sync-clock", playbook="sync-clock"),
                explains=THEIRS | {"oneshot-failed"},
            )


CHECKS = (
    Check("controllers.states", stuck, laptop=(GRAPH,)),
    Check("controllers.manager", manager, (GRAPH,), closer_laptop=(GRAPH,)),  # silence is believed at the second visit
)
