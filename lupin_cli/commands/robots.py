"""`lupin robots`: the inventory, and whether its robots answer."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lupin_cli.config import TRANSPORTS, Config, ConfigError, Robot, load
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.robot_options import (
    ALL,
    ASK_SUDO,
    CONFIG,
    LIMIT,
    STOCK,
    ask_sudo_password,
    destinations,
    named,
    on_each,
    open_target,
    reporting,
    say,
    select,
    status_of,
    trust_of,
)
from lupin_cli.target.base import Script, TargetError

if TYPE_CHECKING:
    from rich.table import Table

app = typer.Typer(
    help="The robots that Lupin knows: list, add, forget, check.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

_JSON = Annotated[bool, typer.Option("--json", help="Print JSON, alone on standard output.")]
_NAME = Annotated[str, typer.Argument(help="The robot's name.")]


@app.callback(invoke_without_command=True)
def _list_by_default(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        list_robots()


@app.command("list")
def list_robots(config: CONFIG = None, as_json: _JSON = False) -> None:
    """List the inventory: names, addresses, and whose host key is accepted."""
    with reporting("robots"):
        found = load(config)
        robots = list(found.robots.values()) or [STOCK]
        trust = trust_of(found)
        rows: list[dict[str, Any]] = []
        for robot in robots:
            places = destinations(robot)
            known = any(trust.known(robot.name, place)[0] for place in places.values())
            rows.append(
                {
                    "name": robot.name,
                    "user": next(iter(places.values())).user,
                    "addresses": dict(robot.addresses),
                    "default": robot.name == found.default_robot or len(robots) == 1,
                    "host_key_accepted": known,
                }
            )
    if as_json:
        typer.echo(json.dumps({"path": str(found.path), "robots": rows}))
        return
    table = _table("robot", "user", "addresses", "host key")
    for row in rows:
        addresses = ", ".join(f"{transport} {address}" for transport, address in row["addresses"].items())
        accepted = "accepted" if row["host_key_accepted"] else "not seen yet"
        table.add_row(f"{row['name']}{' *' if row['default'] else ''}", row["user"], addresses, accepted)
    _print(table)
    if not found.robots:
        typer.echo(f"{found.path} has no robots: this is the one as it comes. lupin robots add NAME ADDRESS")


@app.command()
def add(
    name: _NAME,
    address: Annotated[str, typer.Argument(help="[user@]host[:port]; the host may be an alias of ~/.ssh/config.")],
    transport: Annotated[str, typer.Option("--transport", help="What the address stands on: wired, router or ap.")] = "wired",
    config: CONFIG = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the file as it would be, and write nothing.")] = False,
) -> None:
    """Add a robot, or another address of one, to lupin.toml."""
    with reporting("robots"):
        path, before = _inventory_text(config)
        after = _with_address(before, path, name, address, transport)
        if dry_run:
            typer.echo(after, nl=False)
            return
        _write(path, after)
        typer.echo(f"{path}: {name} by {transport} at {address.split('@')[-1]}. Next: lupin robots check {name}")


@app.command()
def forget(
    name: _NAME,
    from_inventory: Annotated[bool, typer.Option("--remove", help="Take the robot out of lupin.toml as well.")] = False,
    config: CONFIG = None,
) -> None:
    """Forget the accepted host key of a robot, as after it was installed anew."""
    with reporting("robots"):
        found = load(config)
        robot = named(found, name)
        dropped = trust_of(found).forget(name, list(destinations(robot).values()))
        if from_inventory and name in found.robots:
            from lupin_cli.config import without_robot

            _write(found.path, without_robot(found.path.read_text(), name))
            dropped.append(f"[robots.{name}] in {found.path}")
    for what in dropped:
        typer.echo(f"forgot {what}")
    if not dropped:
        typer.echo(f"no key of {name} was accepted; there is nothing to forget")


@dataclass(frozen=True)
class Answer:
    """What a robot said when it was asked."""

    robot: str
    reached: bool
    transport: str = ""
    address: str = ""
    system: str = ""
    python: str = ""
    root: str = ""  # without a password, with one, or why not
    rtt_ms: float | None = None
    error: str = ""
    next_command: str = ""


@app.command()
def check(
    names: Annotated[list[str] | None, typer.Argument(help="Robots; none for the one that goes without saying.")] = None,
    every: ALL = False,
    limit: LIMIT = None,
    accept: Annotated[str, typer.Option("--accept", help="Accept the host key with this SHA256 fingerprint.")] = "",
    config: CONFIG = None,
    as_json: _JSON = False,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Connect, and say who answers over which transport and whether root can be had.

    Exit status: 0 every robot answered, 1 one did but something in it failed, 3 one can't be reached.
    """
    with reporting("robots"):
        found = load(config)
        chosen = select(found, names, every=every, limit=limit)
        if accept and len(chosen) > 1:
            raise ConfigError("--accept is for one robot: each has a key of its own")
        password = ask_sudo_password(chosen[0].name) if ask_sudo else None
        answers = on_each(chosen, lambda robot: _ask(robot, found, accept, password))
    if as_json:
        typer.echo(json.dumps([asdict(_answer(name, answer)) for name, answer in answers.items()]))
    else:
        table = _table("robot", "by", "address", "system", "python3", "root", "round trip")
        for answer in answers.values():
            if isinstance(answer, Answer):
                rtt = f"{answer.rtt_ms:.1f} ms"
                table.add_row(answer.robot, answer.transport, answer.address, answer.system, answer.python, answer.root, rtt)
        if table.row_count:
            _print(table)
        for answer in answers.values():
            if isinstance(answer, TargetError):
                say("robots", answer)
    raise typer.Exit(max((status_of(answer) for answer in answers.values() if isinstance(answer, TargetError)), default=0))


