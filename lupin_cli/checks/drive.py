"""Commands that reach no wheel: a sink that nobody listens at, an e-stop, a page that holds the bus with zeros."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.controllers import graphs
from lupin_cli.facts.graph import GRAPH, Graph
from lupin_runtime.graph import CMD_VEL_AUTO, CMD_VEL_JOY, CMD_VEL_MANUAL, CMD_VEL_SINK_ROBOT, CMD_VEL_SINK_SIM, HMI_ESTOP

# The last has the name that everybody guesses; it exists on no robot.
SINKS = (CMD_VEL_SINK_ROBOT.name, CMD_VEL_SINK_SIM.name, "/mirte_base_controller/cmd_vel_unstamped")
# They listen to commands and turn no wheel.
ONLOOKERS = ("light_strip_bridge", "lupin_recorder", "lupin_supervisor", "rosbridge_websocket", "rosapi", "rosbag2_recorder")
# A page that holds its stop sends zeros at 20 Hz, and the visitor listens for 1.2 s; fewer may be a hand leaving the stick.
MANY_ZEROS = 12
# How each is released, by the words of its reason. A page that went away while it held the stop can't let go any more.
RELEASES = {
    "button is pressed": "release the red button on the robot (the simulated one: lupin sim press estop --release)",
    "was lost": "press stop on a page, and release it there",
}
INPUTS = {
    CMD_VEL_MANUAL.name: ("page-holds-bus", "an open page", "release the e-stop on the page, or close it"),
    CMD_VEL_JOY.name: ("pad-holds-bus", "the gamepad's node", "stop the gamepad's node: a released dead-man must be silent"),
}


def unheard(evidence: Evidence) -> Iterator[Finding]:
    """Velocity commands that are published where no wheel listens."""
    for graph in graphs(evidence):
        for name in SINKS:
            topic = graph.topic(name)
            if topic is None or all(end.is_ghost for end in topic.publishers):
                continue
            if any(end.node.rpartition("/")[2] not in ONLOOKERS for end in topic.subscribers):
                continue
            if dict(graph.bus_listeners).get(name, 0) > len(topic.subscribers):
                continue  # under load a visitor's picture may lack an end that the bus itself is matched with
            elsewhere = [other for other in SINKS if other != name and (seen := graph.topic(other)) and seen.subscribers]
            yield Finding(
                id="drive-sink-unheard",
                severity=Severity.PROBLEM,
                where=graph.where,
                symptom="the robot ignores every drive command, without any error",
                cause=f"{name} has publishers and no wheel listens there"
                + (f"; the base listens on {elsewhere[0]}: the bus was started for another target" if elsewhere else ""),
                evidence=(
                    f"{name} on {graph.name}: published by {', '.join(end.node for end in topic.publishers)}",
                    f"{name}: subscribers: {', '.join(end.node for end in topic.subscribers) or 'none'}",
                    *(f"{other}: subscribers: {_subscribers(graph, other)}" for other in elsewhere),
                ),
                fix=Fix("lupin home" if graph.kind == "robot" and not elsewhere else f"lupin up --target {graph.kind}"),
                about=name,
            )


def _subscribers(graph: Graph, name: str) -> str:
    topic = graph.topic(name)
    return ", ".join(end.node for end in topic.subscribers) if topic else "none"


def stopped(evidence: Evidence) -> Iterator[Finding]:
    """An engaged e-stop, or a bus that is locked for another reason."""
    for graph in graphs(evidence):
        if graph.estop:
            said = " ".join(graph.estop_reasons)
            release = next((what for word, what in RELEASES.items() if word in said), "release the e-stop on the page")
            yield Finding(
                id="estop-engaged",
                severity=Severity.PROBLEM,
                where=graph.where,
                symptom="nothing drives: joystick, page and navigation alike",
                cause="the e-stop is engaged: " + (", ".join(graph.estop_reasons) or "its reason is not told"),
                evidence=(
                    f"e-stop on {graph.name}: engaged",
                    *graph.estop_reasons,
                    *(f"drive bus: {lock}" for lock in graph.bus_locks),
                ),
                fix=Fix(release),
                explains=frozenset({"page-holds-bus", "bus-locked"}),
            )
        elif graph.bus_locks:
            yield Finding(
                id="bus-locked",
                severity=Severity.PROBLEM,
                where=graph.where,
                symptom="nothing drives: joystick, page and navigation alike",
                cause="the drive bus is locked: " + ", ".join(graph.bus_locks),
                evidence=tuple(f"drive bus on {graph.name}: {lock}" for lock in graph.bus_locks),
                fix=Fix("lupin status"),
            )


def outvoted(evidence: Evidence) -> Iterator[Finding]:
    """An input that sends nothing but zeros keeps everything below its priority from the wheels."""
    for graph in graphs(evidence):
        for seen in graph.inputs:
            if seen.topic not in INPUTS or seen.count < MANY_ZEROS or seen.moving:
                continue
            id, who, what = INPUTS[seen.topic]
            topic = graph.topic(seen.topic)
            nodes = ", ".join(end.node for end in topic.publishers) if topic else "?"
            lower = next((each for each in graph.inputs if each.topic == CMD_VEL_AUTO.name), None)
            page = graph.topic(HMI_ESTOP.name)
            yield Finding(
                id=id,
                severity=Severity.PROBLEM if lower and lower.moving else Severity.WARNING,
                where=graph.where,
                symptom="navigation has a goal and the robot stands still; the drive bus belongs to somebody who wants nothing",
                cause=f"{who} sends zeros and out-votes every input of lower priority",
                evidence=(
                    f"{seen.topic} on {graph.name}: {seen.count} commands while listening, all zero, from {nodes}",
                    *((f"{lower.topic}: {lower.count} commands, {lower.moving} of them not zero",) if lower else ()),
                    *((f"drive bus: held by {graph.bus_winner}",) if graph.bus_winner else ()),
                    *((f"{HMI_ESTOP.name}: {len(page.publishers)} publisher(s)",) if page and page.publishers else ()),
                ),
                fix=Fix(what),
            )


CHECKS = (
    Check("drive.sink", unheard, (GRAPH,), closer_laptop=(GRAPH,)),  # a bus that is only coming up says nothing of its own yet
    Check("drive.estop", stopped, laptop=(GRAPH,)),
    Check("drive.inputs", outvoted, laptop=(GRAPH,)),
)
