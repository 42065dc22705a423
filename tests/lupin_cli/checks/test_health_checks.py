"""Captured facts of healthy and faulty robots under all health checks: each fault is named, and nothing else."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import pytest

from lupin_cli.checks import cameras, clocks, ground_truth, resources, services, software
from lupin_cli.checks.base import Finding, Severity, Snapshot
from lupin_cli.connection.base import Output
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts.base import Facts
from lupin_cli.facts.chrony import Chrony
from lupin_cli.facts.clock import Clock, Offset
from lupin_cli.facts.devices import Devices, Holder
from lupin_cli.facts.graph import Graph, Graphs
from lupin_cli.facts.storage import Storage
from lupin_cli.facts.units import UNIT_STATES, VENDOR, Unit, Units
from lupin_cli.release.verify_release import UNSIGNED
from lupin_cli.systemd.units import CAMERAS, CLOCK_SYNC, ONBOARD
from lupin_runtime.cameras.driver_state import ENDED, DriverState
from tests.support.findings import assert_findings_match_rows
from tests.support.optional import present
from tests.support.paths import CAPTURED_FACTS
from tests.support.snapshots import HEALTHY_LAPTOP, HEALTHY_ROBOT, captured, snapshot_of, values

CHECKS = (*clocks.CHECKS, *services.CHECKS, *resources.CHECKS, *cameras.CHECKS, *software.CHECKS)


def make_snapshot(*, ahead_s: float = 0.0, laptop: dict[str, Any] | None = None, **robot: Any) -> Snapshot:
    """Return the healthy robot and laptop with facts replaced by captured cases (by name) or values."""
    return snapshot_of({**HEALTHY_LAPTOP, **(laptop or {})}, {**HEALTHY_ROBOT, **robot}, ahead_s)


def root_findings(snapshot: Snapshot) -> list[Finding]:
    diagnosis = diagnose(CHECKS, snapshot)
    assert_findings_match_rows(diagnosis)
    for finding in diagnosis.findings:
        assert finding.evidence and all(finding.evidence), finding.id
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


def test_masked_unit_needs_no_reload() -> None:
    masked = {"load": "masked", "enabled": "masked", "active": "inactive", "needs_reload": True}
    assert ids(make_snapshot(units=units(lupin_onboard=masked))) == ["unit-not-enabled"]
    assert "units-need-reload" in ids(make_snapshot(units=units(lupin_onboard={**masked, "enabled": "enabled"})))


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


@pytest.mark.parametrize("ahead_s", [0.0, 0.9, -1.4, 1.4])
def test_uncertain_clock_offset_is_ignored(ahead_s: float) -> None:
    assert ids(make_snapshot(ahead_s=ahead_s)) == []


@pytest.mark.parametrize(("ahead_s", "expected"), [(1.2, ["clock-drift"]), (-3.2, ["clock-drift"]), (0.9, [])])
def test_link_clock_offset_overrides_the_batch(ahead_s: float, expected: list[str]) -> None:
    snapshot = make_snapshot(ahead_s=ahead_s)
    link = dataclasses.replace(present(snapshot.link), clock=Offset(ahead_s, 0.004))
    assert ids(dataclasses.replace(snapshot, link=link)) == expected


def test_running_stack_makes_the_clock_fix_unsafe() -> None:
    (live,) = root_findings(make_snapshot(ahead_s=100.0))
    assert live.fix.playbook == "sync-clock" and not live.fix.safe
    down = root_findings(make_snapshot(ahead_s=100.0, units=units(mirte_ros={"active": "inactive"})))
    assert [f.fix.safe for f in down if f.id == "clock-drift"] == [True]


def test_small_offset_is_slewed_under_a_running_stack() -> None:
    follows = captured("chrony", "chrony-follows-laptop")
    alone = dataclasses.replace(follows, sources=(), tracking=None, conf=())
    (live,) = root_findings(make_snapshot(ahead_s=2.0, chrony=alone))
    assert (live.fix.playbook, live.fix.command) == ("install-clock-sync", "lupin sync-clock --install --robot lupin")
    (unaware,) = root_findings(make_snapshot(ahead_s=2.0))
    assert unaware.fix.playbook == "" and "chronyc burst 4/4" in unaware.fix.command
    (down,) = (
        finding
        for finding in root_findings(make_snapshot(ahead_s=2.0, units=units(mirte_ros={"active": "inactive"})))
        if finding.id == "clock-drift"
    )
    assert down.fix.variables == {"tolerance_s": 1.0} and down.fix.safe
    slewing = dataclasses.replace(follows, tracking=dataclasses.replace(follows.tracking, offset_s=1.9))
    (known,) = root_findings(make_snapshot(ahead_s=2.0, chrony=slewing))
    assert known.fix.playbook == "" and "chrony knows" in known.cause


def test_wrong_clock_of_the_laptop_is_not_given_to_the_robot() -> None:
    serving = captured("chrony", "laptop-serving")
    wrong = dataclasses.replace(serving, tracking=dataclasses.replace(serving.tracking, offset_s=300.0))
    (finding,) = root_findings(make_snapshot(ahead_s=300.0, laptop={"chrony": wrong}))
    assert (finding.id, finding.where, finding.fix.playbook) == ("clock-drift", "laptop", "")
    (finding,) = root_findings(make_snapshot(ahead_s=-300.0, laptop={"chrony": wrong}))
    assert finding.where == "robot", "the laptop's own error makes the difference smaller"


@pytest.mark.parametrize("laptop_s", [240.0, 3.1e9])
@pytest.mark.parametrize("active", ["active", "inactive"])
def test_impossible_time_of_the_laptop_is_not_given_on(laptop_s: float, active: str) -> None:
    now_s = captured("clock", HEALTHY_ROBOT["clock"]).epoch_ns / 1e9
    seen = make_snapshot(ahead_s=now_s - laptop_s, units=units(mirte_ros={"active": active}))
    finding = next(each for each in root_findings(seen) if each.id == "clock-drift")
    assert (finding.where, finding.fix.playbook, finding.fix.safe) == ("laptop", "", False)
    assert ("1970-01-01 00:0" in finding.cause) == (laptop_s < 1e9)
    assert finding.fix.command == "sudo timedatectl set-ntp true" and "date -s" in finding.fix.instruction
    robot = dataclasses.replace(present(seen.robot), probed_ns=None)
    exchanged = dataclasses.replace(present(seen.link), clock=Offset(now_s - laptop_s, 0.004))
    assert clocks.laptop_clock_fault(dataclasses.replace(seen, robot=robot, link=exchanged))


def test_laptop_is_blamed_only_beside_a_better_source() -> None:
    follows = captured("chrony", "chrony-follows-laptop")
    (source,) = [each for each in follows.sources if each.state == "*"]

    def blamed(laptop: Any, stratum: int) -> str:
        elsewhere = dataclasses.replace(follows, sources=(dataclasses.replace(source, address="10.9.9.9", stratum=stratum),))
        own = {"chrony": laptop, "kernel-clock": "no-timedated"}
        found = root_findings(make_snapshot(ahead_s=40.0, chrony=elsewhere, laptop=own))
        return next(finding.where for finding in found if finding.id == "clock-drift")

    alone = dataclasses.replace(captured("chrony", "laptop-serving"), tracking=None, sources=())
    assert blamed(alone, 3) == "laptop"
    assert blamed(alone, 10) == "robot", "it serves its own clock"
    assert blamed(dataclasses.replace(alone, others=("systemd-timesyncd",)), 3) == "robot"


def test_clock_is_set_by_a_person_if_either_may_be_wrong() -> None:
    alone = {"chrony": "stopped", "kernel-clock": "no-time-source"}
    for stack in ("active", "inactive"):
        snapshot = make_snapshot(ahead_s=40.0, laptop=alone, units=units(mirte_ros={"active": stack}))
        finding = next(each for each in root_findings(snapshot) if each.id == "clock-drift")
        assert (finding.where, finding.fix.playbook, finding.fix.safe) == ("robot", "", False)
        assert finding.fix.command == "lupin sync-clock --trust-laptop --robot lupin"
        assert "either may be the wrong one" in finding.cause and "only if this machine's time" in finding.fix.instruction
    behind = next(each for each in root_findings(make_snapshot(ahead_s=-40.0, laptop=alone)) if each.id == "clock-drift")
    assert behind.fix.playbook == "sync-clock"


def test_other_time_daemon_is_named() -> None:
    follows = captured("chrony", "chrony-follows-laptop")
    beside = dataclasses.replace(follows, others=("systemd-timesyncd",))
    (finding,) = root_findings(make_snapshot(chrony=beside))
    assert (finding.id, finding.severity) == ("other-time-daemon", Severity.PROBLEM)
    instead = dataclasses.replace(beside, running=False, tracking=None, sources=(), listeners=())
    (finding,) = root_findings(make_snapshot(chrony=instead))
    assert (finding.id, finding.severity) == ("other-time-daemon", Severity.WARNING)
    assert "disable --now systemd-timesyncd.service && " in finding.fix.command
    stepping = dataclasses.replace(instead, conf=("/etc/chrony/chrony.conf:20:makestep 1 3",))
    finding = next(each for each in root_findings(make_snapshot(chrony=stepping)) if each.id == "other-time-daemon")
    assert "enable --now chrony" not in finding.fix.command
    assert finding.fix.command.endswith(" && lupin sync-clock --install --robot lupin")
    (finding,) = root_findings(make_snapshot(chrony=dataclasses.replace(instead, installed=False)))
    assert "disable" not in finding.fix.command and "apt install chrony" in finding.fix.command


def test_unsigned_release_hides_no_failed_unit() -> None:
    failed = units(lupin_onboard={"active": "failed", "sub": "failed", "result": "exit-code"})
    unsigned: dict[str, Any] = {"release-files": (UNSIGNED,)}
    found = root_findings(make_snapshot(units=failed, **unsigned))
    assert {finding.id: finding.severity for finding in found} == {
        "unit-failed": Severity.PROBLEM,
        "release-unsigned": Severity.WARNING,
    }
    assert next(finding for finding in found if finding.id == "unit-failed").fix.playbook == "start-onboard"


def test_silent_sources_need_no_clock_sync_unit() -> None:
    silent = dataclasses.replace(captured("chrony", "serving-without-source"), conf=())
    assert ids(make_snapshot(chrony=silent)) == ["chrony-sources-silent"]
    assert ids(make_snapshot(chrony=dataclasses.replace(silent, sources=()))) == [], "a stock image without the internet"


@pytest.mark.parametrize("unit", ["mirte_ros", "chrony"])
def test_disabled_units_of_others_are_named(unit: str) -> None:
    disabled: dict[str, Any] = {unit: {"enabled": "disabled"}}
    (finding,) = root_findings(make_snapshot(units=units(**disabled)))
    assert finding.id == "unit-not-enabled" and finding.about.startswith(unit.replace("_", "-"))


def lost_graph(**changed: Any) -> dict[str, Any]:
    """Return the laptop's facts while this machine receives nothing."""
    return {"graph": Graphs((Graph("robot", "robot", (), **changed),))}


