"""`lupin sync-clock`: set the robot's clock, but only while its stack is stopped."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.connection.base import TargetError
from lupin_cli.connection.inventory import load
from lupin_cli.connection.options import (
    ASK_SUDO,
    BREAK_LEASE,
    CONFIG,
    ROBOT,
    ask_sudo_passwords,
    connect,
    one_after_another,
    reporting_errors,
    select_robots,
)
from lupin_cli.exit_codes import FAILURE, SUCCESS
from lupin_cli.facts.units import VENDOR
from lupin_cli.link.laptop_clock import DRIFT_LIMIT_S
from lupin_cli.plausible_time import SET_CLOCK, SET_CLOCK_BY_HAND, clock_fault
from lupin_cli.printed_commands import complete, lupin, print_next
from lupin_cli.terminal import echo, ending_in_order

if TYPE_CHECKING:
    from lupin_cli.connection.inventory import Robot
    from lupin_cli.connection.ssh import SshTarget
    from lupin_cli.facts.clock import Offset
    from lupin_cli.link.clock_offset import OffsetEstimate
    from lupin_cli.playbook.results import Result

PLAYBOOK, INSTALL = "sync-clock", "install-clock-sync"
MEASURE_TIMEOUT_S = 15.0
NTP_WAIT_S = 0.7


@dataclass(frozen=True)
class ClockStatus:
    """The robot's clock and stack at one time."""

    estimate: OffsetEstimate
    ntp: Offset | None  # None unless the robot serves its time over NTP
    stack: str  # state of the vendor's service: active, inactive, ... or "missing"

    @property
    def is_good(self) -> bool:
        """Whether nothing has to be changed."""
        return self.estimate.tolerable and self.stack == "active"

    def as_json(self) -> dict[str, Any]:
        """Return the status as JSON-serializable data; its keys are stable."""
        estimate = self.estimate
        return {
            "offset_s": round(estimate.offset.offset_s, 6),
            "bound_s": round(estimate.offset.bound_s, 6),
            "round_trip_s": round(estimate.round_trip_s, 6),
            "samples": estimate.samples,
            "steady": estimate.steady,
            "ntp_offset_s": None if self.ntp is None else round(self.ntp.offset_s, 6),
            "ntp_bound_s": None if self.ntp is None else round(self.ntp.bound_s, 6),
            "stack": self.stack,
        }


@dataclass(frozen=True)
class _Request:
    """What the operator asked for."""

    install: bool
    trust_laptop: bool
    dry_run: bool
    resume: bool
    break_lease: str
    as_json: bool
    ask_sudo: bool

    def command(self, robot: str, *more: str) -> str:
        """Return what starts it again on a robot, with `more` options."""
        words = ["--install"] * self.install + ["--trust-laptop"] * self.trust_laptop
        return lupin("sync-clock", *words, *more, robot=robot)

    def override(self, robot: str) -> str:
        """Return what sets the robot's clock although the laptop's may be the wrong one, with the options that were given."""
        words = ["--ask-sudo-password"] * self.ask_sudo + (["--break-lease", self.break_lease] if self.break_lease else [])
        return self.command(robot, "--trust-laptop", *words)


