"""Topics that are listed and not delivered: incompatible QoS, names without samples, data in one direction only, silence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.clocks import measured_offset
from lupin_cli.checks.controllers import observed_graphs, playbook_on_robot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.ground_truth import STAMP_LIMIT_S
from lupin_cli.checks.laptop_programs import program_on_laptop
from lupin_cli.checks.layers import part_of
from lupin_cli.checks.packet_evidence import data_reaches_robot, packet_lines
from lupin_cli.checks.remote_command import command_on_robot, restart_unit, show_transports
from lupin_cli.facts.clock import CLOCK as CLOCK_READING
from lupin_cli.facts.clock import Offset
from lupin_cli.facts.graph import GRAPH, Endpoint, Graph, Timing
from lupin_cli.facts.packets import PACKETS
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.systemd.units import CAMERAS
from lupin_runtime.graph import BODY_IMAGE_ROBOT, BODY_IMAGE_SIM, GRIPPER_IMAGE, MOTOR_BOARD, camera_info, topics

KNOWN_TOPICS = frozenset(topic.name for topic in topics())
REPEATED_TOPICS = tuple(topic for topic in topics() if topic.repeats)  # silence on them is a fault
_FRAMES = {row.name: row.frame for row in topics()}
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
    for graph in observed_graphs(snapshot):
        for topic in graph.topics:
            if topic.name not in KNOWN_TOPICS or not topic.publishers:
                continue
            for subscriber in (end for end in topic.subscribers if not end.is_stale):
                reasons = [qos_mismatch(publisher, subscriber) for publisher in topic.publishers]
                if not all(reasons):
                    continue
                other_type = all(publisher.type != subscriber.type for publisher in topic.publishers)
                machine, instruction = _adapt(snapshot, graph, topic.publishers, subscriber)
                yield make_finding(
                    "type-mismatch" if other_type else "qos-mismatch",
                    where=machine,
                    graph=graph.name,
                    symptom=f"{subscriber.node} never gets a message on {topic.name}, without any error",
                    cause=f"{topic.name} is {reasons[0]}: DDS connects publisher and subscriber and delivers nothing",
                    evidence=(
                        f"{topic.name} on {graph.name}",
                        *(f"publisher {end.node}: {end.type} {end.qos}" for end in topic.publishers),
                        f"subscriber {subscriber.node}: {subscriber.type} {subscriber.qos}",
                    ),
                    instruction=instruction,
                )


def _adapt(snapshot: Snapshot, graph: Graph, publishers: Sequence[Endpoint], subscriber: Endpoint) -> tuple[str, str]:
    """Return the machine of the end of an incompatible topic that is changed, and how: the laptop's adapts to the robot's."""
    publisher, program = publishers[0], program_on_laptop(snapshot, graph, subscriber.node)
    senders = [program_on_laptop(snapshot, graph, end.node) for end in publishers]
    if program is None and senders[0] is not None and all(senders):
        return "laptop", (
            f"let {publisher.node} (process {senders[0].pid}) publish with {subscriber.type} {subscriber.qos}, "
            f"which is what {subscriber.node} expects, and start it again"
        )
    process = f" (process {program.pid})" if program is not None else ""
    return "laptop" if program is not None else graph.machine, (
        f"let {subscriber.node}{process} subscribe with {publisher.type} {publisher.qos}, "
        f"which is what {publisher.node} offers, and start it again"
    )


def _sample_counts(graph: Graph) -> tuple[str, ...]:
    return tuple(f"{name}: {count} samples" for name, count in graph.samples)


def _received_data(graph: Graph) -> tuple[str, ...]:
    """Return the data that arrived from the graph, as evidence lines. The answer to a call counts: it is a sample too."""
    samples = (f"{name}: {count} samples" for name, count in graph.samples if count)
    return (*samples, *(call.line() for call in graph.calls if call.round_trip_s is not None))


def find_wrong_headers(snapshot: Snapshot) -> Iterator[Finding]:
    """Samples arrive in another frame than the rest of the system expects, or with stamps far from the clock."""
    for graph in observed_graphs(snapshot):
        command = "lupin logs sim"
        if graph.kind == "robot":
            command = command_on_robot(snapshot, "journalctl --no-pager -b -u mirte-ros.service -n 50")
        frames = [t for t in graph.timings if t.frame is not None and _FRAMES.get(t.topic) and t.frame != _FRAMES[t.topic]]
        if frames:
            yield make_finding(
                "frame-wrong",
                where=graph.machine,
                graph=graph.name,
                cause="; ".join(f"samples of {t.topic} are in the frame {t.frame!r}, not {_FRAMES[t.topic]!r}" for t in frames),
                evidence=(f"{t.topic} on {graph.name}: {_publishers(graph, t.topic)}, frame_id {t.frame!r}" for t in frames),
                command=command,
            )
        late = [(timing, age_s) for timing in graph.timings if (age_s := _wrong_age_s(snapshot, graph, timing)) is not None]
        if late:
            drift = measured_offset(snapshot)
            yield make_finding(
                "stamps-wrong",
                where=graph.machine,
                graph=graph.name,
                cause="; ".join(
                    f"stamps of {timing.topic} are {abs(age_s):.1f} s {'behind' if age_s > 0 else 'ahead of'} the clock "
                    f"of the {graph.machine}"
                    for timing, age_s in late
                ),
                evidence=(
                    *(
                        f"{t.topic} on {graph.name}: {_publishers(graph, t.topic)}, {t.stamp_age_s:+.3f} s old when it arrived"
                        for t, _ in late
                    ),
                    *((f"robot's clock minus the laptop's: {drift}",) if drift is not None else ()),
                ),
                command=command,
            )


def _publishers(graph: Graph, name: str) -> str:
    seen = graph.topic(name)
    return f"published by {', '.join(end.node for end in seen.publishers)}" if seen else "not published any more"


def _wrong_age_s(snapshot: Snapshot, graph: Graph, timing: Timing) -> float | None:
    """Return how old samples were by the clock of the machine that stamped them; None if that is right, or not known.

    That the machine's clock is wrong is another finding.
    """
    drift = measured_offset(snapshot) if graph.kind == "robot" else Offset(0.0, 0.0)
    if timing.stamp_age_s is None or drift is None or graph.uses_simulated_time:
        return None
    age_s = timing.stamp_age_s + drift.offset_s
    return age_s if abs(age_s) > STAMP_LIMIT_S + drift.bound_s else None


def find_names_without_samples(snapshot: Snapshot) -> Iterator[Finding]:
    """Topics are listed but none delivers a sample: discovery works, the data path does not."""
    for graph in observed_graphs(snapshot):
        if not graph.samples or any(count for _, count in graph.samples):
            continue
        shared_memory = bool(graph.udp_heard)
        if not shared_memory and _received_data(graph):
            continue  # the data path works: each publisher has its own reason to be silent
        other_path = ", not even over UDP: data takes another path than names" if graph.udp_heard == 0 else ""
        yield make_finding(
            "names-no-samples",
            where=graph.machine if shared_memory else "link",
            graph=graph.name,
            cause="shared memory delivers nothing to nodes that join later; over UDP the samples arrive"
            if shared_memory
            else f"no sample of any topic reaches the laptop{other_path}",
            evidence=(
                f"{graph.name}: {len(graph.topics)} topics, {len(graph.nodes)} nodes, joined after {graph.joined_s:.1f} s",
                *_sample_counts(graph),
                *(
                    (f"a second probe with FASTDDS_BUILTIN_TRANSPORTS=UDPv4 received {graph.udp_heard} topics",)
                    if shared_memory
                    else ()
                ),
                *_received_data(graph),
                *(packet_lines(snapshot) if graph.kind == "robot" else ()),
            ),
            command="export FASTDDS_BUILTIN_TRANSPORTS=UDPv4" if shared_memory else show_transports(snapshot),
            explains={"topic-silent", "camera-silent", "one-way-data", "board-wedged"},
        )


def find_one_way_data(snapshot: Snapshot) -> Iterator[Finding]:
    """Samples arrive from the robot but no call is answered, as when the robot announces an address without a route."""
    for graph in observed_graphs(snapshot):
        if sum(call.sent for call in graph.calls) < 2 or any(call.round_trip_s is not None for call in graph.calls):
            continue
        if not any(count for _, count in graph.samples):
            continue
        if graph.kind == "robot" and data_reaches_robot(snapshot):
            continue  # the link is open in both directions: the servers are only too busy to answer in time
        yield make_finding(
            "one-way-data",
            where="link" if graph.kind == "robot" else graph.machine,
            graph=graph.name,
            cause="data arrives from the robot but does not reach it: it is sent to an address that the robot announces "
            "and to which the laptop has no route"
            if graph.kind == "robot"
            else "samples arrive from the graph, but no service of it answers",
            evidence=(
                *(call.line() for call in graph.calls),
                *(packet_lines(snapshot) if graph.kind == "robot" else ()),
                *_sample_counts(graph),
            ),
            command="lupin play single-home" if graph.kind == "robot" else "lupin logs",
            playbook=playbook_on_robot(graph),
            explains={"controller-manager-silent", "drive-sink-unheard"},
        )


def _silent_publishers(graph: Graph, name: str) -> str:
    """Return the nodes that publish a topic of which no sample arrived; empty if there are none, or if all have exited."""
    topic = graph.topic(name)
    if topic is None or graph.sample_count(name) != 0 or all(end.is_stale for end in topic.publishers):
        return ""
    return ", ".join(end.node for end in topic.publishers)


def find_silent_topics(snapshot: Snapshot) -> Iterator[Finding]:
    """A topic that is published repeatedly has a publisher but delivers nothing, while other data arrives."""
    for graph in observed_graphs(snapshot):
        if not _received_data(graph) or graph.udp_heard:
            continue
        for row in REPEATED_TOPICS:
            publishers = _silent_publishers(graph, row.name)
            if not publishers or (row.name in BOARD_TOPICS and is_board_silent(graph)):
                continue
            yield make_finding(
                "topic-silent",
                where=graph.machine,
                graph=graph.name,
                symptom=f"everything that needs {row.name} waits for it",
                cause=f"{row.name} has a publisher that publishes nothing",
                evidence=(f"{row.name} on {graph.name}: published by {publishers}, 0 samples", *_received_data(graph)),
                command="lupin logs" if graph.kind == "sim" else "lupin play heal",
                about=row.name,
                breaks=(part_of(row),),
            )


def find_silent_cameras(snapshot: Snapshot) -> Iterator[Finding]:
    """A camera's driver is in the graph but publishes no images: the CameraInfo that comes with each does not arrive."""
    for graph in observed_graphs(snapshot):
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
                graph=graph.name,
                symptom=f"no images on {image.name}",
                cause=f"the driver that publishes {image.name} runs but delivers no images",
                evidence=(
                    f"{name} on {graph.name}: published by {publishers}, 0 samples",
                    *_received_data(graph),
                ),
                command="lupin logs" if graph.kind == "sim" else restart_unit(snapshot, CAMERAS),
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
        if graph.error and graph.kind != "shell":  # the check of ground truth judges this shell's own graph
            yield make_finding(
                "graph-not-visited",
                where="laptop",
                cause=f"the doctor could not join the graph {graph.name}",
                evidence=(graph.error, *(f"{key}={value}" for key, value in graph.environment)),
                command="lupin dds check",
            )


# The follow-up probes the graph again: it produces the packets that are captured, and clears findings of a busy moment.
CHECKS = (
    Check(
        "graph.qos",
        find_qos_mismatches,
        laptop=(GRAPH, ROS_PROCESSES),
        robot=(ROS_PROCESSES,),
        followup_laptop=(GRAPH,),
    ),
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
    Check("graph.headers", find_wrong_headers, laptop=(GRAPH,), robot=(CLOCK_READING,), followup_laptop=(GRAPH,)),
    Check("graph.silent", find_silent_topics, laptop=(GRAPH,), followup_laptop=(GRAPH,)),
    Check("graph.cameras", find_silent_cameras, laptop=(GRAPH,), followup_laptop=(GRAPH,)),
    Check("graph.visit", find_failed_visits, laptop=(GRAPH,), followup_laptop=(GRAPH,)),
)