@pytest.mark.parametrize("unit", [VENDOR, ONBOARD])
def test_frozen_unit_is_one_root(unit: str) -> None:
    frozen: dict[str, Any] = {unit.removesuffix(".service").replace("-", "_"): {"frozen": True}}
    (finding,) = root_findings(make_snapshot(units=units(**frozen)))
    assert (finding.id, finding.about, finding.layer) == ("unit-frozen", unit, "processes")


def test_frozen_and_restricted_units_are_parsed_and_named() -> None:
    text = (CAPTURED_FACTS / "units" / "healthy.txt").read_text()
    limited = text.replace("Id=mirte-ros.service\n", "Id=mirte-ros.service\nIPAddressDeny=::/0 0.0.0.0/0\nPrivateNetwork=yes\n")
    parsed = UNIT_STATES.parse(Output(0, limited))
    (finding,) = root_findings(make_snapshot(units=parsed))
    assert (finding.id, finding.where, finding.layer) == ("unit-without-network", "robot", "processes")
    assert "IPAddressDeny=::/0 0.0.0.0/0; PrivateNetwork=yes" in finding.cause
    allowed = "IPAddressDeny=::/0 0.0.0.0/0\nIPAddressAllow=127.0.0.0/8 10.42.0.0/24\n"
    hardened = UNIT_STATES.parse(Output(0, text.replace("Id=mirte-ros.service\n", f"Id=mirte-ros.service\n{allowed}")))
    assert ids(make_snapshot(units=hardened)) == []
    cold = UNIT_STATES.parse(Output(0, text.replace("Id=mirte-ros.service\n", "Id=mirte-ros.service\nFreezerState=frozen\n")))
    assert ids(make_snapshot(units=cold)) == ["unit-frozen"]


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"load": "not-found"}, "is not installed"),
        ({"load": "masked", "active": "inactive"}, "is masked"),
        ({"load": "bad-setting", "active": "inactive"}, "unknown or wrong setting"),
        ({"active": "activating", "sub": "start-pre"}, "has been starting for 90 s"),
    ],
)
def test_load_state_of_the_vendors_unit_is_read_first(changed: dict[str, Any], word: str) -> None:
    vendor = {**changed, "started_s": 10.0}
    seen = units(mirte_ros=vendor, lupin_onboard={"active_since_s": 20.0})
    (finding,) = root_findings(make_snapshot(laptop=lost_graph(), units=dataclasses.replace(seen, uptime_s=100.0)))
    assert (finding.id, finding.layer, finding.where) == ("vendor-service-down", "processes", "robot")
    assert word in finding.cause


