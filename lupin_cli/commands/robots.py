"""`lupin robots`: list, add, forget and check the robots of the inventory."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from lupin_cli.connection.base import ROOT_REFUSED, Output, Script, TargetError
from lupin_cli.connection.inventory import TRANSPORTS, Config, ConfigError, Robot, load, parse
from lupin_cli.connection.options import (
    ALL,
    ASK_SUDO,
    CONFIG,
    LIMIT,
    STOCK_ROBOT,
    ask_sudo_password,
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
from lupin_cli.exit_codes import SUCCESS
from lupin_cli.terminal import echo, printable

app = typer.Typer(
    help="List, add, forget and check the robots of the inventory.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

_JSON = Annotated[bool, typer.Option("--json", help="Print only JSON on standard output.")]
_NAME = Annotated[str, typer.Argument(help="The robot's name.")]


@app.callback(invoke_without_command=True)
def _list_by_default(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        list_robots()


@app.command("list")
def list_robots(config: CONFIG = None, as_json: _JSON = False) -> None:
    """List the robots, their addresses, and whether their host keys are accepted."""
    with reporting_errors("robots"):
        inventory = load(config)
        robots = list(inventory.robots.values()) or [STOCK_ROBOT]
        known_hosts = known_hosts_of(inventory)
        rows: list[dict[str, Any]] = []
        for robot in robots:
            places = destinations(robot)
            rows.append(
                {
                    "name": robot.name,
                    "user": next(iter(places.values())).user,
                    "addresses": dict(robot.addresses),
                    "default": robot.name == inventory.default_robot or len(robots) == 1,
                    "host_key_accepted": any(known_hosts.accepted_keys(robot.name, place)[0] for place in places.values()),
                }
            )
    if as_json:
        echo(json.dumps({"path": str(inventory.path), "robots": rows}))
        return
    cells = []
    for row in rows:
        addresses = ", ".join(f"{transport} {address}" for transport, address in row["addresses"].items())
        accepted = "accepted" if row["host_key_accepted"] else "not accepted yet"
        cells.append((f"{row['name']}{' *' if row['default'] else ''}", row["user"], addresses, accepted))
    _print_table(("robot", "user", "addresses", "host key"), cells)
    if not inventory.robots:
        echo(f"{inventory.path} has no robots; the one shown is a robot as delivered. Add yours: lupin robots add NAME ADDRESS")


@app.command()
def add(
    name: _NAME,
    address: Annotated[str, typer.Argument(help="[user@]host[:port]; the host may be an alias of ~/.ssh/config.")],
    transport: Annotated[str, typer.Option("--transport", help="Use the address for wired, router or ap.")] = "wired",
    config: CONFIG = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the new lupin.toml and write nothing.")] = False,
) -> None:
    """Add a robot, or another address of a robot, to lupin.toml."""
    with reporting_errors("robots"):
        path, before = _read_inventory(config)
        after = _with_address(before, path, name, address, transport)
        if dry_run:
            echo(after, nl=False)
            return
        _write(path, after)
        echo(f"added {name} to {path}: {transport} at {address.split('@')[-1]}. Next: lupin robots check {name}")


@app.command()
def forget(
    name: _NAME,
    from_inventory: Annotated[bool, typer.Option("--remove", help="Also remove the robot from lupin.toml.")] = False,
    config: CONFIG = None,
) -> None:
    """Forget the accepted host key of a robot, for example after it was reinstalled."""
    with reporting_errors("robots"):
        inventory = load(config)
        robot = find_robot(inventory, name)
        removed = known_hosts_of(inventory).forget(name, list(destinations(robot).values()))
        if from_inventory and name in inventory.robots:
            from lupin_cli.connection.inventory_text import without_robot

            _write(inventory.path, without_robot(inventory.path.read_text(), name))
            removed.append(f"[robots.{name}] in {inventory.path}")
    for entry in removed:
        echo(f"forgot {entry}")
    if not removed:
        echo(f"nothing to forget: no host key of {name} is accepted")


@dataclass(frozen=True)
class CheckResult:
    """What `check` found out about one robot; its fields are the keys of `--json`."""

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
    names: Annotated[list[str] | None, typer.Argument(help="Robots [the default robot].")] = None,
    every: ALL = False,
    limit: LIMIT = None,
    accept: Annotated[str, typer.Option("--accept", help="Accept the host key with this SHA256 fingerprint.")] = "",
    config: CONFIG = None,
    as_json: _JSON = False,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Connect to robots; show the transport, the system, and whether root is available.

    Exit status: 0 every robot answered, 1 one answered but a later request failed, 3 one cannot be reached.
    """
    with reporting_errors("robots"):
        inventory = load(config)
        chosen = select_robots(inventory, names, every=every, limit=limit)
        if accept and len(chosen) > 1:
            raise ConfigError("--accept is for one robot, because each has its own host key")
        password = ask_sudo_password(chosen[0].name) if ask_sudo else None
        found = for_each_robot(chosen, lambda robot: _check(robot, inventory, accept, password))
    errors = {name: result for name, result in found.items() if isinstance(result, TargetError)}
    results = [result for result in found.values() if isinstance(result, CheckResult)]
    if as_json:
        echo(
            json.dumps(
                [asdict(_failed_check(name, each) if isinstance(each, TargetError) else each) for name, each in found.items()]
            )
        )
    else:
        if results:
            _print_table(
                ("robot", "transport", "address", "system", "python3", "root", "round trip"),
                [(r.robot, r.transport, r.address, r.system, r.python, r.root, f"{r.rtt_ms:.1f} ms") for r in results],
            )
        for error in errors.values():
            print_error("robots", error)
    raise typer.Exit(max(map(exit_code_of, errors.values()), default=SUCCESS))


