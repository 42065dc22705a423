"""The options by which every command names its robots, and how it gets from a name to an open target.

def command(robot: ROBOT = None, every: ALL = False, limit: LIMIT = None, config: CONFIG = None) -> None:
    with reporting_errors("doctor"):
        chosen = select_robots(load(config), robot, every=every, limit=limit)
        with connect(chosen[0]) as target: ...
        results = for_each_robot(chosen, lambda robot: ...)
"""

from __future__ import annotations

import contextlib
import difflib
import fnmatch
import getpass
import socket
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from lupin_cli.completion import matching
from lupin_cli.connection.base import (
    AuthenticationFailed,
    HostKeyChanged,
    HostKeyUnknown,
    SshConfigUnusable,
    TargetError,
    Unreachable,
)
from lupin_cli.connection.inventory import ADD_EXAMPLE, DEFAULT_USER, Config, ConfigError, Robot, load
from lupin_cli.exit_codes import FAILURE, UNREACHABLE, USAGE_ERROR, worst
from lupin_cli.printed_commands import complete, print_next, repeat_inventory
from lupin_cli.terminal import confirm, echo, erase_status_line, is_interactive, printable

if TYPE_CHECKING:
    from lupin_cli.connection.destination import Destination
    from lupin_cli.connection.host_keys import KnownHosts
    from lupin_cli.connection.ssh import SshTarget


def complete_robots(incomplete: str) -> list[str]:
    """Return the robots of the user's inventory that a shell offers at Tab; none if it cannot be read."""
    try:
        return matching(load().robots, incomplete)
    except ConfigError:
        return []


ROBOT = Annotated[
    list[str] | None,
    typer.Option(
        "--robot", "-r", help="A robot of lupin.toml, or [user@]host[:port]; can be repeated.", autocompletion=complete_robots
    ),
]
LOCAL = Annotated[bool, typer.Option("--local", help="Act on this machine instead of a robot.")]
HOST = Annotated[str, typer.Option("--host", help="Act on the robot at this address; ignore those of lupin.toml.")]
ALL = Annotated[bool, typer.Option("--all", help="Act on every robot of lupin.toml, in parallel.")]
LIMIT = Annotated[str | None, typer.Option("--limit", help="With --all: select robots by a pattern, such as pot-*.")]
CONFIG = Annotated[
    Path | None,
    typer.Option(
        "--config", callback=repeat_inventory, help="Read this inventory [$LUPIN_CONFIG, else lupin/lupin.toml in ~/.config]."
    ),
]
ASK_SUDO = Annotated[bool, typer.Option("--ask-sudo-password", "-K", help="Ask for the robot's sudo password.")]
BREAK_LEASE = Annotated[
    str,
    typer.Option(
        "--break-lease", metavar="HOLDER", help="Take the robot's lease from this holder, such as ada@desk, whose run is dead."
    ),
]

# Used without an inventory: a MIRTE as it is delivered, on a cable or on its own access point.
STOCK_ROBOT = Robot("mirte", {"wired": "10.42.0.1", "ap": "192.168.42.1"})

_MAX_PARALLEL = 20
Result = TypeVar("Result")


def select_subject(
    path: Path | None,
    names: Sequence[str] | None,
    *,
    local: bool,
    host: str = "",
    every: bool = False,
    limit: str | None = None,
) -> tuple[Config | None, list[Robot]]:
    """Return what a command acts on that works on robots and on this machine: an inventory and its chosen robots.

    One rule for all of these commands: `--local` means this machine, for which the inventory is None and there are no robots;
    otherwise it is the named robots, the one at the address `host`, or the default robot. Raises ConfigError.
    """
    if local:
        if names or host or every or limit:
            raise ConfigError("--local is this machine; it excludes --robot, --host, --all and --limit")
        return None, []
    if host and names:
        raise ConfigError("--robot and --host exclude each other")
    inventory = load(path)
    if host:
        if every or limit:
            raise ConfigError("--host is one robot; it excludes --all and --limit")
        inventory = Config(inventory.path)  # --host is an address, even if a robot has the same name
        names = [host]
    return inventory, select_robots(inventory, names, every=every, limit=limit)