def test_unit_that_never_gets_ready_is_named() -> None:
    starting: dict[str, Any] = {"lupin_onboard": {"active": "activating", "sub": "start", "started_s": 40.0}}
    seen = dataclasses.replace(units(**starting), uptime_s=100.0)
    (finding,) = root_findings(make_snapshot(laptop=lost_graph(), units=seen))
    assert finding.id == "unit-starting" and "for 60 s" in finding.cause
    assert ids(make_snapshot(units=seen)) == [], "a robot that boots"
    stopping = units(lupin_onboard={"active": "deactivating", "sub": "stop-sigterm"})
    (finding,) = root_findings(make_snapshot(laptop=lost_graph(), units=stopping))
    assert finding.id == "unit-not-running" and "is being stopped (stop-sigterm)" in finding.cause
    assert ids(make_snapshot(units=stopping)) == [], "all data still arrives"
    booting = dataclasses.replace(units(mirte_ros={**starting["lupin_onboard"], "sub": "start-pre"}), uptime_s=42.0)
    (finding,) = root_findings(make_snapshot(laptop=lost_graph(), units=booting))
    assert finding.id == "vendor-service-down" and "for 2 s" in finding.cause
    for uptime_s, found in ((60.0, []), (75.0, ["unit-starting"])):  # cameras that just started break nothing
        cameras = units(lupin_cameras={**installed(CAMERAS), **starting["lupin_onboard"], "type": "notify"})
        seen = dataclasses.replace(cameras, uptime_s=uptime_s)
        assert [each.id for each in root_findings(make_snapshot(laptop=lost_graph(), units=seen))] == found
    bad: dict[str, Any] = {"lupin_onboard": {"load": "bad-setting", "active": "inactive"}}
    (finding,) = root_findings(make_snapshot(units=units(**bad)))
    assert finding.id == "unit-failed" and "unknown or wrong setting" in finding.cause


