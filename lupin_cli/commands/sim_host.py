"""`lupin sim host`: boot a simulated computer of a robot, log in to it, inject faults."""

from __future__ import annotations

import json
from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from lupin_cli.command_group import command_group
from lupin_cli.completion import worlds
from lupin_cli.exit_codes import FAILURE, USAGE_ERROR
from lupin_cli.terminal import echo, timed_progress

if TYPE_CHECKING:
    from lupin_sim.host import Host

app = command_group(
    "The robot's computer: a Linux that boots on this machine, with a laptop on its network and faults on demand.",
    "lupin sim host up",
    no_args_is_help=True,
)

_NAME = typer.Option("--name", help="Select the host by name, if several are up.")
_ROBOT = typer.Option("--robot", min=1, help="Select the robot of the host, counted from 1.")
_JSON = typer.Option("--json", help="Print JSON.")


@app.command()
def up(
    name: Annotated[str, _NAME] = "host",
    robots: Annotated[int, typer.Option("--robots", min=1, max=32, help="Boot this many robots, all on one network.")] = 1,
    vendor_robot: Annotated[
        bool, typer.Option("--vendor-robot", help="Run the simulated robot as mirte-ros.service, so the ROS graph is complete.")
    ] = False,
    world: Annotated[
        str, typer.Option("--world", autocompletion=worlds, help="Simulate this greenhouse around that robot.")
    ] = "demo",
) -> None:
    """Boot a host, and leave it up until `lupin sim host down`.

    Exit status: 0 it is up, 1 it did not start, or this machine lacks something that it needs.

    Example: lupin sim host up --vendor-robot
    """
    from lupin_sim.host import Host
    from lupin_sim.host.host import ROBOT_ARGUMENTS

    arguments = f"{ROBOT_ARGUMENTS} --world {world}"
    with _reporting(), timed_progress() as progress:
        host = Host.start(
            name,
            robots=robots,
            vendor_robot=vendor_robot,
            boot_laptop=True,
            robot_arguments=arguments,
            lifeline=False,
            progress=progress,
        )
    for robot in host.robots:
        echo(f"{robot.name} is up: eth0 {robot.eth0}, wlan0 {robot.wlan0}, user mirte, password mirte_mirte")
    option = "" if name == "host" else f" --name {name}"
    echo(f"log in:        lupin sim host ssh{option}", wrap=False)
    echo(f"on the laptop: lupin sim host laptop{option} -- lupin doctor", wrap=False)


@app.command()
def down(name: Annotated[str, _NAME] = "host") -> None:
    """Switch a host off and remove everything that belongs to it.

    Example: lupin sim host down
    """
    from lupin_sim.host import state

    if name not in state.running():
        removed = state.remove_stale()
        echo(f"no host {name!r} is up" + (f"; removed the leftovers of {', '.join(removed)}" if removed else ""))
        return
    _attach(name).end()
    echo(f"host {name!r} is down")