def select_robots(config: Config, names: Sequence[str] | None, *, every: bool = False, limit: str | None = None) -> list[Robot]:
    """Return the chosen robots: all (that match `limit`), those named, or the default one. Raises ConfigError."""
    if every:
        if names:
            raise ConfigError("--all and --robot exclude each other; to select some robots: --all --limit PATTERN")
        if not config.robots:
            raise ConfigError(f"{config.path} has no robots", ADD_EXAMPLE)
        found = [robot for name, robot in config.robots.items() if limit is None or fnmatch.fnmatchcase(name, limit)]
        if not found:
            raise ConfigError(f"no robot matches --limit {limit}; the robots are {', '.join(config.robots)}")
        return found
    if limit is not None:
        raise ConfigError("--limit needs --all")
    if names:
        return [find_robot(config, name) for name in dict.fromkeys(names)]
    if config.default_robot:
        return [config.robots[config.default_robot]]
    if len(config.robots) > 1:
        raise ConfigError(
            f"which robot? name one of {', '.join(config.robots)} with --robot, or set default_robot in {config.path}"
        )
    return list(config.robots.values()) or [_connected_stock_robot(config)]


def _connected_stock_robot(config: Config) -> Robot:
    """Return the robot as it is delivered, at those of its addresses that are in a network of this machine. Raises ConfigError.

    Without an inventory, an answer from elsewhere would be that of another machine: its networks are private ones.
    """
    from ipaddress import IPv4Address, IPv4Interface

    import psutil

    own = [
        IPv4Interface(f"{each.address}/{each.netmask}").network
        for addresses in psutil.net_if_addrs().values()
        for each in addresses
        if each.family == socket.AF_INET and each.netmask
    ]
    near = {name: host for name, host in STOCK_ROBOT.addresses.items() if any(IPv4Address(host) in net for net in own)}
    if not near:
        raise ConfigError(
            f"which robot? {config.path} names none, and no interface of this machine is in a network of a robot as it is "
            f"delivered ({' or '.join(STOCK_ROBOT.addresses.values())}); plug its cable in, join its access point, or name it",
            ADD_EXAMPLE,
        )
    return replace(STOCK_ROBOT, addresses=near)


def find_robot(config: Config, name: str) -> Robot:
    """Return the robot `name` of the inventory, or one made from the address `name`. Raises ConfigError."""
    if name in config.robots:
        return config.robots[name]
    if not config.robots and name == STOCK_ROBOT.name:
        return STOCK_ROBOT
    from lupin_cli.connection.destination import parse_destination

    with contextlib.suppress(ValueError):
        user, host, port = parse_destination(name)
        if user or port or "." in host or ":" in host or not config.robots:
            address = f"[{host}]" if ":" in host else host
            return Robot(name, {"": f"{address}:{port}" if port else address}, user)
    near = difflib.get_close_matches(name, config.robots, n=1)
    hint = f"did you mean {near[0]}?" if near else f"its robots are {', '.join(config.robots)}"
    raise ConfigError(f"{config.path} has no robot {name!r}; {hint}")


def destinations(robot: Robot) -> dict[str, Destination]:
    """Return the destinations of `robot` by transport, best first; if a transport is pinned, only that. Raises TargetError."""
    from lupin_cli.connection.destination import parse_destination, resolve

    found = {}
    for transport in [robot.transport] if robot.transport else robot.addresses:
        _, host, port = parse_destination(robot.addresses[transport])
        try:
            found[transport] = resolve(host, robot.user, port, default_user=DEFAULT_USER)
        except SshConfigUnusable as error:
            raise SshConfigUnusable(f"{robot.name}: {error}", error.next_command) from error
    return found


def known_hosts_of(config: Config, accept: str = "") -> KnownHosts:
    """Return the accepted host keys; a person at a terminal may accept more."""
    from lupin_cli.connection.host_keys import KnownHosts

    return KnownHosts(config.known_hosts, confirm=_confirm if is_interactive() else None, accept=accept)