def test_old_kill_for_memory_is_no_finding_once_all_works(monkeypatch: pytest.MonkeyPatch) -> None:
    killed: dict[str, Any] = {"journal": "oom"}
    assert "killed-for-memory" in ids(make_snapshot(**killed))
    monkeypatch.setattr(ground_truth, "measure", lambda _: ground_truth.GroundTruth(ground_truth.State.HEALTHY))
    assert "killed-for-memory" not in ids(make_snapshot(**killed))
    last_s = max(line.time_s for line in captured("journal", "oom").kernel)
    now_ns = round((last_s + 60) * 1e9)
    assert "killed-for-memory" in ids(make_snapshot(**killed, clock=Clock(now_ns, now_ns, None)))


def test_read_only_home_is_named() -> None:
    home = captured("account", "in-all-groups").home
    mount = dataclasses.replace(captured("storage", "bare-robot").mounts[0], path=home, read_only=True)
    assert ids(make_snapshot(storage=Storage((mount,)))) == ["filesystem-read-only"]


def test_journal_lines_have_human_time() -> None:
    (finding,) = root_findings(make_snapshot(units="oneshot-failed", journal="oneshot-failed"))
    assert not any(re.match(r"\d{10}\.", line) for line in finding.evidence)
    assert any(re.match(r"[A-Z][a-z]{2} \d\d \d\d:\d\d:\d\d \S", line) for line in finding.evidence)


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
    missing = dataclasses.replace(stopped, installed=False)
    assert ids(make_snapshot(chrony=missing)) == []
    assert ids(make_snapshot(chrony=missing, units=units(**WITH_CLOCK_SYNC))) == ["chrony-missing"]


