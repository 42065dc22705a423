"""`lupin play`: play a playbook, show what it would change, resume it, take it back."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.robot_options import ALL, ASK_SUDO, BREAK_LEASE, CONFIG, LIMIT, ROBOT, USAGE_ERROR, reporting

if TYPE_CHECKING:
    from lupin_cli.config import Robot
    from lupin_cli.runbook import Playbook, Result
    from lupin_cli.runbook.outcome import Event


def command(
    name: str = typer.Argument(None, help="A shipped playbook's name, or a file of your own."),
    list_all: bool = typer.Option(False, "--list", help="What is shipped."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Show what would change; change nothing."),
    diff: bool = typer.Option(False, "--diff", help="Show how files change."),
    from_step: str = typer.Option("", "--from", help="Begin at this step: its name or number."),
    resume: bool = typer.Option(False, "--resume", help="Go on with the newest run that was cut off or failed."),
    undo: str = typer.Option("", "--undo", help="Take a run back: its id of `lupin journal`, or: latest."),
    yes: bool = typer.Option(False, "--yes", "-y", help="Answer every question with yes."),
    break_lease: BREAK_LEASE = False,
    variables: list[str] = typer.Option(None, "-v", "--var", help="A variable: name=value; may be given again."),
    robot: ROBOT = None,
    every: ALL = False,
    limit: LIMIT = None,
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
    as_json: bool = typer.Option(False, "--json", help="Print JSON, alone on standard output."),
) -> None:
    """Play a playbook: what differs is changed and looked at again; what doesn't is left alone.

    Every run is written to the journal, can be resumed where it was cut off (--resume), and taken back (--undo).
    Exit status: 0 done or nothing to do, 1 a step failed or was declined, 2 usage or a bad playbook, 3 a robot can't be
    reached, 130 interrupted.
    """
    if list_all:
        _list(as_json)
        return
    from lupin_cli.runbook import JournalError, PlaybookError, find_run, load

    if not name:
        _usage("say which playbook; they are listed by: lupin play --list")
    with reporting("play"):
        try:
            book = load(name)
            given = _given(book, variables or [])
            if undo and not robot and not every:
                robot = [found] if (found := find_run(undo).robot) else None
                robots = _named(robot, config)
            else:
                robots = _robots(book, given, robot, every, limit, config, resume)
            one = _player(
                book, given, dry_run, diff, from_step, resume, undo, yes, break_lease, config, ask_sudo,
                Shown(as_json, len(robots), diff),
            )  # fmt: skip
            from lupin_cli.runbook.fleet import on_all

            results = on_all(robots, lambda each: each.name if each else "", book.name, one, _stopping)
        except KeyboardInterrupt:
            # The second one: nobody waits for what is under way. The journal has everything; threads would be waited for.
            os._exit(130)
        except (FileNotFoundError, PlaybookError) as error:
            _usage(str(error))
        except JournalError as error:
            _usage(str(error), error.next_command)
    if as_json:
        plain = [result.plain() for result in results]
        print(json.dumps(plain if len(plain) != 1 else plain[0]))
    for result in results:
        tell_result(result, as_json)
    raise typer.Exit(worst([result.exit_code for result in results]))


def _stopping() -> None:
    typer.echo("stopping as soon as what is under way has ended; Ctrl-C again: at once", err=True)


def worst(codes: Sequence[int]) -> int:
    """One status for several robots: interrupted, else unreachable, else failed, else done."""
    return next((code for code in (130, 3, 1) if code in codes), 0)


def _usage(message: str, next_command: str = "") -> Any:
    typer.echo(f"lupin play: {message}", err=True)
    if next_command:
        typer.echo(f"  next: {next_command}", err=True)
    raise typer.Exit(USAGE_ERROR)


def _list(as_json: bool) -> None:
    from lupin_cli.runbook import PlaybookError, load, shipped

    try:
        books = [load(path) for path in shipped()]
    except PlaybookError as error:
        _usage(str(error))
    if as_json:
        print(json.dumps([{"name": b.name, "description": b.description, "machines": sorted(b.machines)} for b in books]))
        return
    width = max((len(book.name) for book in books), default=0)
    for book in books:
        typer.echo(f"{book.name:{width}}  {book.description}")


def _given(book: Playbook, words: Sequence[str]) -> dict[str, Any]:
    """The values of `-v name=value`, as their variables' types have them."""
    from lupin_cli.runbook.templates import from_command_line

    types = {variable.name: variable.type for variable in book.variables}
    given: dict[str, Any] = {}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals:
            _usage(f"a variable is given as name=value, unlike {word!r}")
        try:
            given[name] = from_command_line(text, types.get(name, "text"))
        except ValueError as error:
            _usage(f"-v {name}: {error}")
    return given


