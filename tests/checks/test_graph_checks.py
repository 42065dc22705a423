"""A captured graph of the simulated robot, healthy and made sick, under all checks that look at a graph."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.checks import board, controllers, drive, samples
from lupin_cli.checks.base import Evidence, Finding, Severity
from lupin_cli.checks.samples import BOARD, mismatch
from lupin_cli.diagnosis import diagnose
from lupin_cli.facts.base import Facts
from lupin_cli.facts.devices import Devices, Process
from lupin_cli.facts.graph import GRAPH, Call, Controller, End, Graph, Graphs, Input
from lupin_cli.facts.journal import JOURNAL
from lupin_cli.facts.link import Link
from lupin_cli.facts.units import UNIT_STATES
from lupin_cli.target.base import Output
from lupin_runtime.safety.consoles import LOST_HOLDING

CHECKS = (*controllers.CHECKS, *drive.CHECKS, *samples.CHECKS, *board.CHECKS)
CAPTURED = Path(__file__).parents[1] / "facts" / "captured"


def captured(fact: Any, case: str) -> Any:
    return fact.parse(Output(0, (CAPTURED / fact.name / f"{case}.txt").read_text()))


def graph(**changed: Any) -> Graph:
    """The robot's graph, healthy but for what is changed."""
    seen = captured(GRAPH, "simulator").graphs[0]
    return dataclasses.replace(seen, name="robot", kind="robot", **changed)


def ends(name: str, seen: Graph | None = None, **sides: tuple[End, ...]) -> Graph:
    """The graph with another set of publishers or subscribers on one topic."""
    seen = seen or graph()
    topics = tuple(dataclasses.replace(topic, **sides) if topic.name == name else topic for topic in seen.topics)
    # The bus knows who listens at its own sink.
    known = tuple((sink, len(sides.get("subscribers", ())) if sink == name else count) for sink, count in seen.bus_listeners)
    return dataclasses.replace(seen, topics=topics, bus_listeners=known)


def evidence(*graphs: Graph, **robot: Any) -> Evidence:
    facts = Facts("robot", robot) if robot else None
    return Evidence(Facts("laptop", {"graph": Graphs(graphs)}), facts, Link("lupin", "10.42.0.1"))


def found(*graphs: Graph, **robot: Any) -> list[Finding]:
    diagnosis = diagnose(CHECKS, evidence(*graphs, **robot))
    assert diagnosis.broken == ()
    for finding in diagnosis.findings:
        assert finding.evidence and all(finding.evidence) and finding.fix.command
    return [root.finding for root in diagnosis.roots]


def ids(*graphs: Graph, **robot: Any) -> list[str]:
    return [finding.id for finding in found(*graphs, **robot)]


def silenced(*names: str) -> tuple[tuple[str, int], ...]:
    return tuple((name, 0 if name in names else count) for name, count in graph().samples)


def test_a_healthy_graph_gives_nothing_on_either_target() -> None:
    assert ids(graph()) == []
    assert ids(*captured(GRAPH, "simulator").graphs) == []


def test_no_graph_and_an_unknown_one_give_nothing() -> None:
    assert ids() == []
    assert ids(graph(nodes=(), topics=(), samples=(), calls=(), controllers=None)) == []
    assert list(diagnose(CHECKS, Evidence(Facts("laptop", {}), None)).findings) == []


def test_a_graph_that_could_not_be_visited_is_said_to_be() -> None:
    assert ids(*captured(GRAPH, "visit-failed").graphs) == ["graph-not-visited"]


@pytest.mark.parametrize("state", ["unconfigured", "inactive", "finalized"])
def test_a_controller_that_is_not_active_is_named(state: str) -> None:
    listed = tuple(dataclasses.replace(c, state=state) if "arm" in c.name else c for c in graph().controllers or ())
    (finding,) = found(graph(controllers=listed))
    assert finding.id == "controllers-not-active"
    assert f"mirte_master_arm_controller is {state}" in finding.cause
    assert finding.fix.playbook == "heal"


def test_a_controller_that_is_missing_from_the_list_is_as_bad_as_a_stuck_one() -> None:
    (finding,) = found(graph(controllers=(Controller("joint_state_broadcaster", "active"),)))
    assert finding.cause.startswith("4 of 5 controllers do not work")
    assert ids(graph(controllers=())) == ["controllers-not-active"]


def test_a_controller_of_another_robot_is_nobodys_business() -> None:
    more = (*(graph().controllers or ()), Controller("camera_mast_controller", "inactive"))
    assert ids(graph(controllers=more)) == []


