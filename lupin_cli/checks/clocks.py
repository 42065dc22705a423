"""The robot's clock compared with the laptop's, and the time daemons that keep them together.

The robot has no hardware clock: it boots with the time of its last shutdown. A clock step under a running ros2_control stack
kills the controllers and leaves shared memory behind that no restart clears, so the fix for drift depends on what runs.
"""

from __future__ import annotations

from collections.abc import Iterator
from ipaddress import IPv4Interface
from typing import Any, TypedDict

from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.path_fixes import laptop_addresses_near_robot
from lupin_cli.checks.remote_command import FixText, command_on_robot, robot_option
from lupin_cli.checks.robot_address import robot_address
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.chrony import CHRONY, Chrony
from lupin_cli.facts.clock import CLOCK, Offset, offset
from lupin_cli.facts.kernel_clock import KERNEL_CLOCK
from lupin_cli.facts.routes import ROUTES
from lupin_cli.facts.units import UNIT_STATES, VENDOR
from lupin_cli.link.laptop_clock import (
    DRIFT_LIMIT_S,
    SLEWING_S,
    ClockEvidence,
    doubt_laptop,
    remedy_command,
    time_source_lines,
)
from lupin_cli.plausible_time import SET_CLOCK, SET_CLOCK_BY_HAND, clock_fault
from lupin_cli.systemd.units import CLOCK_SYNC

STEP_LIMIT_S = 3.0  # below this, restarting the stack costs more than a step gains: chrony slews the clock within a minute
ASK_SOURCE = "sudo chronyc burst 4/4; sleep 10; "  # chrony then slews by up to a tenth of the time that passes


class ServeClock(TypedDict):
    """The command that lets the laptop serve its time, and the variables of its playbook."""

    command: str
    variables: dict[str, str]


class InstallSync(TypedDict):
    """The playbook that lets the robot take the laptop's time, and its variables; empty if only a person can do it."""

    playbook: str
    variables: dict[str, Any]


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


def laptop_clock_fault(snapshot: Snapshot) -> str:
    """Return why this machine's clock is certainly wrong; empty if it may be right, or is not known."""
    if snapshot.robot is None:
        return ""
    clock, drift = snapshot.robot.get(CLOCK), measured_offset(snapshot)
    if snapshot.robot.probed_ns is not None:
        return clock_fault(snapshot.robot.probed_ns[0] / 1e9)
    return clock_fault(clock.epoch_ns / 1e9 - drift.offset_s) if clock is not None and drift is not None else ""


