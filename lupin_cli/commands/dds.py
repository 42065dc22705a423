"""`lupin dds`: set up, check and remove what makes this machine join the robot's graph."""

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

from lupin_cli.command_group import command_group
from lupin_cli.exit_codes import FAILURE, SUCCESS, USAGE_ERROR
from lupin_cli.terminal import echo
from lupin_runtime.bounded_file import read_bounded

if TYPE_CHECKING:
    from lupin_cli.link.dds_check import CheckedItem
    from lupin_cli.link.dds_setup import SetupPaths

app = command_group("Make this machine join the robot's graph: set up, check, remove.", "lupin dds check", no_args_is_help=True)

_SHELL = Annotated[str | None, typer.Option("--shell", help="bash or zsh; default: the shell of $SHELL.")]
_DRY_RUN = Annotated[bool, typer.Option("--dry-run", help="Show what would change; change nothing.")]


@app.command()
def setup(
    ip: Annotated[
        str | None, typer.Argument(help="The robot's address: 10.42.0.1 on the cable, 192.168.42.1 at its access point.")
    ] = None,
    shell: _SHELL = None,
    dry_run: _DRY_RUN = False,
) -> None:
    """Write the Fast DDS profile and ros-env.sh, and make every new terminal source ros-env.sh. Repeating it changes nothing.

    IP defaults to $ROBOT_IP or 192.168.42.1. `lupin up` reads ros-env.sh by itself.

    Example: lupin dds setup 10.42.0.1
    """
    from lupin_cli.link import dds_setup

    paths, shell = _paths(), _shell(shell)
    with _errors_in_one_line():
        robot = dds_setup.parse_robot_ip(ip or os.environ.get("ROBOT_IP") or dds_setup.DEFAULT_IP)
        start = paths.start_file(shell, os.environ)
        changes = {
            paths.profile: dds_setup.profile_xml(robot),
            paths.exports: dds_setup.exports_text(robot, paths),
            start: dds_setup.add_hook(_read(start), paths),
        }
        changed = _apply(changes, dry_run)
    if dry_run:
        return
    if not changed:
        echo(f"nothing to do: this machine joins the robot at {robot}")
        return
    echo(f"this machine joins the robot at {robot}: in new terminals, and in this one after")
    echo(f"  . {paths.exports}")


@app.command()
def remove(shell: _SHELL = None, dry_run: _DRY_RUN = False) -> None:
    """Remove everything that setup wrote. The startup file is restored byte for byte; a copy with the hook stays beside it.

    Example: lupin dds remove --dry-run
    """
    from lupin_cli.link import dds_setup

    paths = _paths()
    changes: dict[Path, str | None] = {paths.profile: None, paths.exports: None}
    with _errors_in_one_line():
        for name in [_shell(shell)] if shell else dds_setup.START_FILES:
            start = paths.start_file(name, os.environ)
            text = _read(start)
            if text is not None and dds_setup.find_hooks(text):
                changes[start] = dds_setup.remove_hook(text)
                if not dry_run:
                    _write(start.with_name(f"{start.name}.lupin-backup"), text, start)
        if not _apply(changes, dry_run):
            echo("nothing to do: this machine is not set up")


@app.command()
def check(
    shell: _SHELL = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON on standard output.")] = False,
) -> None:
    """Check each item: profile, exports, startup file and its order, the variables of a new terminal and of this one.

    Exit status: 0 all correct, 1 something is wrong.

    Example: lupin dds check
    """
    items = _checked_items(_paths(), _shell(shell))
    if as_json:
        print(json.dumps([asdict(item) for item in items]))
    else:
        for item in items:
            echo(f"{'✗' if item.problem else '✓'} {item.name}: {item.place}")
            if item.problem:
                echo(f"    {item.problem}")
                if item.instruction:
                    echo(f"    do: {item.instruction}")
                if item.fix:
                    echo(f"    fix: {item.fix}", wrap=False)  # a line break inside would be pasted, too
    raise typer.Exit(FAILURE if any(item.problem for item in items) else SUCCESS)


