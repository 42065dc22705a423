"""The robot's computer on this machine: boot it, log into it, break it."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

if TYPE_CHECKING:
    from lupin_sim.host import Host

app = typer.Typer(
    help="The robot's computer: a Linux that boots on this machine, with a laptop's network beside it, and faults on demand.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

USAGE_ERROR, FAILED = 2, 1
_NAME = typer.Option("--name", help="Which host, where several are up.")
_ROBOT = typer.Option("--robot", min=1, help="Which robot of it, from 1 on.")
_JSON = typer.Option("--json", help="Print JSON.")


@app.command()
def up(
    name: Annotated[str, _NAME] = "host",
    robots: Annotated[int, typer.Option("--robots", min=1, max=32, help="How many, all on one wire.")] = 1,
    vendor_robot: Annotated[
        bool, typer.Option("--vendor-robot", help="mirte-ros.service runs the simulated robot, so the graph is whole.")
    ] = False,
    world: Annotated[str, typer.Option("--world", help="The greenhouse that robot stands in.")] = "demo",
) -> None:
    """Boot it, and leave it up until `lupin sim host down`.

    Exit status: 0 up, 1 it did not come up or this machine lacks something for it.
    """
    from lupin_sim.host import Host
    from lupin_sim.host.host import ROBOT_ARGUMENTS

    arguments = f"{ROBOT_ARGUMENTS} --world {world}"
    with _reporting():
        host = Host.start(
            name, robots=robots, vendor_robot=vendor_robot, robot_arguments=arguments, lifeline=False, progress=_say
        )
    for robot in host.robots:
        typer.echo(f"{robot.name} is up: eth0 {robot.eth0}, wlan0 {robot.wlan0}, user mirte, password mirte_mirte")
    option = "" if name == "host" else f" --name {name}"
    typer.echo(f"log in: lupin sim host ssh{option}    on the laptop: lupin sim host laptop{option} -- ping {host.robot.eth0}")
    typer.echo(f"key: {host.key}    known hosts: {host.known_hosts}")


@app.command()
def down(name: Annotated[str, _NAME] = "host") -> None:
    """Pull every plug; nothing of it is left."""
    from lupin_sim.host import state

    if name not in state.running():
        swept = state.sweep()
        typer.echo(f"no host {name!r} is up" + (f"; swept what was left of {', '.join(swept)}" if swept else ""))
        return
    _attach(name).end()
    typer.echo(f"host {name!r} is down")


@app.command()
def status(
    name: Annotated[str | None, _NAME] = None,
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """What is up: robots, their addresses, their clocks, the faults that stand."""
    from lupin_sim.host import state, what_is_missing

    names = state.running() if name is None else [name]
    rows: dict[str, Any] = {each: _attach(each).ask("status")["robots"] for each in names}
    if as_json:
        typer.echo(json.dumps(rows))
        return
    if not rows:
        typer.echo(what_is_missing() or "no host is up: lupin sim host up")
        return
    for each, robots in rows.items():
        for robot in robots:
            power = "on" if robot["running"] else "off"
            typer.echo(
                f"{each}: {robot['name']} {power}, eth0 {robot['eth0']}, wlan0 {robot['wlan0']}, boot {robot['boots']}, "
                f"clock {robot['clock_offset_s']:+.3f} s {robot['clock_crystal_ppm']:+.0f} ppm, "
                f"disk {robot['disk_used_mb']} MB, faults: {', '.join(robot['faults']) or 'none'}"
            )


@app.command()
def ssh(
    command: Annotated[list[str] | None, typer.Argument(help="What to run there; without it a shell.")] = None,
    name: Annotated[str, _NAME] = "host",
    robot: Annotated[int, _ROBOT] = 1,
    link: Annotated[str, typer.Option("--link", help="Over eth0 or wlan0.")] = "eth0",
) -> None:
    """Log in as mirte, from the laptop, over the wire. The exit status is the command's."""
    host = _attach(name)
    chosen = _robot(host, robot)
    _become(host, host.ssh_command(*(command or ()), robot=host.robots[chosen], link=link))


@app.command(context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False})
def laptop(
    command: Annotated[list[str] | None, typer.Argument(help="What to run; without it a shell.")] = None,
    name: Annotated[str, _NAME] = "host",
) -> None:
    """Run a program on the laptop: 10.42.0.2 and 192.168.42.2, its own processes, this machine's files."""
    _become(_attach(name), command or [os.environ.get("SHELL", "/bin/sh")])


@app.command()
def fault(
    fault_name: Annotated[str | None, typer.Argument(metavar="[FAULT]", help="Without it, list them all.")] = None,
    settings: Annotated[list[str] | None, typer.Argument(metavar="[SETTING=VALUE]...", help="As listed.")] = None,
    undo: Annotated[bool, typer.Option("--undo", help="Take it back.")] = False,
    name: Annotated[str, _NAME] = "host",
    robot: Annotated[int, _ROBOT] = 1,
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Break the robot or its cables, or list what can be broken.

    Exit status: 0 done, 1 it could not be done, 2 no such fault or setting.
    """
    from lupin_sim.host import faults

    if fault_name is None:
        if as_json:
            typer.echo(json.dumps(faults.listing()))
            return
        for row in faults.listing():
            typer.echo(f"{row['name']:20}{row['summary']}{'' if row['undo'] else ' (nothing to undo)'}")
            if row["settings"]:
                typer.echo(f"{'':20}  " + "  ".join(f"{key}={value}" for key, value in row["settings"].items()))
        return
    try:
        chosen = faults.parse(fault_name, settings or [])
    except faults.FaultError as error:
        typer.echo(f"lupin sim host: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from None
    host = _attach(name)
    target = host.robots[_robot(host, robot)]
    with _reporting():
        (target.mend if undo else target.fault)(fault_name, **chosen)
    typer.echo(
        json.dumps({"fault": fault_name, "undone": undo}) if as_json else f"{fault_name}: {'taken back' if undo else 'done'}"
    )


def _attach(name: str) -> Host:
    from lupin_sim.host import Host

    with _reporting():
        return Host.attach(name)


def _robot(host: Host, number: int) -> int:
    if number > len(host.robots):
        typer.echo(f"lupin sim host: there is no robot {number}, only {len(host.robots)}", err=True)
        raise typer.Exit(USAGE_ERROR)
    return number - 1


def _become(host: Host, command: list[str]) -> NoReturn:
    """Run it with this terminal, and end as it does. Its interrupts are its own."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with host.popen(command) as process:
        code = process.wait()
    raise typer.Exit(code if code >= 0 else 128 - code)


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


@contextmanager
def _reporting() -> Generator[None, None, None]:
    """What a host cannot do is one line, and exit status 1."""
    from lupin_sim.host import HostError

    try:
        yield
    except HostError as error:
        typer.echo(f"lupin sim host: {error}", err=True)
        raise typer.Exit(FAILED) from None
