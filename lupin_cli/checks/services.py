"""systemd units of Lupin and of the vendor: whether they are installed, enabled, running, and restarted together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.findings import NEED_VENDOR, OVER_GRAPH, make_finding
from lupin_cli.checks.layers import DRIVE, EVERYTHING, LUPIN
from lupin_cli.checks.path_fixes import laptop_addresses_near_robot
from lupin_cli.checks.remote_command import command_on_robot
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.units import UNIT_STATES, VENDOR, Unit, Units, admits
from lupin_cli.facts.versions import VERSIONS
from lupin_cli.systemd.units import AUTO_HOME, CAMERAS, LUPIN_UNITS, ONBOARD

JOURNAL_LINES = 4
MASKED = ("masked", "masked-runtime")
UNIT_DOWN = ("unit-failed", "unit-start-limit", "unit-restarting", "unit-not-running", "unit-starting")
# Units of others without which the robot does not work after a boot → what the operator then misses.
NEEDED_AT_BOOT = {
    VENDOR: "no controllers, no lidar, no battery state, no discovery server",
    "chrony.service": "the clock is as wrong as it was at the last shutdown",
}
UNUSABLE = ("bad-setting", "error")  # what systemd loads of a file that it cannot read
START_S = 30.0  # a supervisor gives up after this long without readiness
MANY_RESTARTS = 3  # a service that was restarted this many times since boot will fail again


def unit_evidence(snapshot: Snapshot, unit: Unit) -> tuple[str, ...]:
    """Return the unit's state and its last lines in the system journal."""
    journal = snapshot.robot_fact(SYSTEM_JOURNAL)
    name = unit.name.removesuffix(".service")
    lines = [line.line for line in (journal.units if journal else ()) if name in line.raw]
    return unit.line(), *lines[-JOURNAL_LINES:]


def find_vendor_down(snapshot: Snapshot) -> Iterator[Finding]:
    """The vendor's service, which starts controllers, lidar and discovery server, does not run."""
    units = snapshot.robot_fact(UNIT_STATES)
    if units is None or not units.systemd:
        return
    unit = units.get(VENDOR)
    truth = ground_truth.measure(snapshot)
    broken = truth.state is ground_truth.State.BROKEN
    playbook: str | None = ""
    if unit is None:
        if not broken or ground_truth.hears_vendor(truth):
            return  # another vendor's image may start the stack otherwise
        cause = f"{VENDOR} is not installed: systemd finds no file of that name"
        command = command_on_robot(snapshot, f"systemctl list-unit-files 'mirte*'; ls -l /etc/systemd/system/{VENDOR}")
    elif unit.load == "masked":
        cause, command = f"{VENDOR} is masked: systemd cannot start it", f"sudo systemctl unmask {VENDOR}"
        command = command_on_robot(snapshot, f"{command}; sudo systemctl start {VENDOR}")
    elif unit.load in UNUSABLE and not unit.running:
        cause = f"systemd cannot use {unit.path or VENDOR} ({unit.load}): it has an unknown or wrong setting"
        command = command_on_robot(snapshot, f"systemd-analyze verify {VENDOR}; systemctl cat {VENDOR}")
    elif broken and (starting := _starting(units, unit)):
        cause, command = f"{VENDOR} {starting}", command_on_robot(snapshot, f"systemctl status {VENDOR}; systemctl list-jobs")
    elif unit.running and not _is_restarting(unit):
        return
    else:
        cause, command = f"{VENDOR} is {unit.active} ({unit.sub}, {unit.result})", "lupin play heal"
        playbook = None
    yield make_finding(
        "vendor-service-down",
        where="robot",
        cause=cause,
        evidence=unit_evidence(snapshot, unit) if unit is not None else (f"{VENDOR}: LoadState=not-found",),
        command=command,
        playbook=playbook,
        explains=NEED_VENDOR,
    )


def _starting(units: Units, unit: Unit) -> str:
    """Return for how long a unit has been starting; empty if it is not starting, or nothing is missed because of it yet."""
    if unit.active != "activating" or _is_restarting(unit):
        return ""
    duration_s = units.uptime_s - unit.started_s if units.uptime_s is not None and unit.started_s else None
    # Other units have no nodes whose data the laptop must receive.
    if unit.name not in (VENDOR, ONBOARD) and duration_s is not None and duration_s < START_S:
        return ""
    since = f" for {duration_s:.0f} s" if duration_s is not None else ""
    return f"has been starting{since} and is not ready ({unit.sub})"


