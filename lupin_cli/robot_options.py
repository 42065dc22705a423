"""The options by which every command names its robots, and the way from a name to an open target.

def command(robot: ROBOT = None, every: ALL = False, limit: LIMIT = None, config: CONFIG = None) -> None:
    with reporting("doctor"):
        chosen = select(load(config), robot, every=every, limit=limit)
        with connect(chosen[0]) as target: ...
        results = on_each(chosen, lambda robot: ...)
"""

from __future__ import annotations

import contextlib
import fnmatch
import getpass
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from lupin_cli.config import DEFAULT_USER, Config, ConfigError, Robot, load
from lupin_cli.target.base import TargetError, Unreachable

if TYPE_CHECKING:
    from lupin_cli.target.destination import Destination
    from lupin_cli.target.ssh import SshTarget
    from lupin_cli.target.trust import Trust

USAGE_ERROR, UNREACHED = 2, 3

ROBOT = Annotated[
    list[str] | None, typer.Option("--robot", "-r", help="A robot of lupin.toml, or [user@]host[:port]; may be given again.")
]
ALL = Annotated[bool, typer.Option("--all", help="Every robot of lupin.toml, side by side.")]
LIMIT = Annotated[
    str | None, typer.Option("--limit", help="With --all: only robots whose name fits this pattern, as in pot-*.")
]
CONFIG = Annotated[
    Path | None, typer.Option("--config", help="The inventory; else $LUPIN_CONFIG or lupin/lupin.toml in ~/.config.")
]
ASK_SUDO = Annotated[bool, typer.Option("--ask-sudo-password", "-K", help="Ask for the password of sudo on the robot.")]
BREAK_LEASE = Annotated[bool, typer.Option("--break-lease", help="Change the robot though another run holds its lease.")]

# Where there is no inventory: a MIRTE as it comes, on a cable or at its own access point.
STOCK = Robot("mirte", {"wired": "10.42.0.1", "ap": "192.168.42.1"})

_AT_ONCE = 20
Result = TypeVar("Result")


def select(config: Config, names: Sequence[str] | None, *, every: bool = False, limit: str | None = None) -> list[Robot]:
    """The robots that were meant: all of them, those named, or the one that goes without saying. Raises ConfigError."""
    if every:
        if names:
            raise ConfigError("--all and --robot exclude each other; to take some of all: --all --limit PATTERN")
        if not config.robots:
            raise ConfigError(f"{config.path} has no robots; add one: lupin robots add NAME ADDRESS")
        found = [robot for name, robot in config.robots.items() if limit is None or fnmatch.fnmatchcase(name, limit)]
        if not found:
            raise ConfigError(f"no robot of {', '.join(config.robots)} fits --limit {limit}")
        return found
    if limit is not None:
        raise ConfigError("--limit goes with --all")
    if names:
        return [named(config, name) for name in dict.fromkeys(names)]
    if config.default_robot:
        return [config.robots[config.default_robot]]
    if len(config.robots) > 1:
        raise ConfigError(f"which robot? say --robot with one of {', '.join(config.robots)}, or default_robot in {config.path}")
    return list(config.robots.values()) or [STOCK]


def named(config: Config, name: str) -> Robot:
    """The robot of the inventory, or one that an address describes. Raises ConfigError."""
    if name in config.robots:
        return config.robots[name]
    if not config.robots and name == STOCK.name:
        return STOCK
    from lupin_cli.target.destination import parse_destination

    with contextlib.suppress(ValueError):
        user, host, port = parse_destination(name)
        if user or port or "." in host or ":" in host or not config.robots:
            address = f"[{host}]" if ":" in host else host
            return Robot(name, {"": f"{address}:{port}" if port else address}, user)
    import difflib

    near = difflib.get_close_matches(name, config.robots, n=1)
    hint = f"did you mean {near[0]}?" if near else f"it knows {', '.join(config.robots)}"
    raise ConfigError(f"{config.path} has no robot {name!r}; {hint}")


def destinations(robot: Robot) -> dict[str, Destination]:
    """Where `robot` may be, by transport, best first; the pinned transport alone where one is pinned. Raises TargetError."""
    from lupin_cli.target.destination import resolve

    return {
        transport: resolve(host, robot.user, port, default_user=DEFAULT_USER) for transport, host, port in _addresses(robot)
    }


def _located(robot: Robot) -> dict[str, Destination]:
    """What `destinations` will say, where that can be told without paramiko; else nothing. Raises TargetError."""
    from lupin_cli.target.destination import located

    found = {transport: located(host, robot.user or DEFAULT_USER, port) for transport, host, port in _addresses(robot)}
    return {transport: place for transport, place in found.items() if place is not None}


def _addresses(robot: Robot) -> list[tuple[str, str, int]]:
    """Transport, host and port (or 0) of each address that counts."""
    from lupin_cli.target.destination import parse_destination

    wanted = [robot.transport] if robot.transport else list(robot.addresses)
    return [(transport, *parse_destination(robot.addresses[transport])[1:]) for transport in wanted]


def trust_of(config: Config, accept: str = "") -> Trust:
    """Lupin's accepted keys; on a terminal a person may accept more."""
    from lupin_cli.target.trust import Trust

    return Trust(config.known_hosts, ask=_confirm if _terminal() else None, accept=accept)