def find_clock_drift(snapshot: Snapshot) -> Iterator[Finding]:
    """The clocks certainly differ: the offset minus its uncertainty exceeds the limit. The laptop's may be the wrong one."""
    drift = measured_offset(snapshot)
    if drift is None or drift.at_least_s <= DRIFT_LIMIT_S or snapshot.robot is None:
        return
    if fault := laptop_clock_fault(snapshot):
        yield make_finding(
            "clock-drift",
            where="laptop",
            cause=f"{fault}; the robot's is {drift} relative to it",
            evidence=(f"robot's clock minus the laptop's: {drift}", *time_source_lines(snapshot.laptop.get(CHRONY))),
            command=SET_CLOCK,
            instruction=SET_CLOCK_BY_HAND,
            playbook="",  # the robot's clock must not be set from this one
        )
        return
    laptop, chrony = snapshot.laptop.get(CHRONY), snapshot.robot.get(CHRONY)
    kernel, addresses = snapshot.laptop.get(KERNEL_CLOCK), snapshot.laptop.get(ADDRESSES)
    doubt = doubt_laptop(ClockEvidence(drift, laptop, kernel, addresses, chrony))
    if doubt is not None and doubt.blames_laptop:
        yield make_finding(
            "clock-drift",
            where="laptop",
            cause=f"this machine's clock is wrong, and the robot's is {drift} relative to it",
            evidence=(f"robot's clock minus the laptop's: {drift}", *doubt.lines),
            command=remedy_command(laptop),
            playbook="",  # the robot's clock must not be set from this one
        )
        return
    units = snapshot.robot.get(UNIT_STATES)
    vendor = units.get(VENDOR) if units else None
    stack_runs = vendor is not None and vendor.running
    clock, probed_ns = snapshot.robot.get(CLOCK), snapshot.robot.probed_ns
    lines = []
    if clock is not None and probed_ns is not None:
        lines.append(f"robot: date +%s%N printed {clock.before_ns} .. {clock.after_ns}")
        lines.append(f"laptop: asked at {probed_ns[0]}, answered by {probed_ns[1]}")
    lines += time_source_lines(chrony)
    cause = f"the robot's clock is {drift} relative to the laptop's"
    evidence = (f"robot's clock minus the laptop's: {drift}", *lines, *((vendor.line(),) if vendor else ()))
    if doubt is not None and not doubt.is_certain:
        yield make_finding(
            "clock-drift",
            where="robot",
            cause=f"{cause}, and either may be the wrong one: {doubt.reason}",
            evidence=(*evidence, *doubt.lines),
            command=f"lupin sync-clock --trust-laptop{robot_option(snapshot)}",
            instruction=f"type it only if this machine's time is right; otherwise set this machine's: {remedy_command(laptop)}",
            playbook="",  # only a person can tell
        )
    elif drift.at_least_s > STEP_LIMIT_S:
        yield make_finding(
            "clock-drift",
            where="robot",
            cause=cause + ("; its stack runs, so the clock must not be stepped without stopping it" if stack_runs else ""),
            evidence=evidence,
            command="lupin sync-clock",
            safe=not stack_runs,
        )
    elif stack_runs and chrony is not None and chrony.running and any(source.state == "*" for source in chrony.sources):
        knows = chrony.tracking is not None and abs(chrony.tracking.offset_s) > SLEWING_S
        yield make_finding(
            "clock-drift",
            where="robot",
            cause=f"{cause}; chrony {'knows, and slews the clock' if knows else 'has not asked its source since'}",
            evidence=evidence,
            command=command_on_robot(snapshot, f"{'' if knows else ASK_SOURCE}chronyc waitsync 60 0.1"),
            playbook="",
        )
    elif stack_runs and _is_running(chrony):
        yield make_finding(
            "clock-drift",
            where="robot",
            cause=f"{cause}; its stack runs, so chrony must slew the clock",
            evidence=evidence,
            command=f"lupin sync-clock --install{robot_option(snapshot)}",
            **_install(snapshot),
        )
    else:
        yield make_finding(
            "clock-drift",
            where="robot",
            cause=cause,
            evidence=evidence,
            command=f"lupin play sync-clock{robot_option(snapshot)} -v tolerance_s={DRIFT_LIMIT_S:g}",
            variables={"tolerance_s": DRIFT_LIMIT_S},
            safe=not stack_runs,
        )


def _is_running(chrony: Chrony | None) -> bool:
    return chrony is not None and chrony.running


def find_stock_makestep(snapshot: Snapshot) -> Iterator[Finding]:
    """chrony may step the clock of a running stack: Ubuntu's stock `makestep 1 3` is still configured."""
    chrony = snapshot.robot_fact(CHRONY)
    if chrony is None or not chrony.steps:
        return
    yield make_finding(
        "chrony-stock-makestep",
        where="robot",
        cause="chrony may step the clock while the stack runs: its configuration still has a makestep directive",
        evidence=chrony.steps,
        command="lupin sync-clock --install",
        **_install(snapshot, laptop_serves=False),  # whether the laptop serves time is another finding
    )


def find_robot_chrony_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot's chrony is missing, is stopped, or has no source that answers."""
    chrony, units = snapshot.robot_fact(CHRONY), snapshot.robot_fact(UNIT_STATES)
    sync = units.get(CLOCK_SYNC) if units else None
    if chrony is None:
        return
    if chrony.others:
        yield _other_daemon(snapshot, chrony, sync is not None)
        return
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
        may_step = bool(chrony.steps)
        yield make_finding(
            "chrony-not-running",
            severity=Severity.WARNING if sync is None else Severity.PROBLEM,
            where="robot",
            cause="chrony is installed on the robot but does not run",
            evidence=("pidof chronyd: nothing", *((unit.line(),) if unit else ())),
            command="lupin sync-clock --install" if may_step else command_on_robot(snapshot, "sudo systemctl restart chrony"),
            explains={"chrony-sources-silent"},
            **(_install(snapshot) if may_step else InstallSync(playbook="", variables={})),
        )
    elif (sync is not None or _configured_sources(chrony)) and not any(source.reach for source in chrony.sources):
        yield make_finding(
            "chrony-sources-silent",
            where="robot",
            cause="none of chrony's sources has ever answered" if chrony.sources else "chrony has no source",
            evidence=tuple(source.raw for source in chrony.sources) or ("chronyc sources: none",),
            **_serve_clock(snapshot),
        )


def _install(snapshot: Snapshot, **variables: Any) -> InstallSync:
    """Return the playbook of `lupin sync-clock --install` with this laptop's address, or none if the address is not known."""
    near = next(iter(laptop_addresses_near_robot(snapshot)), None)
    if near is None:
        return InstallSync(playbook="", variables={})
    network = IPv4Interface(f"{near.address}/{near.prefix_length}").network
    return InstallSync(
        playbook="install-clock-sync", variables={"laptop_ip": near.address, "network": str(network), **variables}
    )