@app.command()
def status(
    name: Annotated[str | None, _NAME] = None,
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Show the hosts that are up: robots, addresses, clocks, active faults.

    Example: lupin sim host status
    """
    from lupin_sim.host import missing_prerequisite, state

    names = state.running() if name is None else [name]
    rows: dict[str, Any] = {each: _attach(each).request("status")["robots"] for each in names}
    if as_json:
        print(json.dumps(rows))
        return
    if not rows:
        echo(missing_prerequisite() or "no host is up: lupin sim host up")
        return
    for each, robots in rows.items():
        for robot in robots:
            power = "on" if robot["running"] else "off"
            echo(
                f"{each}: {robot['name']} {power}, eth0 {robot['eth0']}, wlan0 {robot['wlan0']}, boot {robot['boots']}, "
                f"clock {robot['clock_offset_s']:+.3f} s {robot['clock_crystal_ppm']:+.0f} ppm, "
                f"disk {robot['disk_used_mb']} MB, faults: {', '.join(robot['faults']) or 'none'}"
            )


@app.command()
def ssh(
    command: Annotated[list[str] | None, typer.Argument(help="Command to run on the robot; a shell if omitted.")] = None,
    name: Annotated[str, _NAME] = "host",
    robot: Annotated[int, _ROBOT] = 1,
    link: Annotated[str, typer.Option("--link", help="Connect over eth0 or wlan0.")] = "eth0",
) -> None:
    """Log in as mirte from the laptop. The exit status is the command's.

    Example: lupin sim host ssh -- uname -a
    """
    host = _attach(name)
    index = _robot_index(host, robot)
    _run_and_exit(host, host.ssh_command(*(command or ()), robot=host.robots[index], link=link))


@app.command(context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False})
def laptop(
    command: Annotated[list[str] | None, typer.Argument(help="Program to run; a shell if omitted.")] = None,
    name: Annotated[str, _NAME] = "host",
) -> None:
    """Run a program on the laptop, which boots too: its own systemd, chrony and files, and the account student with sudo.

    Its addresses are 10.42.0.2 and 192.168.42.2, and its inventory has the robots. Of this machine it has only Lupin. A program
    finds the DDS environment of a new terminal.

    Example: lupin sim host laptop -- lupin doctor
    """
    from lupin_sim.host.booted_laptop import in_new_terminal

    _run_and_exit(_attach(name), in_new_terminal(command) if command else ["bash", "-i"])


@app.command()
def fault(
    fault_name: Annotated[str | None, typer.Argument(metavar="[FAULT]", help="The fault; all are listed if omitted.")] = None,
    settings: Annotated[list[str] | None, typer.Argument(metavar="[SETTING=VALUE]...", help="Its settings, as listed.")] = None,
    undo: Annotated[bool, typer.Option("--undo", help="Undo the fault.")] = False,
    name: Annotated[str, _NAME] = "host",
    robot: Annotated[int, _ROBOT] = 1,
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Inject a fault into the robot or its network, or list all faults.

    Exit status: 0 done, 1 the fault could not be injected or undone, 2 there is no such fault or setting.

    Example: lupin sim host fault --undo
    """
    from lupin_sim.host import faults

    if fault_name is None:
        if as_json:
            print(json.dumps(faults.list_faults()))
            return
        for row in faults.list_faults():
            echo(f"{row['name']:20}{row['summary']}{'' if row['undo'] else ' (nothing to undo)'}")
            if row["settings"]:
                echo(f"{'':20}  " + "  ".join(f"{key}={value}" for key, value in row["settings"].items()))
        return
    try:
        chosen = faults.parse_settings(fault_name, settings or [])
    except faults.FaultError as error:
        echo(f"lupin sim host: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from None
    host = _attach(name)
    target = host.robots[_robot_index(host, robot)]
    with _reporting():
        (target.undo_fault if undo else target.inject_fault)(fault_name, **chosen)
    if as_json:
        print(json.dumps({"fault": fault_name, "undone": undo}))
    else:
        echo(f"{fault_name}: {'undone' if undo else 'done'}")


def _attach(name: str) -> Host:
    from lupin_sim.host import Host

    with _reporting():
        return Host.attach(name)


def _robot_index(host: Host, number: int) -> int:
    if number > len(host.robots):
        echo(f"lupin sim host: there is no robot {number}; the host has {len(host.robots)}", err=True)
        raise typer.Exit(USAGE_ERROR)
    return number - 1


def _run_and_exit(host: Host, command: list[str]) -> NoReturn:
    """Run a program in this terminal and exit with its status. Ctrl-C interrupts only the program."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with host.popen(command) as process:
        code = process.wait()
    raise typer.Exit(code if code >= 0 else 128 - code)


@contextmanager
def _reporting() -> Generator[None, None, None]:
    """Report a HostError as one line, and exit with status 1."""
    from lupin_sim.host import HostError

    try:
        yield
    except HostError as error:
        echo(f"lupin sim host: {error}", err=True)
        raise typer.Exit(FAILURE) from None