def find_frozen_units(snapshot: Snapshot) -> Iterator[Finding]:
    """A unit is frozen: its processes exist and do not run."""
    units = snapshot.robot_fact(UNIT_STATES)
    for unit in units.units if units is not None else ():
        if unit.frozen and unit.name in (VENDOR, ONBOARD, CAMERAS):
            yield make_finding(
                "unit-frozen",
                where="robot",
                cause=f"{unit.name} is frozen: its processes exist, and none of them runs",
                evidence=(unit.line(), f"{unit.name}: FreezerState=frozen"),
                command=command_on_robot(snapshot, f"sudo systemctl thaw {unit.name}"),
                explains=OVER_GRAPH | {"board-wedged", "bus-locked", "estop-engaged", "unit-restarting", "zombie-process"},
                about=unit.name,
                breaks=lost_with(unit.name),
            )


def find_restricted_units(snapshot: Snapshot) -> Iterator[Finding]:
    """A setting of a unit keeps its processes from the network, while the machine itself reaches it."""
    units, near = snapshot.robot_fact(UNIT_STATES), laptop_addresses_near_robot(snapshot)
    for unit in units.units if units is not None else ():
        limits = [limit for limit in unit.network_limits if not any(admits(limit, each.address) for each in near)]
        if limits and unit.name in (VENDOR, ONBOARD, CAMERAS):
            files = " ".join(file for file in (unit.path, *unit.drop_ins) if file)
            yield make_finding(
                "unit-without-network",
                where="robot",
                cause=f"{unit.name} may not use the network: {'; '.join(limits)}",
                evidence=(*limits, *(f"set by one of: {file}" for file in files.split())),
                command=command_on_robot(snapshot, f"grep -nE 'IPAddress|PrivateNetwork|AddressFamilies' {files}"),
                explains=OVER_GRAPH | {"udp-lost", *(f"{id}:{unit.name}" for id in UNIT_DOWN)},
                about=unit.name,
                breaks=lost_with(unit.name),
            )


def lost_with(unit: str) -> tuple[str, ...]:
    """Return the parts whose data is lost if a unit does not work."""
    return {VENDOR: (EVERYTHING,), ONBOARD: (LUPIN, DRIVE)}.get(unit, ())


def find_unit_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """A unit of Lupin is missing, masked, disabled, failed or stopped; only its most serious fault is reported."""
    units, versions = snapshot.robot_fact(UNIT_STATES), snapshot.robot_fact(VERSIONS)
    if units is None or not units.systemd:
        return
    release = versions.release if versions is not None else None
    for name in NEEDED_AT_BOOT:
        unit = units.get(name)
        if unit is not None and unit.enabled == "disabled" and unit.running:
            yield _disabled_unit(snapshot, unit)
    for name, row in LUPIN_UNITS.items():
        unit = units.get(name)
        if unit is not None:
            yield from _unit_faults(snapshot, units, unit)
        elif row.in_release and release is not None and release.current and (name != CAMERAS or release.cameras):
            yield make_finding(
                "unit-missing",
                where="robot",
                symptom=row.missing_symptom,
                cause=f"a release is deployed, but {name} is not installed",
                evidence=(f"{name}: LoadState=not-found",),
                command="lupin deploy robot",
                breaks=(LUPIN, DRIVE) if name == ONBOARD else (),
            )


