"""`lupin robots`: list, add, remove, rename and check the robots of the inventory."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from lupin_cli.command_group import command_group
from lupin_cli.connection.base import ROOT_REFUSED, Output, Script, Target, TargetError
from lupin_cli.connection.inventory import ADD_EXAMPLE, TRANSPORTS, Config, ConfigError, Robot, load, parse
from lupin_cli.connection.options import (
    ALL,
    ASK_SUDO,
    CONFIG,
    LIMIT,
    STOCK_ROBOT,
    ask_sudo_passwords,
    complete_robots,
    destinations,
    exit_code_of,
    find_robot,
    for_each_robot,
    known_hosts_of,
    open_target,
    print_error,
    reporting_errors,
    select_robots,
)
from lupin_cli.exit_codes import FAILURE, SUCCESS, UNREACHABLE, worst
from lupin_cli.printed_commands import lupin, print_next
from lupin_cli.terminal import echo, printable
from lupin_runtime.bounded_file import read_bounded_text

app = command_group("List, add, remove, rename and check the robots of the inventory.", "lupin robots")

_JSON = Annotated[bool, typer.Option("--json", help="Print only JSON on standard output.")]
_DRY_RUN = Annotated[bool, typer.Option("--dry-run", help="Print the new lupin.toml and write nothing.")]
_NAME = Annotated[str, typer.Argument(help="The robot's name.", autocompletion=complete_robots)]


@app.callback(invoke_without_command=True)
def _list_by_default(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        list_robots()


@app.command("list")
def list_robots(config: CONFIG = None, as_json: _JSON = False) -> None:
    """List the robots, their addresses, and whether their host keys are accepted.

    Example: lupin robots list
    """
    with reporting_errors("robots"):
        inventory = load(config)
        robots = list(inventory.robots.values()) or [STOCK_ROBOT]
        known_hosts = known_hosts_of(inventory)
        rows: list[dict[str, Any]] = []
        codes = [SUCCESS]
        for robot in robots:
            row: dict[str, Any] = {
                "name": robot.name,
                "user": robot.user,
                "addresses": dict(robot.addresses),
                "default": robot.name == inventory.default_robot or len(robots) == 1,
                "destinations": {},
                "host_key_accepted": False,
            }
            try:
                places = destinations(robot)
                row["user"] = next(iter(places.values())).user
                row["destinations"] = {transport: place.with_way for transport, place in places.items()}
                row["host_key_accepted"] = any(known_hosts.key_types(robot.name, place) for place in places.values())
            except TargetError as error:  # the others are listed all the same
                print_error("robots", error)
                codes.append(exit_code_of(error))
                row["error"] = str(error)
            rows.append(row)
    if as_json:
        print(json.dumps({"path": str(inventory.path), "robots": rows}))
        raise typer.Exit(worst(codes))
    cells = []
    for row in rows:
        addresses = ", ".join(f"{transport} {address}" for transport, address in row["addresses"].items())
        accepted = "accepted" if row["host_key_accepted"] else "not accepted yet"
        cells.append((f"{row['name']}{' *' if row['default'] else ''}", row["user"], addresses, accepted))
    _print_table(("robot", "user", "addresses", "host key"), cells)
    if not inventory.robots:
        echo(f"{inventory.path} has no robots; the one shown is a robot as delivered. Add yours:")
        echo(f"  {ADD_EXAMPLE}", wrap=False)
    raise typer.Exit(worst(codes))


@app.command()
def add(
    name: _NAME,
    address: Annotated[str, typer.Argument(help="[user@]host[:port]; the host may be an alias of ~/.ssh/config.")],
    transport: Annotated[str, typer.Option("--transport", help="Use the address for wired, router or ap.")] = "wired",
    config: CONFIG = None,
    dry_run: _DRY_RUN = False,
) -> None:
    """Add a robot, or another address of a robot, to lupin.toml.

    Example: lupin robots add greenhouse mirte@10.42.0.1
    """
    with reporting_errors("robots"):
        path, before = _read_inventory(config)
        after = _with_address(before, path, name, address, transport)
        if dry_run:
            echo(after, nl=False, wrap=False)
            return
        _write(path, after)
        echo(f"added {name} to {path}: {transport} at {address.split('@')[-1]}")
        print_next(lupin("robots", "check", name))


@app.command()
def forget(name: _NAME, config: CONFIG = None) -> None:
    """Forget the accepted host key of a robot, for example after it was reinstalled.

    Example: lupin robots forget greenhouse
    """
    with reporting_errors("robots"):
        inventory = load(config)
        removed = _forget_key(inventory, find_robot(inventory, name))
    _print_forgotten(name, removed)


@app.command()
def remove(name: _NAME, config: CONFIG = None, dry_run: _DRY_RUN = False) -> None:
    """Remove a robot from lupin.toml, and forget its host key.

    Example: lupin robots remove greenhouse --dry-run
    """
    from lupin_cli.connection.inventory_text import without_robot

    with reporting_errors("robots"):
        inventory = load(config)
        robot = _require_known(inventory, name)
        after = without_robot(read_bounded_text(inventory.path), name)
        if name in parse(after, inventory.path).robots:
            raise ConfigError(f"{name} is not in a table [robots.{name}] of its own; remove it in {inventory.path}")
        if dry_run:
            echo(after, nl=False, wrap=False)
            return
        removed = [f"[robots.{name}] in {inventory.path}", *_forget_key(inventory, robot)]
        _write(inventory.path, after)
    _print_forgotten(name, removed)


@app.command()
def rename(
    name: _NAME,
    new_name: Annotated[str, typer.Argument(help="Its new name.")],
    config: CONFIG = None,
    dry_run: _DRY_RUN = False,
) -> None:
    """Give a robot another name in lupin.toml, and keep its accepted host key.

    Example: lupin robots rename greenhouse glasshouse
    """
    from lupin_cli.connection.inventory_text import with_renamed_robot

    with reporting_errors("robots"):
        inventory = load(config)
        _require_known(inventory, name)
        if new_name in inventory.robots:
            raise ConfigError(f"{inventory.path} has a robot {new_name!r} already")
        after = with_renamed_robot(read_bounded_text(inventory.path), name, new_name)
        found = parse(after, inventory.path).robots
        if new_name not in found or name in found:
            raise ConfigError(f"{name} is not in a table [robots.{name}] of its own; rename it in {inventory.path}")
        if dry_run:
            echo(after, nl=False, wrap=False)
            return
        _write(inventory.path, after)
        kept = known_hosts_of(inventory).rename(name, new_name)
    echo(f"{name} is now {new_name} in {inventory.path}" + ("; its host key stays accepted" if kept else ""))


def _require_known(inventory: Config, name: str) -> Robot:
    if name not in inventory.robots:
        find_robot(inventory, name)  # raises with the nearest name, unless it is an address
        raise ConfigError(f"{inventory.path} has no robot {name!r}")
    return inventory.robots[name]


def _forget_key(inventory: Config, robot: Robot) -> list[str]:
    return known_hosts_of(inventory).forget(robot.name, list(destinations(robot).values()))


def _print_forgotten(name: str, removed: list[str]) -> None:
    for entry in removed:
        echo(f"forgot {entry}")
    if not removed:
        echo(f"nothing to forget: no host key of {name} is accepted")


@dataclass(frozen=True)
class CheckResult:
    """What `check` found out about one robot; its fields are the keys of `--json`.

    `error` is empty if all requests succeeded. A robot that was reached, and then failed a request, has both.
    """

    robot: str
    reached: bool
    transport: str = ""
    address: str = ""
    system: str = ""
    python: str = ""
    root: str = ""  # "yes", "with a password", or the reason why not
    rtt_ms: float | None = None
    error: str = ""
    next_command: str = ""


@app.command()
def check(
    names: Annotated[
        list[str] | None, typer.Argument(help="Robots [the default robot].", autocompletion=complete_robots)
    ] = None,
    every: ALL = False,
    limit: LIMIT = None,
    accept: Annotated[str, typer.Option("--accept", help="Accept the host key with this SHA256 fingerprint.")] = "",
    config: CONFIG = None,
    as_json: _JSON = False,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Connect to robots; show the transport, the system, and whether root is available.

    Exit status: 0 every robot answered every request, 1 one was logged in to but failed a request, 2 usage error or an
    unreadable inventory, 3 one cannot be reached or logged in to.

    Example: lupin robots check --all
    """
    with reporting_errors("robots"):
        inventory = load(config)
        chosen = select_robots(inventory, names, every=every, limit=limit)
        if accept and len(chosen) > 1:
            raise ConfigError("--accept is for one robot, because each has its own host key")
        passwords = ask_sudo_passwords(chosen) if ask_sudo else {}
        found = for_each_robot(chosen, lambda robot: _check(robot, inventory, accept, passwords.get(robot.name)))
    results = [_unreached(name, each) if isinstance(each, TargetError) else each for name, each in found.items()]
    if as_json:
        print(json.dumps([asdict(result) for result in results]))
    else:
        answered = [result for result in results if not result.error]
        if answered:
            _print_table(
                ("robot", "transport", "address", "system", "python3", "root", "round trip"),
                [(r.robot, r.transport, r.address, r.system, r.python, r.root, f"{r.rtt_ms:.1f} ms") for r in answered],
            )
        for result in results:
            if result.error:
                print_error("robots", TargetError(result.error, result.next_command))
    raise typer.Exit(worst(UNREACHABLE if not result.reached else FAILURE if result.error else SUCCESS for result in results))


