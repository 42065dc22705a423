"""`lupin bundle`: what somebody else needs to see what is wrong, in one file, without what nobody else should see."""

from __future__ import annotations

import contextlib
import json
import re
import signal
import sys
import time
from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lupin_cli.robot_options import ALL, ASK_SUDO, CONFIG, LIMIT

if TYPE_CHECKING:
    from lupin_cli.bundle.assembly import Contents
    from lupin_cli.bundle.gathering import Gathering
    from lupin_cli.config import Config, Robot

WHOLE, GAPS, USAGE, UNREACHABLE, FAILED = 0, 1, 2, 3, 4
_SPAN = re.compile(r"(\d+(?:\.\d+)?)([smhd])\Z")
_SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}


def command(
    robot: Annotated[str, typer.Option("--robot", "-r", help="A robot of lupin.toml, or [user@]host[:port].")] = "",
    host: Annotated[str, typer.Option("--host", help="The robot at this address, whatever lupin.toml says.")] = "",
    every: ALL = False,
    limit: LIMIT = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The archive; else lupin-bundle-DATE-TIME.tar.gz here.")
    ] = None,
    since: Annotated[str, typer.Option("--since", help="Journals of the last 90s, 30m, 1h, 2d; else since the boot.")] = "",
    force: Annotated[bool, typer.Option("--force", help="Write over an archive that is there already.")] = False,
    mask_users: Annotated[bool, typer.Option("--mask-users", help="Give the names in home paths other names too.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Gather and mask, list what would go in, write nothing.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, alone on standard output.")] = False,
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Pack facts, findings, logs and settings into one archive for somebody else, without passwords, keys, names of networks.

    Without --robot it is about this machine alone. It only reads, there as here. Look through the archive before you send it.

    Exit status: 0 whole, 1 made, but something could not be read, 2 usage, 3 made, but a robot can't be reached, 4 not made.
    """
    if robot and host:
        _usage("--robot and --host exclude each other")
    if (every or limit) and (robot or host):
        _usage("--all takes every robot of lupin.toml; name one with --robot, or take some with --all --limit PATTERN")
    since_s = _since(since)
    made = time.time()
    stamp = datetime.fromtimestamp(made, timezone.utc).strftime("%Y%m%d-%H%M%S")
    path = (out or Path(f"lupin-bundle-{stamp}.tar.gz")).expanduser()
    if not dry_run:
        _check(path, force)
    gathering = _gathering(robot, host, every, limit, config, ask_sudo, since_s)
    options = {"robots": [each.name for each in gathering.robots], "since": since, "mask_users": mask_users}
    size = 0
    with _terminable():
        try:
            contents = _contents(gathering, options, made, mask_users)
        finally:
            gathering.close()
        if not dry_run:
            size = _write(path, contents, stamp, made, force)
    status = _status(gathering, contents)
    told = _told(gathering, contents, status, None if dry_run else path, size)
    if as_json:
        print(json.dumps(told, indent=2))
    else:
        _tell(told, dry_run)
    raise typer.Exit(status)


def _usage(message: str) -> None:
    typer.echo(f"lupin bundle: {message}; see: lupin bundle --help", err=True)
    raise typer.Exit(USAGE)


@contextlib.contextmanager
def _terminable() -> Iterator[None]:
    """Within the block SIGTERM is as Ctrl-C: both leave nothing behind."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _since(text: str) -> float | None:
    found = _SPAN.match(text.strip())
    if text and (not found or float(found[1]) <= 0):
        _usage(f"--since takes a span such as 90s, 30m, 1h or 2d, not {text!r}")
    return float(found[1]) * _SECONDS[found[2]] if found else None


def _progress(line: str) -> None:
    typer.echo(f"lupin bundle: {line}", err=True)


def _check(path: Path, force: bool) -> None:
    from lupin_cli.bundle.archive import CannotWrite, check_place

    try:
        check_place(path, force=force)
    except CannotWrite as error:
        typer.echo(f"lupin bundle: {error}", err=True)
        raise typer.Exit(USAGE) from error


def _gathering(
    robot: str, host: str, every: bool, limit: str | None, config_path: Path | None, ask_sudo: bool, since_s: float | None
) -> Gathering:
    from lupin_cli.bundle.gathering import Gathering
    from lupin_cli.checks.table import built_in, plugged_in
    from lupin_cli.config import Config, load
    from lupin_cli.robot_options import ask_sudo_password, named, reporting, select
    from lupin_cli.target.local import LocalTarget

    added, broken = plugged_in()
    checks = (*built_in(), *added)
    chosen: list[Robot] = []
    inventory: Config | None = None
    passwords: dict[str, str] = {}
    if robot or host or every or limit:
        with reporting("bundle"):
            inventory = load(config_path)
            if host:
                inventory = Config(inventory.path)  # an address means itself, also where a robot is called the same
            chosen = select(inventory, None, every=True, limit=limit) if every or limit else [named(inventory, host or robot)]
            passwords = {each.name: ask_sudo_password(each.name) for each in chosen if ask_sudo}
    return Gathering(checks, broken, LocalTarget(), chosen, inventory, passwords, since_s)


