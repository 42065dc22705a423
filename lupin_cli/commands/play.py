"""`lupin play`: play a playbook, show what it would change, resume a run, undo a run."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.connection.options import ALL, ASK_SUDO, BREAK_LEASE, CONFIG, LIMIT, ROBOT, reporting_errors
from lupin_cli.exit_codes import INTERRUPTED, USAGE_ERROR, worst
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_cli.connection.base import Target
    from lupin_cli.connection.inventory import Robot
    from lupin_cli.playbook import Playbook, Result
    from lupin_cli.playbook.results import Event


def command(
    name: str = typer.Argument(None, help="A shipped playbook's name, or your own file."),
    list_all: bool = typer.Option(False, "--list", help="List the shipped playbooks."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Show what would change; change nothing."),
    diff: bool = typer.Option(False, "--diff", help="Show how files change."),
    from_step: str = typer.Option("", "--from", help="Begin at this step: its name or number."),
    resume: bool = typer.Option(False, "--resume", help="Continue the newest run that was cut off or failed."),
    undo: str = typer.Option("", "--undo", help="Undo this run: an id from `lupin journal`, or: latest."),
    yes: bool = typer.Option(False, "--yes", "-y", help="Answer every question with yes."),
    break_lease: BREAK_LEASE = False,
    variables: list[str] = typer.Option(None, "-v", "--var", help="Set a variable: name=value. Can be repeated."),
    robot: ROBOT = None,
    every: ALL = False,
    limit: LIMIT = None,
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
    as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output."),
) -> None:
    """Play a playbook: change what differs, verify each change, leave the rest alone.

    Every run is journaled; --resume continues one that was cut off, --undo reverts its changes.
    Exit status: 0 done or nothing to do, 1 a step failed or was declined, 2 usage or a bad playbook, 3 a robot cannot be
    reached, 130 interrupted.
    """
    if list_all:
        _list(as_json)
        return
    from lupin_cli.playbook import JournalError, PlaybookError, find_playbook_run, load

    if not name:
        _fail_usage("name a playbook; list them with: lupin play --list")
    with reporting_errors("play"):
        try:
            playbook = load(name)
            given = _parse_variables(playbook, variables or [])
            if undo and not robot and not every:
                robot = [found] if (found := find_playbook_run(undo).robot) else None
                robots: list[Robot | None] = _select_robots(robot, False, None, config) if robot else [None]
            elif _needs_robot(playbook, given, resume) or robot or every:
                robots = _select_robots(robot, every, limit, config)
            else:
                robots = [None]
            request = _Request(
                playbook=playbook,
                variables=given,
                from_step=from_step,
                resume=resume,
                undo=undo,
                dry_run=dry_run,
                diff=diff,
                break_lease=break_lease,
                config=config,
                ask_sudo=ask_sudo,
                confirm=ask_operator(yes),
                progress=ProgressPrinter(quiet=as_json, several=len(robots) > 1, diff=diff),
            )
            results = _play_on_all(request, robots)
        except KeyboardInterrupt:
            # The second Ctrl-C: exit at once instead of waiting for the threads of the runs. The journal is complete.
            os._exit(INTERRUPTED)
        except (FileNotFoundError, PlaybookError) as error:
            _fail_usage(str(error))
        except JournalError as error:
            _fail_usage(str(error), error.next_command)
    if as_json:
        plain = [result.plain() for result in results]
        print(json.dumps(plain if len(plain) != 1 else plain[0]))
    for result in results:
        print_result(result, as_json)
    raise typer.Exit(worst([result.exit_code for result in results]))


def _announce_stop() -> None:
    echo("stopping after the current step; press Ctrl-C again to stop at once", err=True)


def _fail_usage(message: str, next_command: str = "") -> Any:
    echo(f"lupin play: {message}", err=True)
    if next_command:
        echo(f"  next: {next_command}", err=True)
    raise typer.Exit(USAGE_ERROR)


def _list(as_json: bool) -> None:
    from lupin_cli.playbook import PlaybookError, list_shipped, load

    try:
        playbooks = [load(path) for path in list_shipped()]
    except PlaybookError as error:
        _fail_usage(str(error))
    if as_json:
        print(json.dumps([{"name": b.name, "description": b.description, "machines": sorted(b.machines)} for b in playbooks]))
        return
    width = max((len(book.name) for book in playbooks), default=0)
    for book in playbooks:
        echo(f"{book.name:{width}}  {book.description}")


def _parse_variables(playbook: Playbook, words: Sequence[str]) -> dict[str, Any]:
    """Return the values of `-v name=value` as their variables' types."""
    from lupin_cli.playbook.argument_types import from_command_line

    types = {variable.name: variable.type for variable in playbook.variables}
    given: dict[str, Any] = {}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals:
            _fail_usage(f"a variable must be given as name=value: {word!r}")
        try:
            given[name] = from_command_line(text, types.get(name, "text"))
        except ValueError as error:
            _fail_usage(f"-v {name}: {error}")
    return given


def _needs_robot(playbook: Playbook, given: dict[str, Any], resume: bool) -> bool:
    """Return whether a step may run on a robot. Raises PlaybookError for invalid variables."""
    from lupin_cli.playbook import PlaybookError
    from lupin_cli.playbook.binding import Binding

    try:
        return "robot" in Binding(playbook, given, None).needed_machines()
    except (ValueError, PlaybookError) as error:
        if isinstance(error, PlaybookError) and not resume:  # a resumed run has the variables that aren't given again
            raise
        return "robot" in playbook.machines


