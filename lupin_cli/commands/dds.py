"""`lupin dds`: how this machine joins the robot's graph."""

from __future__ import annotations

import contextlib
import difflib
import json
import os
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from lupin_cli.dds_setup import Item, Places

app = typer.Typer(
    help="How this machine joins the robot's graph: set it up, check it, take it back.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

FAILED, USAGE_ERROR = 1, 2
_SHELL = Annotated[str | None, typer.Option("--shell", help="bash or zsh; else the one of $SHELL.")]
_DRY_RUN = Annotated[bool, typer.Option("--dry-run", help="Show what would change, and change nothing.")]


@app.command()
def setup(
    ip: Annotated[
        str | None, typer.Argument(help="The robot's address: 10.42.0.1 on the cable, 192.168.42.1 at its own.")
    ] = None,
    shell: _SHELL = None,
    dry_run: _DRY_RUN = False,
) -> None:
    """Write the Fast DDS profile and ros-env.sh, and have every new terminal read it. Doing it again changes nothing.

    Without IP it is $ROBOT_IP or 192.168.42.1. `lupin up` reads ros-env.sh by itself.
    """
    from lupin_cli import dds_setup

    places, shell = _places(), _shell(shell)
    with _one_line():
        robot = dds_setup.valid_ip(ip or os.environ.get("ROBOT_IP") or dds_setup.DEFAULT_IP)
        start = places.start_file(shell, os.environ)
        changes = {
            places.profile: dds_setup.profile_xml(robot),
            places.exports: dds_setup.exports(robot, places),
            start: dds_setup.with_hook(_read(start), places),
        }
        changed = _apply(changes, dry_run)
    if dry_run:
        return
    if not changed:
        typer.echo(f"nothing to do: this machine joins the robot at {robot}")
        return
    typer.echo(f"this machine joins the robot at {robot}: in new terminals, and here after")
    typer.echo(f"  . {places.exports}")


@app.command()
def remove(shell: _SHELL = None, dry_run: _DRY_RUN = False) -> None:
    """Take it all back: the start file is byte for byte what it was; a copy of how it is now stays beside it."""
    from lupin_cli import dds_setup

    places = _places()
    changes: dict[Path, str | None] = {places.profile: None, places.exports: None}
    with _one_line():
        for name in [_shell(shell)] if shell else dds_setup.START_FILES:
            start = places.start_file(name, os.environ)
            text = _read(start)
            if text is not None and dds_setup.hooks(text):
                changes[start] = dds_setup.without_hook(text)
                if not dry_run:
                    _write(start.with_name(f"{start.name}.lupin-backup"), text, start)
        if not _apply(changes, dry_run):
            typer.echo("nothing to do: nothing of it is here")


@app.command()
def check(
    shell: _SHELL = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, alone on standard output.")] = False,
) -> None:
    """Say of every item whether it is right: profile, exports, start file and its order, a new terminal, this one.

    Exit status: 0 all is right, 1 something isn't.
    """
    items = _check(_places(), _shell(shell))
    if as_json:
        typer.echo(json.dumps([asdict(item) for item in items]))
    else:
        for item in items:
            typer.echo(f"{'✗' if item.problem else '✓'} {item.name}: {item.place}")
            if item.problem:
                typer.echo(f"    {item.problem}\n    fix: {item.fix}")
    raise typer.Exit(FAILED if any(item.problem for item in items) else 0)


def _check(places: Places, shell: str) -> list[Item]:
    from lupin_cli import dds_setup

    text = _read(places.exports)
    wanted, _ = dds_setup.read_exports(text or "", places.home)
    ip = dds_setup.server_ip(wanted.get("ROS_DISCOVERY_SERVER", ""))
    fix = f"lupin dds setup {ip or dds_setup.DEFAULT_IP}" + ("" if shell == _shell(None) else f" --shell {shell}")
    start = places.start_file(shell, os.environ)
    items = [
        dds_setup.check_profile(_read(places.profile), ip, places, fix),
        dds_setup.check_exports(text, places, fix),
        dds_setup.check_hook(_read(start), start, places, fix),
    ]
    if not wanted:
        return items
    if shutil.which(shell):
        seen = dds_setup.new_terminal(shell, os.environ)
        if seen is None:
            items.append(dds_setup.Item("new terminal", shell, "it did not answer within 10 s", f"{shell} -i -c env"))
        else:
            look = f"look in {start} and what it sources for what comes after the hook"
            items.append(dds_setup.check_variables("new terminal", seen, wanted, f"{shell} -i", items[2].fix or look))
    here = f". {shlex.quote(str(places.exports))}    (lupin up does so by itself)"
    items.append(dds_setup.check_variables("this terminal", os.environ, wanted, "environment", here))
    return items


def _places() -> Places:
    from lupin_cli.config import config_directory
    from lupin_cli.dds_setup import Places

    return Places(Path(os.environ.get("HOME") or Path.home()), config_directory())


def _shell(asked: str | None) -> str:
    from lupin_cli.dds_setup import START_FILES

    shell = asked or Path(os.environ.get("SHELL") or "bash").name
    if shell in START_FILES:
        return shell
    if asked is None:
        return "bash"
    typer.echo(f"lupin dds: --shell must be one of {', '.join(START_FILES)}, not {asked!r}", err=True)
    raise typer.Exit(USAGE_ERROR)


@contextlib.contextmanager
def _one_line() -> Iterator[None]:
    from lupin_cli.target.base import TargetError

    try:
        yield
    except ValueError as error:
        typer.echo(f"lupin dds: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    except (OSError, TargetError) as error:
        typer.echo(f"lupin dds: {error}", err=True)
        raise typer.Exit(FAILED) from error


def _read(path: Path) -> str | None:
    """A file's text; bytes that are no UTF-8 survive, and so do the line ends of others."""
    try:
        with path.open(encoding="utf-8", errors="surrogateescape", newline="") as file:
            return file.read()
    except FileNotFoundError:
        return None


def _apply(changes: dict[Path, str | None] | dict[Path, str], dry_run: bool) -> bool:
    """Make files what they should be (None: not there), showing each difference in a dry run; True where one differed."""
    different = {path: text for path, text in changes.items() if _read(path) != text}
    for path, text in different.items():
        before = _read(path)
        if dry_run:
            old, new = ((content or "").splitlines(keepends=True) for content in (before, text))
            old_name, new_name = (str(path) if content is not None else "/dev/null" for content in (before, text))
            for line in difflib.unified_diff(old, new, old_name, new_name):
                shown = line.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
                typer.echo(shown if shown.endswith("\n") else f"{shown}\n\\ No newline at end of file\n", nl=False)
        elif text is None:
            path.unlink()
            typer.echo(f"removed {path}")
        else:
            _write(path, text, path)
            typer.echo(f"wrote {path}")
    return bool(different)


def _write(path: Path, text: str, like: Path) -> None:
    """Whole or not at all, through a link where a start file is one, with the rights of `like`."""
    from lupin_cli.target.local import LocalTarget

    real = path.resolve()
    real.parent.mkdir(parents=True, exist_ok=True)
    mode = like.stat().st_mode & 0o777 if like.exists() else 0o644
    LocalTarget().put(str(real), text.encode("utf-8", "surrogateescape"), mode=mode)
