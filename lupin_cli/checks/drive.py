"""Drive commands that reach no wheel, or bypass the drive bus.

The checks find a sink without subscribers, an engaged e-stop, a locked bus, a page or gamepad that holds the bus with zeros,
and nodes that bypass the bus or forge the e-stop's state.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.controllers import observed_graphs
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.laptop_programs import programs_by_machine
from lupin_cli.checks.remote_command import FixText, restart_unit
from lupin_cli.facts.graph import GRAPH, Graph
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.units import UNIT_STATES
from lupin_cli.systemd.units import ONBOARD
from lupin_runtime.drive.arbiter import CLOSED
from lupin_runtime.graph import (
    CMD_VEL_AUTO,
    CMD_VEL_JOY,
    CMD_VEL_MANUAL,
    CMD_VEL_SINK_ROBOT,
    CMD_VEL_SINK_SIM,
    ESTOP_STATE,
    HMI_ESTOP,
)
from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED, ESTOP_NOT_RECEIVED, ESTOP_SILENT
from lupin_runtime.safety.expected_sources import ESTOP_BUTTON, UNHEARD_BUTTON, UNHEARD_CONSOLE, UNHEARD_WITNESS

# Users often type the last one by mistake; it exists on no robot.
SINKS = (CMD_VEL_SINK_ROBOT.name, CMD_VEL_SINK_SIM.name, "/mirte_base_controller/cmd_vel_unstamped")
# Nodes that subscribe to drive commands but turn no wheel.
PASSIVE_SUBSCRIBERS = (
    "light_strip_bridge",
    "lupin_recorder",
    "lupin_supervisor",
    "rosbridge_websocket",
    "rosapi",
    "rosbag2_recorder",
)
# A page whose e-stop is engaged sends about 24 zeros while the doctor listens (20 Hz for 1.2 s). A released stick sends fewer
# than half of that.
MIN_ZEROS = 12
_BYPASSED = ("twist_mux", "drive-bypassed", "commands of other nodes bypass the drive bus and the e-stop")
# Topic → the only node that may publish on it, and the finding and the danger if another node does.
SOLE_PUBLISHERS = {
    CMD_VEL_SINK_ROBOT.name: _BYPASSED,
    CMD_VEL_SINK_SIM.name: _BYPASSED,
    ESTOP_STATE.name: ("estop_bridge", "estop-forged", "the e-stop cannot be released meanwhile"),
}
FORMER_ESTOP = "former process of the e-stop"  # what a finding is about, if the bus is locked only until that is forgotten
# Finding → what a program does instead, once it was ended.
_INSTEAD = {
    "drive-bypassed": f"let it publish on {CMD_VEL_MANUAL.name}, an input of the drive bus, when you start it again",
    "estop-forged": "do not start it again with this topic",
}
# Phrase in an e-stop reason → how to release the e-stop. A page that was closed while it held the e-stop cannot release it; any
# page can that engages it again.
BUTTON_PRESSED = "button is pressed"
SILENT_BUTTON = "the button has been silent"
_NO_BUTTON_STATE = (SILENT_BUTTON, UNHEARD_BUTTON)  # one that was never received has the same causes
RELEASES = {
    BUTTON_PRESSED: "release the red button on the robot",
    "was lost": "engage the e-stop on any page of the console, then release it there",
    UNHEARD_BUTTON: "press and release the red button on the robot: some firmware publishes its state only when it changes; if "
    f"the robot has none, set {ESTOP_BUTTON}=no as in docs/robot-services.md",
    UNHEARD_CONSOLE: "wait until the console is up; if it does not come up, end the run with lupin down, and start it again "
    "with lupin up --no-web",
    UNHEARD_WITNESS: "wait until the process drive is up; if it does not come up, lupin status says why",
}
# Topic of an input → finding, publisher, how to silence it.
INPUTS = {
    CMD_VEL_MANUAL.name: ("page-holds-bus", "an open page", "release the e-stop on the page, or close it"),
    CMD_VEL_JOY.name: (
        "pad-holds-bus",
        "the gamepad's node",
        "stop the gamepad's node: it must publish nothing while its dead-man switch is released",
    ),
}


def find_sinks_without_subscribers(snapshot: Snapshot) -> Iterator[Finding]:
    """Drive commands are published on a topic to which no wheel controller subscribes."""
    for graph in observed_graphs(snapshot):
        for name in SINKS:
            topic = graph.topic(name)
            if topic is None or all(end.is_stale for end in topic.publishers):
                continue
            if any(end.node.rpartition("/")[2] not in PASSIVE_SUBSCRIBERS for end in topic.subscribers):
                continue
            if dict(graph.sink_subscriptions).get(name, 0) > len(topic.subscribers):
                continue  # under load, the doctor's view may lack a subscription that the bus itself is matched with
            others = [other for other in SINKS if other != name and (seen := graph.topic(other)) and seen.subscribers]
            wrong_target = f"; the base listens on {others[0]}: the bus was started for another target" if others else ""
            yield make_finding(
                "drive-sink-unheard",
                where=graph.machine,
                graph=graph.name,
                cause=f"{name} has publishers, and no wheel controller subscribes to it{wrong_target}",
                evidence=(
                    f"{name} on {graph.name}: published by {', '.join(end.node for end in topic.publishers)}",
                    f"{name}: subscribers: {_subscribers(graph, name)}",
                    *(f"{other}: subscribers: {_subscribers(graph, other)}" for other in others),
                ),
                about=name,
                **_reach_wheels(graph, name, others),
            )


def _reach_wheels(graph: Graph, name: str, others: list[str]) -> FixText:
    """Return how drive commands reach the base: by another topic, or by its controller, which `lupin home` activates."""
    if graph.kind == "robot" and not others:
        return FixText(command="lupin home")
    topic = graph.topic(name)
    publishers = ", ".join(end.node for end in topic.publishers) if topic else "its publisher"
    heard = others[0] if others else "the topic of a wheel controller"
    return FixText(
        instruction=f"let {publishers} publish on {heard}; if it is part of a run of Lupin, end that run with lupin down, and "
        f"start it again with lupin up --target {graph.kind}"
    )


def _subscribers(graph: Graph, name: str) -> str:
    topic = graph.topic(name)
    return ", ".join(end.node for end in topic.subscribers) if topic and topic.subscribers else "none"


def find_engaged_estop(snapshot: Snapshot) -> Iterator[Finding]:
    """The e-stop is engaged."""
    for graph in observed_graphs(snapshot):
        if graph.estop:
            reasons = " ".join(graph.estop_reasons)
            yield make_finding(
                "estop-engaged",
                where=graph.machine,
                graph=graph.name,
                cause="the e-stop is engaged: " + (", ".join(graph.estop_reasons) or "no reason is published"),
                evidence=(
                    f"e-stop on {graph.name}: engaged",
                    *graph.estop_reasons,
                    *(f"drive bus: {lock}" for lock in graph.drive_bus_locks),
                ),
                explains={"page-holds-bus", "bus-locked"},
                about=SILENT_BUTTON if _is_without_button_state(graph.estop_reasons) else "",
                **_release(graph, reasons),
            )


def _is_without_button_state(reasons: tuple[str, ...]) -> bool:
    """Return whether the e-stop is engaged only because it does not receive the button's state."""
    return bool(reasons) and all(any(phrase in reason for phrase in _NO_BUTTON_STATE) for reason in reasons)