def command(
    robot: ROBOT = None,
    install: bool = typer.Option(False, "--install", help="Set the robot's clock from this machine at every boot (chrony)."),
    trust_laptop: bool = typer.Option(
        False, "--trust-laptop", help="Set the robot's clock even if this machine's seems to be the wrong one of both."
    ),
    dry_run: bool = typer.Option(False, "--dry-run", help="Measure, and show what would be done."),
    resume: bool = typer.Option(False, "--resume", help="Continue the playbook run that was interrupted."),
    break_lease: BREAK_LEASE = "",
    as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output."),
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Measure how far the robot's clock is off, and set it if needed.

    With the stack up and at most 3 s of offset, nothing is changed. Otherwise the stack is stopped, the clock set, stale shared
    memory removed and everything started again. The clock of a running stack is never stepped.

    A robot that is behind was off, and gets this machine's time. One that is ahead gets it only if this machine's clock is
    synchronized, or with --trust-laptop.

    Exit status: 0 the clock is right and the stack up, 1 something failed (the message says how to continue), 2 usage, 3 the
    robot cannot be reached, 130 interrupted.

    Example: lupin sync-clock --dry-run
    """
    request = _Request(install, trust_laptop, dry_run, resume, break_lease, as_json, ask_sudo)
    with ending_in_order(), reporting_errors("sync-clock"):
        inventory = load(config)
        robots = select_robots(inventory, robot)
        passwords = ask_sudo_passwords(robots) if ask_sudo else {}

        def sync_robot(one: Robot) -> tuple[dict[str, Any], int]:
            with connect(one, inventory, sudo_password=passwords.get(one.name)) as target:
                return _sync(target, request)

        reports, status = one_after_another("sync-clock", robots, sync_robot)
        if as_json:
            print(json.dumps(reports if len(reports) != 1 else reports[0]))
        raise typer.Exit(status)


def _sync(target: SshTarget, request: _Request) -> tuple[dict[str, Any], int]:
    before = inspect(target)
    if not request.as_json:
        _print_status(target.name, before)
    if before.is_good and not request.install and not request.resume:
        if not request.as_json:
            echo("the offset is within 3 s and the stack is up: nothing to do")
            if before.estimate.offset.at_least_s > DRIFT_LIMIT_S:
                echo(f"navigation and mapping refuse stamps that are {DRIFT_LIMIT_S:g} s from this machine's clock")
                print_next(lupin("sync-clock", "--install", robot=target.name), "let chrony slew it without a restart")
        return {"robot": target.name, "before": before.as_json(), "done": "nothing"}, SUCCESS
    if (request.install or not before.estimate.tolerable) and (fault := clock_fault(time.time())):
        return _refuse(target, before, fault), FAILURE
    from lupin_cli.commands.play import print_result

    result = _play(target, request)
    after = None if request.dry_run else _inspect_again(target)
    report = _json_report(target.name, before, result, after)
    if not request.as_json and result.state == "done" and after is not None:
        _print_status(target.name, after)
    print_result(result, request.as_json)
    return report, result.exit_code if request.dry_run else _judge(target, request, result, after)


def _judge(target: SshTarget, request: _Request, result: Result, after: ClockStatus | None) -> int:
    """Return the exit status of a run, from what was measured `after` it; say what is still wrong, and what helps."""
    if after is None:
        echo(f"{target.name} cannot be reached to check its clock and whether its stack is up", err=True)
        print_next(result.resume or request.command(target.name), "continue with")
        return result.exit_code or FAILURE
    if after.stack != "active":
        # Whatever else happened, the operator must learn that the robot's stack is down.
        echo(f"{target.name}: THE STACK IS DOWN ({VENDOR} is {after.stack})", err=True)
        command = result.resume or result.next_command
        if command:
            print_next(command, "continue with")
        else:
            print_next(complete(f"sudo systemctl start {VENDOR}", login=target.login_command), "start it with")
        return result.exit_code or FAILURE
    if result.state == "done" and not request.install and not after.is_good:
        echo(f"{target.name}: its clock is still {after.estimate.offset} from this machine's", err=True)
        print_next(request.command(target.name))
        return FAILURE
    return result.exit_code


def _refuse(target: SshTarget, before: ClockStatus, fault: str) -> dict[str, Any]:
    """Say why this machine's clock is not given to the robot, and how to set it; return the report."""
    echo(f"sync-clock: {fault}; the robot's clock is not set from it", err=True)
    print_next(SET_CLOCK)
    echo(f"  do: {SET_CLOCK_BY_HAND}", err=True)
    return {"robot": target.name, "before": before.as_json(), "done": "nothing", "message": fault}


def inspect(target: SshTarget) -> ClockStatus:
    """Measure the clock over one channel and, at the same time, over NTP; read the state of the stack. Raises TargetError."""
    from concurrent.futures import ThreadPoolExecutor

    from lupin_cli.connection.base import Script
    from lupin_cli.link.clock_offset import ntp_offset

    with ThreadPoolExecutor(1, thread_name_prefix="ntp") as pool:
        ntp = pool.submit(ntp_offset, target.destination.host, NTP_WAIT_S)
        estimate = measure_clock(target)
        script = f"systemctl show --property=LoadState,ActiveState {VENDOR}"
        output = target.batch([Script("stack", script)])["stack"]
        properties = dict(line.partition("=")[::2] for line in output.stdout.splitlines())
        loaded = properties.get("LoadState") == "loaded"
        return ClockStatus(estimate, ntp.result(), properties.get("ActiveState", "unknown") if loaded else "missing")


def measure_clock(target: SshTarget) -> OffsetEstimate:
    """Measure the offset of the target's clock. Raises TargetError."""
    from lupin_cli.link.clock_offset import ClockError, measure_target

    try:
        return measure_target(target, MEASURE_TIMEOUT_S)
    except (ClockError, OSError, EOFError) as error:
        reason = str(error) or type(error).__name__
        raise TargetError(
            f"{target.name}: its clock could not be read: {reason}", lupin("doctor", robot=target.name)
        ) from error


def _inspect_again(target: SshTarget) -> ClockStatus | None:
    try:
        return inspect(target)
    except TargetError:
        return None


def _play(target: SshTarget, request: _Request) -> Result:
    from lupin_cli.commands.play import ProgressPrinter
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.playbook import JournalError, PlaybookError, Result
    from lupin_cli.playbook.engine import play

    name = INSTALL if request.install else PLAYBOOK
    variables: dict[str, Any] = {}
    if not request.resume:  # a resumed run has those of its journal
        variables = {"override": request.override(target.name), **({"trust_laptop": True} if request.trust_laptop else {})}
        variables |= _laptop_variables(target) if request.install else {}
    try:
        return play(
            name,
            {"robot": target, "laptop": LocalTarget()},
            variables,
            dry_run=request.dry_run,
            resume=request.resume,
            take_lease_from=request.break_lease,
            command=request.command(target.name),
            on_event=ProgressPrinter(quiet=request.as_json, several=False, diff=False),
        )
    except (PlaybookError, FileNotFoundError) as error:
        return Result(name, target.name, "failed", message=str(error))
    except JournalError as error:  # whether the stack is up must be told all the same
        return Result(name, target.name, "failed", message=str(error), next_command=error.next_command)


def _laptop_variables(target: SshTarget) -> dict[str, str]:
    """Return playbook variables for this machine's address, as the robot's sshd sees it, and for the network around it."""
    from ipaddress import IPv4Address, ip_network

    output = target.run('echo "${SSH_CONNECTION%% *}"', timeout_s=10.0).stdout.strip()
    try:
        address = str(IPv4Address(output))
    except ValueError:
        return {}  # through a jump host or over IPv6: the playbook's defaults, those of the cable, apply
    return {"laptop_ip": address, "network": str(ip_network(f"{address}/24", strict=False))}


def _print_status(name: str, status: ClockStatus) -> None:
    ntp = f"; by NTP {status.ntp}" if status.ntp is not None else ""
    echo(f"{name}: clock {status.estimate}{ntp}; {VENDOR} is {status.stack}")


def _json_report(name: str, before: ClockStatus, result: Result, after: ClockStatus | None) -> dict[str, Any]:
    steps = [{"name": s.name, "state": s.state, "summary": s.summary, "error": s.error} for s in result.steps]
    return {
        "robot": name,
        "before": before.as_json(),
        "done": f"would play {result.playbook}" if result.dry_run else result.playbook,
        "state": result.state,
        "steps": steps,
        "after": None if after is None else after.as_json(),
        "message": result.message,
        "next_command": result.next_command,
    }
