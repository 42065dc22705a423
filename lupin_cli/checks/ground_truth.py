"""Ground truth: what this machine really receives, with the DDS configuration of this shell.

Only it can prove health. The other checks look for causes; if none of them explains what is missing here, that is a finding of
its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.layers import BASE_PART, BOARD_PART, DRIVE, EVERYTHING, LUPIN, ONBOARD_PROCESSES, STAMPS, part_of
from lupin_cli.checks.remote_command import robot_option
from lupin_cli.checks.robot_graph import other_robot
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.graph import GRAPH, Graph
from lupin_cli.facts.routes import ROUTES
from lupin_cli.facts.versions import VERSIONS
from lupin_runtime.graph import (
    ARM_LIBRARY_LIST,
    CMD_VEL_MANUAL,
    DRIVE_STATUS,
    ESTOP_STATUS,
    LIST_CONTROLLERS,
    MIN_RATE,
    SERVOS,
    UNTIMED_HZ,
    Topic,
    servo_range,
    topics,
)

NAME = "ground-truth"
UNEXPLAINED = "unexplained"  # the finding of what does not arrive
DRIVE_BUS = "twist_mux"
# Service → the part of the robot that serves it.
SERVED_BY = {
    LIST_CONTROLLERS.name: BASE_PART,
    servo_range(SERVOS[-1]).name: BOARD_PART,
    ARM_LIBRARY_LIST.name: LUPIN,
}
# Nodes that a robot has, by the last part of their name → the part of the robot that they belong to.
NODES = {"controller_manager": BASE_PART, DRIVE_BUS: LUPIN, "estop_bridge": LUPIN}
HEARD, SILENT, MISSING, SLOW, LATE, UNTIMED = "heard", "silent", "missing", "slow", "late", "untimed"
TIMING_S = 1.0  # a rate that was observed for less time proves nothing
STAMP_LIMIT_S = 1.0  # navigation and mapping refuse transforms and scans of this age
BUSY = 0.8  # share of the time in which the probe's process worked or waited for a processor: it may have missed samples


class State(str, Enum):
    """Healthy: everything that is required was observed and works. Unobserved: nothing is known to be broken."""

    HEALTHY = "healthy"
    BROKEN = "broken"
    UNOBSERVED = "unobserved"


@dataclass(frozen=True)
class TopicReport:
    """A topic as it arrives here.

    Silent: it has a publisher, and no sample came; missing: nobody publishes it. Slow: below a usable share of its nominal
    rate; late: its stamps are too far from this machine's clock. Untimed: it was not observed, or not long enough.
    """

    name: str
    required: bool
    samples: int
    rate_hz: float | None
    age_s: float | None
    state: str
    nominal_hz: float | None = None
    stamp_age_s: float | None = None  # how old the samples were by their stamps and this machine's clock

    def line(self) -> str:
        """Return the report in one line."""
        if not self.samples:
            unknown = {MISSING: "no publisher is known here", UNTIMED: "its publisher appeared too late to be observed"}
            return f"{self.name}: {unknown.get(self.state, '0 samples')}"
        rate = "" if self.rate_hz is None else f", {self.rate_hz:g} Hz"
        if self.state == SLOW and self.nominal_hz is not None:
            rate += f" instead of {self.nominal_hz:g} Hz"
        if self.state == UNTIMED:
            rate += "; the probe was too short of processor time to know its rate"
        if self.state == LATE and self.stamp_age_s is not None:
            rate += f", stamps {abs(self.stamp_age_s):.1f} s {'old' if self.stamp_age_s > 0 else 'in the future'}"
        return f"{self.name}: {self.samples} samples{rate}"


@dataclass(frozen=True)
class GroundTruth:
    """What this machine received from one graph, and what is missing, by the part of the robot that should deliver it."""

    state: State
    graph: str = ""  # a run's id, robot or shell; empty if no graph was measured
    environment: Mapping[str, str] = field(default_factory=dict)  # DDS variables of the measuring process
    topics: tuple[TopicReport, ...] = ()
    services: tuple[tuple[str, float | None], ...] = ()  # with the seconds until the answer
    drive: str = "unobserved"  # whether a drive command of this machine would arrive: reaches, unmatched or unobserved
    missing_nodes: tuple[str, ...] = ()
    losses: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # part of the robot → evidence
    unobserved: tuple[str, ...] = ()
    visit_s: float = 0.0  # how long the visit of the graph took

    @property
    def heard(self) -> int:
        """The number of topics with samples."""
        return sum(topic.samples > 0 for topic in self.topics)

    @property
    def needs_second_look(self) -> bool:
        """Whether only rates, ages or names that may come late are at fault: a busy moment of this machine looks the same."""
        missing = any(topic.required and topic.state in (SILENT, MISSING) for topic in self.topics)
        return self.state is State.BROKEN and bool(self.topics) and not missing

    @property
    def required(self) -> int:
        """The number of topics that must have samples."""
        return sum(topic.required for topic in self.topics)


def measure(snapshot: Snapshot) -> GroundTruth:
    """Judge the graphs that the snapshot contains: that of the selected robot, or else the worst of all."""
    graphs = snapshot.laptop.get(GRAPH)
    if graphs is None:
        return GroundTruth(State.UNOBSERVED, unobserved=(f"topics: {snapshot.laptop.why_unknown(GRAPH)}",))
    if snapshot.link is None:
        judged = [_judge(snapshot, graph) for graph in graphs.graphs]
        if not judged:
            return GroundTruth(State.UNOBSERVED, unobserved=("topics: no ROS graph runs on this machine",))
        return min(judged, key=lambda truth: (State.BROKEN, State.UNOBSERVED, State.HEALTHY).index(truth.state))
    graph = next((each for kind in ("shell", "robot") for each in graphs.graphs if each.kind == kind), None)
    if graph is None:
        return GroundTruth(State.UNOBSERVED, unobserved=("topics: this shell joins no robot's graph",))
    if host := other_robot(snapshot, graph):
        line = f"topics: this shell's ROS 2 asks the server at {host}, not {snapshot.link.robot}"
        return GroundTruth(State.UNOBSERVED, graph.name, dict(graph.environment), unobserved=(line,))
    return _judge(snapshot, graph)


def hears_vendor(truth: GroundTruth) -> bool:
    """Return whether samples of the vendor's own programs arrive."""
    vendors = {row.name for row in topics() if row.from_vendor}
    return any(report.samples and report.name in vendors for report in truth.topics)