def _release(graph: Graph, reasons: str) -> FixText:
    if graph.kind == "sim" and BUTTON_PRESSED in reasons:
        return FixText(command="lupin sim press estop --release")
    by_hand = (release for phrase, release in RELEASES.items() if phrase in reasons)
    return FixText(instruction=next(by_hand, "release the e-stop on the page"))


def find_bus_locks(snapshot: Snapshot) -> Iterator[Finding]:
    """The drive bus is locked for another reason than the engaged e-stop."""
    for graph in observed_graphs(snapshot):
        if graph.estop or not graph.drive_bus_locks:
            continue
        if graph.drive_bus_locks == (ESTOP_ENGAGED,) and (former := _former_bridges(graph)):
            yield make_finding(
                "bus-locked",
                severity=Severity.WARNING,
                where=graph.machine,
                graph=graph.name,
                cause="the e-stop is released, and the drive bus stays locked for up to 20 s: the e-stop's process was killed "
                "and started again, and the graph still contains the former one",
                evidence=(
                    f"drive bus on {graph.name}: {ESTOP_ENGAGED}",
                    f"{ESTOP_STATE.name} on {graph.name}: {former} more publishers than the e-stop's process has",
                ),
                about=FORMER_ESTOP,
                command="lupin wait",
                instruction="the lock ends by itself; the command waits for that",
            )
        else:
            yield make_finding(
                "bus-locked",
                where=graph.machine,
                graph=graph.name,
                cause="the drive bus is locked: " + ", ".join(graph.drive_bus_locks),
                evidence=(f"drive bus on {graph.name}: {lock}" for lock in graph.drive_bus_locks),
                **_unlock(snapshot, graph),
            )


