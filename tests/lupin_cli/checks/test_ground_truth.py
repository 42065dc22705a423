"""What this machine receives, judged from a captured graph: health needs every required topic, an answer and a drive bus."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Fix, Severity, Snapshot
from lupin_cli.checks.findings import FINDINGS, make_finding
from lupin_cli.checks.ground_truth import GroundTruth, State, measure
from lupin_cli.checks.layers import BASE_PART, BOARD_PART, DRIVE, EVERYTHING, LIDAR_PART, LUPIN, STAMPS
from lupin_cli.connection.base import Output
from lupin_cli.doctor.doubts import unconfirmed_losses
from lupin_cli.doctor.engine import Diagnosis, diagnose
from lupin_cli.doctor.report import exit_status, verdict
from lupin_cli.exit_codes import FAILURE, NO_RESULT, SUCCESS
from lupin_cli.facts.addresses import Address, Addresses
from lupin_cli.facts.base import Facts, Unknown
from lupin_cli.facts.graph import GRAPH, Endpoint, Graph, Graphs, ObservedTopic, Timing
from lupin_cli.facts.link import Link
from lupin_cli.facts.routes import RoutingTable
from lupin_runtime import graph as rows
from lupin_runtime.graph import CMD_VEL_MANUAL, CMD_VEL_SINK_ROBOT, DRIVE_STATUS, SCAN
from tests.support.optional import present
from tests.support.paths import CAPTURED_FACTS

LINK = Link("greenhouse", "10.42.0.1", transport="wired")
TWIST = "geometry_msgs/msg/Twist"


def received(**changed: Any) -> Graph:
    """Return what a laptop receives of a healthy robot with Lupin's drive bus, with fields `changed`."""
    seen = GRAPH.parse(Output(0, (CAPTURED_FACTS / "graph" / "simulator.txt").read_text())).graphs[0]
    bus = Endpoint("/twist_mux", TWIST, reliable=True, latched=False)
    others = tuple(topic for topic in seen.topics if topic.name not in (CMD_VEL_MANUAL.name, DRIVE_STATUS.name))
    status = Endpoint("/twist_mux", DRIVE_STATUS.type, reliable=True, latched=True)
    topics = (
        *others,
        ObservedTopic(CMD_VEL_MANUAL.name, (), (bus,)),
        ObservedTopic(DRIVE_STATUS.name, (status,), ()),
    )
    required = [
        row.name for row in rows.topics() if (row.repeats and row.from_vendor) or {"drive", "estop"} & set(row.publishers)
    ]
    samples = {name: 5 for name in required if (row := rows.topic(name)) and (row.repeats or row.probed)}
    defaults: dict[str, Any] = {
        "name": "robot",
        "kind": "robot",
        "topics": topics,
        "samples": tuple(samples.items()),
        "sink_subscriptions": ((CMD_VEL_SINK_ROBOT.name, 1),),
        "drive_matched": 1,
    }
    return dataclasses.replace(seen, **(defaults | changed))


def without(*names: str, count: int | None = 0) -> tuple[tuple[str, int], ...]:
    """Return the samples with `count` on these topics; None removes them."""
    pairs = ((name, count if name in names else number) for name, number in received().samples)
    return tuple((name, number) for name, number in pairs if number is not None)


def snapshot(*graphs: Graph, link: Link | None = LINK) -> Snapshot:
    return Snapshot(Facts("laptop", {"graph": Graphs(graphs)}), None, link)


def judge(*graphs: Graph, explanations: tuple[Finding, ...] = (), link: Link | None = LINK) -> Diagnosis:
    checks = (*ground_truth.CHECKS, Check("explanations", lambda _: explanations))
    return diagnose(checks, snapshot(*graphs, link=link))


def lost(*graphs: Graph) -> dict[str, tuple[str, ...]]:
    return dict(measure(snapshot(*graphs)).losses)


def test_health_is_what_was_received() -> None:
    diagnosis = judge(received())
    assert diagnosis.healthy and exit_status(diagnosis, LINK) == SUCCESS
    count = len(received().samples)
    assert verdict(diagnosis, LINK) == f"greenhouse over cable (10.42.0.1): healthy, {count} topics with samples"


@pytest.mark.parametrize("name", [name for name, _ in received().samples])
@pytest.mark.parametrize("count", [0, None])
def test_each_topic_that_does_not_arrive_breaks_health(name: str, count: int | None) -> None:
    diagnosis = judge(received(samples=without(name, count=count)))
    assert exit_status(diagnosis, LINK) == FAILURE
    (root,) = diagnosis.roots
    assert root.finding.id == "unexplained" and root.finding.severity is Severity.PROBLEM
    assert any(name in line for line in root.finding.evidence)