def test_a_base_controller_that_is_unconfigured_explains_the_deaf_sink() -> None:
    listed = tuple(dataclasses.replace(c, state="unconfigured") if "base" in c.name else c for c in graph().controllers or ())
    deaf = ends("/cmd_vel", graph(controllers=listed), subscribers=())
    diagnosis = diagnose(CHECKS, evidence(deaf))
    assert [root.finding.id for root in diagnosis.roots] == ["controllers-not-active"]
    assert "drive-sink-unheard" in [finding.id for finding in diagnosis.roots[0].consequences]


def test_a_robot_without_controller_manager_is_named() -> None:
    calls = tuple(call for call in graph().calls if "controller_manager" not in call.service)
    assert ids(graph(controllers=None, calls=calls)) == ["controller-manager-missing"]


def test_a_controller_manager_that_hangs_is_told_from_a_way_that_is_closed() -> None:
    first, *others = graph().calls
    assert "controller_manager" in first.service
    assert ids(graph(controllers=None, calls=(Call(first.service, None), *others))) == ["controller-manager-silent"]
    nobody = tuple(Call(call.service, None) for call in graph().calls)
    (finding,) = found(graph(controllers=None, calls=nobody))
    assert finding.id == "one-way-data" and finding.where == "link" and finding.fix.playbook == "single-home"


def test_names_without_samples_name_shared_memory_only_where_udp_was_heard() -> None:
    silent = tuple((name, 0) for name, _ in graph().samples)
    (finding,) = found(graph(samples=silent, udp_heard=9))
    assert finding.id == "names-no-samples" and "UDPv4" in finding.fix.command
    nobody = tuple(Call(call.service, None) for call in graph().calls)
    (finding,) = found(graph(samples=silent, udp_heard=0, calls=nobody, controllers=None))
    assert finding.where == "link" and "shared memory" not in finding.cause


def test_topics_that_are_all_silent_where_calls_are_answered_are_each_silent_by_themselves() -> None:
    silent = tuple((name, 0) for name, _ in graph().samples)
    findings = found(graph(samples=silent, udp_heard=0))
    assert {finding.id for finding in findings} == {"board-wedged", "topic-silent"}
    mute = {finding.about for finding in findings} - {""}
    assert "/scan" in mute and not mute & set(BOARD)
    assert any("answered after" in line for line in findings[0].evidence)


def test_a_closed_way_in_both_directions_is_one_finding() -> None:
    silent = tuple((name, 0) for name, _ in graph().samples)
    nobody = tuple(Call(call.service, None) for call in graph().calls)
    assert ids(graph(samples=silent, calls=nobody, controllers=None)) == ["names-no-samples"]


def test_one_silent_sensor_is_named_alone() -> None:
    (finding,) = found(graph(samples=silenced("/scan")))
    assert finding.id == "topic-silent" and "/scan" in finding.cause


def test_what_a_process_that_ended_left_on_the_servers_list_is_nobodys_silence_and_nobodys_misfit() -> None:
    ghost = End("_NODE_NAMESPACE_UNKNOWN_/_NODE_NAME_UNKNOWN_", "sensor_msgs/msg/LaserScan", False, False)
    silent = graph(samples=silenced("/scan"))
    assert ids(ends("/scan", silent, publishers=(ghost,))) == []
    assert ids(ends("/scan", silent, publishers=(ghost, dataclasses.replace(ghost, node="/lidar")))) == ["topic-silent"]
    assert ids(ends("/scan", subscribers=(dataclasses.replace(ghost, reliable=True),))) == []
    assert ids(ends("/cmd_vel", publishers=(ghost,), subscribers=())) == []


def test_a_topic_that_speaks_on_change_may_be_silent() -> None:
    assert ids(graph(samples=silenced("/lupin/drive/status", "/twin/state"))) == []


def test_a_sink_whose_only_listener_turns_no_wheel_is_deaf() -> None:
    strip = End("/light_strip_bridge", "geometry_msgs/msg/Twist", False, False)
    (finding,) = found(ends("/cmd_vel", subscribers=(strip,)))
    assert finding.id == "drive-sink-unheard"
    assert "the base listens on /mirte_base_controller/cmd_vel" in finding.cause


def test_a_picture_that_lacks_an_end_which_the_bus_is_matched_with_names_nothing() -> None:
    assert ids(dataclasses.replace(ends("/cmd_vel", subscribers=()), bus_listeners=(("/cmd_vel", 1),))) == []


def test_commands_to_the_name_that_exists_nowhere_are_named() -> None:
    seen = graph()
    wrong = dataclasses.replace(seen.topics[0], name="/mirte_base_controller/cmd_vel_unstamped", subscribers=())
    assert ids(dataclasses.replace(seen, topics=(*seen.topics, wrong))) == ["drive-sink-unheard"]


