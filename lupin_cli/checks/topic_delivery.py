"""Topics that are listed and not delivered: incompatible QoS, names without samples, data in one direction only, silence."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.controllers import visited_graphs
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.packet_evidence import data_reaches_robot, packet_lines
from lupin_cli.checks.remote_command import command_on_robot
from lupin_cli.facts.graph import GRAPH, Endpoint, Graph
from lupin_cli.facts.packets import PACKETS
from lupin_cli.systemd.units import CAMERAS
from lupin_runtime.graph import BODY_IMAGE_ROBOT, BODY_IMAGE_SIM, GRIPPER_IMAGE, MOTOR_BOARD, camera_info, topics

KNOWN_TOPICS = frozenset(topic.name for topic in topics())
REPEATED_TOPICS = tuple(topic for topic in topics() if topic.repeats)  # silence on them is a fault
BOARD_TOPICS = tuple(topic.name for topic in REPEATED_TOPICS if MOTOR_BOARD in topic.publishers)


def qos_mismatch(publisher: Endpoint, subscriber: Endpoint) -> str:
    """Return why no sample flows from `publisher` to `subscriber`; empty if they are compatible.

    A subscription gets everything that it requests, or nothing (OMG DDS 1.4, 2.2.3, "requested versus offered").
    """
    if publisher.type != subscriber.type:
        return f"published as {publisher.type}, expected as {subscriber.type}"
    if subscriber.reliable and not publisher.reliable:
        return "offered BEST_EFFORT, expected RELIABLE"
    if subscriber.latched and not publisher.latched:
        return "offered VOLATILE, expected TRANSIENT_LOCAL"
    return ""


def find_qos_mismatches(snapshot: Snapshot) -> Iterator[Finding]:
    """A subscription is incompatible with every publisher of its topic, in type or QoS."""
    for graph in visited_graphs(snapshot):
        for topic in graph.topics:
            if topic.name not in KNOWN_TOPICS or not topic.publishers:
                continue
            for subscriber in (end for end in topic.subscribers if not end.is_ghost):
                reasons = [qos_mismatch(publisher, subscriber) for publisher in topic.publishers]
                if not all(reasons):
                    continue
                other_type = all(publisher.type != subscriber.type for publisher in topic.publishers)
                yield make_finding(
                    "type-mismatch" if other_type else "qos-mismatch",
                    where=graph.machine,
                    symptom=f"{subscriber.node} never gets a message on {topic.name}, without any error",
                    cause=f"{topic.name} is {reasons[0]}: DDS connects publisher and subscriber and delivers nothing",
                    evidence=(
                        f"{topic.name} on {graph.name}",
                        *(f"publisher {end.node}: {end.type} {end.qos}" for end in topic.publishers),
                        f"subscriber {subscriber.node}: {subscriber.type} {subscriber.qos}",
                    ),
                    command=f"start {subscriber.node} with the QoS that {topic.name} offers: {topic.publishers[0].qos}",
                )


def _sample_counts(graph: Graph) -> tuple[str, ...]:
    return tuple(f"{name}: {count} samples" for name, count in graph.samples)


def _received_data(graph: Graph) -> tuple[str, ...]:
    """Return the data that arrived from the graph, as evidence lines. The answer to a call counts: it is a sample too."""
    samples = (f"{name}: {count} samples" for name, count in graph.samples if count)
    return (*samples, *(call.line() for call in graph.calls if call.round_trip_s is not None))


def find_names_without_samples(snapshot: Snapshot) -> Iterator[Finding]:
    """Topics are listed but none delivers a sample: discovery works, the data path does not."""
    for graph in visited_graphs(snapshot):
        if not graph.samples or any(count for _, count in graph.samples):
            continue
        shared_memory = bool(graph.udp_heard)
        if not shared_memory and _received_data(graph):
            continue  # the data path works: each publisher has its own reason to be silent
        other_path = ", not even over UDP: data takes another path than names" if graph.udp_heard == 0 else ""
        yield make_finding(
            "names-no-samples",
            where=graph.machine if shared_memory else "link",
            cause="shared memory delivers nothing to nodes that join later; over UDP the samples arrive"
            if shared_memory
            else f"no sample of any topic reaches the laptop{other_path}",
            evidence=(
                f"{graph.name}: {len(graph.topics)} topics, {len(graph.nodes)} nodes, joined after {graph.joined_s:.1f} s",
                *_sample_counts(graph),
                *(
                    (f"a second visit with FASTDDS_BUILTIN_TRANSPORTS=UDPv4 received {graph.udp_heard} topics",)
                    if shared_memory
                    else ()
                ),
                *_received_data(graph),
                *(packet_lines(snapshot) if graph.kind == "robot" else ()),
            ),
            command="export FASTDDS_BUILTIN_TRANSPORTS=UDPv4" if shared_memory else "lupin transport",
            explains={"topic-silent", "camera-silent", "one-way-data", "board-wedged"},
        )


def find_one_way_data(snapshot: Snapshot) -> Iterator[Finding]:
    """Samples arrive from the robot but no call is answered, as when the robot announces an address without a route."""
    for graph in visited_graphs(snapshot):
        if len(graph.calls) < 2 or any(call.round_trip_s is not None for call in graph.calls):
            continue
        if not any(count for _, count in graph.samples):
            continue
        if graph.kind == "robot" and data_reaches_robot(snapshot):
            continue  # the link is open in both directions: the servers are only too busy to answer in time
        yield make_finding(
            "one-way-data",
            where="link" if graph.kind == "robot" else graph.machine,
            cause="data arrives from the robot but does not reach it: it is sent to an address that the robot announces "
            "and to which the laptop has no route",
            evidence=(
                *(call.line() for call in graph.calls),
                *(packet_lines(snapshot) if graph.kind == "robot" else ()),
                *_sample_counts(graph),
            ),
            command="lupin play single-home",
            explains={"controller-manager-silent", "drive-sink-unheard"},
        )


def _silent_publishers(graph: Graph, name: str) -> str:
    """Return the nodes that publish a topic of which no sample arrived; empty if there are none, or if all have exited."""
    topic = graph.topic(name)
    if topic is None or graph.sample_count(name) != 0 or all(end.is_ghost for end in topic.publishers):
        return ""
    return ", ".join(end.node for end in topic.publishers)


def find_silent_topics(snapshot: Snapshot) -> Iterator[Finding]:
    """A topic that is published repeatedly has a publisher but delivers nothing, while other data arrives."""
    for graph in visited_graphs(snapshot):
        if not _received_data(graph) or graph.udp_heard:
            continue
        for row in REPEATED_TOPICS:
            publishers = _silent_publishers(graph, row.name)
            if not publishers or (row.name in BOARD_TOPICS and is_board_silent(graph)):
                continue
            yield make_finding(
                "topic-silent",
                where=graph.machine,
                symptom=f"everything that needs {row.name} waits for it",
                cause=f"{row.name} has a publisher that publishes nothing",
                evidence=(f"{row.name} on {graph.name}: published by {publishers}, 0 samples", *_received_data(graph)),
                command="lupin logs" if graph.kind == "sim" else "lupin play heal",
                about=row.name,
            )


def find_silent_cameras(snapshot: Snapshot) -> Iterator[Finding]:
    """A camera's driver is in the graph but publishes no pictures: the CameraInfo that comes with each does not arrive."""
    for graph in visited_graphs(snapshot):
        if not _received_data(graph) or graph.udp_heard:
            continue
        for image in (BODY_IMAGE_SIM, BODY_IMAGE_ROBOT, GRIPPER_IMAGE):
            name = camera_info(image).name
            publishers = _silent_publishers(graph, name)
            if not publishers:
                continue
            yield make_finding(
                "camera-silent",
                where=graph.machine,
                symptom=f"no pictures on {image.name}",
                cause=f"the driver that publishes {image.name} runs but delivers no pictures",
                evidence=(
                    f"{name} on {graph.name}: published by {publishers}, 0 samples",
                    *_received_data(graph),
                ),
                command="lupin logs"
                if graph.kind == "sim"
                else command_on_robot(snapshot, f"sudo systemctl restart {CAMERAS}; sudo journalctl -b -u {CAMERAS} -n 50"),
                about=image.name,
            )


