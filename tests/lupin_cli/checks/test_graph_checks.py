"""A captured graph of the simulated robot, healthy and changed, under all checks that read a graph."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from lupin_cli.checks import controllers, drive, motor_board, topic_delivery
from lupin_cli.checks.base import Finding, Severity, Snapshot
from lupin_cli.checks.topic_delivery import BOARD_TOPICS, qos_mismatch
from lupin_cli.connection.base import Output
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts.base import Facts
from lupin_cli.facts.devices import Devices, TelemetrixProcess
from lupin_cli.facts.graph import GRAPH, Controller, DriveInput, Endpoint, Graph, Graphs, ServiceCall
from lupin_cli.facts.link import Link
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.units import UNIT_STATES
from lupin_runtime.safety.console_stop import LOST_HOLDING
from tests.support.findings import assert_findings_match_rows
from tests.support.paths import CAPTURED_FACTS

CHECKS = (*controllers.CHECKS, *drive.CHECKS, *topic_delivery.CHECKS, *motor_board.CHECKS)


def captured(fact: Any, case: str) -> Any:
    return fact.parse(Output(0, (CAPTURED_FACTS / fact.name / f"{case}.txt").read_text()))


def graph(**changed: Any) -> Graph:
    """Return the healthy graph of the robot, with fields `changed`."""
    seen = captured(GRAPH, "simulator").graphs[0]
    result: Graph = dataclasses.replace(seen, name="robot", kind="robot", **changed)
    return result


def with_endpoints(name: str, seen: Graph | None = None, **sides: tuple[Endpoint, ...]) -> Graph:
    """Return the graph with other publishers or subscribers on one topic."""
    seen = seen or graph()
    topics = tuple(dataclasses.replace(topic, **sides) if topic.name == name else topic for topic in seen.topics)  # type: ignore[arg-type]
    # The drive bus counts the subscriptions of its own sink.
    known = tuple((sink, len(sides.get("subscribers", ())) if sink == name else count) for sink, count in seen.bus_listeners)
    return dataclasses.replace(seen, topics=topics, bus_listeners=known)


def snapshot(*graphs: Graph, **robot: Any) -> Snapshot:
    facts = Facts("robot", robot) if robot else None
    return Snapshot(Facts("laptop", {"graph": Graphs(graphs)}), facts, Link("lupin", "10.42.0.1"))


def root_findings(*graphs: Graph, **robot: Any) -> list[Finding]:
    diagnosis = diagnose(CHECKS, snapshot(*graphs, **robot))
    assert_findings_match_rows(diagnosis)
    for finding in diagnosis.findings:
        assert finding.evidence and all(finding.evidence) and finding.fix.command, finding.id
    return [root.finding for root in diagnosis.roots]


def ids(*graphs: Graph, **robot: Any) -> list[str]:
    return [finding.id for finding in root_findings(*graphs, **robot)]


def samples_without(*names: str) -> tuple[tuple[str, int], ...]:
    return tuple((name, 0 if name in names else count) for name, count in graph().samples)


def test_healthy_graph_has_no_findings_on_either_target() -> None:
    assert ids(graph()) == []
    assert ids(*captured(GRAPH, "simulator").graphs) == []


def test_missing_and_empty_graph_have_no_findings() -> None:
    assert ids() == []
    assert ids(graph(nodes=(), topics=(), samples=(), calls=(), controllers=None)) == []
    assert list(diagnose(CHECKS, Snapshot(Facts("laptop", {}), None)).findings) == []


def test_failed_graph_visit_is_named() -> None:
    assert ids(*captured(GRAPH, "visit-failed").graphs) == ["graph-not-visited"]


@pytest.mark.parametrize("state", ["unconfigured", "inactive", "finalized"])
def test_inactive_controller_is_named(state: str) -> None:
    listed = tuple(dataclasses.replace(c, state=state) if "arm" in c.name else c for c in graph().controllers or ())
    (finding,) = root_findings(graph(controllers=listed))
    assert finding.id == "controllers-not-active"
    assert f"mirte_master_arm_controller is {state}" in finding.cause
    assert finding.fix.playbook == "heal"


def test_unlisted_controller_counts_as_inactive() -> None:
    (finding,) = root_findings(graph(controllers=(Controller("joint_state_broadcaster", "active"),)))
    assert finding.cause.startswith("4 of 5 controllers do not work")
    assert ids(graph(controllers=())) == ["controllers-not-active"]


def test_unknown_inactive_controller_is_ignored() -> None:
    more = (*(graph().controllers or ()), Controller("camera_mast_controller", "inactive"))
    assert ids(graph(controllers=more)) == []


def test_unconfigured_base_controller_explains_unheard_sink() -> None:
    listed = tuple(dataclasses.replace(c, state="unconfigured") if "base" in c.name else c for c in graph().controllers or ())
    unheard = with_endpoints("/cmd_vel", graph(controllers=listed), subscribers=())
    diagnosis = diagnose(CHECKS, snapshot(unheard))
    assert [root.finding.id for root in diagnosis.roots] == ["controllers-not-active"]
    assert "drive-sink-unheard" in [finding.id for finding in diagnosis.roots[0].consequences]


def test_missing_controller_manager_is_named() -> None:
    calls = tuple(call for call in graph().calls if "controller_manager" not in call.service)
    assert ids(graph(controllers=None, calls=calls)) == ["controller-manager-missing"]


def test_hanging_controller_manager_differs_from_one_way_link() -> None:
    first, *others = graph().calls
    assert "controller_manager" in first.service
    assert ids(graph(controllers=None, calls=(ServiceCall(first.service, None), *others))) == ["controller-manager-silent"]
    unanswered = tuple(ServiceCall(call.service, None) for call in graph().calls)
    (finding,) = root_findings(graph(controllers=None, calls=unanswered))
    assert finding.id == "one-way-data" and finding.where == "link" and finding.fix.playbook == "single-home"


def test_names_without_samples_blame_shared_memory_only_with_udp() -> None:
    silent = tuple((name, 0) for name, _ in graph().samples)
    (finding,) = root_findings(graph(samples=silent, udp_heard=9))
    assert finding.id == "names-no-samples" and "UDPv4" in finding.fix.command
    unanswered = tuple(ServiceCall(call.service, None) for call in graph().calls)
    (finding,) = root_findings(graph(samples=silent, udp_heard=0, calls=unanswered, controllers=None))
    assert finding.where == "link" and "shared memory" not in finding.cause


def test_silent_topics_with_answered_calls_are_named_separately() -> None:
    silent = tuple((name, 0) for name, _ in graph().samples)
    findings = root_findings(graph(samples=silent, udp_heard=0))
    assert {finding.id for finding in findings} == {"board-wedged", "topic-silent"}
    mute = {finding.about for finding in findings} - {""}
    assert "/scan" in mute and not mute & set(BOARD_TOPICS)
    assert any("answered after" in line for line in findings[0].evidence)


def test_link_closed_in_both_directions_is_one_finding() -> None:
    silent = tuple((name, 0) for name, _ in graph().samples)
    unanswered = tuple(ServiceCall(call.service, None) for call in graph().calls)
    assert ids(graph(samples=silent, calls=unanswered, controllers=None)) == ["names-no-samples"]


def test_one_silent_sensor_is_named_alone() -> None:
    (finding,) = root_findings(graph(samples=samples_without("/scan")))
    assert finding.id == "topic-silent" and "/scan" in finding.cause


def test_ghost_endpoints_cause_no_findings() -> None:
    ghost = Endpoint("_NODE_NAMESPACE_UNKNOWN_/_NODE_NAME_UNKNOWN_", "sensor_msgs/msg/LaserScan", False, False)
    silent = graph(samples=samples_without("/scan"))
    assert ids(with_endpoints("/scan", silent, publishers=(ghost,))) == []
    lidar = dataclasses.replace(ghost, node="/lidar")
    assert ids(with_endpoints("/scan", silent, publishers=(ghost, lidar))) == ["topic-silent"]
    assert ids(with_endpoints("/scan", subscribers=(dataclasses.replace(ghost, reliable=True),))) == []
    assert ids(with_endpoints("/cmd_vel", publishers=(ghost,), subscribers=())) == []


def test_topic_published_on_change_may_be_silent() -> None:
    assert ids(graph(samples=samples_without("/lupin/drive/status", "/twin/state"))) == []


def test_sink_heard_only_by_passive_subscribers_is_named() -> None:
    strip = Endpoint("/light_strip_bridge", "geometry_msgs/msg/Twist", False, False)
    (finding,) = root_findings(with_endpoints("/cmd_vel", subscribers=(strip,)))
    assert finding.id == "drive-sink-unheard"
    assert "the base listens on /mirte_base_controller/cmd_vel" in finding.cause


def test_incomplete_graph_view_causes_no_unheard_sink() -> None:
    assert ids(dataclasses.replace(with_endpoints("/cmd_vel", subscribers=()), bus_listeners=(("/cmd_vel", 1),))) == []


def test_commands_to_nonexistent_sink_are_named() -> None:
    seen = graph()
    wrong = dataclasses.replace(seen.topics[0], name="/mirte_base_controller/cmd_vel_unstamped", subscribers=())
    assert ids(dataclasses.replace(seen, topics=(*seen.topics, wrong))) == ["drive-sink-unheard"]


def test_engaged_stop_names_its_holder_and_explains_bus_lock() -> None:
    pressed = graph(estop=True, estop_reasons=("the button is pressed",), bus_locks=("the e-stop is engaged",))
    (finding,) = root_findings(pressed)
    assert finding.id == "estop-engaged" and "red button" in finding.fix.command
    (finding,) = root_findings(graph(estop=True, estop_reasons=("a console holds the stop",)))
    assert finding.fix.command == "release the e-stop on the page"
    (finding,) = root_findings(graph(estop=True, estop_reasons=(LOST_HOLDING,)))
    assert finding.fix.command.startswith("press stop on a page")
    assert ids(graph(bus_locks=("no e-stop state for 1.0 s",))) == ["bus-locked"]


@pytest.mark.parametrize(("topic", "expected"), [("/cmd_vel", "drive-bypassed"), ("/e_stop_state", "estop-forged")])
def test_other_publisher_on_a_safety_topic_is_named(topic: str, expected: str) -> None:
    own = graph().topic(topic)
    assert own is not None and len(own.publishers) == 1
    stranger = dataclasses.replace(own.publishers[0], node="/games/pilot")
    (finding,) = root_findings(with_endpoints(topic, publishers=(*own.publishers, stranger)))
    assert finding.id == expected and "/games/pilot" in finding.cause
    ghost = dataclasses.replace(own.publishers[0], node="/_NODE_NAME_UNKNOWN_")
    assert ids(with_endpoints(topic, publishers=(*own.publishers, ghost))) == []


def test_page_sending_zeros_holds_the_bus() -> None:
    auto = DriveInput("/cmd_vel_auto", 24, 24)
    (finding,) = root_findings(graph(inputs=(DriveInput("/cmd_vel_manual", 24, 0), auto), bus_winner="manual"))
    assert finding.id == "page-holds-bus" and finding.severity is Severity.PROBLEM
    (finding,) = root_findings(graph(inputs=(DriveInput("/cmd_vel_joy", 24, 0),)))
    assert finding.id == "pad-holds-bus" and finding.severity is Severity.WARNING


@pytest.mark.parametrize(
    "drive_input",
    [DriveInput("/cmd_vel_manual", 24, 3), DriveInput("/cmd_vel_manual", 5, 0), DriveInput("/cmd_vel_auto", 24, 0)],
)
def test_moving_or_rare_commands_are_no_fault(drive_input: DriveInput) -> None:
    assert ids(graph(inputs=(drive_input,))) == []


RELIABLE = Endpoint("/a", "sensor_msgs/msg/LaserScan", True, False)
BEST_EFFORT = Endpoint("/b", "sensor_msgs/msg/LaserScan", False, False)
LATCHED = Endpoint("/c", "sensor_msgs/msg/LaserScan", True, True)
OTHER_TYPE = Endpoint("/d", "std_msgs/msg/String", False, False)


@pytest.mark.parametrize(
    ("publisher", "subscriber", "compatible"),
    [
        (RELIABLE, RELIABLE, True),
        (RELIABLE, BEST_EFFORT, True),
        (LATCHED, RELIABLE, True),
        (LATCHED, BEST_EFFORT, True),
        (BEST_EFFORT, RELIABLE, False),
        (RELIABLE, LATCHED, False),
        (OTHER_TYPE, BEST_EFFORT, False),
    ],
)
def test_qos_compatibility_follows_requested_versus_offered(
    publisher: Endpoint, subscriber: Endpoint, compatible: bool
) -> None:
    assert (qos_mismatch(publisher, subscriber) == "") is compatible


def test_only_subscription_without_any_match_is_named() -> None:
    (finding,) = root_findings(with_endpoints("/scan", subscribers=(RELIABLE, BEST_EFFORT)))
    assert finding.id == "qos-mismatch" and "/a never gets a message on /scan" in finding.symptom
    assert ids(with_endpoints("/scan", publishers=(BEST_EFFORT, RELIABLE), subscribers=(RELIABLE,))) == []
    assert ids(with_endpoints("/scan", subscribers=(dataclasses.replace(BEST_EFFORT, type="std_msgs/msg/String"),))) == [
        "type-mismatch"
    ]


@pytest.mark.parametrize(
    ("read", "expected"),
    [
        ((0.15, 11.0), ["battery-low"]),
        ((15.0, 11.0), ["battery-low"]),
        ((0.20, 11.4), []),
        ((80.0, 12.1), []),
        ((None, 12.1), ["battery-unreadable"]),
        ((-1.0, None), ["battery-unreadable"]),
        (None, []),
    ],
)
def test_battery_is_read_on_either_scale(read: Any, expected: list[str]) -> None:
    assert ids(graph(battery=read)) == expected


BOARD_SILENT = samples_without("/io/imu/movement/data", "/io/power/power_watcher", "/io/intensity/emergency_button/digital")


def devices(*serials: str, state: str = "S") -> Devices:
    return Devices((), (), serials, (), (), (TelemetrixProcess(412, state, "python3 telemetrix"),))


def test_board_silent_among_live_topics_is_wedged() -> None:
    (finding,) = root_findings(graph(samples=BOARD_SILENT), devices=devices("/dev/ttyACM0 root:dialout 660"))
    assert finding.id == "board-wedged" and "telemetrix: pid 412 state S: python3 telemetrix" in finding.evidence
    assert ids(graph(samples=samples_without("/io/imu/movement/data"))) == ["topic-silent"]


def test_board_off_the_usb_bus_is_wedged_without_a_graph() -> None:
    journal = captured(SYSTEM_JOURNAL, "board-gone")
    (finding,) = root_findings(devices=devices(), journal=journal, units=captured(UNIT_STATES, "healthy"))
    assert finding.id == "board-wedged" and any("USB disconnect" in line for line in finding.evidence)
    assert ids(devices=devices("/dev/ttyACM0 root:dialout 660"), journal=journal) == []  # it came back
    assert ids(devices=dataclasses.replace(devices(), telemetrix=()), journal=journal) == []


def test_blocked_telemetrix_is_wedged_only_with_a_second_sign() -> None:
    waiting = devices("/dev/ttyACM0 root:dialout 660", state="D")
    assert ids(graph(), devices=waiting) == []
    (finding,) = root_findings(graph(samples=BOARD_SILENT), devices=waiting)
    assert "hangs in the kernel" in finding.cause