def _ask(robot: Robot, config: Config, accept: str, sudo_password: str | None) -> Answer:
    import time

    target = open_target(robot, config, sudo_password=sudo_password, accept=accept)
    try:
        target.connect()
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
    root = outputs["root"]
    granted = "with a password" if sudo_password is not None else "yes"
    return Answer(
        robot.name,
        True,
        target.transport_name,
        str(target.destination),
        outputs["system"].stdout.strip() or "unknown",
        outputs["python"].stdout.strip() or "none",
        granted if root.stdout.strip() == "0" else root.stderr.removeprefix("root refused: "),
        rtt_ms,
    )


def _answer(name: str, answer: Answer | TargetError) -> Answer:
    if isinstance(answer, Answer):
        return answer
    return Answer(name, False, error=str(answer), next_command=answer.next_command)


def _inventory_text(config: Path | None) -> tuple[Path, str]:
    """The file that will be written, and what is in it; a named file need not exist yet."""
    if config is not None and not config.exists():
        return config, ""
    path = load(config).path
    return path, path.read_text() if path.exists() else ""


def _with_address(text: str, path: Path, name: str, address: str, transport: str) -> str:
    from lupin_cli.config import parse, with_robot
    from lupin_cli.target.destination import parse_destination

    if transport not in TRANSPORTS:
        raise ConfigError(f"--transport must be one of {', '.join(TRANSPORTS)}")
    try:
        user, host, port = parse_destination(address)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    bare = f"[{host}]" if ":" in host else host
    bare += f":{port}" if port else ""
    robots = parse(text, path).robots
    robot = Robot(name, {transport: bare}, user)
    if name in robots:
        known = robots[name]
        if transport in known.addresses:
            raise ConfigError(
                f"{name} has the address {known.addresses[transport]} for {transport} already; change it in {path}"
            )
        from lupin_cli.config import without_robot

        both = {
            kind: {**known.addresses, transport: bare}[kind] for kind in TRANSPORTS if kind in {*known.addresses, transport}
        }
        robot = replace(known, addresses=both, user=user or known.user)
        text = without_robot(text, name)
    after = with_robot(text, robot)
    parse(after, path)  # nothing is written that could not be read
    return after


def _write(path: Path, text: str) -> None:
    from lupin_cli.target.local import LocalTarget

    path.parent.mkdir(parents=True, exist_ok=True)
    LocalTarget().put(str(path), text.encode())


def _table(*columns: str) -> Table:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def _print(table: Table) -> None:
    from rich.console import Console

    Console().print(table)
