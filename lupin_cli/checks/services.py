"""systemd units of Lupin and of the vendor: whether they are installed, enabled, running, and restarted together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.findings import NEED_VENDOR, make_finding
from lupin_cli.checks.remote_command import command_on_robot
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.units import UNIT_STATES, VENDOR, Unit
from lupin_cli.facts.versions import VERSIONS
from lupin_cli.systemd.units import AUTO_HOME, CAMERAS, LUPIN_UNITS, ONBOARD

JOURNAL_LINES = 4
MANY_RESTARTS = 3  # a service that was restarted this often since boot will fail again


def _unit_evidence(snapshot: Snapshot, unit: Unit) -> tuple[str, ...]:
    """Return the unit's state and its last lines in the system journal."""
    journal = snapshot.robot_fact(SYSTEM_JOURNAL)
    name = unit.name.removesuffix(".service")
    lines = [line.raw for line in (journal.units if journal else ()) if name in line.raw]
    return unit.line(), *lines[-JOURNAL_LINES:]


def find_vendor_down(snapshot: Snapshot) -> Iterator[Finding]:
    """The vendor's service, which starts controllers, lidar and discovery server, does not run."""
    units = snapshot.robot_fact(UNIT_STATES)
    unit = units.get(VENDOR) if units else None
    if unit is None or (unit.running and not _is_restarting(unit)):
        return
    yield make_finding(
        "vendor-service-down",
        where="robot",
        cause=f"{VENDOR} is {unit.active} ({unit.sub}, {unit.result})",
        evidence=_unit_evidence(snapshot, unit),
        command="lupin play heal",
        explains=NEED_VENDOR,
    )


def find_unit_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """A unit of Lupin is missing, masked, disabled, failed or stopped; only its most serious fault is reported."""
    units, versions = snapshot.robot_fact(UNIT_STATES), snapshot.robot_fact(VERSIONS)
    if units is None or not units.systemd:
        return
    release = versions.release if versions is not None else None
    for name, row in LUPIN_UNITS.items():
        unit = units.get(name)
        if unit is not None:
            yield from _unit_faults(snapshot, unit)
        elif row.in_release and release is not None and release.current and (name != CAMERAS or release.cameras):
            yield make_finding(
                "unit-missing",
                where="robot",
                symptom=row.missing_symptom,
                cause=f"a release is deployed, but {name} is not installed",
                evidence=(f"{name}: LoadState=not-found",),
                command="lupin deploy robot",
            )


def _unit_faults(snapshot: Snapshot, unit: Unit) -> Iterator[Finding]:
    name = unit.name
    if unit.enabled in ("masked", "masked-runtime") or unit.load == "masked":
        cause, command = f"{name} is masked: systemd cannot start it", f"sudo systemctl unmask {name}"
        yield _unit_not_enabled(snapshot, unit, cause, _unit_evidence(snapshot, unit), command)
    elif unit.type == "oneshot":
        if unit.active == "failed":
            yield _failed_oneshot(snapshot, unit)
    elif unit.active == "failed" and _reached_start_limit(snapshot, unit):
        cause = f"{name} failed too often in a row, and systemd will not start it again"
        yield _unit_down(
            snapshot, "unit-start-limit", unit, cause, f"sudo systemctl reset-failed {name}; sudo systemctl start {name}"
        )
    elif unit.active == "failed":
        cause = f"{name} failed: {unit.result}, exit status {unit.exit_status}"
        yield _unit_down(snapshot, "unit-failed", unit, cause, f"sudo systemctl restart {name}")
    elif _is_restarting(unit):
        cause = f"{name} fails and is restarted, {unit.restarts} times so far"
        yield _unit_down(snapshot, "unit-restarting", unit, cause, f"sudo journalctl -b -u {name} -n 50")
    elif unit.active == "inactive":
        yield _unit_down(
            snapshot, "unit-not-running", unit, f"{name} is installed but not running", f"sudo systemctl start {name}"
        )
    if unit.enabled == "disabled" and unit.active != "failed" and not _is_restarting(unit):
        cause, command = f"{name} will not start at the next boot", f"sudo systemctl enable {name}"
        yield _unit_not_enabled(snapshot, unit, cause, (unit.line(),), command)


def _failed_oneshot(snapshot: Snapshot, unit: Unit) -> Finding:
    last = "systemd gave up after repeated tries" if _reached_start_limit(snapshot, unit) else "its last try failed"
    status = f"{unit.result}, exit status {unit.exit_status}"
    cause = f"{unit.name} failed ({status}): {last}, and nothing retries it before the next boot"
    if unit.name == AUTO_HOME:
        return make_finding(
            "oneshot-failed",
            where="robot",
            cause=cause,
            evidence=_unit_evidence(snapshot, unit),
            command="lupin play heal",  # it moves the arm, so `--fix` asks first
            explains={"controllers-not-active"},
        )
    return make_finding(
        "oneshot-failed",
        severity=_severity(unit),
        where="robot",
        symptom="the clock was not set before the stack started",
        cause=cause,
        evidence=_unit_evidence(snapshot, unit),
        command=command_on_robot(snapshot, f"sudo systemctl reset-failed {unit.name}"),
        playbook="",
    )


def _unit_not_enabled(snapshot: Snapshot, unit: Unit, cause: str, evidence: tuple[str, ...], command: str) -> Finding:
    return make_finding(
        "unit-not-enabled",
        where="robot",
        symptom=f"{LUPIN_UNITS[unit.name].symptom}, after the next boot",
        cause=cause,
        evidence=evidence,
        command=command_on_robot(snapshot, command),
    )


def _unit_down(snapshot: Snapshot, id: str, unit: Unit, cause: str, command: str) -> Finding:
    """Return the finding for a unit that does not run, or keeps restarting."""
    onboard = unit.name == ONBOARD
    # start-onboard starts drive bus and e-stop without the arm: nothing moves, so `--fix` need not ask.
    by_playbook = onboard and id != "unit-restarting"
    return make_finding(
        id,
        severity=_severity(unit),
        where="robot",
        symptom=LUPIN_UNITS[unit.name].symptom,
        cause=cause,
        evidence=_unit_evidence(snapshot, unit),
        command="lupin play start-onboard" if by_playbook else command_on_robot(snapshot, command),
        playbook=None if by_playbook else "",
        # Without the onboard unit, no node publishes that the stop is released.
        explains={"bus-locked"} if onboard else (),
        about=unit.name,
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
    stale = [unit for unit in (units.units if units else ()) if unit.needs_reload and unit.name in (*LUPIN_UNITS, VENDOR)]
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
    Check("units.vendor", find_vendor_down, robot=(UNIT_STATES, SYSTEM_JOURNAL)),
    Check("units.lupin", find_unit_faults, robot=(UNIT_STATES, SYSTEM_JOURNAL, VERSIONS)),
    Check("units.together", find_uncoupled_restarts, robot=(UNIT_STATES,)),
    Check("units.reload", find_unread_unit_files, robot=(UNIT_STATES,)),
)