def is_board_silent(graph: Graph) -> bool:
    """Return whether every topic of the motor board has a publisher and no samples, while other data arrives."""
    counts = [graph.sample_count(name) for name in BOARD_TOPICS if graph.sample_count(name) is not None]
    return len(counts) >= 2 and not any(counts) and bool(_received_data(graph)) and not graph.udp_heard


def find_failed_visits(snapshot: Snapshot) -> Iterator[Finding]:
    """The doctor could not join a graph."""
    seen = snapshot.laptop.get(GRAPH)
    for graph in seen.graphs if seen else ():
        if graph.error:
            yield make_finding(
                "graph-not-visited",
                where="laptop",
                cause=f"the doctor could not join the graph {graph.name}",
                evidence=(graph.error, *(f"{key}={value}" for key, value in graph.environment)),
                command="python -m lupin_runtime.stack.graph_probe",
            )


# The follow-up visits the graph again: it produces the packets that are captured, and clears findings of a busy moment.
CHECKS = (
    Check("graph.qos", find_qos_mismatches, laptop=(GRAPH,), followup_laptop=(GRAPH,)),
    Check(
        "graph.samples",
        find_names_without_samples,
        laptop=(GRAPH,),
        followup_laptop=(GRAPH, PACKETS),
        followup_robot=(PACKETS,),
    ),
    Check(
        "graph.asymmetry",
        find_one_way_data,
        laptop=(GRAPH,),
        followup_laptop=(GRAPH, PACKETS),
        followup_robot=(PACKETS,),
    ),
    Check("graph.silent", find_silent_topics, laptop=(GRAPH,), followup_laptop=(GRAPH,)),
    Check("graph.cameras", find_silent_cameras, laptop=(GRAPH,), followup_laptop=(GRAPH,)),
    Check("graph.visit", find_failed_visits, laptop=(GRAPH,), followup_laptop=(GRAPH,)),
)
