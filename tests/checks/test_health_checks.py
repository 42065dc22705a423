"""Captured robots, healthy and sick, under all checks of a robot's health: a fault is named, and nothing else is."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.checks import cameras, clocks, resources, services, software
from lupin_cli.checks.base import Evidence, Finding, Severity
from lupin_cli.diagnosis import diagnose, facts_of
from lupin_cli.facts.base import Facts
from lupin_cli.facts.chrony import Chrony
from lupin_cli.facts.clock import Clock, Offset
from lupin_cli.facts.devices import Devices, Holder
from lupin_cli.facts.link import Link
from lupin_cli.facts.storage import Storage
from lupin_cli.facts.units import CAMERAS, CLOCK_SYNC, Unit, Units
from lupin_cli.target.base import Output

CHECKS = (*clocks.CHECKS, *services.CHECKS, *resources.CHECKS, *cameras.CHECKS, *software.CHECKS)
CAPTURED = Path(__file__).parents[1] / "facts" / "captured"
FACTS = {fact.name: fact for machine in ("laptop", "robot") for fact in facts_of(CHECKS, machine)}

LAPTOP = {"chrony": "laptop-serving", "storage": "bare-robot", "memory": "orange-pi"}
ROBOT = {
    "units": "healthy",
    "journal": "healthy",
    "chrony": "chrony-follows-laptop",
    "clock": "bare-robot",
    "storage": "bare-robot",
    "memory": "orange-pi",
    "thermal": "orange-pi",
    "devices": "bare-robot",
    "account": "in-all-groups",
    "versions": "deployed-humble",
}
SECOND_NS = 1_000_000_000


def captured(fact: str, case: str) -> Any:
    return FACTS[fact].parse(Output(0, (CAPTURED / fact / f"{case}.txt").read_text()))


def values(cases: dict[str, Any]) -> dict[str, Any]:
    return {fact: captured(fact, case) if isinstance(case, str) else case for fact, case in cases.items()}


def world(*, ahead_s: float = 0.0, laptop: dict[str, Any] | None = None, **robot: Any) -> Evidence:
    """The healthy robot and laptop, changed: a captured case by name, or a value."""
    of_robot = values({**ROBOT, **robot})
    clock = of_robot["clock"]
    asked = tuple(clock.epoch_ns - round((ahead_s + side) * SECOND_NS) for side in (0.5, -0.5))
    return Evidence(
        Facts("laptop", values({**LAPTOP, **(laptop or {})})),
        Facts("robot", of_robot, asked),  # type: ignore[arg-type]
        Link("lupin", "10.42.0.1"),
    )


def found(evidence: Evidence) -> list[Finding]:
    diagnosis = diagnose(CHECKS, evidence)
    assert diagnosis.broken == ()
    for finding in diagnosis.findings:
        assert finding.evidence and all(finding.evidence), finding.id
        assert finding.fix.command and finding.symptom and finding.cause
    return [root.finding for root in diagnosis.roots]


def ids(evidence: Evidence) -> list[str]:
    return [finding.id for finding in found(evidence)]


def units(case: str = "healthy", **changed: dict[str, Any]) -> Units:
    """A capture with properties of some units changed: `lupin_onboard={"active": "failed"}`."""
    seen = captured("units", case)
    by_name = {name.replace("_", "-") + ".service": changes for name, changes in changed.items()}
    return dataclasses.replace(
        seen, units=tuple(dataclasses.replace(unit, **by_name.get(unit.name, {})) for unit in seen.units)
    )


def installed(name: str) -> dict[str, Any]:
    return {
        "load": "loaded",
        "active": "active",
        "sub": "exited",
        "type": "oneshot",
        "enabled": "enabled",
        "path": f"/etc/{name}",
    }


WITH_CLOCK_SYNC = {"lupin_clock_sync": installed(CLOCK_SYNC)}


def test_a_healthy_robot_and_laptop_give_nothing() -> None:
    assert ids(world()) == []
    assert ids(world(units=units(**WITH_CLOCK_SYNC))) == []


def test_without_a_robot_only_this_machine_is_looked_at() -> None:
    laptop = Facts("laptop", values({**LAPTOP, "chrony": "stopped"}))
    assert ids(Evidence(laptop, None)) == []


def test_an_unanswered_fact_gives_no_finding() -> None:
    assert ids(Evidence(Facts("laptop", {}), Facts("robot", {}))) == []


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ({"units": "oneshot-failed", "journal": "oneshot-failed"}, ["oneshot-failed"]),
        ({"units": "outlived"}, ["unit-outlived-vendor"]),
        ({"units": "start-limit", "journal": "start-limit"}, ["unit-start-limit"]),
        ({"units": "start-limit"}, ["unit-failed"]),
        ({"units": "restarting-and-disabled"}, ["unit-restarting", "unit-not-enabled"]),
        ({"units": "another-init"}, []),
        ({"journal": "none"}, []),
        ({"units": "bare-robot"}, ["unit-missing", "unit-missing"]),
        ({"units": "bare-robot", "versions": "bare-robot"}, ["not-deployed"]),
        ({"chrony": "bare-robot"}, ["chrony-stock-makestep"]),
        ({"storage": "shm-full"}, ["shared-memory-full"]),
        ({"storage": "read-only-and-full"}, ["filesystem-read-only", "disk-full", "inodes-used-up"]),
        ({"memory": "used-up", "journal": "oom"}, ["memory-low", "killed-for-memory"]),
        ({"thermal": "orange-pi-hot"}, ["too-hot"]),
        ({"thermal": "raspberry-pi-under-voltage"}, ["under-voltage", "too-hot"]),
        ({"versions": "current-leads-nowhere"}, ["release-broken"]),
        ({"versions": "python-changed"}, ["python-changed"]),
        ({"versions": "older-release"}, ["version-skew"]),
        ({"versions": "no-python"}, ["python-missing"]),
        ({"account": "operator"}, ["home-not-writable", "groups-missing"]),
    ],
    ids=lambda value: "-".join(value.values()) if isinstance(value, dict) else "",
)
def test_each_captured_fault_is_named_and_nothing_else(case: dict[str, str], expected: list[str]) -> None:
    assert ids(world(**case)) == expected


def test_a_stopped_vendor_service_explains_what_hangs_on_it() -> None:
    evidence = world(units=units(mirte_ros={"active": "inactive", "sub": "dead"}, lupin_onboard={"active": "inactive"}))
    diagnosis = diagnose(CHECKS, evidence)
    assert [root.finding.id for root in diagnosis.roots] == ["vendor-service-down"]
    assert [finding.id for finding in diagnosis.roots[0].consequences] == ["unit-not-running"]


def test_full_shared_memory_is_swept_on_the_machine_that_it_is_on() -> None:
    (finding,) = found(world(storage="shm-full"))
    assert (finding.fix.playbook, finding.fix.variables, finding.fix.safe) == ("sweep", {"machine": "robot"}, False)
    assert finding.fix.command == "lupin sweep --robot lupin"


def test_a_changed_unit_file_and_a_masked_unit_are_named() -> None:
    seen = ids(world(units="stopped-and-stale"))
    assert seen == ["vendor-service-down", *3 * ["unit-not-enabled"], "units-need-reload"]


def test_the_failed_oneshot_shows_its_last_words_and_is_healed_by_a_person() -> None:
    (finding,) = found(world(units="oneshot-failed", journal="oneshot-failed"))
    assert any("Failed with result" in line for line in finding.evidence)
    assert finding.fix.playbook == "heal" and not finding.fix.safe  # it moves the arm
    assert "controllers-not-active" in finding.explains


@pytest.mark.parametrize("ahead_s", [5040.0, -16440.0, 4.0])
def test_a_clock_that_is_off_for_certain_is_a_problem(ahead_s: float) -> None:
    (finding,) = found(world(ahead_s=ahead_s))
    assert finding.id == "clock-drift" and finding.severity is Severity.PROBLEM
    assert f"{ahead_s:+.3f} s ± 0.5" in finding.cause


@pytest.mark.parametrize("ahead_s", [0.0, 2.9, -3.2, 3.4])
def test_a_clock_that_may_be_right_is_left_alone(ahead_s: float) -> None:
    assert ids(world(ahead_s=ahead_s)) == []


@pytest.mark.parametrize(("ahead_s", "expected"), [(3.2, ["clock-drift"]), (-3.2, ["clock-drift"]), (2.9, [])])
def test_several_exchanges_decide_where_one_batch_could_not(ahead_s: float, expected: list[str]) -> None:
    evidence = world(ahead_s=ahead_s)
    link = dataclasses.replace(evidence.link, clock=Offset(ahead_s, 0.004))
    assert ids(dataclasses.replace(evidence, link=link)) == expected


def test_a_live_stack_makes_the_cure_of_drift_unsafe() -> None:
    (live,) = found(world(ahead_s=100.0))
    assert live.fix.playbook == "sync-clock" and not live.fix.safe
    down = found(world(ahead_s=100.0, units=units(mirte_ros={"active": "inactive"})))
    assert [f.fix.safe for f in down if f.id == "clock-drift"] == [True]


def test_a_clock_read_without_bounds_says_nothing() -> None:
    evidence = world(ahead_s=100.0)
    assert evidence.robot is not None
    assert ids(dataclasses.replace(evidence, robot=dataclasses.replace(evidence.robot, asked_ns=None))) == []


def test_chrony_of_the_robot_is_asked_for_only_where_it_has_a_part() -> None:
    follows = captured("chrony", "chrony-follows-laptop")
    stopped = dataclasses.replace(follows, running=False, tracking=None, sources=(), listeners=())
    (finding,) = found(world(chrony=stopped))
    assert finding.id == "chrony-not-running" and finding.severity is Severity.WARNING
    (finding,) = found(world(chrony=stopped, units=units(**WITH_CLOCK_SYNC)))
    assert finding.severity is Severity.PROBLEM
    assert ids(world(chrony=dataclasses.replace(stopped, others=("systemd-timesyncd",)))) == []
    missing = dataclasses.replace(stopped, installed=False)
    assert ids(world(chrony=missing)) == []
    assert ids(world(chrony=missing, units=units(**WITH_CLOCK_SYNC))) == ["chrony-missing"]


def test_a_stopped_chrony_with_makestep_is_not_simply_started() -> None:
    findings = {finding.id: finding for finding in found(world(chrony="stopped"))}
    assert set(findings) == {"chrony-stock-makestep", "chrony-not-running"}
    assert findings["chrony-not-running"].fix.playbook == "install-clock-sync"


@pytest.mark.parametrize("case", ["stopped", "bare-robot"])
def test_a_laptop_that_serves_nobody_is_named_and_explains_silent_sources(case: str) -> None:
    silent = dataclasses.replace(captured("chrony", "serving-without-source"), conf=())
    evidence = world(laptop={"chrony": case}, chrony=silent, units=units(**WITH_CLOCK_SYNC))
    diagnosis = diagnose(CHECKS, evidence)
    assert [root.finding.id for root in diagnosis.roots] == ["chrony-not-serving"]
    assert [finding.id for finding in diagnosis.roots[0].consequences] == ["chrony-sources-silent"]


def test_a_robot_with_another_source_of_time_needs_no_laptop() -> None:
    assert ids(world(laptop={"chrony": "stopped"}, units=units(**WITH_CLOCK_SYNC))) == []


def holder(unit: str) -> Devices:
    one = Holder(812, "/dev/video0", unit, "usb_cam_node_exe", "usb_cam_node_exe --ros-args")
    return dataclasses.replace(captured("devices", "bare-robot"), holders=(one,))


def test_cameras_belong_to_our_unit_where_it_runs_and_to_the_vendor_where_not() -> None:
    ours = units(lupin_cameras={**installed(CAMERAS), "sub": "running", "type": "simple", "active_since_s": 99.0})
    assert ids(world(devices=holder("lupin-cameras.service"), units=ours)) == []
    assert ids(world(devices=holder("mirte-ros.service"), units=ours)) == ["camera-held"]
    assert ids(world(devices=holder("mirte-ros.service"))) == []
    assert ids(world(devices=holder("-"))) == ["camera-held"]


def test_the_captured_strays_hold_the_camera() -> None:
    findings = found(world(devices="held"))
    assert [finding.id for finding in findings] == ["camera-held"]
    assert any("usb_cam_node_exe" in line for line in findings[0].evidence)


def test_no_cure_that_writes_is_safe_on_a_robot_whose_disk_takes_nothing() -> None:
    def safe(evidence: Evidence) -> dict[str, bool]:
        return {finding.id: finding.fix.safe for finding in found(evidence) if finding.fix.playbook}

    full = "read-only-and-full"
    assert safe(world(chrony="bare-robot"))["chrony-stock-makestep"]
    assert not safe(world(chrony="bare-robot", storage=full))["chrony-stock-makestep"]
    assert safe(world(chrony="bare-robot", laptop={"storage": full}))["chrony-stock-makestep"]


def test_serial_ports_and_cameras_ask_for_their_groups() -> None:
    account = dataclasses.replace(captured("account", "operator"), home_writable=True, groups=("mirte", "input"))
    devices = dataclasses.replace(captured("devices", "held"), holders=())
    (finding,) = found(world(account=account, devices=devices))
    assert finding.id == "groups-missing" and "dialout" in finding.cause


def test_values_of_the_captures_are_what_the_checks_believe() -> None:
    assert isinstance(captured("chrony", "laptop-serving"), Chrony) and captured("chrony", "laptop-serving").serves
    assert isinstance(captured("clock", "with-rtc"), Clock) and captured("clock", "with-rtc").rtc_s == 1795271018
    unit = captured("units", "outlived").get("lupin-onboard.service")
    assert isinstance(unit, Unit) and unit.part_of == ()


@pytest.mark.parametrize(
    ("path", "size_kb", "available_kb", "expected"),
    [
        ("/", 30_000_000, 10_000_000, []),
        ("/", 30_000_000, 400_000, ["disk-full"]),
        ("/", 8_000_000, 600_000, []),
        ("/", 17_000, 1_000, ["disk-full"]),
        ("/var/log", 51_000, 20_000, []),  # in memory, to spare the card
        ("/var/log", 51_000, 1_500, ["disk-full"]),
        ("/boot", 520_000, 60_000, []),
        ("/run", 0, 0, []),
    ],
)
def test_a_file_system_is_full_when_nothing_fits_and_not_when_it_is_small(
    path: str, size_kb: int, available_kb: int, expected: list[str]
) -> None:
    mount = dataclasses.replace(
        captured("storage", "bare-robot").mounts[0], path=path, size_kb=size_kb, available_kb=available_kb
    )
    assert ids(world(storage=Storage((mount,)))) == expected