@contextlib.contextmanager
def connect(
    robot: Robot, config: Config | None = None, *, sudo_password: str | None = None, accept: str = ""
) -> Iterator[SshTarget]:
    """An open connection to `robot`, over the best of its transports that answers; closed at the end. Raises TargetError."""
    target = open_target(robot, config, sudo_password=sudo_password, accept=accept, at_once=True)
    try:
        target.connect()
        yield target
    finally:
        target.close()


def open_target(
    robot: Robot, config: Config | None = None, *, sudo_password: str | None = None, accept: str = "", at_once: bool = False
) -> SshTarget:
    """The target of `robot`; it connects when it is first used, which begins here where that is to be `at_once`."""
    from lupin_cli.target.reach import Knock, best_of

    knock = None
    early = _located(robot) if at_once else {}
    transport, destination = best_of(early or destinations(robot))
    with contextlib.ExitStack() as undone:
        if at_once and not (destination.jumps or destination.proxy_command):
            knock = Knock(destination)
            undone.callback(knock.forget)
        if early:
            destination = destinations(robot)[transport]  # with its keys
        from lupin_cli.target.ssh import SshTarget  # takes its time: paramiko

        target = SshTarget(
            robot.name,
            destination,
            trust_of(config or load(), accept),
            ask_password=_ask_password if _terminal() else None,
            sudo_password=sudo_password,
            knock=knock,
        )
        undone.pop_all()
    target.transport_name = transport
    return target


class Way:
    """The way to `robot`, gone beside other work: its target, and when it is connected with a shell that is ready."""

    def __init__(self, robot: Robot, config: Config, sudo_password: str | None = None) -> None:
        self._target: Future[SshTarget] = Future()
        self._ready: Future[None] = Future()
        threading.Thread(target=self._go, args=(robot, config, sudo_password), name="reach", daemon=True).start()

    def _go(self, robot: Robot, config: Config, sudo_password: str | None) -> None:
        try:
            target = open_target(robot, config, sudo_password=sudo_password, at_once=True)
            self._target.set_result(target)
            target.connect()
            target.get_ready()
        except BaseException as error:  # raised where it is waited for
            if not self._target.done():
                self._target.set_exception(error)
            self._ready.set_exception(error)
        else:
            self._ready.set_result(None)

    def target(self) -> SshTarget:
        """The target, connected or not. Raises what opening it raised."""
        return self._target.result()

    def wait(self) -> None:
        """Until it is connected. Raises TargetError, or what opening it raised."""
        self._ready.result()

    def settle(self, bound_s: float) -> None:
        """Until it is known whether it leads there, `bound_s` at most."""
        wait([self._ready], max(0.0, bound_s))

    def forget(self) -> None:
        """Whatever is opened is closed."""
        self._ready.add_done_callback(lambda _: None if self._target.exception() else self._target.result().close())


def on_each(robots: Sequence[Robot], action: Callable[[Robot], Result]) -> dict[str, Result | TargetError]:
    """`action` on every robot, side by side; a robot that fails gives its TargetError and disturbs no other."""

    def guarded(robot: Robot) -> Result | TargetError:
        try:
            return action(robot)
        except TargetError as error:
            return error

    with ThreadPoolExecutor(max_workers=min(_AT_ONCE, max(1, len(robots))), thread_name_prefix="robot") as pool:
        return dict(zip([robot.name for robot in robots], pool.map(guarded, robots)))


@contextlib.contextmanager
def reporting(verb: str) -> Iterator[None]:
    """Turn what is expected to go wrong into one line, the next command and a status: 2 usage, 3 the robot can't be reached,
    1 it was reached and something else failed."""
    try:
        yield
    except ConfigError as error:
        typer.echo(f"lupin {verb}: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    except TargetError as error:
        say(verb, error)
        raise typer.Exit(status_of(error)) from error


def say(verb: str, error: TargetError) -> None:
    """One line of what went wrong and one of what to type."""
    typer.echo(f"lupin {verb}: {error}", err=True)
    if error.next_command:
        typer.echo(f"  next: {error.next_command}", err=True)


def status_of(error: TargetError) -> int:
    """3 where no conversation came about, 1 where something in it failed."""
    from lupin_cli.target.base import AuthenticationFailed, HostKeyChanged, HostKeyUnknown

    return UNREACHED if isinstance(error, Unreachable | HostKeyChanged | HostKeyUnknown | AuthenticationFailed) else 1


def ask_sudo_password(robot: str) -> str:
    """The password of sudo, from the terminal. Raises ConfigError without one."""
    if not _terminal():
        raise ConfigError("--ask-sudo-password needs a terminal")
    return getpass.getpass(f"sudo password on {robot}: ")


def _terminal() -> bool:
    return sys.stdin.isatty() and sys.stderr.isatty()


def _confirm(question: str) -> bool:
    _take_the_line()
    typer.echo(question, err=True)
    return typer.confirm("Accept it", default=False, err=True)


def _ask_password(prompt: str) -> str:
    _take_the_line()
    return getpass.getpass(prompt)


def _take_the_line() -> None:
    """Where a line of progress stands, a question takes its place."""
    typer.echo("\r\x1b[K", nl=False, err=True)