def hears_robot(truth: GroundTruth) -> bool:
    """Return whether anything of the robot arrives: a sample, or the answer to a call."""
    return bool(truth.heard) or is_answered(truth)


def is_answered(truth: GroundTruth) -> bool:
    """Return whether a call was answered: commands of this machine reach the robot."""
    return any(round_trip_s is not None for _, round_trip_s in truth.services)


def knows_names(snapshot: Snapshot) -> bool:
    """Return whether the names of another machine's topics or nodes have arrived here over DDS."""
    graphs = snapshot.laptop.get(GRAPH)
    return graphs is not None and any(graph.kind != "sim" for graph in graphs.alive)


def _judge(snapshot: Snapshot, graph: Graph) -> GroundTruth:
    environment = dict(graph.environment)
    if graph.error:
        losses: dict[str, tuple[str, ...]] = {
            EVERYTHING: (f"no process of this machine can join the graph {graph.name}", graph.error)
        }
        return GroundTruth(State.BROKEN, graph.name, environment, losses=losses)
    if snapshot.link is None and graph.kind == "robot" and not graph.topics:
        server = environment.get("ROS_DISCOVERY_SERVER", "")
        line = f"topics: no robot was selected, and nothing of the graph of {server} arrives"
        return GroundTruth(State.UNOBSERVED, graph.name, environment, unobserved=(line,))
    with_lupin = _has_lupin(snapshot, graph)
    reports = tuple(
        _report(graph, row, required=_is_required(graph, row, with_lupin))
        for row in topics()
        if row.repeats or row.probed
        if _is_required(graph, row, with_lupin) or graph.sample_count(row.name) is not None
    )
    services = tuple((call.service, call.round_trip_s) for call in graph.calls)
    drive = _drive_state(graph) if with_lupin else "unobserved"
    losses = _losses(graph, reports, _missing_services(graph, with_lupin), drive)
    unobserved = [report.line() for report in reports if report.required and report.state == UNTIMED]
    unobserved += [f"{name}: its server appeared too late to be called" for name in graph.late if name in SERVED_BY]
    if not services:
        unobserved.append("services: no server of a service that the doctor may call is known here")
    if not with_lupin and graph.kind != "sim" and snapshot.link is not None and not snapshot.link.reachable:
        unobserved.append("drive bus and e-stop: the robot could not be asked whether it should run them")
    if with_lupin and drive == "unobserved":
        unobserved.append("drive commands: the drive bus is not known here")
    state = State.BROKEN if losses else State.UNOBSERVED if unobserved else State.HEALTHY
    return GroundTruth(
        state,
        graph.name,
        environment,
        reports,
        services,
        drive,
        _missing_nodes(graph, losses),
        losses,
        () if losses else tuple(unobserved),
        graph.visit_s,
    )


