"""The robot's clock against this machine's, and whether anything keeps them together.

The robot has no hardware clock: it boots with the time of its last shutdown. A step under a live ros2_control stack kills the
controllers and leaves shared memory behind that no restart clears, so the cure for drift depends on what runs.
"""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.typed import on_robot
from lupin_cli.facts.chrony import CHRONY
from lupin_cli.facts.clock import CLOCK, Offset, offset
from lupin_cli.facts.units import CLOCK_SYNC, UNIT_STATES, VENDOR

DRIFT_LIMIT_S = 3.0  # below this a restart of the stack costs more than it mends


def measured(evidence: Evidence) -> Offset | None:
    """The robot's clock against this machine's, or None where it could not be asked."""
    if evidence.robot is None:
        return None
    exchanged: Offset | None = getattr(evidence.link, "clock", None)
    clock = evidence.robot.get(CLOCK)
    if exchanged is not None or clock is None or evidence.robot.asked_ns is None:
        return exchanged
    return offset(clock, evidence.robot.asked_ns)


def drift(evidence: Evidence) -> Iterator[Finding]:
    """A clock that is off for certain: the offset less its uncertainty is beyond the limit."""
    found = measured(evidence)
    if found is None or found.at_least_s <= DRIFT_LIMIT_S or evidence.robot is None:
        return
    units = evidence.robot.get(UNIT_STATES)
    vendor = units.get(VENDOR) if units else None
    live = vendor is not None and vendor.running
    clock, asked_ns = evidence.robot.get(CLOCK), evidence.robot.asked_ns
    lines = []
    if clock is not None and asked_ns is not None:
        lines.append(f"robot: date +%s%N said {clock.before_ns} .. {clock.after_ns}")
        lines.append(f"laptop: asked at {asked_ns[0]}, answered by {asked_ns[1]}")
    yield Finding(
        id="clock-drift",
        severity=Severity.PROBLEM,
        where="robot",
        symptom="the map stops (Message Filter dropping message); transforms are too old, or from the future",
        cause=f"the robot's clock is {found} against this machine's"
        + ("; its stack is up, so the clock must not be stepped as it is" if live else ""),
        evidence=(
            f"robot's clock less this machine's: {found}",
            *lines,
            *((vendor.line(),) if vendor else ()),
        ),
        fix=Fix("lupin sync-clock", playbook="sync-clock", safe=not live),
    )


def stock_makestep(evidence: Evidence) -> Iterator[Finding]:
    """Ubuntu's `makestep 1 3` steps the clock of a live stack at the first far-off source that answers."""
    chrony = evidence.robot.get(CHRONY) if evidence.robot else None
    if chrony is None or not chrony.directives("makestep"):
        return
    yield Finding(
        id="chrony-stock-makestep",
        severity=Severity.WARNING,
        where="robot",
        symptom="controllers die without a cause minutes after boot, as soon as a time source comes into reach",
        cause="chrony may step the clock while the stack runs: its configuration still has a makestep directive",
        evidence=chrony.directives("makestep"),
        # The laptop's half of that is another finding's.
        fix=Fix("lupin sync-clock --install", playbook="install-clock-sync", variables={"laptop_serves": False}, safe=True),
    )


def robots_chrony(evidence: Evidence) -> Iterator[Finding]:
    """chrony of the robot: there, running, and with a source that answers."""
    if evidence.robot is None:
        return
    chrony, units = evidence.robot.get(CHRONY), evidence.robot.get(UNIT_STATES)
    sync = units.get(CLOCK_SYNC) if units else None
    if chrony is None or chrony.others:
        return  # another program looks after the clock
    wanted = sync is not None
    install = Fix("lupin sync-clock --install", playbook="install-clock-sync")
    if not chrony.installed:
        if wanted:
            yield Finding(
                id="chrony-missing",
                severity=Severity.PROBLEM,
                where="robot",
                symptom="the clock is as wrong after every boot as it was at the last shutdown",
                cause=f"{CLOCK_SYNC} is installed and chrony, which it gives its orders to, is not",
                evidence=("command -v chronyd: nothing", sync.line() if sync else ""),
                fix=Fix(on_robot(evidence, "sudo apt install chrony")),
            )
    elif not chrony.running:
        unit = units.get("chrony.service") if units else None
        yield Finding(
            id="chrony-not-running",
            severity=Severity.PROBLEM if wanted else Severity.WARNING,
            where="robot",
            symptom="the clock drifts by seconds a day, and by hours after a power-off: there is no hardware clock",
            cause="chrony is installed on the robot and doesn't run",
            evidence=("pidof chronyd: nothing", *((unit.line(),) if unit else ())),
            # A chrony that may step would do so under the live stack as soon as it runs.
            fix=install if chrony.directives("makestep") else Fix(on_robot(evidence, "sudo systemctl restart chrony")),
            explains=frozenset({"chrony-sources-silent"}),
        )
    elif wanted and not any(source.reach for source in chrony.sources):
        yield Finding(
            id="chrony-sources-silent",
            severity=Severity.WARNING,
            where="robot",
            symptom="the robot's clock follows nobody",
            cause="none of chrony's sources has ever answered" if chrony.sources else "chrony knows no source",
            evidence=tuple(source.raw for source in chrony.sources) or ("chronyc sources: none",),
            fix=Fix("lupin play serve-clock", playbook="serve-clock"),
        )


def laptop_serves(evidence: Evidence) -> Iterator[Finding]:
    """chrony installed is not chrony serving: the robot takes its time from this machine."""
    if evidence.robot is None:
        return
    chrony, robots, units = evidence.laptop.get(CHRONY), evidence.robot.get(CHRONY), evidence.robot.get(UNIT_STATES)
    if chrony is None or chrony.serves or not units or units.get(CLOCK_SYNC) is None:
        return
    if robots is not None and any(source.reach and source.state in "*+" for source in robots.sources):
        return  # it has the time from elsewhere
    if not chrony.installed:
        cause, line = "chrony isn't installed here", "command -v chronyd: nothing"
    elif not chrony.running:
        cause, line = "chrony is installed here and doesn't run", "pidof chronyd: nothing"
    else:
        cause, line = "chrony runs here and serves nobody: nothing listens on port 123", "ss -lnu: no listener on :123"
    yield Finding(
        id="chrony-not-serving",
        severity=Severity.WARNING,
        where="laptop",
        symptom="the robot's clock stays wrong after a boot, although its clock-sync unit is installed",
        cause=cause,
        evidence=(
            line,
            *(chrony.directives("allow") or ("no `allow` in chrony's configuration",)),
            *chrony.directives("local"),
        ),
        fix=Fix("lupin play serve-clock", playbook="serve-clock"),
        explains=frozenset({"chrony-sources-silent"}),
    )


CHECKS = (
    Check("clock.drift", drift, robot=(CLOCK, UNIT_STATES)),
    Check("clock.makestep", stock_makestep, robot=(CHRONY,)),
    Check("clock.robot", robots_chrony, robot=(CHRONY, UNIT_STATES)),
    Check("clock.laptop", laptop_serves, laptop=(CHRONY,), robot=(CHRONY, UNIT_STATES)),
)
