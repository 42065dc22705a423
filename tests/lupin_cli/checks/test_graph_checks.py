"""A captured graph of the simulated robot, healthy and changed, under all checks that read a graph."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from lupin_cli.checks import controllers, drive, ground_truth, missing_parts, motor_board, topic_delivery
from lupin_cli.checks import path as path_checks
from lupin_cli.checks.base import Finding, Severity, Snapshot
from lupin_cli.checks.layers import EVERYTHING, LUPIN
from lupin_cli.checks.topic_delivery import BOARD_TOPICS, qos_mismatch
from lupin_cli.connection.base import Output
from lupin_cli.doctor.engine import diagnose, doubt_luck
from lupin_cli.facts.account import Account
from lupin_cli.facts.base import Facts
from lupin_cli.facts.clock import Offset
from lupin_cli.facts.devices import Devices, TelemetrixProcess
from lupin_cli.facts.graph import GRAPH, UNKNOWN_NODE, Controller, DriveInput, Endpoint, Graph, Graphs, ServiceCall, Timing
from lupin_cli.facts.link import Link
from lupin_cli.facts.ros_processes import RosProcess
from lupin_cli.facts.sockets import Socket, Sockets
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.units import UNIT_STATES
from lupin_cli.link.path import End, Path, UnreadSocket
from lupin_runtime.graph import ESTOP_STATE, JOINT_STATES, ODOM
from lupin_runtime.safety.console_stop import LOST_HOLDING
from lupin_runtime.safety.estop import BUTTON_SILENT
from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED
from lupin_runtime.safety.expected_sources import BUTTON, CONSOLE, ESTOP_BUTTON, UNHEARD, WITNESS
from tests.support.findings import assert_findings_match_rows
from tests.support.optional import present
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
    known = tuple(
        (sink, len(sides.get("subscribers", ())) if sink == name else count) for sink, count in seen.sink_subscriptions
    )
    return dataclasses.replace(seen, topics=topics, sink_subscriptions=known)


def snapshot(*graphs: Graph, **robot: Any) -> Snapshot:
    facts = Facts("robot", robot) if robot else None
    return Snapshot(Facts("laptop", {"graph": Graphs(graphs)}), facts, Link("lupin", "10.42.0.1"))


def root_findings(*graphs: Graph, **robot: Any) -> list[Finding]:
    diagnosis = diagnose(CHECKS, snapshot(*graphs, **robot))
    assert_findings_match_rows(diagnosis)
    for finding in diagnosis.findings:
        assert finding.evidence and all(finding.evidence), finding.id
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


def test_failed_graph_probe_is_named() -> None:
    assert ids(*captured(GRAPH, "visit-failed").graphs) == ["graph-not-visited"]


@pytest.mark.parametrize("state", ["unconfigured", "inactive", "finalized"])
def test_inactive_controller_is_named(state: str) -> None:
    listed = tuple(dataclasses.replace(c, state=state) if "arm" in c.name else c for c in graph().controllers or ())
    (finding,) = root_findings(graph(controllers=listed))
    assert finding.id == "controllers-not-active"
    assert f"mirte_master_arm_controller is {state}" in finding.cause
    assert finding.fix.playbook == "heal"


def test_fix_for_a_simulated_graph_does_not_act_on_a_robot() -> None:
    simulated = dataclasses.replace(graph(controllers=()), name="20261124-071233-ab12", kind="sim")
    without_manager = dataclasses.replace(
        simulated,
        controllers=None,
        calls=tuple(call for call in simulated.calls if "controller_manager" not in call.service),
    )
    hanging = tuple(
        dataclasses.replace(c, round_trip_s=None if "controller_manager" in c.service else 0.01) for c in graph().calls
    )
    unanswered = tuple(dataclasses.replace(call, round_trip_s=None) for call in graph().calls)
    for changed, command in (
        (simulated, "lupin home"),
        (dataclasses.replace(simulated, controllers=None, calls=unanswered), "lupin logs"),
        (dataclasses.replace(graph(battery=(None, 12.1)), kind="sim"), "lupin logs sim"),
        (without_manager, "lupin logs sim"),
        (dataclasses.replace(simulated, controllers=None, calls=hanging), "lupin logs sim"),
    ):
        (finding,) = root_findings(changed)
        assert (finding.fix.command, finding.fix.playbook) == (command, ""), finding.id


def test_unlisted_controller_counts_as_inactive() -> None:
    (finding,) = root_findings(graph(controllers=(Controller("joint_state_broadcaster", "active"),)))
    assert finding.cause.startswith("4 of 5 controllers do not work")
    assert ids(graph(controllers=())) == ["controllers-not-active"]


def test_unknown_inactive_controller_is_ignored() -> None:
    more = (*(graph().controllers or ()), Controller("camera_mast_controller", "inactive"))
    assert ids(graph(controllers=more)) == []


def test_unconfigured_controller_explains_missing_subscriber() -> None:
    listed = tuple(dataclasses.replace(c, state="unconfigured") if "base" in c.name else c for c in graph().controllers or ())
    unheard = with_endpoints("/cmd_vel", graph(controllers=listed), subscribers=())
    diagnosis = diagnose(CHECKS, snapshot(unheard))
    assert [root.finding.id for root in diagnosis.roots] == ["controllers-not-active"]
    assert "drive-sink-unheard" in [finding.id for finding in diagnosis.roots[0].consequences]


GRIPPER, JOINTS, WHEELS = "mirte_master_gripper_controller", "joint_state_broadcaster", "pid_wheels_controller"


@pytest.mark.parametrize(
    ("controller", "silent", "unheard", "expected"),
    [
        (GRIPPER, "", True, {"controllers-not-active", "drive-sink-unheard"}),
        (GRIPPER, ODOM.name, False, {"controllers-not-active", "topic-silent"}),
        (JOINTS, ODOM.name, False, {"controllers-not-active", "topic-silent"}),
        (JOINTS, JOINT_STATES.name, False, {"controllers-not-active"}),
        (WHEELS, ODOM.name, True, {"controllers-not-active"}),
        (WHEELS, JOINT_STATES.name, False, {"controllers-not-active", "topic-silent"}),
    ],
)
def test_controller_explains_only_its_own_silence(controller: str, silent: str, unheard: bool, expected: set[str]) -> None:
    listed = tuple(
        dataclasses.replace(each, state="inactive") if each.name == controller else each for each in graph().controllers or ()
    )
    seen = graph(controllers=listed, samples=samples_without(silent))
    seen = with_endpoints("/cmd_vel", seen, subscribers=()) if unheard else seen
    roots = diagnose((*ground_truth.CHECKS, *CHECKS), snapshot(seen)).roots
    lost = {root.finding.id for root in roots if root.finding.about not in (LUPIN, EVERYTHING)}
    assert lost == expected, [root.finding.cause for root in roots]


def test_missing_controller_manager_is_named() -> None:
    calls = tuple(call for call in graph().calls if "controller_manager" not in call.service)
    assert ids(graph(controllers=None, calls=calls)) == ["controller-manager-missing"]


@pytest.mark.parametrize("offset_s", [0.002, 40.0])
def test_clock_is_only_synchronized_if_it_is_wrong(offset_s: float) -> None:
    calls = tuple(call for call in graph().calls if "controller_manager" not in call.service)
    seen = snapshot(graph(controllers=None, calls=calls))
    link = dataclasses.replace(present(seen.link), clock=Offset(offset_s, 0.001))
    (root,) = diagnose(controllers.CHECKS, dataclasses.replace(seen, link=link, robot=Facts("robot", {}))).roots
    restart = "ssh -t 10.42.0.1 'sudo systemctl restart mirte-ros.service' && lupin play heal --robot lupin"
    expected = ("lupin sync-clock --robot lupin", "sync-clock") if offset_s > 1.0 else (restart, "")
    assert (root.finding.fix.command, root.finding.fix.playbook) == expected


def test_manager_is_not_started_by_a_clock_that_is_wrong() -> None:
    calls = tuple(call for call in graph().calls if "controller_manager" not in call.service)
    seen = snapshot(graph(controllers=None, calls=calls))
    robot = Facts("robot", {}, probed_ns=(240_000_000_000, 241_000_000_000))
    link = dataclasses.replace(present(seen.link), clock=Offset(1.7e9, 0.001))
    (root,) = diagnose(controllers.CHECKS, dataclasses.replace(seen, link=link, robot=robot)).roots
    assert root.finding.fix.playbook == "" and "sync-clock" not in root.finding.fix.command


@pytest.mark.parametrize(
    ("stamp_age_s", "frame", "clock", "expected"),
    [
        (0.05, "laser", Offset(0.0, 0.01), []),
        (0.05, "lidar_link", Offset(0.0, 0.01), ["frame-wrong"]),
        (0.05, "/laser", Offset(0.0, 0.01), ["frame-wrong"]),
        (9.0, "laser", Offset(0.0, 0.01), ["stamps-wrong"]),
        (1.3, "laser", Offset(0.0, 0.01), ["stamps-wrong"]),
        (1.3, "laser", Offset(-1.3, 0.01), []),
        (-9.0, "laser", Offset(0.0, 0.01), ["stamps-wrong"]),
        (-60.0, "laser", Offset(60.0, 0.01), []),  # the robot's clock is wrong: another finding
        (0.0, "laser", Offset(60.0, 0.01), ["stamps-wrong"]),
        (9.0, "laser", None, []),  # nobody knows whose fault it is
        (9.0, "", None, ["frame-wrong"]),
    ],
)
def test_headers_are_judged_by_frame_and_own_clock(
    stamp_age_s: float, frame: str, clock: Offset | None, expected: list[str]
) -> None:
    seen = graph(timings=(Timing("/scan", 10.0, 0.1, stamp_age_s, frame), Timing("/tf", 50.0, 0.1)))
    seen = dataclasses.replace(seen, topics=tuple(each for each in seen.topics if each.name != "/clock"))
    known = snapshot(seen)
    link = dataclasses.replace(present(known.link), clock=clock)
    diagnosis = diagnose(CHECKS, dataclasses.replace(known, link=link, robot=Facts("robot", {})))
    assert_findings_match_rows(diagnosis)
    assert [root.finding.id for root in diagnosis.roots] == expected
    simulated = dataclasses.replace(graph(timings=seen.timings), kind="sim")
    found = diagnose(CHECKS, dataclasses.replace(snapshot(simulated), link=link, robot=Facts("robot", {}))).roots
    assert [root.finding.id for root in found] == [each for each in expected if each != "stamps-wrong"]


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
    stale = Endpoint("_NODE_NAMESPACE_UNKNOWN_/_NODE_NAME_UNKNOWN_", "sensor_msgs/msg/LaserScan", False, False)
    silent = graph(samples=samples_without("/scan"))
    assert ids(with_endpoints("/scan", silent, publishers=(stale,))) == []
    lidar = dataclasses.replace(stale, node="/lidar")
    assert ids(with_endpoints("/scan", silent, publishers=(stale, lidar))) == ["topic-silent"]
    assert ids(with_endpoints("/scan", subscribers=(dataclasses.replace(stale, reliable=True),))) == []
    assert ids(with_endpoints("/cmd_vel", publishers=(stale,), subscribers=())) == []


def test_topic_published_on_change_may_be_silent() -> None:
    assert ids(graph(samples=samples_without("/lupin/drive/status", "/twin/state"))) == []


def test_sink_with_only_passive_subscribers_is_named() -> None:
    strip = Endpoint("/light_strip_bridge", "geometry_msgs/msg/Twist", False, False)
    (finding,) = root_findings(with_endpoints("/cmd_vel", subscribers=(strip,)))
    assert finding.id == "drive-sink-unheard"
    assert "the base listens on /mirte_base_controller/cmd_vel" in finding.cause


def test_incomplete_graph_view_is_no_missing_subscriber() -> None:
    assert ids(dataclasses.replace(with_endpoints("/cmd_vel", subscribers=()), sink_subscriptions=(("/cmd_vel", 1),))) == []


def test_commands_to_nonexistent_sink_are_named() -> None:
    seen = graph()
    wrong = dataclasses.replace(seen.topics[0], name="/mirte_base_controller/cmd_vel_unstamped", subscribers=())
    assert ids(dataclasses.replace(seen, topics=(*seen.topics, wrong))) == ["drive-sink-unheard"]


def test_engaged_stop_names_its_holder_and_explains_bus_lock() -> None:
    pressed = graph(estop=True, estop_reasons=("the button is pressed",), drive_bus_locks=("the e-stop is engaged",))
    (finding,) = root_findings(pressed)
    assert finding.id == "estop-engaged" and "red button" in finding.fix.instruction and not finding.fix.command
    (finding,) = root_findings(graph(estop=True, estop_reasons=("a console holds the stop",)))
    assert finding.fix.instruction == "release the e-stop on the page"
    (finding,) = root_findings(graph(estop=True, estop_reasons=(LOST_HOLDING,)))
    assert finding.fix.instruction.startswith("engage the e-stop on any page")
    (finding,) = root_findings(dataclasses.replace(pressed, name="sim", kind="sim"))
    assert (finding.fix.instruction, finding.fix.command) == ("", "lupin sim press estop --release")


@pytest.mark.parametrize(
    ("source", "way_out"), [(BUTTON, f"set {ESTOP_BUTTON}=no"), (CONSOLE, "lupin up --no-web"), (WITNESS, "process drive")]
)
def test_estop_that_waits_for_a_source_names_the_way_out(source: str, way_out: str) -> None:
    (finding,) = root_findings(graph(estop=True, estop_reasons=(UNHEARD[source],), drive_bus_locks=("the e-stop is engaged",)))
    assert finding.id == "estop-engaged" and UNHEARD[source] in finding.cause
    assert way_out in finding.fix.instruction and not finding.fix.command


@pytest.mark.parametrize(
    ("lock", "holder"),
    [
        ("no e-stop state for 1.0 s", "the e-stop's process"),
        ("shutting down", "the drive bus itself"),
        ("slam does not respond", "the supervisor: slam does not respond"),
    ],
)
def test_bus_lock_names_its_holder_and_the_machine(lock: str, holder: str) -> None:
    (finding,) = root_findings(graph(drive_bus_locks=(lock,)))
    assert finding.id == "bus-locked" and holder in finding.fix.instruction
    assert finding.fix.command == "lupin status"
    (finding,) = root_findings(graph(drive_bus_locks=(lock,)), units=captured(UNIT_STATES, "healthy"))
    assert finding.fix.command == "ssh -t 10.42.0.1 'sudo systemctl restart lupin-onboard.service'"


BRIDGE = Endpoint("/estop_bridge", "std_msgs/msg/Bool", reliable=True, latched=False)
STALE = dataclasses.replace(BRIDGE, node=f"/{UNKNOWN_NODE}")


@pytest.mark.parametrize(
    ("publishers", "severity"),
    [
        ((BRIDGE, BRIDGE), Severity.WARNING),
        ((BRIDGE, STALE, STALE), Severity.WARNING),
        ((BRIDGE,), Severity.PROBLEM),
        ((BRIDGE, dataclasses.replace(BRIDGE, node="/intruder")), Severity.PROBLEM),
    ],
)
def test_lock_by_a_killed_estop_process_ends_by_itself(publishers: tuple[Endpoint, ...], severity: Severity) -> None:
    seen = with_endpoints(ESTOP_STATE.name, graph(drive_bus_locks=(ESTOP_ENGAGED,)), publishers=publishers)
    (finding,) = [each for each in root_findings(seen) if each.id == "bus-locked"]
    assert finding.severity is severity
    assert finding.fix.command.startswith("lupin wait") is (severity is Severity.WARNING)
    truth = present(doubt_luck(ground_truth.GroundTruth(ground_truth.State.HEALTHY), (finding,)))
    assert (truth.state is ground_truth.State.UNOBSERVED) is (severity is Severity.WARNING)


def test_finding_of_one_graph_explains_none_of_another() -> None:
    simulated = graph(estop=True, estop_reasons=("the button is pressed",))
    simulated = dataclasses.replace(simulated, name="20261124-071233-ab12", kind="sim")
    robot = graph(drive_bus_locks=("no e-stop state for 1.0 s",), inputs=(DriveInput("/cmd_vel_manual", 24, 0),))
    assert sorted(ids(simulated, robot)) == ["bus-locked", "estop-engaged", "page-holds-bus"]
    unanswered = tuple(ServiceCall(call.service, None) for call in simulated.calls)
    samples = tuple((name, 0) for name, _ in simulated.samples)
    silent = dataclasses.replace(simulated, estop=False, samples=samples, calls=unanswered)
    assert sorted(ids(silent, graph(samples=samples_without("/scan")))) == ["names-no-samples", "topic-silent"]


@pytest.mark.parametrize(("topic", "expected"), [("/cmd_vel", "drive-bypassed"), ("/e_stop_state", "estop-forged")])
def test_other_publisher_on_a_safety_topic_is_named(topic: str, expected: str) -> None:
    own = graph().topic(topic)
    assert own is not None and len(own.publishers) == 1
    stranger = dataclasses.replace(own.publishers[0], node="/games/pilot")
    (finding,) = root_findings(with_endpoints(topic, publishers=(*own.publishers, stranger)))
    assert finding.id == expected and "/games/pilot" in finding.cause
    stale = dataclasses.replace(own.publishers[0], node="/_NODE_NAME_UNKNOWN_")
    assert ids(with_endpoints(topic, publishers=(*own.publishers, stale))) == []


TELEOP = ("/usr/bin/python3", "/opt/ros/humble/lib/teleop_twist_keyboard/teleop_twist_keyboard")
REMAPPED = (*TELEOP, "--ros-args", "-r", "/cmd_vel:=/mirte_base_controller/cmd_vel")


def program(pid: int, *arguments: str, **environment: str) -> RosProcess:
    return RosProcess(pid, 40, 1000, "S", 60.0, "/user.slice/user-1000.slice/session-2.scope", arguments, environment)


def roots_beside(seen: Graph, *programs: RosProcess, on_robot: tuple[RosProcess, ...] = ()) -> list[Finding]:
    """Return what is found while programs run on the laptop and on the robot."""
    facts = snapshot(dataclasses.replace(seen, environment=(("ROS_DISCOVERY_SERVER", "10.42.0.1:11811"),)))
    laptop = Facts("laptop", {**facts.laptop.values, "ros-processes": programs})
    diagnosis = diagnose(CHECKS, dataclasses.replace(facts, laptop=laptop, robot=Facts("robot", {"ros-processes": on_robot})))
    assert_findings_match_rows(diagnosis)
    return [root.finding for root in diagnosis.roots]


@pytest.mark.parametrize(
    ("node", "arguments"),
    [
        ("/teleop_twist_keyboard", TELEOP),
        ("/teleop_twist_keyboard", REMAPPED),
        ("/pilot", (*TELEOP, "--ros-args", "-r", "__node:=pilot")),
        ("/_ros2cli_5001", ("/usr/bin/python3", "/opt/ros/humble/bin/ros2", "topic", "pub", "/cmd_vel")),
        ("/rosbag2_player", ("/usr/bin/python3", "/opt/ros/humble/bin/ros2", "bag", "play", "run")),
        ("/games/joy", ("/opt/ros/humble/lib/games/joy", "--ros-args")),
    ],
)
@pytest.mark.parametrize(("topic", "expected"), [("/cmd_vel", "drive-bypassed"), ("/e_stop_state", "estop-forged")])
def test_program_of_the_laptop_is_named_there(topic: str, expected: str, node: str, arguments: tuple[str, ...]) -> None:
    own = present(graph().topic(topic)).publishers
    seen = with_endpoints(topic, publishers=(*own, dataclasses.replace(own[0], node=node)))
    (finding,) = roots_beside(seen, program(5000, "/usr/bin/python3", "other"), program(5001, *arguments))
    assert (finding.id, finding.where, finding.fix.command) == (expected, "laptop", "kill 5001")
    assert f"laptop: 5001 {arguments[0]}" in " ".join(finding.evidence) and node in finding.fix.instruction


def test_program_that_may_be_the_robots_is_not_the_laptops() -> None:
    own = present(graph().topic("/cmd_vel")).publishers
    seen = with_endpoints("/cmd_vel", publishers=(*own, dataclasses.replace(own[0], node="/teleop_twist_keyboard")))
    teleop = program(5001, *TELEOP)
    for programs, on_robot in (
        ((teleop,), (program(7, *TELEOP),)),  # on both
        ((dataclasses.replace(teleop, environment={"ROS_DOMAIN_ID": "9"}),), ()),  # in another graph
        ((dataclasses.replace(teleop, environment={"ROS_DISCOVERY_SERVER": "10.77.0.1:11811"}),), ()),
        ((dataclasses.replace(teleop, arguments=(*TELEOP, "--ros-args", "-r", "__node:=pilot")),), ()),
        ((), (teleop,)),
    ):
        (finding,) = roots_beside(seen, *programs, on_robot=on_robot)
        assert (finding.where, finding.fix.command) == ("robot", "")


def test_strangers_of_both_machines_are_two_findings() -> None:
    own = present(graph().topic("/cmd_vel")).publishers
    nodes = (dataclasses.replace(own[0], node=node) for node in ("/teleop_twist_keyboard", "/patrol"))
    found = roots_beside(with_endpoints("/cmd_vel", publishers=(*own, *nodes)), program(5001, *REMAPPED))
    assert sorted((each.where, each.fix.command) for each in found) == [("laptop", "kill 5001"), ("robot", "")]


def test_gamepad_of_the_laptop_is_ended_there() -> None:
    own = present(graph().topic("/cmd_vel_joy"))
    pad = Endpoint("/teleop_twist_joy_node", "geometry_msgs/msg/Twist", True, False)
    seen = with_endpoints("/cmd_vel_joy", graph(inputs=(DriveInput("/cmd_vel_joy", 24, 0),)), publishers=(pad,))
    assert own.name == "/cmd_vel_joy"
    (finding,) = roots_beside(seen, program(5001, "/opt/ros/humble/lib/teleop_twist_joy/teleop_node"))
    assert (finding.id, finding.where, finding.fix.command) == ("pad-holds-bus", "laptop", "kill 5001")
    (finding,) = roots_beside(seen)
    assert (finding.where, finding.fix.command) == ("robot", "")


def test_program_of_the_laptop_adapts_to_the_robot() -> None:
    lidar = dataclasses.replace(BEST_EFFORT, node="/lidar")
    rviz = dataclasses.replace(RELIABLE, node="/rviz")
    seen = with_endpoints("/scan", publishers=(lidar,), subscribers=(rviz,))
    (finding,) = roots_beside(seen, program(5001, "/opt/ros/humble/lib/rviz2/rviz2"))
    assert (finding.id, finding.where) == ("qos-mismatch", "laptop")
    assert finding.fix.instruction.startswith("let /rviz (process 5001) subscribe with ")
    (finding,) = roots_beside(seen)
    assert finding.where == "robot"
    bag = dataclasses.replace(OTHER_TYPE, node="/rosbag2_player")
    played = with_endpoints("/scan", publishers=(bag,), subscribers=(dataclasses.replace(BEST_EFFORT, node="/slam"),))
    (finding,) = roots_beside(played, program(5001, "/usr/bin/python3", "/opt/ros/humble/bin/ros2", "bag", "play", "x"))
    assert (finding.id, finding.where) == ("type-mismatch", "laptop")
    assert finding.fix.instruction.startswith("let /rosbag2_player (process 5001) publish with sensor_msgs/msg/LaserScan ")


def test_page_sending_zeros_holds_the_bus() -> None:
    auto = DriveInput("/cmd_vel_auto", 24, 24)
    (finding,) = root_findings(graph(inputs=(DriveInput("/cmd_vel_manual", 24, 0), auto), drive_bus_holder="manual"))
    assert finding.id == "page-holds-bus" and finding.severity is Severity.PROBLEM
    (finding,) = root_findings(graph(inputs=(DriveInput("/cmd_vel_joy", 24, 0),)))
    assert finding.id == "pad-holds-bus" and finding.severity is Severity.WARNING


def test_idle_wheels_while_commanded_show_a_wedged_board() -> None:
    driven = {"inputs": (DriveInput("/cmd_vel_joy", 24, 24),), "drive_bus_holder": "joy", "drive_bus_locks": ()}
    (finding,) = root_findings(graph(idle_wheels_s=1.3, **driven))
    assert finding.id == "board-wedged" and finding.fix.playbook == "recover-board"
    assert finding.cause.startswith("the encoders are silent while the wheels are commanded")
    assert finding.evidence[0] == f"{ODOM.name} on robot: unchanged for 1.3 s, while the input joy drove"
    assert ids(graph(idle_wheels_s=0.9, **driven)) == []
    assert "board-wedged" not in ids(graph(idle_wheels_s=1.3, **{**driven, "drive_bus_locks": ("e-stop engaged",)}))
    assert "board-wedged" not in ids(graph(idle_wheels_s=1.3, battery=(0.9, 0.3), **driven)), "the motors have no power"
    simulated = dataclasses.replace(graph(idle_wheels_s=1.3, **driven), kind="sim")
    assert "board-wedged" not in ids(simulated)


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
    stopped = graph(samples=BOARD_SILENT, estop=True, estop_reasons=(BUTTON_SILENT.format(seconds=2),))
    assert ids(stopped, devices=devices("/dev/ttyACM0 root:dialout 660")) == ["board-wedged"]  # it sends the button's state


def test_board_off_the_usb_bus_is_wedged_without_a_graph() -> None:
    journal = captured(SYSTEM_JOURNAL, "board-gone")
    (finding,) = root_findings(devices=devices(), journal=journal, units=captured(UNIT_STATES, "healthy"))
    assert finding.id == "board-wedged" and any("USB disconnect" in line for line in finding.evidence)
    assert ids(devices=devices("/dev/ttyACM0 root:dialout 660"), journal=journal) == []  # it came back
    assert ids(devices=dataclasses.replace(devices(), telemetrix=()), journal=journal) == []


@pytest.mark.parametrize(
    ("text", "trouble"),
    [
        ("cdc_acm 1-1.2:1.0: ttyACM0: USB ACM device", False),
        ("ch341-uart converter now attached to ttyUSB0", False),
        ("usb 1-1.2: USB disconnect, device number 5", True),
        ("cdc_acm 1-1.2:1.0: failed to set dtr/rts", True),
        ("ttyUSB0: usb_serial_generic_read_bulk_callback - urb error -71", True),
    ],
)
def test_only_errors_of_serial_devices_are_trouble(text: str, trouble: bool) -> None:
    assert motor_board.is_serial_trouble(text) == trouble


@pytest.mark.parametrize(
    ("line", "closed"),
    [
        ("/dev/ttyUSB0 root:dialout 660", False),
        ("/dev/ttyUSB0 root:root 600", True),
        ("/dev/ttyUSB0 root:root 666", False),
        ("/dev/ttyUSB0 root:dialout 600", True),
        ("/dev/ttyUSB0 mirte:root 600", False),
    ],
)
def test_serial_port_that_the_user_may_not_open_is_named(line: str, closed: bool) -> None:
    account = Account("mirte", 1000, ("mirte", "dialout"), ("dialout",), "/home/mirte", home_writable=True)
    seen = Devices((), (), (line,), (), (), ())
    found = root_findings(graph(), devices=seen, account=account)
    assert [(finding.id, finding.layer) for finding in found] == ([("serial-port-closed", "devices")] if closed else [])


def test_part_without_publishers_is_named_with_its_unit() -> None:
    def found(gone: str, **robot: Any) -> dict[str, Finding]:
        topics = tuple(dataclasses.replace(t, publishers=()) if t.name == gone else t for t in graph().topics)
        seen = graph(topics=topics, samples=tuple(pair for pair in graph().samples if pair[0] != gone))
        diagnosis = diagnose((*ground_truth.CHECKS, *missing_parts.CHECKS), snapshot(seen, **robot))
        assert_findings_match_rows(diagnosis)
        return {root.finding.about: root.finding for root in diagnosis.roots if root.finding.id == "part-missing"}

    journal = SYSTEM_JOURNAL.parse(Output(0, "@@ units\n1795271018.5 mirte launch[7]: rplidar: exited\n@@ kernel\n@@ end\n"))
    lidar = found("/scan", journal=journal)["lidar"]
    assert (lidar.layer, lidar.where) == ("processes", "robot") and "mirte-ros.service" in lidar.fix.command
    assert any("rplidar: exited" in line for line in lidar.evidence)
    unplugged = Devices(("1-1 1a86:7523 x",), (), (), (), (), ())
    assert found("/scan", devices=unplugged)["lidar"].layer == "devices"
    assert "lidar" not in found("/nothing", journal=journal)


@pytest.mark.parametrize(
    ("machine", "program", "expected"),
    [
        ("robot", "rplidar_composition", {"socket-not-read"}),
        ("robot", "own_logger", {"unexplained"}),
        ("laptop", "ros2 topic echo /scan", {"unexplained"}),
    ],
)
def test_hung_program_explains_only_its_own_part(machine: str, program: str, expected: set[str]) -> None:
    seen = graph(samples=tuple((name, 0 if name == "/scan" else count) for name, count in graph().samples))
    owner = {"sockets": Sockets((Socket("udp", "0.0.0.0", 7413, program.split()[0], 4242, program),))}
    lost = snapshot(seen, **(owner if machine == "robot" else {"addresses": None}))
    laptop = Facts("laptop", {**lost.laptop.values, **(owner if machine == "laptop" else {})})
    path = Path("10.42.0.1", End("laptop", "lan0", "10.42.0.2"), unread=(UnreadSocket(machine, 7413, 900),))
    diagnosis = diagnose((*ground_truth.CHECKS, *path_checks.CHECKS), dataclasses.replace(lost, laptop=laptop, path=path))
    assert_findings_match_rows(diagnosis)
    assert {root.finding.id for root in diagnosis.roots if root.finding.severity is Severity.PROBLEM} == expected
    assert "socket-not-read" in {finding.id for finding in diagnosis.findings}


def test_blocked_telemetrix_is_wedged_only_with_a_second_sign() -> None:
    waiting = devices("/dev/ttyACM0 root:dialout 660", state="D")
    assert ids(graph(), devices=waiting) == []
    (finding,) = root_findings(graph(samples=BOARD_SILENT), devices=waiting)
    assert "hangs in the kernel" in finding.cause