def _unit_faults(snapshot: Snapshot, units: Units, unit: Unit) -> Iterator[Finding]:
    name = unit.name
    broken = ground_truth.measure(snapshot).state is ground_truth.State.BROKEN
    if unit.enabled in MASKED or unit.load == "masked":
        cause, command = f"{name} is masked: systemd cannot start it", f"sudo systemctl unmask {name}"
        yield _unit_not_enabled(snapshot, unit, cause, unit_evidence(snapshot, unit), command)
    elif unit.load in UNUSABLE and not unit.running:
        cause = f"systemd cannot use {unit.path or name} ({unit.load}): it has an unknown or wrong setting"
        yield _unit_down(
            snapshot, "unit-failed", unit, cause, f"systemd-analyze verify {name}; systemctl cat {name}", playbook=""
        )
    elif unit.type == "oneshot":
        if unit.active == "failed":
            yield _failed_oneshot(snapshot, unit)
    elif unit.active == "failed" and _reached_start_limit(snapshot, unit):
        cause = f"{name} failed too often in a row, and systemd will not start it again"
        yield _unit_down(
            snapshot, "unit-start-limit", unit, cause, f"sudo systemctl reset-failed {name} && sudo systemctl start {name}"
        )
    elif unit.active == "failed":
        cause = f"{name} failed: {unit.result}, exit status {unit.exit_status}"
        yield _unit_down(snapshot, "unit-failed", unit, cause, f"sudo systemctl restart {name}")
    elif _is_restarting(unit):
        cause = f"{name} fails and is restarted" + (f", {unit.restarts} times so far" if unit.restarts else "")
        yield _unit_down(snapshot, "unit-restarting", unit, cause, f"sudo journalctl --no-pager -b -u {name} -n 50")
    elif broken and (starting := _starting(units, unit)):
        command = f"systemctl status {name}; systemctl list-jobs"
        yield _unit_down(snapshot, "unit-starting", unit, f"{name} {starting}", command, playbook="")
    elif broken and unit.active == "deactivating":
        command = f"systemctl status {name}; systemctl list-jobs"
        yield _unit_down(snapshot, "unit-not-running", unit, f"{name} is being stopped ({unit.sub})", command, playbook="")
    elif unit.active == "inactive":
        yield _unit_down(
            snapshot, "unit-not-running", unit, f"{name} is installed but not running", f"sudo systemctl start {name}"
        )
    if unit.enabled == "disabled" and unit.active != "failed" and not _is_restarting(unit):
        yield _disabled_unit(snapshot, unit)


def _disabled_unit(snapshot: Snapshot, unit: Unit) -> Finding:
    cause, command = f"{unit.name} will not start at the next boot", f"sudo systemctl enable {unit.name}"
    return _unit_not_enabled(snapshot, unit, cause, (unit.line(),), command)


def _failed_oneshot(snapshot: Snapshot, unit: Unit) -> Finding:
    last = "systemd gave up after repeated tries" if _reached_start_limit(snapshot, unit) else "its last try failed"
    status = f"{unit.result}, exit status {unit.exit_status}"
    cause = f"{unit.name} failed ({status}): {last}, and nothing retries it before the next boot"
    if unit.name == AUTO_HOME:
        return make_finding(
            "oneshot-failed",
            where="robot",
            cause=cause,
            evidence=unit_evidence(snapshot, unit),
            command="lupin play heal",  # it moves the arm, so `--fix` asks first
            explains={"controllers-not-active"},
            about=unit.name,
        )
    return make_finding(
        "oneshot-failed",
        severity=_severity(unit),
        where="robot",
        symptom="the clock was not set before the stack started",
        cause=cause,
        evidence=unit_evidence(snapshot, unit),
        command=command_on_robot(snapshot, f"sudo systemctl reset-failed {unit.name}"),
        playbook="",
        about=unit.name,
    )


def _unit_not_enabled(snapshot: Snapshot, unit: Unit, cause: str, evidence: tuple[str, ...], command: str) -> Finding:
    return make_finding(
        "unit-not-enabled",
        where="robot",
        symptom=f"{NEEDED_AT_BOOT.get(unit.name) or LUPIN_UNITS[unit.name].symptom}, after the next boot",
        cause=cause,
        evidence=evidence,
        command=command_on_robot(snapshot, command),
        about=unit.name,
        breaks=(LUPIN, DRIVE) if unit.name == ONBOARD and not unit.running else (),
    )