def _robots(
    book: Playbook, given: dict[str, Any], names: Any, every: bool, limit: Any, config: Any, lenient: bool
) -> list[Robot | None]:
    """The robots to play on; [None] where the playbook needs none."""
    from lupin_cli.config import load as load_config
    from lupin_cli.robot_options import select
    from lupin_cli.runbook import PlaybookError
    from lupin_cli.runbook.binding import Binding

    try:
        machines = Binding(book, given, None).machines()
    except (ValueError, PlaybookError) as error:
        if isinstance(error, PlaybookError) and not lenient:  # an unfinished run knows the variables that aren't given again
            raise
        machines = set(book.machines)
    if "robot" not in machines and not names and not every:
        return [None]
    return list(select(load_config(config), names, every=every, limit=limit))


def _named(names: list[str] | None, config: Any) -> list[Robot | None]:
    from lupin_cli.config import load as load_config
    from lupin_cli.robot_options import select

    return list(select(load_config(config), names)) if names else [None]


def _player(
    book: Playbook,
    given: dict[str, Any],
    dry_run: bool,
    diff: bool,
    from_step: str,
    resume: bool,
    undo_run: str,
    yes: bool,
    break_lease: bool,
    config: Any,
    ask_sudo: bool,
    shown: Shown,
) -> Callable[[Robot | None, threading.Event], Result]:
    from lupin_cli.config import load as load_config
    from lupin_cli.robot_options import ask_sudo_password, open_target
    from lupin_cli.runbook import find_run, play
    from lupin_cli.runbook.fleet import TakingTurns
    from lupin_cli.runbook.undo import undo
    from lupin_cli.target.local import LocalTarget

    laptop = TakingTurns(LocalTarget())
    confirm = asking(yes)

    def one(robot: Robot | None, stop: threading.Event) -> Result:
        targets: dict[str, Any] = {"laptop": laptop}
        if robot is not None:
            password = ask_sudo_password(robot.name) if ask_sudo else None
            targets["robot"] = open_target(robot, load_config(config), sudo_password=password)
        try:
            if undo_run:
                run = find_run(undo_run)
                return undo(run, targets, dry_run=dry_run, confirm=confirm, on_event=shown, stop=stop, break_lease=break_lease)
            return play(
                book, targets, given, dry_run=dry_run, diff=diff, from_step=from_step, resume=resume,
                confirm=confirm, on_event=shown, stop=stop, break_lease=break_lease,
            )  # fmt: skip
        finally:
            if robot is not None:
                targets["robot"].close()

    return one


def asking(yes: bool) -> Callable[[str], bool]:
    """Who answers a step's question: `yes`, else the person at the terminal, one question at a time; nobody says no."""
    turn = threading.Lock()

    def confirm(question: str) -> bool:
        if yes or not sys.stdin.isatty():
            return yes
        with turn:
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
_SILENT_S = 1.0


class Shown:
    """Progress as it happens, on standard error: a line a step, and what a long one says."""

    def __init__(self, quiet: bool, robots: int, diff: bool) -> None:
        self._quiet = quiet
        self._several = robots > 1
        self._diff = diff
        self._lock = threading.Lock()
        self._began: dict[str, float] = {}

    def __call__(self, event: Event) -> None:
        with self._lock:
            self._show(event)

    def _show(self, event: Event) -> None:
        if self._quiet:
            return
        lead = f"[{event.robot}] " if self._several else ""
        place = f"{event.index + 1:>{len(str(event.total))}}/{event.total}"
        if event.kind == "step":
            self._began[event.robot] = time.monotonic()
        elif event.kind == "difference" and event.text:
            typer.echo(f"{lead}{place}   {event.step}: {event.text}", err=True)
            if self._diff and event.diff:
                for line in event.diff.splitlines():
                    typer.echo(f"{lead}        {line}", err=True)
        elif event.kind == "line" and time.monotonic() - self._began.get(event.robot, 0.0) > _SILENT_S:
            typer.echo(f"{lead}        {event.text}", err=True)
        elif event.kind == "step-end":
            mark = _MARKS.get(event.state, "!")
            took = f" ({event.duration_s:.1f} s)" if event.duration_s >= 1.0 else ""
            state = "" if event.state in ("same", "changed") else f": {event.state}"
            typer.echo(f"{lead}{place} {mark} {event.step}{state}{took}", err=True)


def tell_result(result: Result, as_json: bool) -> None:
    where = f"{result.robot}: " if result.robot else ""
    if result.state == "done" and not as_json:
        would = "would change" if result.dry_run else "changed"
        said = result.message or (
            f"{result.changed} of {len(result.steps)} steps {would}" if result.changed else "nothing to do"
        )
        journal = f"; journal: lupin journal show {result.run}" if result.run and result.changed else ""
        typer.echo(f"{where}{result.playbook}: {said}{journal}")
    elif result.state != "done":
        typer.echo(f"{where}{result.playbook}: {result.state}: {result.message}", err=True)
        if result.next_command:
            typer.echo(f"  next: {result.next_command}", err=True)
        if result.resume and not result.next_command.startswith(result.resume):
            typer.echo(f"  then: {result.resume}", err=True)