def _contents(gathering: Gathering, options: dict[str, Any], made: float, mask_users: bool) -> Contents:
    from lupin_cli import __version__
    from lupin_cli.bundle import here
    from lupin_cli.bundle.assembly import assemble
    from lupin_cli.bundle.pieces import LeftOut, Piece
    from lupin_cli.bundle.redaction import Redactor
    from lupin_cli.config import config_directory

    found = gathering(_progress)
    place = gathering.config.path if gathering.config else config_directory() / "lupin.toml"
    found += [here.lupin(options), *here.of_lupin(place, gathering.since_s)]
    _progress("masking ...")
    about = {
        "lupin": __version__,
        "made": datetime.fromtimestamp(made, timezone.utc).isoformat(timespec="seconds"),
        "options": options,
        "robots": _robots(gathering),
    }
    redactor = Redactor(gathering.secrets, users=mask_users)
    pieces = [each for each in found if isinstance(each, Piece)]
    return assemble(pieces, [each for each in found if isinstance(each, LeftOut)], redactor, about)


def _robots(gathering: Gathering) -> list[dict[str, Any]]:
    return [
        {"name": link.robot, "address": link.address, "unreachable": link.kind or None, "message": link.message or None}
        for link in gathering.links
    ]


def _status(gathering: Gathering, contents: Contents) -> int:
    from lupin_cli.bundle.pieces import GAPS as KINDS
    from lupin_cli.bundle.pieces import UNREACHABLE as LOST

    kinds = {each.kind for each in contents.left_out}
    if LOST in kinds or any(not link.reachable for link in gathering.links):
        return UNREACHABLE
    return GAPS if kinds & KINDS else WHOLE


def _write(path: Path, contents: Contents, stamp: str, made: float, force: bool) -> int:
    from lupin_cli.bundle.archive import CannotWrite, pack, write

    data = pack(contents.members, f"lupin-bundle-{stamp}", made)
    try:
        write(path, data, force=force)
    except CannotWrite as error:
        typer.echo(f"lupin bundle: {error}", err=True)
        raise typer.Exit(FAILED) from error
    return len(data)


def _told(gathering: Gathering, contents: Contents, status: int, path: Path | None, size: int) -> dict[str, Any]:
    return {
        "status": status,
        "path": str(path) if path else None,
        "bytes": size,
        "bytes_unpacked": contents.size,
        "robots": _robots(gathering),
        "files": [{"path": each.path, "what": each.what, "bytes": len(each.data)} for each in contents.members],
        "left_out": [{"path": each.path, "kind": each.kind, "reason": each.reason} for each in contents.left_out],
        "masked": contents.masked,
    }


def _tell(told: dict[str, Any], dry_run: bool) -> None:
    from lupin_cli.bundle.pieces import ABSENT
    from lupin_cli.report import printable

    lost = {f"robots/{link['name']}" for link in told["robots"] if link["unreachable"]}
    for link in told["robots"]:
        if link["unreachable"]:
            typer.echo(f"lupin bundle: {printable(str(link['message']))}; the rest goes in without it", err=True)
    if dry_run:
        for row in told["files"]:
            typer.echo(f"{_size(row['bytes']):>9}  {printable(row['path']):<52} {row['what']}")
    for row in told["left_out"]:
        if dry_run or (row["kind"] != ABSENT and row["path"] not in lost):
            typer.echo(f"{'-':>9}  {printable(row['path'])}: {row['kind']}: {printable(row['reason'])}")
    masked = ", ".join(f"{count} {kind}" for kind, count in told["masked"].items()) or "nothing"
    if dry_run:
        typer.echo(f"{len(told['files'])} files, {_size(told['bytes_unpacked'])} unpacked, would go in; masked: {masked}")
        typer.echo("nothing was written")
        return
    typer.echo(f"{told['path']}: {len(told['files'])} files, {_size(told['bytes'])} ({_size(told['bytes_unpacked'])} unpacked)")
    typer.echo(f"masked: {masked}")
    typer.echo("masking goes by rules: look through it before you send it:")
    typer.echo(f"  tar -xOzf {told['path']} | less")
    sys.stdout.flush()


def _size(count: int) -> str:
    for unit, size in (("MB", 1_000_000), ("kB", 1_000)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count} B"
