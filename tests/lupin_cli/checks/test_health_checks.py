"""Captured facts of healthy and faulty robots under all health checks: each fault is named, and nothing else."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from lupin_cli.checks import cameras, clocks, resources, services, software
from lupin_cli.checks.base import Finding, Severity, Snapshot
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts.base import Facts
from lupin_cli.facts.chrony import Chrony
from lupin_cli.facts.clock import Clock, Offset
from lupin_cli.facts.devices import Devices, Holder
from lupin_cli.facts.storage import Storage
from lupin_cli.facts.units import Unit, Units
from lupin_cli.systemd.units import CAMERAS, CLOCK_SYNC
from lupin_runtime.cameras.driver_state import ENDED, DriverState
from tests.support.findings import assert_findings_match_rows
from tests.support.optional import present
from tests.support.snapshots import HEALTHY_LAPTOP, HEALTHY_ROBOT, captured, snapshot_of, values

CHECKS = (*clocks.CHECKS, *services.CHECKS, *resources.CHECKS, *cameras.CHECKS, *software.CHECKS)


def make_snapshot(*, ahead_s: float = 0.0, laptop: dict[str, Any] | None = None, **robot: Any) -> Snapshot:
    """Return the healthy robot and laptop with facts replaced by captured cases (by name) or values."""
    return snapshot_of({**HEALTHY_LAPTOP, **(laptop or {})}, {**HEALTHY_ROBOT, **robot}, ahead_s)


def root_findings(snapshot: Snapshot) -> list[Finding]:
    diagnosis = diagnose(CHECKS, snapshot)
    assert_findings_match_rows(diagnosis)
    for finding in diagnosis.findings:
        assert finding.evidence and all(finding.evidence) and finding.fix.command, finding.id
    return [root.finding for root in diagnosis.roots]


def ids(snapshot: Snapshot) -> list[str]:
    return [finding.id for finding in root_findings(snapshot)]


def units(case: str = "healthy", **changed: Any) -> Units:
    """Return a captured case with properties of units changed: `lupin_onboard={"active": "failed"}`."""
    by_name = {name.replace("_", "-") + ".service": changes for name, changes in changed.items()}
    seen: Units = captured("units", case)
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


WITH_CLOCK_SYNC: dict[str, Any] = {"lupin_clock_sync": installed(CLOCK_SYNC)}


def test_healthy_robot_and_laptop_have_no_findings() -> None:
    assert ids(make_snapshot()) == []
    assert ids(make_snapshot(units=units(**WITH_CLOCK_SYNC))) == []


def test_without_robot_only_the_laptop_is_judged() -> None:
    laptop = Facts("laptop", values({**HEALTHY_LAPTOP, "chrony": "stopped"}))
    assert ids(Snapshot(laptop, None)) == []


def test_unknown_fact_causes_no_finding() -> None:
    assert ids(Snapshot(Facts("laptop", {}), Facts("robot", {}))) == []


def test_stopped_vendor_service_explains_its_units() -> None:
    snapshot = make_snapshot(units=units(mirte_ros={"active": "inactive", "sub": "dead"}, lupin_onboard={"active": "inactive"}))
    diagnosis = diagnose(CHECKS, snapshot)
    assert [root.finding.id for root in diagnosis.roots] == ["vendor-service-down"]
    assert [finding.id for finding in diagnosis.roots[0].consequences] == ["unit-not-running"]


def test_full_shared_memory_is_cleaned_on_its_machine() -> None:
    (finding,) = root_findings(make_snapshot(storage="shm-full"))
    assert (finding.fix.playbook, finding.fix.variables, finding.fix.safe) == ("sweep", {"machine": "robot"}, False)
    assert finding.fix.command == "lupin sweep --robot lupin"


def test_changed_unit_file_and_masked_unit_are_named() -> None:
    seen = ids(make_snapshot(units="stopped-and-stale"))
    assert seen == ["vendor-service-down", *3 * ["unit-not-enabled"], "units-need-reload"]


def test_failed_oneshot_shows_its_log_and_asks_before_healing() -> None:
    (finding,) = root_findings(make_snapshot(units="oneshot-failed", journal="oneshot-failed"))
    assert any("Failed with result" in line for line in finding.evidence)
    assert finding.fix.playbook == "heal" and not finding.fix.safe  # heal moves the arm
    assert "controllers-not-active" in finding.explains


@pytest.mark.parametrize("ahead_s", [5040.0, -16440.0, 4.0])
def test_certain_clock_offset_is_a_problem(ahead_s: float) -> None:
    (finding,) = root_findings(make_snapshot(ahead_s=ahead_s))
    assert finding.id == "clock-drift" and finding.severity is Severity.PROBLEM
    assert f"{ahead_s:+.3f} s ± 0.5" in finding.cause


@pytest.mark.parametrize("ahead_s", [0.0, 2.9, -3.2, 3.4])
def test_uncertain_clock_offset_is_ignored(ahead_s: float) -> None:
    assert ids(make_snapshot(ahead_s=ahead_s)) == []


@pytest.mark.parametrize(("ahead_s", "expected"), [(3.2, ["clock-drift"]), (-3.2, ["clock-drift"]), (2.9, [])])
def test_link_clock_offset_overrides_the_batch(ahead_s: float, expected: list[str]) -> None:
    snapshot = make_snapshot(ahead_s=ahead_s)
    link = dataclasses.replace(present(snapshot.link), clock=Offset(ahead_s, 0.004))
    assert ids(dataclasses.replace(snapshot, link=link)) == expected


def test_running_stack_makes_the_clock_fix_unsafe() -> None:
    (live,) = root_findings(make_snapshot(ahead_s=100.0))
    assert live.fix.playbook == "sync-clock" and not live.fix.safe
    down = root_findings(make_snapshot(ahead_s=100.0, units=units(mirte_ros={"active": "inactive"})))
    assert [f.fix.safe for f in down if f.id == "clock-drift"] == [True]


def test_clock_without_probe_times_causes_no_finding() -> None:
    snapshot = make_snapshot(ahead_s=100.0)
    assert snapshot.robot is not None
    assert ids(dataclasses.replace(snapshot, robot=dataclasses.replace(snapshot.robot, probed_ns=None))) == []


def test_robot_chrony_is_judged_only_if_it_is_used() -> None:
    follows = captured("chrony", "chrony-follows-laptop")
    stopped = dataclasses.replace(follows, running=False, tracking=None, sources=(), listeners=())
    (finding,) = root_findings(make_snapshot(chrony=stopped))
    assert finding.id == "chrony-not-running" and finding.severity is Severity.WARNING
    (finding,) = root_findings(make_snapshot(chrony=stopped, units=units(**WITH_CLOCK_SYNC)))
    assert finding.severity is Severity.PROBLEM
    assert ids(make_snapshot(chrony=dataclasses.replace(stopped, others=("systemd-timesyncd",)))) == []
    missing = dataclasses.replace(stopped, installed=False)
    assert ids(make_snapshot(chrony=missing)) == []
    assert ids(make_snapshot(chrony=missing, units=units(**WITH_CLOCK_SYNC))) == ["chrony-missing"]


def test_stopped_chrony_with_makestep_is_reconfigured() -> None:
    findings = {finding.id: finding for finding in root_findings(make_snapshot(chrony="stopped"))}
    assert set(findings) == {"chrony-stock-makestep", "chrony-not-running"}
    assert findings["chrony-not-running"].fix.playbook == "install-clock-sync"


@pytest.mark.parametrize("case", ["stopped", "bare-robot"])
def test_laptop_not_serving_explains_silent_sources(case: str) -> None:
    silent = dataclasses.replace(captured("chrony", "serving-without-source"), conf=())
    snapshot = make_snapshot(laptop={"chrony": case}, chrony=silent, units=units(**WITH_CLOCK_SYNC))
    diagnosis = diagnose(CHECKS, snapshot)
    assert [root.finding.id for root in diagnosis.roots] == ["chrony-not-serving"]
    assert [finding.id for finding in diagnosis.roots[0].consequences] == ["chrony-sources-silent"]


def test_robot_with_another_time_source_needs_no_laptop() -> None:
    assert ids(make_snapshot(laptop={"chrony": "stopped"}, units=units(**WITH_CLOCK_SYNC))) == []


def holder(unit: str) -> Devices:
    one = Holder(812, "/dev/video0", unit, "usb_cam_node_exe", "usb_cam_node_exe --ros-args")
    result: Devices = dataclasses.replace(captured("devices", "bare-robot"), holders=(one,))
    return result


WITH_CAMERAS: dict[str, Any] = {
    "lupin_cameras": {**installed(CAMERAS), "sub": "running", "type": "simple", "active_since_s": 99.0}
}


def test_camera_driver_faults_are_named_while_the_service_runs() -> None:
    drivers: dict[str, Any] = {"camera-drivers": "failing-and-absent"}
    found = root_findings(make_snapshot(units=units(**WITH_CAMERAS), **drivers))
    assert [(finding.id, finding.about) for finding in found] == [
        ("camera-driver-failing", "body"),
        ("camera-absent", "gripper"),
    ]
    assert "status 3" in found[0].evidence[0]
    no_service: dict[str, Any] = {"camera-drivers": "no-service"}
    assert ids(make_snapshot(units=units(**WITH_CAMERAS), **no_service)) == []
    assert ids(make_snapshot(**drivers)) == [], "the files of a service that was removed"


def test_driver_that_exited_once_causes_no_finding() -> None:
    once: dict[str, Any] = {"camera-drivers": {"body": DriverState(ENDED, "ended with status 1", 1)}}
    assert ids(make_snapshot(units=units(**WITH_CAMERAS), **once)) == []


def test_camera_owner_is_the_running_camera_unit_or_the_vendor() -> None:
    ours = units(**WITH_CAMERAS)
    assert ids(make_snapshot(devices=holder("lupin-cameras.service"), units=ours)) == []
    assert ids(make_snapshot(devices=holder("mirte-ros.service"), units=ours)) == ["camera-held"]
    assert ids(make_snapshot(devices=holder("mirte-ros.service"))) == []
    assert ids(make_snapshot(devices=holder("-"))) == ["camera-held"]


def test_captured_stray_processes_hold_the_camera() -> None:
    findings = root_findings(make_snapshot(devices="held"))
    assert [finding.id for finding in findings] == ["camera-held"]
    assert any("usb_cam_node_exe" in line for line in findings[0].evidence)


def test_read_only_disk_makes_writing_fixes_unsafe() -> None:
    def safe_by_finding(snapshot: Snapshot) -> dict[str, bool]:
        return {finding.id: finding.fix.safe for finding in root_findings(snapshot) if finding.fix.playbook}

    full = "read-only-and-full"
    assert safe_by_finding(make_snapshot(chrony="bare-robot"))["chrony-stock-makestep"]
    assert not safe_by_finding(make_snapshot(chrony="bare-robot", storage=full))["chrony-stock-makestep"]
    assert safe_by_finding(make_snapshot(chrony="bare-robot", laptop={"storage": full}))["chrony-stock-makestep"]


def test_serial_ports_and_cameras_require_their_groups() -> None:
    account = dataclasses.replace(captured("account", "operator"), home_writable=True, groups=("mirte", "input"))
    devices = dataclasses.replace(captured("devices", "held"), holders=())
    (finding,) = root_findings(make_snapshot(account=account, devices=devices))
    assert finding.id == "groups-missing" and "dialout" in finding.cause


def test_captures_have_the_assumed_values() -> None:
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
def test_full_file_system_is_named_and_small_one_is_not(
    path: str, size_kb: int, available_kb: int, expected: list[str]
) -> None:
    mount = dataclasses.replace(
        captured("storage", "bare-robot").mounts[0], path=path, size_kb=size_kb, available_kb=available_kb
    )
    assert ids(make_snapshot(storage=Storage((mount,)))) == expected