def test_laptop_that_serves_another_network_is_named() -> None:
    """The cable's network is allowed, and the robot is reached over its access point."""
    silent = dataclasses.replace(captured("chrony", "serving-without-source"), conf=())
    snapshot = make_snapshot(chrony=silent, units=units(**WITH_CLOCK_SYNC))
    link = dataclasses.replace(present(snapshot.link), address="192.168.42.1")
    (finding,) = root_findings(dataclasses.replace(snapshot, link=link))
    assert finding.id == "chrony-not-serving" and "does not allow 192.168.42.1" in finding.cause
    assert finding.fix.command == "lupin play serve-clock -v network=192.168.42.0/24"
    assert finding.fix.variables == {"network": "192.168.42.0/24"}


@pytest.mark.parametrize(
    ("conf", "address", "allowed"),
    [
        ("allow 10.42.0.0/24", "10.42.0.1", True),
        ("allow 10.42.0.0/24", "192.168.42.1", False),
        ("allow 10.42", "10.42.7.1", True),
        ("allow", "192.168.42.1", True),
        ("allow all", "192.168.42.1", True),
        ("allow 10.42.0.0/16\ndeny 10.42.7", "10.42.7.1", False),
        ("allow 10.42.7.1\ndeny all", "10.42.7.1", True),
        ("allow fe80::/10", "10.42.0.1", False),
    ],
)
def test_most_specific_directive_allows_an_address(conf: str, address: str, allowed: bool) -> None:
    lines = tuple(f"/etc/chrony/chrony.conf:1:{line}" for line in conf.splitlines())
    assert dataclasses.replace(captured("chrony", "laptop-serving"), conf=lines).allows(address) is allowed


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


@pytest.mark.parametrize(
    ("unit", "end"),
    [
        ("mirte-ros.service", "sudo kill 812"),  # the rest of the vendor's stack goes on
        ("-", "sudo kill 812"),
        ("webcam.service", "sudo systemctl stop webcam.service"),  # systemd would start it again
    ],
)
def test_only_the_holder_of_the_camera_is_ended(unit: str, end: str) -> None:
    (finding,) = root_findings(make_snapshot(devices=holder(unit), units=units(**WITH_CAMERAS)))
    assert finding.fix.command == f"ssh -t 10.42.0.1 '{end} && sudo systemctl restart lupin-cameras.service'"


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


def test_full_socket_buffers_are_named_if_the_kernel_limits_them() -> None:
    small = dataclasses.replace(captured("socket-buffers", "overflowing"), receive_limit=212_992)
    for machine in ("robot", "laptop"):
        given: dict[str, Any] = {"socket-buffers": small}
        (finding,) = root_findings(make_snapshot(laptop=given) if machine == "laptop" else make_snapshot(**given))
        assert (finding.id, finding.where, finding.severity) == ("socket-buffers-small", machine, Severity.WARNING)
        assert "net.core.rmem_max is 212992" in finding.cause and "net.core.rmem_max=4194304" in finding.fix.command
    idle = dataclasses.replace(captured("socket-buffers", "idle"), receive_limit=212_992)
    unlimited = captured("socket-buffers", "overflowing")
    for harmless in (idle, unlimited, dataclasses.replace(small, receive_limit=None)):
        assert ids(make_snapshot(**{"socket-buffers": harmless})) == []
