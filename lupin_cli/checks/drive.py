"""Drive commands that reach no wheel, or bypass the drive bus.

The checks find a sink without subscribers, an engaged e-stop, a page or gamepad that holds the bus with zeros, and nodes that
bypass the bus or forge the e-stop's state.
"""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.controllers import visited_graphs
from lupin_cli.checks.findings import make_finding
from lupin_cli.facts.graph import GRAPH, Graph
from lupin_runtime.graph import (
    CMD_VEL_AUTO,
    CMD_VEL_JOY,
    CMD_VEL_MANUAL,
    CMD_VEL_SINK_ROBOT,
    CMD_VEL_SINK_SIM,
    ESTOP_STATE,
    HMI_ESTOP,
)

# The last one is the name that people guess; it exists on no robot.
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
# A page that holds its stop sends zeros at 20 Hz, and the doctor listens for 1.2 s. Fewer may come from a released stick.
MANY_ZEROS = 12
# Topic → the only node that may publish on it, and the finding and the danger if another node does.
SOLE_PUBLISHERS = {
    CMD_VEL_SINK_ROBOT.name: ("twist_mux", "drive-bypassed", "its commands bypass the drive bus and the e-stop"),
    CMD_VEL_SINK_SIM.name: ("twist_mux", "drive-bypassed", "its commands bypass the drive bus and the e-stop"),
    ESTOP_STATE.name: ("estop_bridge", "estop-forged", "the e-stop cannot be released while it does"),
}
# How the e-stop is released, by words of its reason. A page that disappeared while it held the stop cannot release it any more.
RELEASES = {
    "button is pressed": "release the red button on the robot (the simulated one: lupin sim press estop --release)",
    "was lost": "press stop on a page, and release it there",
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


def find_unheard_sinks(snapshot: Snapshot) -> Iterator[Finding]:
    """Drive commands are published on a topic to which no wheel controller subscribes."""
    for graph in visited_graphs(snapshot):
        for name in SINKS:
            topic = graph.topic(name)
            if topic is None or all(end.is_ghost for end in topic.publishers):
                continue
            if any(end.node.rpartition("/")[2] not in PASSIVE_SUBSCRIBERS for end in topic.subscribers):
                continue
            if dict(graph.bus_listeners).get(name, 0) > len(topic.subscribers):
                continue  # under load, the doctor's view may lack a subscription that the bus itself is matched with
            others = [other for other in SINKS if other != name and (seen := graph.topic(other)) and seen.subscribers]
            wrong_target = f"; the base listens on {others[0]}: the bus was started for another target" if others else ""
            yield make_finding(
                "drive-sink-unheard",
                where=graph.machine,
                cause=f"{name} has publishers, and no wheel controller subscribes to it{wrong_target}",
                evidence=(
                    f"{name} on {graph.name}: published by {', '.join(end.node for end in topic.publishers)}",
                    f"{name}: subscribers: {_subscribers(graph, name)}",
                    *(f"{other}: subscribers: {_subscribers(graph, other)}" for other in others),
                ),
                command="lupin home" if graph.kind == "robot" and not others else f"lupin up --target {graph.kind}",
                about=name,
            )


def _subscribers(graph: Graph, name: str) -> str:
    topic = graph.topic(name)
    return ", ".join(end.node for end in topic.subscribers) if topic and topic.subscribers else "none"


def find_engaged_stop(snapshot: Snapshot) -> Iterator[Finding]:
    """The e-stop is engaged, or the drive bus is locked for another reason."""
    for graph in visited_graphs(snapshot):
        if graph.estop:
            reasons = " ".join(graph.estop_reasons)
            yield make_finding(
                "estop-engaged",
                where=graph.machine,
                cause="the e-stop is engaged: " + (", ".join(graph.estop_reasons) or "no reason is published"),
                evidence=(
                    f"e-stop on {graph.name}: engaged",
                    *graph.estop_reasons,
                    *(f"drive bus: {lock}" for lock in graph.bus_locks),
                ),
                command=next(
                    (release for word, release in RELEASES.items() if word in reasons), "release the e-stop on the page"
                ),
                explains={"page-holds-bus", "bus-locked"},
            )
        elif graph.bus_locks:
            yield make_finding(
                "bus-locked",
                where=graph.machine,
                cause="the drive bus is locked: " + ", ".join(graph.bus_locks),
                evidence=(f"drive bus on {graph.name}: {lock}" for lock in graph.bus_locks),
                command="lupin status",
            )


def find_intruders(snapshot: Snapshot) -> Iterator[Finding]:
    """A node publishes on a topic on which only the drive bus or the e-stop bridge may publish."""
    for graph in visited_graphs(snapshot):
        for name, (expected, id, danger) in SOLE_PUBLISHERS.items():
            topic = graph.topic(name)
            publishers = [end.node for end in topic.publishers if not end.is_ghost] if topic else []
            intruders = sorted({node for node in publishers if node.rpartition("/")[2] != expected})
            if intruders:
                yield make_finding(
                    id,
                    where=graph.machine,
                    cause=f"{', '.join(intruders)} also publishes on {name}: {danger}",
                    evidence=(f"{name} on {graph.name}: published by {', '.join(publishers)}",),
                    command=f"stop the program that runs the node {intruders[0]}",
                    about=name,
                )


def find_inputs_sending_zeros(snapshot: Snapshot) -> Iterator[Finding]:
    """An input of the drive bus sends only zeros and so overrides every input of lower priority."""
    for graph in visited_graphs(snapshot):
        for seen in graph.inputs:
            if seen.topic not in INPUTS or seen.count < MANY_ZEROS or seen.moving:
                continue
            id, publisher, command = INPUTS[seen.topic]
            topic = graph.topic(seen.topic)
            nodes = ", ".join(end.node for end in topic.publishers) if topic else "?"
            lower = next((each for each in graph.inputs if each.topic == CMD_VEL_AUTO.name), None)
            page = graph.topic(HMI_ESTOP.name)
            yield make_finding(
                id,
                severity=Severity.PROBLEM if lower and lower.moving else Severity.WARNING,
                where=graph.machine,
                cause=f"{publisher} sends zeros and overrides every input of lower priority",
                evidence=(
                    f"{seen.topic} on {graph.name}: {seen.count} commands received, all zero, from {nodes}",
                    *((f"{lower.topic}: {lower.count} commands, {lower.moving} of them not zero",) if lower else ()),
                    *((f"drive bus: held by {graph.bus_winner}",) if graph.bus_winner else ()),
                    *((f"{HMI_ESTOP.name}: {len(page.publishers)} publisher(s)",) if page and page.publishers else ()),
                ),
                command=command,
            )


CHECKS = (
    # A bus that is still starting does not publish its own listeners yet: the second visit decides.
    Check("drive.sink", find_unheard_sinks, laptop=(GRAPH,), followup_laptop=(GRAPH,)),
    Check("drive.estop", find_engaged_stop, laptop=(GRAPH,)),
    Check("drive.publishers", find_intruders, laptop=(GRAPH,)),
    Check("drive.inputs", find_inputs_sending_zeros, laptop=(GRAPH,)),
)