def _former_bridges(graph: Graph) -> int:
    """Return how many publishers of the e-stop's state are those of killed processes, which DDS keeps for its lease of 20 s.

    A publisher of another node is no former one, but see `find_unexpected_publishers`.
    """
    topic = graph.topic(ESTOP_STATE.name)
    ends = topic.publishers if topic is not None else ()
    known = all(end.is_stale or end.node.rpartition("/")[2] == SOLE_PUBLISHERS[ESTOP_STATE.name][0] for end in ends)
    return max(0, len(ends) - 1) if known else 0


def _unlock(snapshot: Snapshot, graph: Graph) -> FixText:
    """Return who holds the lock of the drive bus, and how it is released. Nothing moves when a lock ends."""
    reasons = " ".join(graph.drive_bus_locks)
    if ESTOP_NOT_RECEIVED in reasons or ESTOP_SILENT in reasons:
        holder = "the e-stop's process, which publishes no state"
    elif CLOSED in reasons:
        holder = "the drive bus itself, which is shutting down"
    else:
        holder = f"the supervisor: {', '.join(graph.drive_bus_locks)}"
    units = snapshot.robot_fact(UNIT_STATES)
    onboard = units.get(ONBOARD) if units is not None and graph.kind == "robot" else None
    if onboard is not None and onboard.running:
        return FixText(
            command=restart_unit(snapshot, ONBOARD),
            instruction=f"the lock is held by {holder}; the command starts {ONBOARD} again",
        )
    return FixText(
        command="lupin status",
        instruction=f"the lock is held by {holder}; the command names processes that are not up: end the run with lupin down, "
        "and start it again",
    )


def find_unexpected_publishers(snapshot: Snapshot) -> Iterator[Finding]:
    """A node publishes on a topic on which only the drive bus or the e-stop bridge may publish."""
    for graph in observed_graphs(snapshot):
        for name, (expected, id, danger) in SOLE_PUBLISHERS.items():
            topic = graph.topic(name)
            publishers = [end.node for end in topic.publishers if not end.is_stale] if topic else []
            unexpected = sorted({node for node in publishers if node.rpartition("/")[2] != expected})
            for machine, nodes in programs_by_machine(snapshot, graph, unexpected).items():
                yield make_finding(
                    id,
                    where=machine,
                    graph=graph.name,
                    cause=f"{name} is published by {', '.join(nodes)}; only {expected} may publish on it: {danger}",
                    evidence=(
                        f"{name} on {graph.name}: published by {', '.join(publishers)}",
                        *(f"{machine}: {program.line()}" for program in nodes.values() if program is not None),
                    ),
                    about=name,
                    **_silence(id, nodes),
                )