def _select_robots(names: list[str] | None, every: bool, limit: str | None, config: Path | None) -> list[Robot | None]:
    from lupin_cli.connection.inventory import load as load_config
    from lupin_cli.connection.options import select_robots

    return list(select_robots(load_config(config), names, every=every, limit=limit))


@dataclass(frozen=True)
class _Request:
    """What the operator asked for."""

    playbook: Playbook
    variables: dict[str, Any]
    from_step: str
    resume: bool
    undo: str  # the run to undo, or empty
    dry_run: bool
    diff: bool
    break_lease: bool
    config: Path | None
    ask_sudo: bool
    confirm: Callable[[str], bool]
    progress: Callable[[Event], None]


def _play_on_all(request: _Request, robots: list[Robot | None]) -> list[Result]:
    """Play or undo on each robot; None stands for the laptop alone."""
    from lupin_cli.connection.inventory import load as load_config
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.connection.options import ask_sudo_password, open_target
    from lupin_cli.playbook import find_playbook_run, play
    from lupin_cli.playbook.fleet import play_on_all
    from lupin_cli.playbook.serialized_target import SerializedTarget
    from lupin_cli.playbook.undo import undo

    laptop = SerializedTarget(LocalTarget())

    def play_one(robot: Robot | None, stop: threading.Event) -> Result:
        targets: dict[str, Target] = {"laptop": laptop}
        if robot is not None:
            password = ask_sudo_password(robot.name) if request.ask_sudo else None
            targets["robot"] = open_target(robot, load_config(request.config), sudo_password=password)
        try:
            if request.undo:
                return undo(
                    find_playbook_run(request.undo), targets, dry_run=request.dry_run, confirm=request.confirm,
                    on_event=request.progress, stop=stop, break_lease=request.break_lease,
                )  # fmt: skip
            return play(
                request.playbook, targets, request.variables, dry_run=request.dry_run, diff=request.diff,
                from_step=request.from_step, resume=request.resume, confirm=request.confirm, on_event=request.progress,
                stop=stop, break_lease=request.break_lease,
            )  # fmt: skip
        finally:
            if robot is not None:
                targets["robot"].close()

    return play_on_all(robots, lambda robot: robot.name if robot else "", request.playbook.name, play_one, _announce_stop)


def ask_operator(yes: bool) -> Callable[[str], bool]:
    """Return a function that answers a step's question: yes if `yes`, else as the operator types; no without a terminal."""
    one_at_a_time = threading.Lock()

    def confirm(question: str) -> bool:
        if yes or not sys.stdin.isatty():
            return yes
        with one_at_a_time:
            return typer.confirm(question, err=True)

    return confirm


_MARKS = {
    "same": "=",
    "same before": "=",
    "changed": "*",
    "changed before": "*",
    "would-change": "~",
    "skipped": "-",
    "skipped before": "-",
}
_SHOW_OUTPUT_AFTER_S = 1.0


class ProgressPrinter:
    """Prints progress on standard error: one line per step, and the output of a step that takes long."""

    def __init__(self, *, quiet: bool, several: bool, diff: bool) -> None:
        """With `several` robots, each line names its robot. With `diff`, the diffs of files are printed."""
        self._quiet = quiet
        self._several = several
        self._diff = diff
        self._lock = threading.Lock()
        self._started_s: dict[str, float] = {}

    def __call__(self, event: Event) -> None:
        """Print one event of a run; several runs may call this at the same time."""
        with self._lock:
            self._print(event)

    def _print(self, event: Event) -> None:
        if self._quiet:
            return
        prefix = f"[{event.robot}] " if self._several else ""
        place = f"{event.index + 1:>{len(str(event.total))}}/{event.total}"
        if event.kind == "step":
            self._started_s[event.robot] = time.monotonic()
        elif event.kind == "difference" and event.text:
            echo(f"{prefix}{place}   {event.step}: {event.text}", err=True)
            if self._diff and event.diff:
                for line in event.diff.splitlines():
                    echo(f"{prefix}        {line}", err=True)
        elif event.kind == "line" and time.monotonic() - self._started_s.get(event.robot, 0.0) > _SHOW_OUTPUT_AFTER_S:
            echo(f"{prefix}        {event.text}", err=True)
        elif event.kind == "step-end":
            mark = _MARKS.get(event.state, "!")
            took = f" ({event.duration_s:.1f} s)" if event.duration_s >= 1.0 else ""
            state = "" if event.state in ("same", "changed") else f": {event.state}"
            echo(f"{prefix}{place} {mark} {event.step}{state}{took}", err=True)


def print_result(result: Result, as_json: bool) -> None:
    """Print how a run ended; with `as_json`, only what went wrong, on standard error."""
    prefix = f"{result.robot}: " if result.robot else ""
    if result.state == "done" and not as_json:
        would = "would change" if result.dry_run else "changed"
        summary = result.message or (
            f"{result.changed} of {len(result.steps)} steps {would}" if result.changed else "nothing to do"
        )
        journal = f"; journal: lupin journal show {result.run}" if result.run and result.changed else ""
        echo(f"{prefix}{result.playbook}: {summary}{journal}")
    elif result.state != "done":
        echo(f"{prefix}{result.playbook}: {result.state}: {result.message}", err=True)
        if result.next_command:
            echo(f"  next: {result.next_command}", err=True)
        if result.resume and not result.next_command.startswith(result.resume):
            echo(f"  then: {result.resume}", err=True)
