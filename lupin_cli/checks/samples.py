"""What is named and not delivered: QoS that fits nowhere, names without samples, one way without the other."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.capture import packet_lines, reaches_robot
from lupin_cli.checks.controllers import graphs
from lupin_cli.facts.graph import GRAPH, End, Graph
from lupin_cli.facts.packets import PACKETS
from lupin_runtime.graph import BATTERY, CLOCK, ESTOP_BUTTON, ESTOP_STATE, IMU, JOINT_STATES, ODOM, SCAN, TF, topics

KNOWN = frozenset(topic.name for topic in topics())
# They repeat all the time where they work: silence means something.
REPEATED = (CLOCK, SCAN, ODOM, JOINT_STATES, TF, ESTOP_STATE, IMU, BATTERY, ESTOP_BUTTON)
BOARD = (IMU.name, BATTERY.name, ESTOP_BUTTON.name)


def mismatch(publisher: End, subscriber: End) -> str:
    """Why nothing flows from one to the other; empty where it does.

    A reader gets what it asks for or nothing (OMG DDS 1.4, 2.2.3, "requested versus offered").
    """
    if publisher.type != subscriber.type:
        return f"published as {publisher.type}, expected as {subscriber.type}"
    if subscriber.reliable and not publisher.reliable:
        return "offered BEST_EFFORT, expected RELIABLE"
    if subscriber.latched and not publisher.latched:
        return "offered VOLATILE, expected TRANSIENT_LOCAL"
    return ""


def unfitting(evidence: Evidence) -> Iterator[Finding]:
    """Subscribers that hear none of a topic's publishers, although there are some."""
    for graph in graphs(evidence):
        for topic in graph.topics:
            if topic.name not in KNOWN or not topic.publishers:
                continue
            for subscriber in (end for end in topic.subscribers if not end.is_ghost):
                reasons = [mismatch(publisher, subscriber) for publisher in topic.publishers]
                if not all(reasons):
                    continue
                kind = "type-mismatch" if all(p.type != subscriber.type for p in topic.publishers) else "qos-mismatch"
                yield Finding(
                    id=kind,
                    severity=Severity.PROBLEM,
                    where=graph.where,
                    symptom=f"{subscriber.node} never gets a message on {topic.name}, without any error",
                    cause=f"{topic.name} is {reasons[0]}: DDS connects the two and delivers nothing",
                    evidence=(
                        f"{topic.name} on {graph.name}",
                        *(f"publisher {end.node}: {end.type} {end.qos}" for end in topic.publishers),
                        f"subscriber {subscriber.node}: {subscriber.type} {subscriber.qos}",
                    ),
                    fix=Fix(f"start {subscriber.node} with the QoS that {topic.name} offers: {topic.publishers[0].qos}"),
                )


def _counts(graph: Graph) -> tuple[str, ...]:
    return tuple(f"{name}: {count} samples" for name, count in graph.samples)


def _arrived(graph: Graph) -> tuple[str, ...]:
    """What data came from there: a call's answer is a sample as any other."""
    samples = (f"{name}: {count} samples" for name, count in graph.samples if count)
    return (*samples, *(call.line() for call in graph.calls if call.round_trip_s is not None))


def names_only(evidence: Evidence) -> Iterator[Finding]:
    """Every topic is listed and none delivers: the phone book works and the line does not."""
    for graph in graphs(evidence):
        if not graph.samples or any(count for _, count in graph.samples):
            continue
        shared = bool(graph.udp_heard)
        if not shared and _arrived(graph):
            continue  # the line works: whoever publishes there is silent, each for a reason of its own
        yield Finding(
            id="names-no-samples",
            severity=Severity.PROBLEM,
            where=graph.where if shared else "link",
            symptom="every topic is listed and nothing arrives: a dead stack to look at, though its own nodes work",
            cause=(
                "shared memory does not hand samples to those that join later; over UDP they arrive"
                if shared
                else "no sample of any topic reaches this machine"
                + (", over UDP neither: data goes another way than names" if graph.udp_heard == 0 else "")
            ),
            evidence=(
                f"{graph.name}: {len(graph.topics)} topics, {len(graph.nodes)} nodes, joined after {graph.joined_s:.1f} s",
                *_counts(graph),
                *(
                    (f"a second visitor with FASTDDS_BUILTIN_TRANSPORTS=UDPv4 heard {graph.udp_heard} topics",)
                    if shared
                    else ()
                ),
                *_arrived(graph),
                *(packet_lines(evidence) if graph.kind == "robot" else ()),
            ),
            fix=Fix("export FASTDDS_BUILTIN_TRANSPORTS=UDPv4" if shared else "lupin transport"),
            explains=frozenset({"topic-silent", "one-way-data", "board-wedged"}),
        )


