"""`lupin bundle`: collect everything that a diagnosis by somebody else needs into one archive, with secrets masked."""

from __future__ import annotations

import json
import re
import sys
import time
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lupin_cli.connection.options import ALL, ASK_SUDO, CONFIG, HOST, LIMIT, LOCAL, ROBOT
from lupin_cli.exit_codes import FAILURE, NO_RESULT, SUCCESS, UNREACHABLE, USAGE_ERROR
from lupin_cli.terminal import echo, sigterm_as_ctrl_c

if TYPE_CHECKING:
    from lupin_cli.bundle.archive import Contents
    from lupin_cli.bundle.collect import Collector

_DURATION = re.compile(r"(\d+(?:\.\d+)?)([smhd])\Z")
_SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}


def command(
    robot: ROBOT = None,
    local: LOCAL = False,
    host: HOST = "",
    every: ALL = False,
    limit: LIMIT = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write to this file; default: lupin-bundle-DATE-TIME.tar.gz.")
    ] = None,
    since: Annotated[
        str, typer.Option("--since", help="Collect system journals of the last 90s, 30m, 1h, 2d; default: since boot.")
    ] = "",
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing archive.")] = False,
    mask_users: Annotated[bool, typer.Option("--mask-users", help="Mask user names in home paths, too.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Collect and mask, list the files, write nothing.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON on standard output.")] = False,
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Pack findings, facts, logs and settings into one archive, without passwords, keys and network names.

    It covers this machine and the default robot, or with --local only this machine. Nothing is changed on any machine. Look
    through the archive before you send it.

    Exit status: 0 complete, 1 written, but something could not be read, 2 usage, 3 written, but a robot cannot be reached,
    4 not written.

    Example: lupin bundle --local --dry-run
    """
    max_age_s = _parse_since(since)
    created_s = time.time()
    stamp = datetime.fromtimestamp(created_s, timezone.utc).strftime("%Y%m%d-%H%M%S")
    path = (out or Path(f"lupin-bundle-{stamp}.tar.gz")).expanduser()
    if not dry_run:
        _check_writable(path, force)
    collector = _collector(robot, local, host, every, limit, config, ask_sudo, max_age_s)
    options = {"robots": [each.name for each in collector.robots], "since": since, "mask_users": mask_users}
    size = 0
    with sigterm_as_ctrl_c():
        try:
            contents = _contents(collector, options, created_s, mask_users)
        finally:
            collector.close()
        if not dry_run:
            size = _write(path, contents, stamp, created_s, force)
    status = _status(collector, contents)
    summary = _summary(collector, contents, status, None if dry_run else path, size)
    if as_json:
        print(json.dumps(summary, indent=2))
    else:
        _print_summary(summary, dry_run)
    raise typer.Exit(status)


def _usage(message: str) -> None:
    echo(f"lupin bundle: {message}; see: lupin bundle --help", err=True)
    raise typer.Exit(USAGE_ERROR)


def _parse_since(text: str) -> float | None:
    found = _DURATION.match(text.strip())
    if text and (not found or float(found[1]) <= 0):
        _usage(f"--since takes a duration such as 90s, 30m, 1h or 2d, not {text!r}")
    return float(found[1]) * _SECONDS[found[2]] if found else None


def _print_progress(line: str) -> None:
    echo(f"lupin bundle: {line}", err=True)


def _check_writable(path: Path, force: bool) -> None:
    from lupin_cli.bundle.archive import CannotWrite, check_writable

    try:
        check_writable(path, force=force)
    except CannotWrite as error:
        echo(f"lupin bundle: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error


def _collector(
    names: list[str] | None,
    local: bool,
    host: str,
    every: bool,
    limit: str | None,
    config: Path | None,
    ask_sudo: bool,
    max_age_s: float | None,
) -> Collector:
    from lupin_cli.bundle.collect import Collector
    from lupin_cli.checks.table import built_in, plugged_in
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.connection.options import ask_sudo_passwords, reporting_errors, select_subject

    added, plugin_errors = plugged_in()
    checks = (*built_in(), *added)
    with reporting_errors("bundle"):
        inventory, chosen = select_subject(config, names, local=local, host=host, every=every, limit=limit)
        passwords = ask_sudo_passwords(chosen) if ask_sudo else {}
    return Collector(checks, plugin_errors, LocalTarget(), chosen, inventory, passwords, max_age_s)


def _contents(collector: Collector, options: dict[str, Any], created_s: float, mask_users: bool) -> Contents:
    from lupin_cli import __version__
    from lupin_cli.bundle.archive import assemble
    from lupin_cli.bundle.collect import lupin_files
    from lupin_cli.bundle.items import BundleItem, Omission
    from lupin_cli.bundle.redact import Redactor
    from lupin_cli.connection.inventory import config_directory

    found = collector.collect(_print_progress)
    inventory = collector.config.path if collector.config else config_directory() / "lupin.toml"
    found += lupin_files(inventory, options, collector.max_age_s)
    _print_progress("masking ...")
    about = {
        "lupin": __version__,
        "made": datetime.fromtimestamp(created_s, timezone.utc).isoformat(timespec="seconds"),
        "options": options,
        "robots": _robots(collector),
    }
    redactor = Redactor(collector.secrets, users=mask_users)
    items = [each for each in found if isinstance(each, BundleItem)]
    return assemble(items, [each for each in found if isinstance(each, Omission)], redactor, about)


def _robots(collector: Collector) -> list[dict[str, Any]]:
    return [
        {"name": link.robot, "address": link.address, "unreachable": link.kind or None, "message": link.message or None}
        for link in collector.links
    ]


def _status(collector: Collector, contents: Contents) -> int:
    from lupin_cli.bundle import items

    kinds = {each.kind for each in contents.omissions}
    if items.UNREACHABLE in kinds or any(not link.reachable for link in collector.links):
        return UNREACHABLE
    return FAILURE if kinds & items.GAPS else SUCCESS


def _write(path: Path, contents: Contents, stamp: str, created_s: float, force: bool) -> int:
    from lupin_cli.bundle.archive import CannotWrite, pack, write

    data = pack(contents.members, f"lupin-bundle-{stamp}", created_s)
    try:
        write(path, data, force=force)
    except CannotWrite as error:
        echo(f"lupin bundle: {error}", err=True)
        raise typer.Exit(NO_RESULT) from error
    return len(data)


def _summary(collector: Collector, contents: Contents, status: int, path: Path | None, size: int) -> dict[str, Any]:
    return {
        "status": status,
        "path": str(path) if path else None,
        "bytes": size,
        "bytes_unpacked": contents.size,
        "robots": _robots(collector),
        "files": [{"path": each.path, "what": each.description, "bytes": len(each.data)} for each in contents.members],
        "left_out": [{"path": each.path, "kind": each.kind, "reason": each.reason} for each in contents.omissions],
        "masked": contents.masked,
    }


def _print_summary(summary: dict[str, Any], dry_run: bool) -> None:
    from lupin_cli.bundle.items import ABSENT

    unreachable = {f"robots/{link['name']}" for link in summary["robots"] if link["unreachable"]}
    for link in summary["robots"]:
        if link["unreachable"]:
            echo(f"lupin bundle: {link['message']}; the archive is written without it", err=True)
    if dry_run:
        for row in summary["files"]:
            echo(f"{_size(row['bytes']):>9}  {row['path']:<52} {row['what']}")
    for row in summary["left_out"]:
        if dry_run or (row["kind"] != ABSENT and row["path"] not in unreachable):
            echo(f"{'-':>9}  {row['path']}: {row['kind']}: {row['reason']}")
    masked = ", ".join(f"{count} {kind}" for kind, count in summary["masked"].items()) or "nothing"
    if dry_run:
        echo(f"{len(summary['files'])} files, {_size(summary['bytes_unpacked'])} unpacked, would be packed; masked: {masked}")
        echo("nothing was written")
        return
    sizes = f"{_size(summary['bytes'])} ({_size(summary['bytes_unpacked'])} unpacked)"
    echo(f"{summary['path']}: {len(summary['files'])} files, {sizes}")
    echo(f"masked: {masked}")
    echo("masking may miss something: look through it before you send it:")
    echo(f"  tar -xOzf {summary['path']} | less")
    sys.stdout.flush()


def _size(count: int) -> str:
    for unit, size in (("MB", 1_000_000), ("kB", 1_000)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count} B"