def _has_lupin(snapshot: Snapshot, graph: Graph) -> bool:
    """Return whether the robot should run Lupin's onboard service: simulated robots do, others if a release is deployed."""
    versions = snapshot.robot_fact(VERSIONS)
    if graph.kind == "sim" or (versions is not None and versions.release is not None and versions.release.current):
        return True
    published = (graph.topic(row.name) for row in (DRIVE_STATUS, ESTOP_STATUS))
    return any(topic is not None and any(not end.is_stale for end in topic.publishers) for topic in published)


def _is_required(graph: Graph, row: Topic, with_lupin: bool) -> bool:
    if any(publisher in ONBOARD_PROCESSES for publisher in row.publishers) and not row.from_vendor:
        return with_lupin
    if "sim" in row.publishers:
        return graph.kind == "sim" and row.repeats and graph.sample_count(row.name) is not None
    return row.repeats and row.from_vendor


def _report(graph: Graph, row: Topic, *, required: bool) -> TopicReport:
    count, timing = graph.sample_count(row.name), graph.timing(row.name)
    if count:
        state = _timing_state(graph, row, count) if required else HEARD
    elif count is None:
        state = UNTIMED if row.name in graph.late else MISSING
    else:
        state = SILENT
    rate_hz = timing.rate_hz
    if state in (SLOW, UNTIMED) and count and timing.listened_s:
        rate_hz = round(count / timing.listened_s, 2)  # over the whole time: samples may come in bursts
    return TopicReport(row.name, required, count or 0, rate_hz, timing.age_s, state, row.rate_hz, timing.stamp_age_s)


def _timing_state(graph: Graph, row: Topic, count: int) -> str:
    """Return whether a topic that delivers does so in time. Rates and stamps of a simulation are those of simulated time."""
    timing = graph.timing(row.name)
    if graph.uses_simulated_time:
        return HEARD
    # The first sample begins the time, so this is the highest rate that fits what was observed.
    listened_s = timing.listened_s or 0.0
    if row.repeats and row.rate_hz and listened_s >= TIMING_S and count < MIN_RATE * row.rate_hz * listened_s:
        return UNTIMED if graph.busy is not None and graph.busy >= BUSY else SLOW
    if timing.stamp_age_s is not None and abs(timing.stamp_age_s) > STAMP_LIMIT_S:
        return LATE
    return HEARD


def _missing_services(graph: Graph, with_lupin: bool) -> tuple[str, ...]:
    """Return the services that a robot must have and that have no server here, while others answer."""
    if graph.kind == "sim" or not any(call.round_trip_s is not None for call in graph.calls):
        return ()
    known = {*graph.late, *(call.service for call in graph.calls)}
    return tuple(name for name, part in SERVED_BY.items() if name not in known and (with_lupin or part != LUPIN))


def _drive_state(graph: Graph) -> str:
    """Return whether a drive command of this machine would be received by the drive bus, and its output by the base."""
    manual = graph.topic(CMD_VEL_MANUAL.name)
    listed = manual is not None and any(end.node.rpartition("/")[2] == DRIVE_BUS for end in manual.subscribers)
    if not listed or graph.drive_matched is None:
        return "unobserved"
    to_wheels = all(count for _, count in graph.sink_subscriptions)
    return "reaches" if graph.drive_matched and to_wheels else "unmatched"


