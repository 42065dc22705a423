"""systemd units of Lupin and of the vendor: there, enabled, running, and restarted together."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.typed import on_robot
from lupin_cli.facts.journal import JOURNAL
from lupin_cli.facts.units import AUTO_HOME, CAMERAS, CLOCK_SYNC, ONBOARD, OURS, UNIT_STATES, VENDOR, Unit
from lupin_cli.facts.versions import VERSIONS

JOURNAL_LINES = 4
# A service that came back so often in one boot comes back again.
MANY_RESTARTS = 3
HEAL = Fix("lupin play heal", playbook="heal")  # moves the arm: a person says so
# Drive bus and e-stop without the arm: nothing moves that was not asked to.
START_ONBOARD = Fix("lupin play start-onboard", playbook="start-onboard", safe=True)
DEPLOYED = (ONBOARD, AUTO_HOME)  # what a deployed robot has; cameras and clock sync are installed by choice


def _last_words(evidence: Evidence, unit: str) -> tuple[str, ...]:
    journal = evidence.robot.get(JOURNAL) if evidence.robot else None
    name = unit.removesuffix(".service")
    lines = [line for line in (journal.units if journal else ()) if name in line.raw]
    return tuple(line.raw for line in lines[-JOURNAL_LINES:])


def vendor(evidence: Evidence) -> Iterator[Finding]:
    """Without the vendor's service there are no controllers, no lidar and no discovery server."""
    units = evidence.robot.get(UNIT_STATES) if evidence.robot else None
    unit = units.get(VENDOR) if units else None
    if unit is None or (unit.running and not _looping(unit)):
        return
    yield Finding(
        id="vendor-service-down",
        severity=Severity.PROBLEM,
        where="robot",
        symptom="nothing of the robot answers: no controllers, no lidar, no battery",
        cause=f"{VENDOR} is {unit.active} ({unit.sub}, {unit.result})",
        evidence=(unit.line(), *_last_words(evidence, VENDOR)),
        fix=HEAL,
        explains=frozenset(
            {
                "unit-not-running", "unit-failed", "oneshot-failed", "unit-restarting", "controller-manager-missing",
                "controller-manager-silent", "controllers-not-active", "drive-sink-unheard", "board-wedged", "topic-silent",
                "discovery-server-missing",
            }
        ),
    )  # fmt: skip


def ours(evidence: Evidence) -> Iterator[Finding]:
    """Lupin's own units: what is wrong with each, the gravest thing only."""
    if evidence.robot is None:
        return
    units, versions = evidence.robot.get(UNIT_STATES), evidence.robot.get(VERSIONS)
    if units is None or not units.systemd:
        return
    deployed = versions is not None and versions.release is not None and bool(versions.release.current)
    for name in OURS:
        unit = units.get(name)
        if unit is None:
            if name in DEPLOYED and deployed:
                yield Finding(
                    id="unit-missing",
                    severity=Severity.PROBLEM,
                    where="robot",
                    symptom="manual drive, e-stop, arm and lights are gone after a boot"
                    if name == ONBOARD
                    else "the arm never homes",
                    cause=f"a release is deployed and {name} is not installed",
                    evidence=(f"{name}: LoadState=not-found",),
                    fix=Fix("lupin deploy robot", playbook="deploy-robot"),
                )
            continue
        yield from _of_unit(evidence, unit)


def _of_unit(evidence: Evidence, unit: Unit) -> Iterator[Finding]:
    name = unit.name
    words = (unit.line(), *_last_words(evidence, name))
    if unit.enabled in ("masked", "masked-runtime") or unit.load == "masked":
        yield _finding(
            "unit-not-enabled",
            unit,
            f"{name} is masked: nothing can start it",
            words,
            f"sudo systemctl unmask {name}",
            evidence,
        )
    elif unit.type == "oneshot":
        if unit.active == "failed":
            again = "systemd gave up after so many tries" if _gave_up(evidence, unit) else "its last try failed"
            cause = (
                f"{name} failed ({unit.result}, exit status {unit.exit_status}): {again}, and nothing tries again in this boot"
            )
            if name == AUTO_HOME:
                yield Finding(
                    id="oneshot-failed",
                    severity=Severity.PROBLEM,
                    where="robot",
                    symptom="controllers are stuck and the arm is not at home",
                    cause=cause,
                    evidence=words,
                    fix=HEAL,
                    explains=frozenset({"controllers-not-active"}),
                )
            else:
                command = f"sudo systemctl reset-failed {name}"
                yield _finding(
                    "oneshot-failed", unit, cause, words, command, evidence, "the clock was not set before the stack started"
                )
    elif unit.active == "failed" and _gave_up(evidence, unit):
        command = f"sudo systemctl reset-failed {name}; sudo systemctl start {name}"
        yield _finding(
            "unit-start-limit",
            unit,
            f"{name} failed too often in a row; systemd won't start it again",
            words,
            command,
            evidence,
        )
    elif unit.active == "failed":
        command = f"sudo systemctl restart {name}"
        yield _finding(
            "unit-failed", unit, f"{name} failed: {unit.result}, exit status {unit.exit_status}", words, command, evidence
        )
    elif _looping(unit):
        cause = f"{name} dies and is started again, {unit.restarts} times so far"
        yield _finding("unit-restarting", unit, cause, words, f"sudo journalctl -b -u {name} -n 50", evidence)
    elif unit.active == "inactive":
        cause = f"{name} is installed and not running"
        command = f"sudo systemctl start {name}"
        yield _finding("unit-not-running", unit, cause, words, command, evidence)
    if unit.enabled == "disabled" and unit.active != "failed" and not _looping(unit):
        command = f"sudo systemctl enable {name}"
        yield _finding("unit-not-enabled", unit, f"{name} will not start at the next boot", (unit.line(),), command, evidence)


