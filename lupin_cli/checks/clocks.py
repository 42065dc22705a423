"""The robot's clock compared with the laptop's, and the time daemons that keep them together.

The robot has no hardware clock: it boots with the time of its last shutdown. A clock step under a running ros2_control stack
kills the controllers and leaves shared memory behind that no restart clears, so the fix for drift depends on what runs.
"""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.remote_command import command_on_robot
from lupin_cli.facts.chrony import CHRONY
from lupin_cli.facts.clock import CLOCK, Offset, offset
from lupin_cli.facts.units import UNIT_STATES, VENDOR
from lupin_cli.systemd.units import CLOCK_SYNC

DRIFT_LIMIT_S = 3.0  # below this, restarting the stack costs more than the correction gains


def measured_offset(snapshot: Snapshot) -> Offset | None:
    """Return the offset of the robot's clock from the laptop's; None if it was not measured.

    The exchange over the link is more precise than the times of the batch, and is preferred.
    """
    if snapshot.robot is None:
        return None
    exchanged = snapshot.link.clock if snapshot.link else None
    clock = snapshot.robot.get(CLOCK)
    if exchanged is not None or clock is None or snapshot.robot.probed_ns is None:
        return exchanged
    return offset(clock, snapshot.robot.probed_ns)


def find_clock_drift(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot's clock is certainly wrong: the offset minus its uncertainty exceeds the limit."""
    drift = measured_offset(snapshot)
    if drift is None or drift.at_least_s <= DRIFT_LIMIT_S or snapshot.robot is None:
        return
    units = snapshot.robot.get(UNIT_STATES)
    vendor = units.get(VENDOR) if units else None
    stack_runs = vendor is not None and vendor.running
    clock, probed_ns = snapshot.robot.get(CLOCK), snapshot.robot.probed_ns
    lines = []
    if clock is not None and probed_ns is not None:
        lines.append(f"robot: date +%s%N printed {clock.before_ns} .. {clock.after_ns}")
        lines.append(f"laptop: asked at {probed_ns[0]}, answered by {probed_ns[1]}")
    yield make_finding(
        "clock-drift",
        where="robot",
        cause=f"the robot's clock is {drift} relative to the laptop's"
        + ("; its stack runs, so the clock must not be stepped without stopping it" if stack_runs else ""),
        evidence=(f"robot's clock minus the laptop's: {drift}", *lines, *((vendor.line(),) if vendor else ())),
        command="lupin sync-clock",
        safe=not stack_runs,
    )


def find_stock_makestep(snapshot: Snapshot) -> Iterator[Finding]:
    """chrony may step the clock of a running stack: Ubuntu's stock `makestep 1 3` is still configured."""
    chrony = snapshot.robot_fact(CHRONY)
    if chrony is None or not chrony.directives("makestep"):
        return
    yield make_finding(
        "chrony-stock-makestep",
        where="robot",
        cause="chrony may step the clock while the stack runs: its configuration still has a makestep directive",
        evidence=chrony.directives("makestep"),
        command="lupin sync-clock --install",
        variables={"laptop_serves": False},  # whether the laptop serves time is another finding
    )


def find_robot_chrony_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot's chrony is missing, is stopped, or has no source that answers."""
    chrony, units = snapshot.robot_fact(CHRONY), snapshot.robot_fact(UNIT_STATES)
    sync = units.get(CLOCK_SYNC) if units else None
    if chrony is None or chrony.others:
        return  # another time daemon runs
    if not chrony.installed:
        if sync is not None:
            yield make_finding(
                "chrony-missing",
                where="robot",
                cause=f"{CLOCK_SYNC} is installed, but chrony, which it controls, is not",
                evidence=("command -v chronyd: nothing", sync.line()),
                command=command_on_robot(snapshot, "sudo apt install chrony"),
            )
    elif not chrony.running:
        unit = units.get("chrony.service") if units else None
        # With makestep configured, merely starting chrony would step the clock under the running stack.
        may_step = bool(chrony.directives("makestep"))
        yield make_finding(
            "chrony-not-running",
            severity=Severity.WARNING if sync is None else Severity.PROBLEM,
            where="robot",
            cause="chrony is installed on the robot but does not run",
            evidence=("pidof chronyd: nothing", *((unit.line(),) if unit else ())),
            command="lupin sync-clock --install" if may_step else command_on_robot(snapshot, "sudo systemctl restart chrony"),
            playbook="install-clock-sync" if may_step else "",
            explains={"chrony-sources-silent"},
        )
    elif sync is not None and not any(source.reach for source in chrony.sources):
        yield make_finding(
            "chrony-sources-silent",
            where="robot",
            cause="none of chrony's sources has ever answered" if chrony.sources else "chrony has no source",
            evidence=tuple(source.raw for source in chrony.sources) or ("chronyc sources: none",),
            command="lupin play serve-clock",
        )


def find_laptop_not_serving(snapshot: Snapshot) -> Iterator[Finding]:
    """The laptop serves no time, although the robot is set up to take its time from the laptop."""
    chrony, units = snapshot.laptop.get(CHRONY), snapshot.robot_fact(UNIT_STATES)
    if chrony is None or chrony.serves or not units or units.get(CLOCK_SYNC) is None:
        return
    robot_chrony = snapshot.robot_fact(CHRONY)
    if robot_chrony is not None and any(source.reach and source.state in "*+" for source in robot_chrony.sources):
        return  # the robot follows another source
    if not chrony.installed:
        cause, line = "chrony is not installed on the laptop", "command -v chronyd: nothing"
    elif not chrony.running:
        cause, line = "chrony is installed on the laptop but does not run", "pidof chronyd: nothing"
    else:
        cause, line = (
            "chrony runs on the laptop but does not serve time: nothing listens on port 123",
            "ss -lnu: no listener on :123",
        )
    allowed = chrony.directives("allow") or ("no `allow` in chrony's configuration",)
    yield make_finding(
        "chrony-not-serving",
        where="laptop",
        cause=cause,
        evidence=(line, *allowed, *chrony.directives("local")),
        command="lupin play serve-clock",
        explains={"chrony-sources-silent"},
    )


CHECKS = (
    Check("clock.drift", find_clock_drift, robot=(CLOCK, UNIT_STATES)),
    Check("clock.makestep", find_stock_makestep, robot=(CHRONY,)),
    Check("clock.robot", find_robot_chrony_faults, robot=(CHRONY, UNIT_STATES)),
    Check("clock.laptop", find_laptop_not_serving, laptop=(CHRONY,), robot=(CHRONY, UNIT_STATES)),
)
