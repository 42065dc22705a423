"""`lupin sync-clock`: set the robot's clock, but only while its stack is stopped."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.connection.inventory import ConfigError, load
from lupin_cli.connection.options import (
    ASK_SUDO,
    BREAK_LEASE,
    CONFIG,
    ROBOT,
    ask_sudo_password,
    connect,
    reporting_errors,
    select_robots,
)
from lupin_cli.exit_codes import FAILURE, SUCCESS
from lupin_cli.facts.units import VENDOR
from lupin_cli.terminal import echo

if TYPE_CHECKING:
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
        """Return the status as JSON-able data; its keys are stable."""
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


def command(
    robot: ROBOT = None,
    install: bool = typer.Option(False, "--install", help="Set the robot's clock from this machine at every boot (chrony)."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Measure, and show what would be done."),
    resume: bool = typer.Option(False, "--resume", help="Continue the playbook run that was interrupted."),
    break_lease: BREAK_LEASE = False,
    as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output."),
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Measure how far the robot's clock is off, and set it if needed.

    With the stack up and at most 3 s of offset, nothing is changed. Otherwise the stack is stopped, the clock set, stale shared
    memory removed and everything started again. The clock of a running stack is never stepped.

    Exit status: 0 the clock is right and the stack up, 1 something failed (the message says how to continue), 2 usage, 3 the
    robot cannot be reached, 130 interrupted.
    """
    status = SUCCESS
    with reporting_errors("sync-clock"):
        inventory = load(config)
        for one in select_robots(inventory, robot):
            with connect(one, inventory, sudo_password=ask_sudo_password(one.name) if ask_sudo else None) as target:
                status = max(status, _sync(target, install, dry_run, resume, break_lease, as_json))
    raise typer.Exit(status)


def _sync(target: SshTarget, install: bool, dry_run: bool, resume: bool, break_lease: bool, as_json: bool) -> int:
    before = inspect(target)
    if not as_json:
        _print_status(target.name, before)
    if before.is_good and not install and not resume:
        if as_json:
            print(json.dumps({"robot": target.name, "before": before.as_json(), "done": "nothing"}))
        else:
            echo("the offset is within 3 s and the stack is up: nothing to do")
        return SUCCESS
    from lupin_cli.commands.play import print_result

    result = _play(INSTALL if install else PLAYBOOK, target, dry_run, resume, break_lease, as_json)
    after = None if dry_run else _inspect_again(target)
    if as_json:
        print(json.dumps(_json_report(target.name, before, result, after)))
    elif result.state == "done" and after is not None:
        _print_status(target.name, after)
    print_result(result, as_json)
    if after is not None and after.stack != "active":
        # Whatever else happened, the operator must learn that the robot's stack is down.
        command = result.resume or result.next_command
        action = f"continue with: {command}" if command else f"start it with: systemctl start {VENDOR}"
        echo(f"{target.name}: THE STACK IS DOWN ({VENDOR} is {after.stack}); {action}", err=True)
        return result.exit_code or FAILURE
    if result.state != "done" and after is None and not dry_run:
        echo(f"{target.name} cannot be reached to check whether its stack is up; continue with: {result.resume}", err=True)
    return result.exit_code


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
    from lupin_cli.connection.base import TargetError
    from lupin_cli.link.clock_offset import ClockError, measure_target

    try:
        return measure_target(target, MEASURE_TIMEOUT_S)
    except (ClockError, OSError, EOFError) as error:
        reason = str(error) or type(error).__name__
        raise TargetError(
            f"{target.name}: its clock could not be read: {reason}", f"lupin doctor --robot {target.name}"
        ) from error


def _inspect_again(target: SshTarget) -> ClockStatus | None:
    from lupin_cli.connection.base import TargetError

    try:
        return inspect(target)
    except TargetError:
        return None


def _play(name: str, target: SshTarget, dry_run: bool, resume: bool, break_lease: bool, as_json: bool) -> Result:
    from lupin_cli.commands.play import ProgressPrinter
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.playbook.engine import play
    from lupin_cli.playbook.journal import JournalError
    from lupin_cli.playbook.yaml_source import PlaybookError

    try:
        return play(
            name,
            {"robot": target, "laptop": LocalTarget()},
            _laptop_variables(target) if name == INSTALL and not resume else {},
            dry_run=dry_run,
            resume=resume,
            break_lease=break_lease,
            on_event=ProgressPrinter(quiet=as_json, several=False, diff=False),
        )
    except (PlaybookError, FileNotFoundError) as error:
        raise ConfigError(str(error)) from error
    except JournalError as error:
        raise ConfigError(f"{error}; next: {error.next_command}") from error


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