def test_losses_are_grouped_by_the_part_that_should_deliver() -> None:
    calls = tuple(dataclasses.replace(call, round_trip_s=None) for call in received().calls)
    assert list(lost(received(samples=without(SCAN.name)))) == [LIDAR_PART]
    assert set(lost(received(calls=calls))) == {BASE_PART, BOARD_PART, LUPIN}
    silent = received(samples=tuple((name, 0) for name, _ in received().samples), calls=calls)
    assert list(lost(silent)) == [EVERYTHING]
    assert list(lost(received(drive_matched=0))) == [DRIVE]
    assert list(lost(received(sink_subscriptions=((CMD_VEL_SINK_ROBOT.name, 0),)))) == [DRIVE]
    assert list(lost(received(samples=without(DRIVE_STATUS.name)))) == [LUPIN]


def test_empty_graph_and_unjoinable_graph_break_health() -> None:
    empty = Graph("shell", "shell", ())
    for graphs in ((empty,), (received(), empty), (Graph("robot", "robot", (), error="no rmw"),)):
        diagnosis = judge(*graphs)
        assert [root.finding.about for root in diagnosis.roots] == [EVERYTHING]
        assert "healthy" not in verdict(diagnosis, LINK).replace("not healthy", "")
        assert exit_status(diagnosis, LINK) == FAILURE


def test_what_was_not_observed_is_listed_and_is_not_health() -> None:
    unprobed = diagnose(ground_truth.CHECKS, Snapshot(Facts("laptop", {"graph": Unknown("too slow")}), None, LINK))
    no_bus = received(topics=tuple(topic for topic in received().topics if topic.name != CMD_VEL_MANUAL.name))
    for diagnosis in (unprobed, judge(), judge(received(calls=())), judge(no_bus)):
        assert not diagnosis.healthy and diagnosis.roots == () and diagnosis.gaps
        assert exit_status(diagnosis, LINK) == NO_RESULT
        assert "healthy" not in verdict(diagnosis, LINK)
    assert "drive commands" in judge(no_bus).gaps[0] and "services" in judge(received(calls=())).gaps[0]


def test_graph_of_this_machine_needs_no_robot() -> None:
    nothing = judge(link=None)
    assert nothing.gaps == ("topics: no ROS graph runs on this machine",) and exit_status(nothing) == NO_RESULT
    robot_off = judge(Graph("robot", "robot", (("ROS_DISCOVERY_SERVER", "10.42.0.1:11811"),)), link=None)
    assert robot_off.roots == () and "10.42.0.1:11811" in robot_off.gaps[0]


@pytest.mark.parametrize(
    ("id", "part", "explained"),
    [
        ("discovery-server-missing", EVERYTHING, True),
        ("discovery-server-missing", LIDAR_PART, True),
        ("controllers-not-active", BASE_PART, True),
        ("controllers-not-active", LIDAR_PART, False),
        ("board-wedged", BOARD_PART, True),
        ("battery-low", BOARD_PART, False),
        ("release-broken", LUPIN, True),
        ("release-broken", EVERYTHING, False),
        ("shared-memory-at-risk", EVERYTHING, False),
    ],
)
def test_finding_explains_only_the_parts_it_breaks(id: str, part: str, explained: bool) -> None:
    parts = {
        EVERYTHING: received(samples=(), calls=()),
        LIDAR_PART: received(samples=without(SCAN.name)),
        BASE_PART: received(samples=without(rows.ODOM.name)),
        BOARD_PART: received(samples=without(rows.IMU.name)),
        LUPIN: received(samples=without(DRIVE_STATUS.name)),
    }
    cause = make_finding(id, where="robot", cause="c", evidence=("line",), command="fix it")
    roots = [root.finding.id for root in judge(parts[part], explanations=(cause,)).roots]
    assert roots == ([id] if explained else sorted([id, "unexplained"], key=[*roots].index))
    assert ("unexplained" in roots) != explained


def test_unit_of_another_package_explains_nothing() -> None:
    plugin = Finding("theirs", Severity.PROBLEM, "robot", "s", "c", ("e",), Fix("f"))
    diagnosis = judge(received(samples=without(SCAN.name)), explanations=(plugin,))
    assert {root.finding.id for root in diagnosis.roots} == {"theirs", "unexplained"}


def test_every_finding_has_a_layer_and_breaks_known_parts() -> None:
    from lupin_cli.checks.layers import LAYERS

    parts = {EVERYTHING, LIDAR_PART, BASE_PART, BOARD_PART, LUPIN, DRIVE, STAMPS}
    for row in FINDINGS:
        assert row.path_layer in LAYERS and set(row.breaks) <= parts, row.id