def test_the_stop_says_who_holds_it_and_explains_the_bus() -> None:
    button = graph(estop=True, estop_reasons=("the button is pressed",), bus_locks=("the e-stop is engaged",))
    (finding,) = found(button)
    assert finding.id == "estop-engaged" and "red button" in finding.fix.command
    (finding,) = found(graph(estop=True, estop_reasons=("a console holds the stop",)))
    assert finding.fix.command == "release the e-stop on the page"
    (finding,) = found(graph(estop=True, estop_reasons=(LOST_HOLDING,)))
    assert finding.fix.command.startswith("press stop on a page")
    assert ids(graph(bus_locks=("no e-stop state for 1.0 s",))) == ["bus-locked"]


def test_a_page_that_sends_zeros_out_votes_navigation() -> None:
    auto = Input("/cmd_vel_auto", 24, 24)
    (finding,) = found(graph(inputs=(Input("/cmd_vel_manual", 24, 0), auto), bus_winner="manual"))
    assert finding.id == "page-holds-bus" and finding.severity is Severity.PROBLEM
    (finding,) = found(graph(inputs=(Input("/cmd_vel_joy", 24, 0),)))
    assert finding.id == "pad-holds-bus" and finding.severity is Severity.WARNING


@pytest.mark.parametrize(
    "hand", [Input("/cmd_vel_manual", 24, 3), Input("/cmd_vel_manual", 5, 0), Input("/cmd_vel_auto", 24, 0)]
)
def test_a_hand_on_the_stick_is_no_fault(hand: Input) -> None:
    assert ids(graph(inputs=(hand,))) == []


RELIABLE = End("/a", "sensor_msgs/msg/LaserScan", True, False)
BEST_EFFORT = End("/b", "sensor_msgs/msg/LaserScan", False, False)
LATCHED = End("/c", "sensor_msgs/msg/LaserScan", True, True)
OTHER_TYPE = End("/d", "std_msgs/msg/String", False, False)


@pytest.mark.parametrize(
    ("publisher", "subscriber", "fits"),
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
def test_a_reader_gets_what_it_asks_for_or_nothing(publisher: End, subscriber: End, fits: bool) -> None:
    assert (mismatch(publisher, subscriber) == "") is fits


def test_a_subscriber_that_fits_no_publisher_is_named_one_that_fits_some_is_not() -> None:
    (finding,) = found(ends("/scan", subscribers=(RELIABLE, BEST_EFFORT)))
    assert finding.id == "qos-mismatch" and "/a never gets a message on /scan" in finding.symptom
    assert ids(ends("/scan", publishers=(BEST_EFFORT, RELIABLE), subscribers=(RELIABLE,))) == []
    assert ids(ends("/scan", subscribers=(dataclasses.replace(BEST_EFFORT, type="std_msgs/msg/String"),))) == ["type-mismatch"]


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
def test_the_battery_is_read_on_either_scale(read: Any, expected: list[str]) -> None:
    assert ids(graph(battery=read)) == expected


BOARD_SILENT = silenced("/io/imu/movement/data", "/io/power/power_watcher", "/io/intensity/emergency_button/digital")


def devices(*serials: str, state: str = "S") -> Devices:
    return Devices((), (), serials, (), (), (Process(412, state, "python3 telemetrix"),))


def test_a_board_that_says_nothing_while_others_speak_is_wedged() -> None:
    (finding,) = found(graph(samples=BOARD_SILENT), devices=devices("/dev/ttyACM0 root:dialout 660"))
    assert finding.id == "board-wedged" and "telemetrix: pid 412 state S: python3 telemetrix" in finding.evidence
    assert ids(graph(samples=silenced("/io/imu/movement/data"))) == ["topic-silent"]


def test_a_board_that_left_the_bus_is_wedged_even_where_no_graph_is_seen() -> None:
    journal = captured(JOURNAL, "board-gone")
    (finding,) = found(devices=devices(), journal=journal, units=captured(UNIT_STATES, "healthy"))
    assert finding.id == "board-wedged" and any("USB disconnect" in line for line in finding.evidence)
    assert ids(devices=devices("/dev/ttyACM0 root:dialout 660"), journal=journal) == []  # it came back
    assert ids(devices=dataclasses.replace(devices(), telemetrix=()), journal=journal) == []


def test_a_telemetrix_that_waits_in_the_kernel_is_wedged_only_with_another_sign() -> None:
    waiting = devices("/dev/ttyACM0 root:dialout 660", state="D")
    assert ids(graph(), devices=waiting) == []
    (finding,) = found(graph(samples=BOARD_SILENT), devices=waiting)
    assert "hangs in the kernel" in finding.cause