def one_way(evidence: Evidence) -> Iterator[Finding]:
    """Samples arrive from the robot and no call gets there and back: the mark of an announced address without a route."""
    for graph in graphs(evidence):
        if len(graph.calls) < 2 or any(call.round_trip_s is not None for call in graph.calls):
            continue
        if not any(count for _, count in graph.samples):
            continue
        if graph.kind == "robot" and reaches_robot(evidence):
            continue  # the way is open: whoever is asked is only too busy to answer in time
        yield Finding(
            id="one-way-data",
            severity=Severity.PROBLEM,
            where="link" if graph.kind == "robot" else graph.where,
            symptom="telemetry is live, and no drive command, arm service or controller call gets through",
            cause="data flows from the robot and not back: what is sent to the robot goes to an address that it announces and "
            "that this machine has no way to",
            evidence=(
                *(call.line() for call in graph.calls),
                *(packet_lines(evidence) if graph.kind == "robot" else ()),
                *_counts(graph),
            ),
            fix=Fix("lupin play single-home", playbook="single-home"),
            explains=frozenset({"controller-manager-silent", "drive-sink-unheard"}),
        )


def silent(evidence: Evidence) -> Iterator[Finding]:
    """A publisher of something that repeats, and not one message of it while others speak."""
    for graph in graphs(evidence):
        if not _arrived(graph) or graph.udp_heard:
            continue
        for row in REPEATED:
            topic = graph.topic(row.name)
            if graph.heard(row.name) != 0 or topic is None or (row.name in BOARD and board_silent(graph)):
                continue
            if all(end.is_ghost for end in topic.publishers):
                continue
            yield Finding(
                id="topic-silent",
                severity=Severity.PROBLEM,
                where=graph.where,
                symptom=f"whatever needs {row.name} waits for it",
                cause=f"{row.name} has a publisher that says nothing",
                evidence=(
                    f"{row.name} on {graph.name}: published by {', '.join(end.node for end in topic.publishers)}, 0 samples",
                    *_arrived(graph),
                ),
                fix=Fix("lupin logs" if graph.kind == "sim" else "lupin play heal"),
                about=row.name,
            )


def board_silent(graph: Graph) -> bool:
    """Whether everything that the motor board says has a publisher, says nothing, and others do speak."""
    said = [graph.heard(name) for name in BOARD if graph.heard(name) is not None]
    return len(said) >= 2 and not any(said) and bool(_arrived(graph)) and not graph.udp_heard


def unvisited(evidence: Evidence) -> Iterator[Finding]:
    """A graph that could not be joined at all."""
    seen = evidence.laptop.get(GRAPH)
    for graph in seen.graphs if seen else ():
        if graph.error:
            yield Finding(
                id="graph-not-visited",
                severity=Severity.WARNING,
                where="laptop",
                symptom="nothing on this machine can join the graph, or the doctor can't",
                cause=f"the visit to {graph.name} failed",
                evidence=(graph.error, *(f"{key}={value}" for key, value in graph.environment)),
                fix=Fix("python -m lupin_runtime.stack.probe"),
            )


CHECKS = (
    Check("graph.qos", unfitting, (GRAPH,), closer_laptop=(GRAPH,)),
    # A closer look visits the graph again: that makes the packets that are counted, and a machine that was only busy is well.
    Check("graph.samples", names_only, (GRAPH,), closer_laptop=(GRAPH, PACKETS), closer_robot=(PACKETS,)),
    Check("graph.asymmetry", one_way, (GRAPH,), closer_laptop=(GRAPH, PACKETS), closer_robot=(PACKETS,)),
    Check("graph.silent", silent, (GRAPH,), closer_laptop=(GRAPH,)),
    Check("graph.visit", unvisited, (GRAPH,), closer_laptop=(GRAPH,)),
)