def _checked_items(paths: SetupPaths, shell: str) -> list[CheckedItem]:
    from lupin_cli.link import dds_check, dds_setup

    text = _read(paths.exports)
    expected, _ = dds_check.read_exports(text or "", paths.home)
    ip = dds_check.server_ip(expected.get("ROS_DISCOVERY_SERVER", ""))
    fix = f"lupin dds setup {ip or dds_setup.DEFAULT_IP}" + ("" if shell == _shell(None) else f" --shell {shell}")
    start = paths.start_file(shell, os.environ)
    items = [
        dds_check.check_profile(_read(paths.profile), ip, paths, fix),
        dds_check.check_exports(text, paths, fix),
        dds_check.check_hook(_read(start), start, paths, fix),
    ]
    if not expected:
        return items
    if shutil.which(shell):
        variables = dds_check.read_terminal_environment(shell, os.environ)
        if variables is None:
            items.append(dds_check.CheckedItem("new terminal", shell, "it did not answer within 10 s", f"{shell} -i -c env"))
        else:
            search = f"find the line after the hook that changes them, in {start} and the files that it sources"
            by_hand = "" if items[2].fix else search
            items.append(dds_check.check_variables("new terminal", variables, expected, f"{shell} -i", items[2].fix, by_hand))
    source, by_itself = f". {shlex.quote(str(paths.exports))}", "nothing for `lupin up`, which reads ros-env.sh by itself"
    items.append(dds_check.check_variables("this terminal", os.environ, expected, "environment", source, by_itself))
    return items


def _paths() -> SetupPaths:
    from lupin_cli.connection.inventory import config_directory
    from lupin_cli.link.dds_setup import SetupPaths

    return SetupPaths(Path(os.environ.get("HOME") or Path.home()), config_directory())


def _shell(option: str | None) -> str:
    from lupin_cli.link.dds_setup import START_FILES

    shell = option or Path(os.environ.get("SHELL") or "bash").name
    if shell in START_FILES:
        return shell
    if option is None:
        return "bash"
    echo(f"lupin dds: --shell must be one of {', '.join(START_FILES)}, not {option!r}", err=True)
    raise typer.Exit(USAGE_ERROR)


@contextlib.contextmanager
def _errors_in_one_line() -> Iterator[None]:
    from lupin_cli.connection.base import TargetError

    try:
        yield
    except ValueError as error:
        echo(f"lupin dds: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    except (OSError, TargetError) as error:
        echo(f"lupin dds: {error}", err=True)
        raise typer.Exit(FAILURE) from error


def _read(path: Path) -> str | None:
    """Return the text of a file, or None if it is missing. Invalid UTF-8 and other line endings survive a round trip."""
    try:
        return read_bounded(path).decode("utf-8", "surrogateescape")
    except FileNotFoundError:
        return None


def _apply(changes: dict[Path, str | None] | dict[Path, str], dry_run: bool) -> bool:
    """Write each file (None: delete it), or print the differences in a dry run. Return whether any file differed."""
    changed = {path: text for path, text in changes.items() if _read(path) != text}
    for path, text in changed.items():
        before = _read(path)
        if dry_run:
            old, new = ((content or "").splitlines(keepends=True) for content in (before, text))
            old_name, new_name = (str(path) if content is not None else "/dev/null" for content in (before, text))
            for line in difflib.unified_diff(old, new, old_name, new_name):
                shown = line.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
                echo(shown if shown.endswith("\n") else f"{shown}\n\\ No newline at end of file\n", nl=False, wrap=False)
        elif text is None:
            path.unlink()
            echo(f"removed {path}")
        else:
            _write(path, text, path)
            echo(f"wrote {path}")
    return bool(changed)


def _write(path: Path, text: str, like: Path) -> None:
    """Write a file atomically with the permissions of `like`. If it is a symbolic link, the link's target is written."""
    from lupin_cli.connection.local import LocalTarget

    real = path.resolve()
    real.parent.mkdir(parents=True, exist_ok=True)
    mode = like.stat().st_mode & 0o777 if like.exists() else 0o644
    LocalTarget().put(str(real), text.encode("utf-8", "surrogateescape"), mode=mode)