def _check(robot: Robot, config: Config, accept: str, sudo_password: str | None) -> CheckResult:
    """Log in and ask for the robot's properties. Raises TargetError if it cannot be logged in to."""
    target = open_target(robot, config, sudo_password=sudo_password, accept=accept)
    try:
        target.connect()
        reached = CheckResult(robot.name, True, target.transport_name, str(target.destination))
        try:
            return _ask(target, reached, sudo_password)
        except TargetError as error:
            return replace(reached, error=str(error), next_command=error.next_command)
    finally:
        target.close()


def _ask(target: Target, reached: CheckResult, sudo_password: str | None) -> CheckResult:
    """Complete the result with the robot's properties. Raises TargetError if a request fails or does not finish."""
    outputs = target.batch(
        [
            Script("system", '. /etc/os-release; echo "$PRETTY_NAME, $(uname -m)"'),
            Script("python", "python3 -I -c 'import sys; print(sys.version.split()[0])'"),
            Script("root", "id -u", root=True),
        ]
    )
    start = time.monotonic()
    nothing = target.batch([Script("nothing", ":")])
    rtt_ms = (time.monotonic() - start) * 1e3
    for name, output in {**outputs, **nothing}.items():
        if output.status is None and not output.stderr.startswith(ROOT_REFUSED):
            raise TargetError(
                f"{target.name} was logged in to, but the request {name!r} was not answered: {output.stderr.strip()}",
                lupin("doctor", robot=target.name),
            )
    return replace(
        reached,
        system=outputs["system"].stdout.strip() or "unknown",
        python=outputs["python"].stdout.strip() or "none",
        root=_root_access(outputs["root"], sudo_password),
        rtt_ms=rtt_ms,
    )