def _silence(id: str, nodes: Mapping[str, RosProcess | None]) -> FixText:
    """Return how nodes cease to publish: a program of the laptop is ended, any other is looked for by hand."""
    programs = [program for program in nodes.values() if program is not None]
    names = ", ".join(nodes)
    if len(programs) < len(nodes):
        return FixText(
            instruction=f"stop the program that runs {'the node' if len(nodes) == 1 else 'each of the nodes'} {names}"
        )
    return FixText(command=_kill(programs), instruction=f"the command ends {names}; {_INSTEAD[id]}")


def _kill(programs: Iterable[RosProcess]) -> str:
    """Return the command that ends programs of the laptop; empty for none."""
    pids = sorted({program.pid for program in programs})
    return f"kill {' '.join(map(str, pids))}" if pids else ""


def find_inputs_sending_zeros(snapshot: Snapshot) -> Iterator[Finding]:
    """An input of the drive bus sends only zeros and so overrides every input of lower priority."""
    for graph in observed_graphs(snapshot):
        for seen in graph.inputs:
            if seen.topic not in INPUTS or seen.count < MIN_ZEROS or seen.moving:
                continue
            id, publisher, instruction = INPUTS[seen.topic]
            topic = graph.topic(seen.topic)
            nodes = [end.node for end in topic.publishers if not end.is_stale] if topic else []
            machines = programs_by_machine(snapshot, graph, nodes) or {graph.machine: {}}
            machine = next(iter(machines)) if len(machines) == 1 else graph.machine
            programs = [program for program in machines[machine].values() if program is not None]
            lower = next((each for each in graph.inputs if each.topic == CMD_VEL_AUTO.name), None)
            yield make_finding(
                id,
                severity=Severity.PROBLEM if lower and lower.moving else Severity.WARNING,
                where=machine,
                graph=graph.name,
                cause=f"{publisher} sends zeros and overrides every input of lower priority",
                evidence=(
                    f"{seen.topic} on {graph.name}: {seen.count} commands received, all zero, from {', '.join(nodes) or '?'}",
                    *(f"{machine}: {program.line()}" for program in programs),
                    *((f"{lower.topic}: {lower.count} commands, {lower.moving} of them not zero",) if lower else ()),
                    *((f"drive bus: held by {graph.drive_bus_holder}",) if graph.drive_bus_holder else ()),
                    *_publisher_count(graph, HMI_ESTOP.name),
                ),
                # A page is released by its user; the program that serves it goes on for the others.
                command=_kill(programs) if id == "pad-holds-bus" else "",
                instruction=instruction,
            )


def _publisher_count(graph: Graph, name: str) -> tuple[str, ...]:
    topic = graph.topic(name)
    return (f"{name}: {len(topic.publishers)} publisher(s)",) if topic and topic.publishers else ()


CHECKS = (
    # A drive bus that is still starting does not publish its matched subscriptions yet: the follow-up probe decides.
    Check("drive.sink", find_sinks_without_subscribers, laptop=(GRAPH,), followup_laptop=(GRAPH,)),
    Check("drive.estop", find_engaged_estop, laptop=(GRAPH,)),
    # While its supervisor replaces the e-stop's process, the bus is locked for a moment: the follow-up probe decides.
    Check("drive.locks", find_bus_locks, laptop=(GRAPH,), robot=(UNIT_STATES,), followup_laptop=(GRAPH,)),
    Check("drive.publishers", find_unexpected_publishers, laptop=(GRAPH, ROS_PROCESSES), robot=(ROS_PROCESSES,)),
    Check("drive.inputs", find_inputs_sending_zeros, laptop=(GRAPH, ROS_PROCESSES), robot=(ROS_PROCESSES,)),
)