def test_cause_of_everything_is_a_warning_while_all_arrives() -> None:
    edited = make_finding("profile-unreadable", where="robot", cause="c", evidence=("e",), command="f", breaks=(EVERYTHING,))
    (root,) = judge(received(), explanations=(edited,)).roots
    assert root.finding.severity is Severity.WARNING
    (root,) = judge(received(samples=(), calls=()), explanations=(edited,)).roots
    assert root.finding.severity is Severity.PROBLEM


def timed(rate_share: float = 1.0, *names: str, stamp_age_s: float | None = None, **changed: Any) -> Graph:
    """Return a graph of which these topics (all, without any) arrived for 2 s at this share of their nominal rate."""
    counts, timings = [], []
    for name, count in received().samples:
        row = rows.topic(name)
        rate_hz = row.rate_hz if row is not None and row.rate_hz else 1.0
        if row is not None and row.repeats:
            count = max(1, round(2.0 * rate_hz * (rate_share if not names or name in names else 1.0)))
        stamped = row is not None and row.frame is not None
        counts.append((name, count))
        timings.append(Timing(name, None, 0.01, stamp_age_s if stamped else None, None, listened_s=2.0))
    # A node with the parameter use_sim_time listens for a simulated time that nobody publishes.
    topics = tuple(
        dataclasses.replace(topic, publishers=()) if topic.name == rows.CLOCK.name else topic for topic in received().topics
    )
    return received(**({"topics": topics, "samples": tuple(counts), "timings": tuple(timings)} | changed))


def test_topic_below_its_rate_is_slow() -> None:
    assert judge(timed()).healthy and judge(timed(0.5, SCAN.name)).healthy
    diagnosis = judge(timed(0.04, SCAN.name))
    (root,) = diagnosis.roots
    assert (root.finding.about, root.finding.where) == (LIDAR_PART, "robot") and exit_status(diagnosis, LINK) == FAILURE
    assert any("instead of 10 Hz" in line for line in root.finding.evidence)
    assert "less than 40% of its rate" in root.finding.cause
    truth = present(diagnosis.ground_truth)
    assert truth.needs_second_look and next(topic.state for topic in truth.topics if topic.name == SCAN.name) == "slow"


def test_loss_that_only_a_warning_explains_needs_confirmation() -> None:
    slow = timed(0.04, SCAN.name)
    assert [loss.about for loss in unconfirmed_losses(judge(slow))] == [LIDAR_PART]
    edited = make_finding("dds-not-set-up", where="laptop", cause="c", evidence=("e",), command="f")
    assert [loss.about for loss in unconfirmed_losses(judge(slow, explanations=(edited,)))] == [LIDAR_PART]
    server = make_finding("discovery-server-missing", where="robot", cause="c", evidence=("e",), command="f")
    assert unconfirmed_losses(judge(slow, explanations=(server,))) == []


def test_everything_slow_is_one_loss_on_the_link() -> None:
    (root,) = judge(timed(0.04)).roots
    assert (root.finding.about, root.finding.where) == (EVERYTHING, "link")


def test_busy_probe_proves_no_slow_topic() -> None:
    diagnosis = judge(timed(0.04, SCAN.name, busy=0.95))
    assert diagnosis.roots == () and not diagnosis.healthy and SCAN.name in diagnosis.gaps[0]


def test_short_observation_and_simulated_time_prove_no_rate() -> None:
    short = tuple(dataclasses.replace(each, listened_s=0.3) for each in timed().timings)
    assert judge(timed(0.04, SCAN.name, timings=short)).healthy
    assert judge(timed(0.04, SCAN.name, topics=received().topics)).healthy
    wall = timed(0.04, SCAN.name, stamp_age_s=0.1, topics=received().topics)
    assert not judge(wall).healthy, "a simulated robot that stamps its data by the clock"


@pytest.mark.parametrize(("age_s", "healthy"), [(0.4, True), (-0.9, True), (1.3, False), (-1.6, False), (2.8, False)])
def test_stamps_must_be_within_a_second(age_s: float, healthy: bool) -> None:
    diagnosis = judge(timed(stamp_age_s=age_s))
    assert diagnosis.healthy == healthy
    if not healthy:
        (root,) = diagnosis.roots
        assert root.finding.about == STAMPS and any("1.3 s old" in line for line in root.finding.evidence) == (age_s == 1.3)
        drift = make_finding("clock-drift", where="robot", cause="c", evidence=("e",), command="f")
        assert [root.finding.id for root in judge(timed(stamp_age_s=age_s), explanations=(drift,)).roots] == ["clock-drift"]