def _root_access(output: Output, sudo_password: str | None) -> str:
    if output.stdout.strip() != "0":
        return output.stderr.removeprefix(ROOT_REFUSED)
    return "yes" if sudo_password is None else "with a password"


def _unreached(name: str, error: TargetError) -> CheckResult:
    return CheckResult(name, False, error=str(error), next_command=error.next_command)


def _read_inventory(config: Path | None) -> tuple[Path, str]:
    """Return the path and the text of the file to edit. A file named with --config need not exist yet."""
    if config is not None and not config.exists():
        return config, ""
    path = load(config).path
    return path, read_bounded_text(path) if path.exists() else ""


def _with_address(text: str, path: Path, name: str, address: str, transport: str) -> str:
    """Return the inventory's text with the address added to the robot `name`. Raises ConfigError."""
    from lupin_cli.connection.destination import parse_destination
    from lupin_cli.connection.inventory_text import with_address, with_robot, without_robot

    if transport not in TRANSPORTS:
        raise ConfigError(f"--transport must be one of {', '.join(TRANSPORTS)}")
    try:
        user, host, port = parse_destination(address)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    host_and_port = (f"[{host}]" if ":" in host else host) + (f":{port}" if port else "")
    known = parse(text, path).robots.get(name)
    if known is None:
        after = with_robot(text, Robot(name, {transport: host_and_port}, user))
        parse(after, path)  # raises before a file is written that cannot be read
        return after
    if transport in known.addresses:
        existing = known.addresses[transport]
        raise ConfigError(f"{name} already has the {transport} address {existing}; change it in {path}")
    addresses = {**known.addresses, transport: host_and_port}
    ranked = {each: addresses[each] for each in TRANSPORTS if each in addresses}
    wanted = replace(known, addresses=ranked, user=user or known.user)
    after = with_address(text, name, transport, host_and_port)
    if parse(after, path).robots[name] != wanted:
        # Its addresses have no table of their own, or its user changes: its tables are written anew, without their comments.
        after = with_robot(without_robot(text, name, keep_default=True), wanted)
        parse(after, path)
    return after


def _write(path: Path, text: str) -> None:
    from lupin_cli.connection.local import LocalTarget

    path.parent.mkdir(parents=True, exist_ok=True)
    LocalTarget().put(str(path), text.encode())


def _print_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    from rich.measure import Measurement
    from rich.table import Table
    from rich.text import Text

    from lupin_cli.safe_console import SafeConsole

    console = SafeConsole()
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in columns:
        table.add_column(column, overflow="fold")
    shown = list(rows)
    for row in shown:
        table.add_row(*(Text(printable(cell)) for cell in row))
    if Measurement.get(console, console.options, table).minimum <= console.width:
        console.print(table)
        return
    for row in shown:  # columns that are too narrow for their words would break them
        for column, cell in zip(columns, row):
            echo(f"{column:12} {cell}")
        echo()