@contextlib.contextmanager
def connect(
    robot: Robot, config: Config | None = None, *, sudo_password: str | None = None, accept: str = ""
) -> Iterator[SshTarget]:
    """Yield an open connection to `robot` over its best transport that answers; close it at the end. Raises TargetError."""
    target = open_target(robot, config, sudo_password=sudo_password, accept=accept)
    try:
        target.connect()
        yield target
    finally:
        target.close()


def open_target(robot: Robot, config: Config | None = None, *, sudo_password: str | None = None, accept: str = "") -> SshTarget:
    """Return a target for `robot` over its best transport that answers; it connects on first use. Raises TargetError."""
    from lupin_cli.connection.connect import first_reachable
    from lupin_cli.connection.ssh import SshTarget

    choices = destinations(robot)
    transport = first_reachable(choices)
    return SshTarget(
        robot.name,
        choices[transport],
        known_hosts_of(config or load(), accept),
        transport_name=transport,
        ask_password=ask_hidden if is_interactive() else None,
        sudo_password=sudo_password,
    )


def for_each_robot(robots: Sequence[Robot], action: Callable[[Robot], Result]) -> dict[str, Result | TargetError]:
    """Call `action` for every robot in parallel. Return the results by name; a robot that fails has its TargetError."""

    def guarded(robot: Robot) -> Result | TargetError:
        try:
            return action(robot)
        except TargetError as error:
            return error

    with ThreadPoolExecutor(max_workers=min(_MAX_PARALLEL, max(1, len(robots))), thread_name_prefix="robot") as pool:
        return dict(zip([robot.name for robot in robots], pool.map(guarded, robots)))


def one_after_another(
    verb: str, robots: Sequence[Robot], action: Callable[[Robot], tuple[dict[str, Any], int]]
) -> tuple[list[dict[str, Any]], int]:
    """Call `action` for one robot after another; it returns a report, for `--json`, and an exit status.

    A robot that fails with a TargetError, which is printed, has it as its report, and the others have their turn all the same.
    Return the reports and one exit status.
    """
    reports, codes = [], []
    for robot in robots:
        try:
            report, code = action(robot)
        except TargetError as error:
            print_error(verb, error)
            code = exit_code_of(error)
            problem = {"message": str(error), "next_command": complete(error.next_command), "exit_code": code}
            report = {"robot": robot.name, "error": problem}
        reports.append(report)
        codes.append(code)
    return reports, worst(codes)


@contextlib.contextmanager
def reporting_errors(verb: str) -> Iterator[None]:
    """Report an expected error of the block in one line, print the next command, and exit with the error's code."""
    try:
        yield
    except ConfigError as error:
        echo(f"lupin {verb}: {error}", err=True)
        print_next(error.next_command)
        raise typer.Exit(USAGE_ERROR) from error
    except TargetError as error:
        print_error(verb, error)
        raise typer.Exit(exit_code_of(error)) from error


def print_error(verb: str, error: TargetError) -> None:
    """Print one line with the error and one with the next command to type."""
    echo(f"lupin {verb}: {error}", err=True)
    print_next(error.next_command)


def exit_code_of(error: TargetError) -> int:
    """Return UNREACHABLE if there was no connection, FAILURE if something failed over one."""
    no_connection = Unreachable | HostKeyChanged | HostKeyUnknown | AuthenticationFailed | SshConfigUnusable
    return UNREACHABLE if isinstance(error, no_connection) else FAILURE


def ask_sudo_passwords(robots: Sequence[Robot]) -> dict[str, str]:
    """Ask for the sudo password of each robot, one after another; return them by the robot's name.

    It is asked before anything is started: threads would read from one terminal at the same time. Raises ConfigError without a
    terminal.
    """
    if not is_interactive():
        raise ConfigError("--ask-sudo-password needs a terminal")
    return {robot.name: getpass.getpass(printable(f"sudo password on {robot.name}: ")) for robot in robots}


def _confirm(question: str) -> bool:
    erase_status_line()
    echo(question, err=True)
    return confirm("Accept it")


def ask_hidden(prompt: str) -> str:
    """Ask a person for a secret, which is not shown while it is typed."""
    erase_status_line()
    return getpass.getpass(printable(prompt))