def _losses(
    graph: Graph, reports: tuple[TopicReport, ...], missing_services: tuple[str, ...], drive: str
) -> dict[str, tuple[str, ...]]:
    """Return what does not arrive, by the part of the robot that should deliver it."""
    by_name = {row.name: row for row in topics()}
    required = [report for report in reports if report.required]
    answered = any(call.round_trip_s is not None for call in graph.calls)
    if not answered and not any(report.samples for report in reports):
        return {EVERYTHING: (_visit_line(graph), *(report.line() for report in required))}
    losses: dict[str, list[str]] = {}
    timed = [report for report in required if (report.nominal_hz or 0.0) > UNTIMED_HZ]
    if len(timed) > 1 and all(report.state == SLOW for report in timed):
        losses[EVERYTHING] = [_visit_line(graph), *(report.line() for report in timed)]
    for report in required:
        if report.state == LATE:
            losses.setdefault(STAMPS, []).append(report.line())
        elif report.state in (SILENT, MISSING) or (report.state == SLOW and EVERYTHING not in losses):
            losses.setdefault(part_of(by_name[report.name]), []).append(report.line())
    for call in graph.calls:
        if call.round_trip_s is None and call.service in SERVED_BY:
            losses.setdefault(SERVED_BY[call.service], []).append(call.line())
    for name in missing_services:
        losses.setdefault(SERVED_BY[name], []).append(f"{name}: no server is known here")
    if drive == "unmatched":
        sinks = (f"{name}: {count} subscriptions are matched with the drive bus" for name, count in graph.sink_subscriptions)
        losses[DRIVE] = [f"{CMD_VEL_MANUAL.name}: {graph.drive_matched} subscriptions are matched with this machine", *sinks]
    return {part: tuple(lines) for part, lines in losses.items()}


def _missing_nodes(graph: Graph, losses: Mapping[str, object]) -> tuple[str, ...]:
    """Return the nodes that the lost parts of the robot should have. Names alone prove nothing: under load they come late."""
    names = {name.rpartition("/")[2] for name in graph.nodes}
    lost = [node for node, part in NODES.items() if part in losses or EVERYTHING in losses]
    return tuple(node for node in lost if node not in names)


def _visit_line(graph: Graph) -> str:
    counts = f"{len(graph.topics)} topics and {len(graph.nodes)} nodes are known"
    return f"graph {graph.name}, joined from this machine: {counts} after {graph.joined_s:.1f} s"


def find_unexplained_losses(snapshot: Snapshot) -> Iterator[Finding]:
    """What this machine should receive and does not. A finding that explains it takes its place as root cause."""
    truth = measure(snapshot)
    for part, lines in truth.losses.items():
        everything, slow, stamps = part == EVERYTHING, _is_slow(truth, part), part == STAMPS
        heard = [report.line() for report in truth.topics if report.state == HEARD]
        nodes = [f"node {node}: not in the graph" for node in truth.missing_nodes if everything or NODES[node] == part]
        nodes = [] if slow or stamps else nodes
        yield make_finding(
            UNEXPLAINED,
            where="link" if everything else "robot" if snapshot.link is not None else "laptop",
            symptom=_symptom(part, slow=slow),
            cause=f"{_loss(part, slow=slow)}, and no check explains it",
            evidence=(*lines, *nodes, *(f"arrives here: {line}" for line in heard)),
            command=f"lupin bundle{robot_option(snapshot)}",
            about=part,
        )


def _is_slow(truth: GroundTruth, part: str) -> bool:
    """Return whether all that a part lacks is rate."""
    lines = truth.losses.get(part, ())
    slow = {report.line() for report in truth.topics if report.state == SLOW}
    return any(line in slow for line in lines) and all(line in slow or line.startswith("graph ") for line in lines)


def _symptom(part: str, *, slow: bool) -> str:
    if part == STAMPS:
        return "navigation and mapping refuse the robot's data: its stamps are too far from this machine's clock"
    if part == EVERYTHING:
        return "the robot's data arrives too slowly" if slow else "this machine receives nothing of the robot"
    return f"data of {part} arrives too slowly" if slow else f"this machine lacks data of: {part}"


def _loss(part: str, *, slow: bool) -> str:
    if part == STAMPS:
        return f"samples arrive with stamps that are more than {STAMP_LIMIT_S:g} s from this machine's clock"
    if part == EVERYTHING:
        if slow:
            return f"every topic arrives at less than {MIN_RATE:.0%} of its rate"
        return "no topic delivers samples to this machine and no service answers"
    return f"data of {part} arrives at less than {MIN_RATE:.0%} of its rate" if slow else f"data of {part} does not arrive here"


CHECKS = (
    Check(
        NAME,
        find_unexplained_losses,
        laptop=(GRAPH, ROUTES),
        robot=(VERSIONS, ADDRESSES),
        followup_laptop=(GRAPH,),  # a busy moment: only the second result counts
    ),
)