def _unit_down(snapshot: Snapshot, id: str, unit: Unit, cause: str, command: str, playbook: str | None = None) -> Finding:
    """Return the finding for a unit that does not run, or keeps restarting."""
    onboard = unit.name == ONBOARD
    instruction = "mend what the last lines of its journal name" if id == "unit-restarting" else ""
    # start-onboard starts drive bus and e-stop without the arm: nothing moves, so `--fix` need not ask.
    by_playbook = onboard and id != "unit-restarting" and playbook is None
    return make_finding(
        id,
        severity=_severity(unit),
        where="robot",
        symptom=LUPIN_UNITS[unit.name].symptom,
        cause=cause,
        evidence=unit_evidence(snapshot, unit),
        instruction=instruction,
        command="lupin play start-onboard" if by_playbook else command_on_robot(snapshot, command),
        playbook=None if by_playbook else "",
        # Without the onboard unit, no node publishes that the stop is released.
        explains={"bus-locked"} if onboard else (),
        about=unit.name,
        breaks=(LUPIN, DRIVE) if onboard else (),
    )


def _severity(unit: Unit) -> Severity:
    return Severity.WARNING if LUPIN_UNITS[unit.name].optional else Severity.PROBLEM


def _reached_start_limit(snapshot: Snapshot, unit: Unit) -> bool:
    """Return whether systemd's start limit was hit. After automatic restarts, Result is that of the last run instead."""
    journal = snapshot.robot_fact(SYSTEM_JOURNAL)
    lines = [line.text for line in (journal.units if journal else ()) if line.text.startswith(f"{unit.name}:")]
    return unit.result == "start-limit-hit" or any("repeated too quickly" in text for text in lines)


def _is_restarting(unit: Unit) -> bool:
    return unit.sub == "auto-restart" or (unit.active == "activating" and unit.restarts >= MANY_RESTARTS)


def find_uncoupled_restarts(snapshot: Snapshot) -> Iterator[Finding]:
    """A unit of Lupin did not restart with the vendor's service, and still uses the old controllers and discovery server."""
    units = snapshot.robot_fact(UNIT_STATES)
    vendor = units.get(VENDOR) if units else None
    if units is None or vendor is None or vendor.active != "active":
        return
    for name in (ONBOARD, CAMERAS):
        unit = units.get(name)
        if unit is None or unit.active != "active" or unit.active_since_s >= vendor.started_s:
            continue
        uncoupled = VENDOR not in unit.part_of
        yield make_finding(
            "unit-outlived-vendor",
            where="robot",
            cause=f"{name} did not restart with {VENDOR}" + (f": it has no PartOf={VENDOR}" if uncoupled else ""),
            evidence=(
                f"{name}: active since {unit.active_since_s:.1f} s after boot, PartOf={' '.join(unit.part_of) or '-'}",
                f"{VENDOR}: started {vendor.started_s:.1f} s after boot",
            ),
            command="lupin deploy robot" if uncoupled else command_on_robot(snapshot, f"sudo systemctl restart {name}"),
            playbook=None if uncoupled else "",
        )


def find_unread_unit_files(snapshot: Snapshot) -> Iterator[Finding]:
    """A unit file changed on disk after systemd read it."""
    units = snapshot.robot_fact(UNIT_STATES)
    stale = [
        unit
        for unit in (units.units if units else ())
        if unit.needs_reload and unit.name in (*LUPIN_UNITS, VENDOR)
        # systemd compares a masked unit with the drop-ins that it had before, whatever is reloaded.
        if not (unit.load == "masked" and unit.enabled in MASKED)
    ]
    if stale:
        yield make_finding(
            "units-need-reload",
            where="robot",
            cause=f"systemd uses an older version of {_join_names(stale)} than the one on disk",
            evidence=(f"{unit.name}: NeedDaemonReload=yes FragmentPath={unit.path}" for unit in stale),
            command=command_on_robot(snapshot, "sudo systemctl daemon-reload"),
        )


def _join_names(units: Iterable[Unit]) -> str:
    return ", ".join(unit.name for unit in units)


CHECKS = (
    Check("units.frozen", find_frozen_units, robot=(UNIT_STATES,)),
    Check("units.network", find_restricted_units, laptop=(ADDRESSES,), robot=(UNIT_STATES,)),
    Check("units.vendor", find_vendor_down, robot=(UNIT_STATES, SYSTEM_JOURNAL)),
    Check("units.lupin", find_unit_faults, robot=(UNIT_STATES, SYSTEM_JOURNAL, VERSIONS)),
    Check("units.together", find_uncoupled_restarts, robot=(UNIT_STATES,)),
    Check("units.reload", find_unread_unit_files, robot=(UNIT_STATES,)),
)
