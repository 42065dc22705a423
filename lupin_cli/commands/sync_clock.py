"""`lupin sync-clock`: the robot's clock, set only while nothing watches it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.config import ConfigError, load
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.robot_options import ASK_SUDO, BREAK_LEASE, CONFIG, ROBOT, ask_sudo_password, connect, reporting, select

if TYPE_CHECKING:
    from lupin_cli.clock import Drift
    from lupin_cli.facts.clock import Offset
    from lupin_cli.runbook.outcome import Result
    from lupin_cli.target.ssh import SshTarget

PLAYBOOK, INSTALL = "sync-clock", "install-clock-sync"
MEASURE_BOUND_S = 15.0
NTP_WAIT_S = 0.7
VENDOR = "mirte-ros.service"


@dataclass(frozen=True)
class Look:
    """What was found before anything was done."""

    drift: Drift
    ntp: Offset | None  # where the robot serves its time itself
    stack: str  # the vendor's service: active, inactive, ... or "missing"

    @property
    def fine(self) -> bool:
        """Whether nothing must be touched."""
        return self.drift.tolerable and self.stack == "active"

    def as_json(self) -> dict[str, Any]:
        drift = self.drift
        return {
            "offset_s": round(drift.offset.offset_s, 6),
            "bound_s": round(drift.offset.bound_s, 6),
            "round_trip_s": round(drift.round_trip_s, 6),
            "samples": drift.samples,
            "steady": drift.steady,
            "ntp_offset_s": None if self.ntp is None else round(self.ntp.offset_s, 6),
            "ntp_bound_s": None if self.ntp is None else round(self.ntp.bound_s, 6),
            "stack": self.stack,
        }


def command(
    robot: ROBOT = None,
    install: bool = typer.Option(False, "--install", help="Let the robot take this machine's time at every boot (chrony)."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Measure, and say what would be done."),
    resume: bool = typer.Option(False, "--resume", help="Go on where the last one was cut off."),
    break_lease: BREAK_LEASE = False,
    as_json: bool = typer.Option(False, "--json", help="Print JSON, alone on standard output."),
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Measure how far the robot's clock is off. Up to 3 s with its stack up, nothing is touched; else the stack is stopped, the
    clock set, shared memory swept and everything started again. The clock of a running stack is never stepped.

    Exit status: 0 the clock is right and the stack up, 1 something failed, with how to go on; 2 usage, 3 the robot can't be
    reached, 130 interrupted.
    """
    status = 0
    with reporting("sync-clock"):
        inventory = load(config)
        for one in select(inventory, robot):
            with connect(one, inventory, sudo_password=ask_sudo_password(one.name) if ask_sudo else None) as target:
                status = max(status, _sync(target, install, dry_run, resume, break_lease, as_json))
    raise typer.Exit(status)


def _sync(target: SshTarget, install: bool, dry_run: bool, resume: bool, break_lease: bool, as_json: bool) -> int:
    before = look(target)
    if not as_json:
        _tell_look(target.name, before)
    if before.fine and not install and not resume:
        if as_json:
            print(json.dumps({"robot": target.name, "before": before.as_json(), "done": "nothing"}))
        else:
            typer.echo("within 3 s and the stack is up: nothing is touched")
        return 0
    from lupin_cli.commands.play import tell_result

    result = _play(INSTALL if install else PLAYBOOK, target, dry_run, resume, break_lease, as_json)
    after = None if dry_run else _look_again(target)
    if as_json:
        print(json.dumps(_outcome(target.name, before, result, after)))
    elif result.state == "done" and after is not None:
        _tell_look(target.name, after)
    tell_result(result, as_json)
    if after is not None and after.stack != "active":
        # Whatever else happened: nobody may walk away from a robot that is down without having read so.
        onward = result.resume or result.next_command
        how = f"; go on with: {onward}" if onward else f"; start it with: systemctl start {VENDOR}"
        typer.echo(f"{target.name}: THE STACK IS DOWN ({VENDOR} is {after.stack}){how}", err=True)
        return result.exit_code or 1
    if result.state != "done" and after is None and not dry_run:
        typer.echo(f"{target.name} can't be asked whether its stack is up; go on with: {result.resume}", err=True)
    return result.exit_code


def look(target: SshTarget) -> Look:
    """Measure the clock over one open channel, ask for NTP meanwhile, and see whether the stack is up. Raises TargetError."""
    from concurrent.futures import ThreadPoolExecutor

    from lupin_cli.clock import ntp_offset
    from lupin_cli.target.base import Script

    with ThreadPoolExecutor(1, thread_name_prefix="ntp") as pool:
        ntp = pool.submit(ntp_offset, target.destination.host, NTP_WAIT_S)
        drift = measure_drift(target)
        script = f"systemctl show --property=LoadState,ActiveState {VENDOR}"
        output = target.batch([Script("stack", script)])["stack"]
        found = dict(line.partition("=")[::2] for line in output.stdout.splitlines())
        loaded = found.get("LoadState") == "loaded"
        return Look(drift, ntp.result(), found.get("ActiveState", "unknown") if loaded else "missing")


def measure_drift(target: SshTarget) -> Drift:
    """The offset of the target's clock. Raises TargetError."""
    from lupin_cli.clock import ClockError, measure_over
    from lupin_cli.target.base import TargetError

    try:
        return measure_over(target, MEASURE_BOUND_S)
    except (ClockError, OSError, EOFError) as error:
        why = str(error) or type(error).__name__
        raise TargetError(
            f"{target.name}: its clock could not be read: {why}", f"lupin doctor --robot {target.name}"
        ) from error


def _look_again(target: SshTarget) -> Look | None:
    from lupin_cli.target.base import TargetError

    try:
        return look(target)
    except TargetError:
        return None


def _play(name: str, target: SshTarget, dry_run: bool, resume: bool, break_lease: bool, as_json: bool) -> Result:
    from lupin_cli.commands.play import Shown
    from lupin_cli.runbook.engine import play
    from lupin_cli.runbook.journal import JournalError
    from lupin_cli.runbook.source import PlaybookError
    from lupin_cli.target.local import LocalTarget

    try:
        return play(
            name,
            {"robot": target, "laptop": LocalTarget()},
            _laptop_as_seen(target) if name == INSTALL and not resume else {},
            dry_run=dry_run,
            resume=resume,
            break_lease=break_lease,
            on_event=Shown(as_json, 1, False),
        )
    except (PlaybookError, FileNotFoundError) as error:
        raise ConfigError(str(error)) from error
    except JournalError as error:
        raise ConfigError(f"{error}; next: {error.next_command}") from error


def _laptop_as_seen(target: SshTarget) -> dict[str, str]:
    """Where the robot finds this machine: the address that its sshd sees, and the network around it."""
    from ipaddress import IPv4Address, ip_network

    said = target.run('echo "${SSH_CONNECTION%% *}"', bound_s=10.0).stdout.strip()
    try:
        address = str(IPv4Address(said))
    except ValueError:
        return {}  # by way of another host, or over IPv6: the playbook's own defaults are the cable's
    return {"laptop_ip": address, "network": str(ip_network(f"{address}/24", strict=False))}


def _tell_look(name: str, seen: Look) -> None:
    ntp = f"; by NTP {seen.ntp}" if seen.ntp is not None else ""
    typer.echo(f"{name}: clock {seen.drift}{ntp}; {VENDOR} is {seen.stack}")


def _outcome(name: str, before: Look, result: Result, after: Look | None) -> dict[str, Any]:
    steps = [{key: getattr(step, key) for key in ("name", "state", "summary", "error")} for step in result.steps]
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
