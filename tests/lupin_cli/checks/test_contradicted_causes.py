"""Causes that what arrives contradicts: they hide no other finding, and are warnings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from lupin_cli.checks import controllers, drive, ground_truth, missing_parts, topic_delivery
from lupin_cli.checks.drive import SILENT_BUTTON
from lupin_cli.checks.layers import LIDAR_PART
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts.addresses import Address, Addresses
from lupin_cli.facts.graph import Graph, Graphs
from lupin_cli.facts.sockets import Sockets
from lupin_cli.systemd.units import ONBOARD
from lupin_runtime.graph import DRIVE_STATUS, ESTOP_STATUS, SCAN
from lupin_runtime.safety.expected_sources import BUTTON, UNHEARD
from tests.lupin_cli.checks.conftest import CHECKS as NETWORK
from tests.lupin_cli.checks.conftest import Machines
from tests.lupin_cli.checks.test_ground_truth import received, timed, without
from tests.support.changed_facts import changed, without_access_point
from tests.support.findings import assert_findings_match_rows

CHECKS = (*ground_truth.CHECKS, *missing_parts.CHECKS, *topic_delivery.CHECKS, *controllers.CHECKS, *drive.CHECKS, *NETWORK)
VENDOR_GROUP = "/system.slice/mirte-ros.service"


def without_lidar() -> Graph:
    """Return what arrives if nothing publishes scans."""
    topics = tuple(replace(topic, publishers=()) if topic.name == SCAN.name else topic for topic in received().topics)
    return received(topics=topics, samples=without(SCAN.name, count=None))


def roots(machines: Machines, graph: Graph) -> list[tuple[str, str]]:
    """Return severity and id of each root cause while `graph` is what arrives."""
    diagnosis = diagnose(CHECKS, machines.with_laptop("graph", Graphs((graph,))).snapshot)
    assert_findings_match_rows(diagnosis)
    return [(root.finding.severity.value, root.finding.id) for root in diagnosis.roots]


def pinned(sockets: Sockets) -> Sockets:
    return Sockets(tuple(replace(each, address="10.42.0.1") if each.port == 11811 else each for each in sockets.entries))


def unaware(sockets: Sockets) -> Sockets:
    return Sockets(tuple(each for each in sockets.entries if each.address != "10.42.0.1"))


def stopped(*arguments: str) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    return changed(1, state="T", parent=1, group=VENDOR_GROUP, arguments=arguments)


FAULTS: dict[str, Callable[[Machines], Machines]] = {
    "robot-multi-homed": lambda machines: machines.with_laptop("routes", without_access_point),
    "discovery-server-pinned": lambda machines: machines.with_robot("sockets", pinned),
    "process-stopped": lambda machines: machines.with_robot("ros-processes", stopped("/opt/ros/web_video_server")),
    "process-older-than-interface": lambda machines: machines.with_robot("sockets", unaware),
}


@pytest.mark.parametrize("id", FAULTS)
def test_cause_explains_no_loss_that_it_cannot_have_caused(healthy: Machines, id: str) -> None:
    faulty = FAULTS[id](healthy)
    assert roots(faulty, received()) == [("warning", id)]
    assert sorted(roots(faulty, without_lidar())) == [("problem", "part-missing"), ("warning", id)]
    listed = tuple(replace(each, state="inactive") for each in received().controllers or ())
    inactive = received(controllers=listed)
    assert sorted(roots(faulty, inactive)) == [("problem", "controllers-not-active"), ("warning", id)]


@pytest.mark.parametrize("id", FAULTS)
def test_cause_explains_that_nothing_arrives(healthy: Machines, id: str) -> None:
    assert roots(FAULTS[id](healthy), Graph("robot", "robot", ())) == [("problem", id)]


def test_unanswered_calls_are_explained_by_a_second_address(healthy: Machines) -> None:
    one_way = received(calls=tuple(replace(call, round_trip_s=None) for call in received().calls), controllers=None)
    assert roots(FAULTS["robot-multi-homed"](healthy), one_way) == [("problem", "robot-multi-homed")]


def test_stopped_program_explains_its_own_part(healthy: Machines) -> None:
    lidar = healthy.with_robot("ros-processes", stopped("/opt/ros/rplidar_composition"))
    assert roots(lidar, without_lidar()) == [("problem", "process-stopped")]
    assert roots(lidar, received(samples=without(SCAN.name))) == [("problem", "process-stopped")]
    everything = healthy.with_robot("ros-processes", stopped("python3", "-m", "all_of_the_robot"))
    own = {DRIVE_STATUS.name, ESTOP_STATUS.name}
    others = [name for name, _ in received().samples if name not in own]
    silent = received(samples=without(*others), controllers=None)
    assert roots(everything, silent) == [("problem", "process-stopped")]
    for reason in (f"{SILENT_BUTTON} for more than 2 s", UNHEARD[BUTTON]):
        engaged = replace(silent, estop=True, estop_reasons=(reason,))
        assert roots(everything, engaged) == [("problem", "process-stopped")]
    # Stopped for most of the time: all topics are slow, or all of the vendor's.
    assert roots(everything, timed(0.1)) == roots(everything, timed(0.1, *others)) == [("problem", "process-stopped")]


def test_stopped_program_whose_data_came_before_is_not_healthy(healthy: Machines) -> None:
    """One that is stopped for most of the time delivers while it runs: then nobody may say that all works."""
    everything = healthy.with_robot("ros-processes", stopped("python3", "-m", "all_of_the_robot"))
    assert roots(everything, received()) == [("warning", "process-stopped")]
    truth = diagnose(CHECKS, everything.with_laptop("graph", Graphs((received(),))).snapshot).ground_truth
    assert truth is not None and truth.state is ground_truth.State.UNOBSERVED and "is stopped" in truth.unobserved[0]


def test_stopped_program_of_lupin_explains_no_silent_lidar(healthy: Machines) -> None:
    estop = changed(1, state="T", parent=1, group=f"/system.slice/{ONBOARD}", arguments=("python3", "-m", "lupin_runtime.x"))
    machines = healthy.with_robot("ros-processes", estop)
    assert sorted(roots(machines, without_lidar())) == [("problem", "part-missing"), ("problem", "process-stopped")]
    lost = received(samples=without(ESTOP_STATUS.name))
    assert roots(machines, lost) == [("problem", "process-stopped")]
    truth = ground_truth.measure(machines.with_laptop("graph", Graphs((without_lidar(),))).snapshot)
    assert list(truth.losses) == [LIDAR_PART]


@pytest.mark.parametrize("source", ["10.42.0.2", ""])
def test_newer_address_of_the_interface_in_use_is_ignored(healthy: Machines, source: str) -> None:
    newer = Address("lan0", "192.168.7.7", 24, "global", up=True, carrier=True)
    machines = healthy.with_laptop("addresses", lambda own: Addresses((newer, *own.entries)))
    from_there = machines.with_laptop(
        "routes", lambda routes: replace(routes, main=tuple(replace(each, source=source) for each in routes.main))
    )
    assert roots(from_there, received()) == []


def test_bare_shell_hides_no_missing_lidar(healthy: Machines) -> None:
    other = {"ROS_DISCOVERY_SERVER": "10.42.0.9:11811"}
    machines = healthy.with_laptop("shell", lambda shell: replace(shell, environment={**shell.environment, **other}))
    machines = machines.with_robot(
        "addresses", lambda own: Addresses((*own.entries, replace(own.entries[0], address="10.42.0.9")))
    )
    assert roots(machines, without_lidar()) == [("problem", "part-missing"), ("warning", "shell-multicast-only")]


def test_old_process_of_the_laptop_hides_nothing_of_the_robot(healthy: Machines) -> None:
    old = healthy.with_laptop(
        "sockets", lambda sockets: Sockets(tuple(each for each in sockets.entries if each.address != "10.42.0.2"))
    )
    assert roots(old, received()) == [("warning", "process-older-than-interface")]
    assert sorted(roots(old, without_lidar())) == [("problem", "part-missing"), ("problem", "process-older-than-interface")]