def test_service_without_server_is_lost_while_others_answer() -> None:
    calls = tuple(call for call in received().calls if call.service != rows.ARM_LIBRARY_LIST.name)
    (root,) = judge(received(calls=calls)).roots
    assert root.finding.about == LUPIN and "no server is known here" in root.finding.evidence[0]
    late = judge(received(calls=calls, late=(rows.ARM_LIBRARY_LIST.name,)))
    assert late.roots == () and not late.healthy and rows.ARM_LIBRARY_LIST.name in late.gaps[0]


def reached(graph: Graph, *addresses: str, link: Link = LINK) -> Diagnosis:
    """Judge a graph while the robot was reached and has these addresses."""
    entries = tuple(Address("eth0", each, 24, "global", up=True, carrier=True) for each in addresses)
    robot = Facts("robot", {"addresses": Addresses(entries), "versions": Unknown("not asked")})
    return diagnose(ground_truth.CHECKS, Snapshot(Facts("laptop", {"graph": Graphs((graph,))}), robot, link))


def test_graph_of_another_robot_proves_nothing() -> None:
    other = received(environment=(("ROS_DISCOVERY_SERVER", "10.42.7.1:11811"),))
    diagnosis = reached(other, "10.42.0.1")
    assert not diagnosis.healthy and exit_status(diagnosis, LINK) == NO_RESULT
    assert any("asks the server at 10.42.7.1, not greenhouse" in gap for gap in diagnosis.gaps)
    own = received(environment=(("ROS_DISCOVERY_SERVER", "192.168.42.1:11811"),))
    assert present(reached(own, "10.42.0.1", "192.168.42.1").ground_truth).state is ground_truth.State.HEALTHY
    empty = Graph("shell", "shell", (("ROS_DISCOVERY_SERVER", "10.42.7.1:11811"),))
    assert present(reached(empty, "10.42.0.1").ground_truth).state is ground_truth.State.BROKEN


def test_second_address_of_the_robot_is_no_other_robot() -> None:
    def judged(graph: Graph, link: Link, *known: str) -> GroundTruth:
        robot = Facts("robot", {"addresses": Addresses((Address("eth0", "10.42.0.1", 24, "global", up=True, carrier=True),))})
        routes = RoutingTable((), to_robot=dict.fromkeys(known, ()))
        facts = Facts("laptop", {"graph": Graphs((graph,)), "routes": routes})
        return measure(Snapshot(facts, None if link.kind else robot, link))

    ap = (("ROS_DISCOVERY_SERVER", "192.168.42.1:11811"),)
    both = dataclasses.replace(LINK, addresses={"wired": "10.42.0.1", "ap": "192.168.42.1"})
    known = ("10.42.0.1", "192.168.42.1")
    assert judged(Graph("shell", "shell", ap), both, *known).state is State.BROKEN
    assert judged(received(environment=ap), dataclasses.replace(both, kind="timeout"), *known).state is State.HEALTHY
    # With several robots, the address of another one proves nothing.
    assert judged(Graph("shell", "shell", ap), LINK, *known).state is State.UNOBSERVED
    assert judged(received(environment=ap), dataclasses.replace(LINK, kind="timeout"), *known).state is State.UNOBSERVED


def test_areas_name_what_was_observed_and_what_was_not() -> None:
    def marks(diagnosis: Diagnosis) -> dict[str, str]:
        return {area.name: area.mark for area in diagnosis.areas}

    healthy = judge(received())
    assert marks(healthy)["topics"] == marks(healthy)["drive"] == marks(healthy)["discovery"] == "✓"
    assert marks(healthy)["release"] == "?"  # the robot's facts were not gathered
    assert "required topics deliver samples" in next(area.detail for area in healthy.areas if area.name == "topics")
    server = make_finding("discovery-server-missing", where="robot", cause="no server", evidence=("e",), command="f")
    broken = judge(received(samples=(), calls=()), explanations=(server,))
    assert marks(broken)["discovery"] == "✗" and marks(broken)["topics"] == "-"
    assert diagnose((), snapshot(received())).areas == ()


def test_robot_without_login_and_onboard_is_not_called_healthy() -> None:
    """Whether Lupin is deployed there is not known: its drive bus and e-stop may be missing."""
    bare = received()
    ours = (CMD_VEL_MANUAL.name, DRIVE_STATUS.name, rows.ESTOP_STATUS.name)
    vendors = dataclasses.replace(bare, topics=tuple(topic for topic in bare.topics if topic.name not in ours))
    for kind, state in (("", State.HEALTHY), ("timeout", State.UNOBSERVED)):
        truth = measure(snapshot(vendors, link=Link("greenhouse", "10.42.0.1", kind=kind)))
        assert truth.state is state, truth.unobserved
    assert any("could not be asked" in line for line in truth.unobserved)