def _check(robot: Robot, config: Config, accept: str, sudo_password: str | None) -> CheckResult:
    target = open_target(robot, config, sudo_password=sudo_password, accept=accept)
    try:
        outputs = target.batch(
            [
                Script("system", '. /etc/os-release; echo "$PRETTY_NAME, $(uname -m)"'),
                Script("python", "python3 -c 'import sys; print(sys.version.split()[0])'"),
                Script("root", "id -u", root=True),
            ]
        )
        start = time.monotonic()
        target.batch([Script("nothing", ":")])
        rtt_ms = (time.monotonic() - start) * 1e3
    finally:
        target.close()
    return CheckResult(
        robot.name,
        True,
        target.transport_name,
        str(target.destination),
        outputs["system"].stdout.strip() or "unknown",
        outputs["python"].stdout.strip() or "none",
        _root_access(outputs["root"], sudo_password),
        rtt_ms,
    )


def _root_access(output: Output, sudo_password: str | None) -> str:
    if output.stdout.strip() != "0":
        return output.stderr.removeprefix(ROOT_REFUSED)
    return "yes" if sudo_password is None else "with a password"


def _failed_check(name: str, error: TargetError) -> CheckResult:
    return CheckResult(name, False, error=str(error), next_command=error.next_command)


def _read_inventory(config: Path | None) -> tuple[Path, str]:
    """Return the path and the text of the file to edit. A file named with --config need not exist yet."""
    if config is not None and not config.exists():
        return config, ""
    path = load(config).path
    return path, path.read_text() if path.exists() else ""


def _with_address(text: str, path: Path, name: str, address: str, transport: str) -> str:
    """Return the inventory's text with the address added to the robot `name`. Raises ConfigError."""
    from lupin_cli.connection.destination import parse_destination
    from lupin_cli.connection.inventory_text import with_robot, without_robot

    if transport not in TRANSPORTS:
        raise ConfigError(f"--transport must be one of {', '.join(TRANSPORTS)}")
    try:
        user, host, port = parse_destination(address)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    host_and_port = (f"[{host}]" if ":" in host else host) + (f":{port}" if port else "")
    robot = Robot(name, {transport: host_and_port}, user)
    known = parse(text, path).robots.get(name)
    if known is not None:
        if transport in known.addresses:
            existing = known.addresses[transport]
            raise ConfigError(f"{name} has the {transport} address {existing} already; change it in {path}")
        addresses = {**known.addresses, transport: host_and_port}
        ranked = {each: addresses[each] for each in TRANSPORTS if each in addresses}
        robot = replace(known, addresses=ranked, user=user or known.user)
        text = without_robot(text, name)
    after = with_robot(text, robot)
    parse(after, path)  # raises before a file is written that cannot be read
    return after


def _write(path: Path, text: str) -> None:
    from lupin_cli.connection.local import LocalTarget

    path.parent.mkdir(parents=True, exist_ok=True)
    LocalTarget().put(str(path), text.encode())


def _print_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in columns:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*(Text(printable(cell)) for cell in row))
    Console().print(table)