def _gave_up(evidence: Evidence, unit: Unit) -> bool:
    """Whether the start limit was hit. Result keeps what the last run ended with where the restarts were systemd's own."""
    journal = evidence.robot.get(JOURNAL) if evidence.robot else None
    lines = [line.text for line in (journal.units if journal else ()) if line.text.startswith(f"{unit.name}:")]
    return unit.result == "start-limit-hit" or any("repeated too quickly" in text for text in lines)


def _looping(unit: Unit) -> bool:
    return unit.sub == "auto-restart" or (unit.active == "activating" and unit.restarts >= MANY_RESTARTS)


SYMPTOMS = {
    ONBOARD: "no drive bus, no e-stop, no arm presets, no lights",
    CAMERAS: "no camera pictures",
    AUTO_HOME: "controllers stay stuck after a boot and the arm never homes",
    CLOCK_SYNC: "the clock is wrong after a boot",
}


def _finding(
    id: str, unit: Unit, cause: str, words: tuple[str, ...], command: str, evidence: Evidence, symptom: str = ""
) -> Finding:
    later = id == "unit-not-enabled"
    down = id in ("unit-not-running", "unit-failed", "unit-start-limit")
    return Finding(
        id=id,
        severity=Severity.WARNING if later or unit.name == CLOCK_SYNC else Severity.PROBLEM,
        where="robot",
        symptom=symptom or SYMPTOMS[unit.name] + (", after the next boot" if later else ""),
        cause=cause,
        evidence=words,
        fix=START_ONBOARD if down and unit.name == ONBOARD else Fix(on_robot(evidence, command)),
        # Without the bus nobody publishes, and nobody says that the stop is released.
        explains=frozenset({"bus-locked"}) if unit.name == ONBOARD and not later else frozenset(),
    )


def together(evidence: Evidence) -> Iterator[Finding]:
    """What holds on to the vendor's old controllers and discovery server must restart with the vendor's service."""
    units = evidence.robot.get(UNIT_STATES) if evidence.robot else None
    vendors = units.get(VENDOR) if units else None
    if units is None or vendors is None or vendors.active != "active":
        return
    for name in (ONBOARD, CAMERAS):
        unit = units.get(name)
        if unit is None or unit.active != "active" or unit.active_since_s >= vendors.started_s:
            continue
        missing = VENDOR not in unit.part_of
        yield Finding(
            id="unit-outlived-vendor",
            severity=Severity.PROBLEM,
            where="robot",
            symptom="after a restart of the robot's stack, commands go nowhere while everything looks alive",
            cause=f"{name} did not restart with {VENDOR}" + (f": it has no PartOf={VENDOR}" if missing else ""),
            evidence=(
                f"{name}: active since {unit.active_since_s:.1f} s after boot, PartOf={' '.join(unit.part_of) or '-'}",
                f"{VENDOR}: started {vendors.started_s:.1f} s after boot",
            ),
            fix=Fix("lupin deploy robot", playbook="deploy-robot")
            if missing
            else Fix(on_robot(evidence, f"sudo systemctl restart {name}")),
        )


def reload(evidence: Evidence) -> Iterator[Finding]:
    """Unit files that changed on disk after systemd read them."""
    units = evidence.robot.get(UNIT_STATES) if evidence.robot else None
    stale = [unit for unit in (units.units if units else ()) if unit.needs_reload and unit.name in (*OURS, VENDOR)]
    if stale:
        yield Finding(
            id="units-need-reload",
            severity=Severity.WARNING,
            where="robot",
            symptom="a change to a unit has no effect",
            cause=f"systemd runs an older version of {', '.join(unit.name for unit in stale)} than lies on disk",
            evidence=tuple(f"{unit.name}: NeedDaemonReload=yes FragmentPath={unit.path}" for unit in stale),
            fix=Fix(on_robot(evidence, "sudo systemctl daemon-reload")),
        )


CHECKS = (
    Check("units.vendor", vendor, robot=(UNIT_STATES, JOURNAL)),
    Check("units.lupin", ours, robot=(UNIT_STATES, JOURNAL, VERSIONS)),
    Check("units.together", together, robot=(UNIT_STATES,)),
    Check("units.reload", reload, robot=(UNIT_STATES,)),
)