def _serve_clock(snapshot: Snapshot) -> ServeClock:
    """Return the command that lets the laptop serve time to the network of the route to this robot, and its variables."""
    routes, address = snapshot.laptop.get(ROUTES), robot_address(snapshot)
    route = routes.best(address) if routes is not None and address else None
    network = route.destination if route is not None and "/" in route.destination else f"{address}/32" if address else ""
    if not network:
        return ServeClock(command="lupin play serve-clock", variables={})
    return ServeClock(command=f"lupin play serve-clock -v network={network}", variables={"network": network})


def _configured_sources(chrony: Chrony) -> tuple[str, ...]:
    """Return the sources that chrony should have: those that it lists, or that its configuration names."""
    named = tuple(line for name in ("server", "pool", "peer") for line in chrony.directives(name))
    return tuple(source.raw for source in chrony.sources) or named


def _other_daemon(snapshot: Snapshot, chrony: Chrony, with_sync: bool) -> Finding:
    """Return the finding for another program than chrony that sets the robot's clock: it may step it under the stack."""
    others = " and ".join(chrony.others)
    services = " ".join("ntp.service" if each == "ntpd" else f"{each}.service" for each in chrony.others)
    stop = f"sudo systemctl disable --now {services}"
    if not chrony.installed:
        # Debian's package of chrony takes the place of the other daemon. Without it, the robot would have no time at all.
        fix = FixText(
            command=command_on_robot(snapshot, "sudo apt install chrony"),
            instruction="the robot needs internet for it; then run: lupin sync-clock --install",
        )
    elif chrony.steps and not chrony.running:
        # Merely starting chrony would step the clock under the running stack.
        fix = FixText(command=f"{command_on_robot(snapshot, stop)} && lupin sync-clock --install{robot_option(snapshot)}")
    else:
        fix = FixText(command=command_on_robot(snapshot, f"{stop} && sudo systemctl enable --now chrony.service"))
    beside = "beside chrony: both set the clock" if chrony.running else "instead of chrony"
    return make_finding(
        "other-time-daemon",
        severity=Severity.PROBLEM if chrony.running or with_sync else Severity.WARNING,
        where="robot",
        cause=f"{others} runs on the robot {beside}, and steps the clock while the stack runs",
        evidence=(
            *(f"pidof {each}: running" for each in chrony.others),
            f"chronyd: {'runs' if chrony.running else 'does not run'}",
        ),
        **fix,
        explains={"chrony-not-running", "chrony-sources-silent", "unit-not-enabled:chrony.service"},
    )


def find_laptop_not_serving(snapshot: Snapshot) -> Iterator[Finding]:
    """The laptop serves no time, although the robot is set up to take its time from the laptop."""
    chrony, units = snapshot.laptop.get(CHRONY), snapshot.robot_fact(UNIT_STATES)
    address = robot_address(snapshot)
    # It listens, so something admits a network; without an `allow` in the files that were read, that is not known.
    is_known = chrony is not None and chrony.serves and bool(chrony.directives("allow")) and bool(address)
    refused = chrony is not None and is_known and not chrony.allows(address)
    if chrony is None or (chrony.serves and not refused) or not units or units.get(CLOCK_SYNC) is None:
        return
    robot_chrony = snapshot.robot_fact(CHRONY)
    if robot_chrony is not None and any(source.reach and source.state in "*+" for source in robot_chrony.sources):
        return  # the robot follows another source
    if not chrony.installed:
        cause, line = "chrony is not installed on the laptop", "command -v chronyd: nothing"
    elif not chrony.running:
        cause, line = "chrony is installed on the laptop but does not run", "pidof chronyd: nothing"
    elif refused:
        cause, line = (
            f"chrony on the laptop does not allow {address}, the robot's address",
            f"chronyc: {address} is not allowed",
        )
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
        **_serve_clock(snapshot),
        explains={"chrony-sources-silent"},
    )


CHECKS = (
    Check("clock.drift", find_clock_drift, laptop=(CHRONY, ADDRESSES, KERNEL_CLOCK), robot=(CLOCK, UNIT_STATES, CHRONY)),
    Check("clock.makestep", find_stock_makestep, laptop=(ADDRESSES,), robot=(CHRONY,)),
    Check("clock.robot", find_robot_chrony_faults, laptop=(ADDRESSES, ROUTES), robot=(CHRONY, UNIT_STATES)),
    Check("clock.laptop", find_laptop_not_serving, laptop=(CHRONY, ROUTES), robot=(CHRONY, UNIT_STATES)),
)
