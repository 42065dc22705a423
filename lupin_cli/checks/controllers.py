"""The five controllers of ros2_control, each of which must be loaded and active."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.clocks import laptop_clock_fault, measured_offset
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.layers import BASE_PART, DRIVE
from lupin_cli.checks.remote_command import restart_unit, robot_option
from lupin_cli.checks.robot_graph import other_robot
from lupin_cli.facts.clock import CLOCK
from lupin_cli.facts.graph import GRAPH, Graph
from lupin_cli.link.laptop_clock import DRIFT_LIMIT_S
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
# Silence and missing subscribers that each dead controller explains. Nothing repeated comes from those of arm and gripper.
_OF_BASE = frozenset(
    {
        *(f"topic-silent:{row.name}" for row in (ODOM, TF)),
        *(f"drive-sink-unheard:{row.name}" for row in (CMD_VEL_SINK_ROBOT, CMD_VEL_SINK_SIM)),
    }
)
_JOINT_STATES = "joint_state_broadcaster"
_BASE_CONTROLLERS = ("pid_wheels_controller", "mirte_base_controller")
_CONSEQUENCES = {**dict.fromkeys(_BASE_CONTROLLERS, _OF_BASE), _JOINT_STATES: frozenset({f"topic-silent:{JOINT_STATES.name}"})}
CONTROLLER_CONSEQUENCES = frozenset[str]().union(*_CONSEQUENCES.values())


def has_robot(graph: Graph) -> bool:
    """Return whether a robot publishes on the graph."""
    return any(topic and topic.publishers for topic in map(graph.topic, ROBOT_TOPICS))


def observed_graphs(snapshot: Snapshot) -> tuple[Graph, ...]:
    """Return every known graph that the doctor joined and that has nodes or topics, without those of other robots."""
    seen = snapshot.laptop.get(GRAPH)
    known = (graph for graph in seen.alive if graph.kind != "shell") if seen else ()
    return tuple(graph for graph in known if not other_robot(snapshot, graph))


def find_inactive_controllers(snapshot: Snapshot) -> Iterator[Finding]:
    """A controller is not loaded or not active."""
    for graph in observed_graphs(snapshot):
        if graph.controllers is None:
            continue
        states = {controller.name: controller.state for controller in graph.controllers}
        by_state: dict[str, list[str]] = {}
        for name in CONTROLLERS:
            if (state := states.get(name, "not loaded")) != "active":
                by_state.setdefault(state, []).append(name)
        if not by_state:
            continue
        dead = [name for names in by_state.values() for name in names]
        groups = [f"{_subject(names)} {state}" for state, names in by_state.items()]
        yield make_finding(
            "controllers-not-active",
            where=graph.machine,
            graph=graph.name,
            cause=f"{len(dead)} of {len(CONTROLLERS)} controllers do not work: {'; '.join(groups)}",
            evidence=(f"{LIST_CONTROLLERS.name} on {graph.name}:", *(controller.line() for controller in graph.controllers)),
            command="lupin play heal" if graph.kind == "robot" else "lupin home",
            playbook=playbook_on_robot(graph),
            explains=frozenset[str]().union(*(_CONSEQUENCES.get(name, ()) for name in dead)),
            breaks=_broken_parts(graph, dead),
        )


def _broken_parts(graph: Graph, dead: list[str]) -> tuple[str, ...]:
    """Return the parts of the robot whose data dead controllers take away."""
    if any(name in _BASE_CONTROLLERS for name in dead):
        return BASE_PART, DRIVE
    return (BASE_PART,) if _JOINT_STATES in dead and graph.sample_count(ODOM.name) else ()


def _subject(names: list[str]) -> str:
    if len(names) == len(CONTROLLERS):
        return "all are"
    return f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"


def playbook_on_robot(graph: Graph) -> str | None:
    """Return None for the playbook of the finding's row; empty for a simulated graph, as playbooks act on a robot."""
    return None if graph.kind == "robot" else ""


def _restart(snapshot: Snapshot, graph: Graph) -> tuple[str, str]:
    """Return command and playbook that start the controller manager again.

    A clock step kills it. Where the clock is still wrong, `lupin sync-clock` sets it and restarts the stack; where it is right,
    or this machine's is wrong, that does nothing.
    """
    if graph.kind != "robot":
        return "lupin logs sim", ""
    drift = measured_offset(snapshot)
    if (drift is None or drift.at_least_s > DRIFT_LIMIT_S) and not laptop_clock_fault(snapshot):
        return "lupin sync-clock", "sync-clock"
    return f"{restart_unit(snapshot)} && lupin play heal{robot_option(snapshot)}", ""


def find_controller_manager_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The controller manager is missing, or does not answer while other services do."""
    for graph in observed_graphs(snapshot):
        call = next((call for call in graph.calls if call.service == LIST_CONTROLLERS.name), None)
        command, playbook = _restart(snapshot, graph)
        if call is None and has_robot(graph):
            published = [f"{name}: published" for name in ROBOT_TOPICS if (topic := graph.topic(name)) and topic.publishers]
            yield make_finding(
                "controller-manager-missing",
                where=graph.machine,
                graph=graph.name,
                cause="no node serves the controllers: controller_manager died or never started",
                evidence=(f"{LIST_CONTROLLERS.name}: no server on {graph.name}", *published),
                command=command,
                playbook=playbook,
                explains=CONTROLLER_CONSEQUENCES | {"controllers-not-active", "oneshot-failed"},
            )
        elif (
            call is not None
            and call.sent
            and call.round_trip_s is None
            and any(other.round_trip_s is not None for other in graph.calls)
        ):
            yield make_finding(
                "controller-manager-silent",
                where=graph.machine,
                graph=graph.name,
                cause="controller_manager runs but does not answer, while other services do: it hangs, as after a clock step",
                evidence=(each.line() for each in graph.calls),
                command=command,
                playbook=playbook,
                explains=CONTROLLER_CONSEQUENCES | {"oneshot-failed"},
            )


CHECKS = (
    Check("controllers.states", find_inactive_controllers, laptop=(GRAPH,)),
    # One call may go unanswered because the machine is busy: the follow-up probe decides.
    Check("controllers.manager", find_controller_manager_faults, laptop=(GRAPH,), robot=(CLOCK,), followup_laptop=(GRAPH,)),
)
