"""`lupin play`: play a playbook, show what it would change, resume a run, undo a run."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lupin_cli.commands.journal import playbook_runs
from lupin_cli.commands.playbook_list import fail_usage, list_playbooks
from lupin_cli.completion import playbooks
from lupin_cli.connection.inventory import ConfigError
from lupin_cli.connection.options import ALL, ASK_SUDO, BREAK_LEASE, CONFIG, LIMIT, ROBOT, ask_sudo_passwords, reporting_errors
from lupin_cli.exit_codes import INTERRUPTED, worst
from lupin_cli.printed_commands import print_next
from lupin_cli.terminal import can_repaint, confirm, echo, ending_in_order, erase_status_line, show_status_line

HIDDEN = Annotated[
    list[str] | None,
    typer.Option(
        "--hidden",
        metavar="NAME[=FILE]",
        help="Set a variable to a secret: NAME asks for it, NAME=FILE reads it from a file, NAME=- from standard input. "
        "Can be repeated.",
    ),
]

if TYPE_CHECKING:
    from lupin_cli.connection.base import Target
    from lupin_cli.connection.inventory import Robot
    from lupin_cli.playbook import Playbook, Result
    from lupin_cli.playbook.results import Event


def command(
    name: Annotated[
        str | None, typer.Argument(help="A shipped playbook's name, or your own file.", autocompletion=playbooks)
    ] = None,
    list_all: Annotated[
        bool, typer.Option("--list", help="List the shipped playbooks; with NAME, the steps of that one.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would change; change nothing.")] = False,
    diff: Annotated[bool, typer.Option("--diff", help="Show how files change.")] = False,
    from_step: Annotated[str, typer.Option("--from", help="Begin at this step: its name or number.")] = "",
    tags: Annotated[list[str] | None, typer.Option("--tag", help="Only play steps with this tag. Can be repeated.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the newest run that was cut off or failed.")] = False,
    undo: Annotated[
        str,
        typer.Option(
            "--undo",
            help="Undo this run: any unique part of an id from `lupin journal`, or: latest.",
            autocompletion=playbook_runs,
        ),
    ] = "",
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="With --undo: overwrite what was changed after the run; of a file, keep a copy beside it."
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Answer every question with yes.")] = False,
    break_lease: BREAK_LEASE = "",
    variables: Annotated[
        list[str] | None, typer.Option("-v", "--var", help="Set a variable: name=value. Can be repeated.")
    ] = None,
    hidden: HIDDEN = None,
    robot: ROBOT = None,
    every: ALL = False,
    limit: LIMIT = None,
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON on standard output.")] = False,
) -> None:
    """Play a playbook: change what differs, verify each change, leave the rest alone.

    Every run is journaled; --resume continues one that was cut off, --undo reverts its changes. Secrets are asked for, or read
    from a file or standard input; they are never written down.
    Exit status: 0 done or nothing to do, 1 a step failed or was declined, 2 usage or a bad playbook, 3 a robot cannot be
    reached, 130 interrupted.

    Example: lupin play sync-clock --dry-run
    """
    if list_all:
        list_playbooks(name, as_json)
        return
    if not name:
        fail_usage("name a playbook; list them with: lupin play --list")
    if undo and (others := ["--resume"] * resume + ["--from"] * bool(from_step) + ["--tag"] * bool(tags)):
        fail_usage(f"--undo undoes all steps of a run; it excludes {', '.join(others)}")
    if resume and (others := ["--from"] * bool(from_step) + ["--tag"] * bool(tags)):
        fail_usage(f"--resume continues a run with the steps that it began with; it excludes {', '.join(others)}")
    if force and not undo:
        fail_usage("--force needs --undo")
    from lupin_cli.playbook import JournalError, PlaybookError, find_run_to_undo, load
    from lupin_cli.playbook.secret_input import SecretError, read_secrets

    with ending_in_order(), reporting_errors("play"):
        try:
            playbook = load(name)
            given = parse_variables(playbook, variables or [])
            given |= read_secrets(playbook, hidden or [], given, ask_missing=not undo)
            if undo and not robot and not every:
                found = find_run_to_undo(undo, playbook.name).robot
                robots: list[Robot | None] = _select_robots([found], False, None, config) if found else [None]
            elif _needs_robot(playbook, given, resume) or robot or every:
                robots = _select_robots(robot, every, limit, config)
            else:
                robots = [None]
            progress = ProgressPrinter(quiet=as_json, several=len(robots) > 1, diff=diff)
            request = _Request(
                playbook=playbook,
                variables=given,
                from_step=from_step,
                tags=tuple(tags or ()),
                resume=resume,
                undo=undo,
                force=force,
                dry_run=dry_run,
                diff=diff,
                break_lease=break_lease,
                config=config,
                sudo_passwords=ask_sudo_passwords([each for each in robots if each is not None]) if ask_sudo else {},
                confirm=ask_operator(yes, progress),
                progress=progress,
            )
            results = _play_on_all(request, robots)
        except KeyboardInterrupt:
            # The second Ctrl-C: exit at once instead of waiting for the threads of the runs. The journal is complete.
            os._exit(INTERRUPTED)
        except (FileNotFoundError, PlaybookError, SecretError) as error:
            fail_usage(str(error))
        except JournalError as error:
            fail_usage(str(error), error.next_command)
        if as_json:
            plain = [result.plain() for result in results]
            print(json.dumps(plain if len(plain) != 1 else plain[0]))
        for result in results:
            print_result(result, as_json)
        raise typer.Exit(worst([result.exit_code for result in results]))


def _announce_stop() -> None:
    echo("stopping after the current step; press Ctrl-C again to stop at once", err=True)


def parse_variables(playbook: Playbook, words: Sequence[str]) -> dict[str, Any]:
    """Return the values of `-v name=value` as their variables' types. Raises ConfigError for one that is none of its type.

    A name that the playbook does not have is kept: the playbook refuses it.
    """
    from lupin_cli.playbook.argument_types import from_command_line
    from lupin_cli.playbook.variables import check_variable

    known = {variable.name: variable for variable in playbook.variables}
    given: dict[str, Any] = {}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals:
            raise ConfigError(f"a variable must be given as name=value: {word!r}")
        variable = known.get(name)
        try:
            given[name] = text if variable is None else check_variable(variable, from_command_line(text, variable.type))
        except ValueError as error:
            raise ConfigError(f"-v {name}: {error}") from error
        if variable is not None and variable.type == "secret":
            echo(f"every user of this computer can see -v {name}=... in the list of processes; use: --hidden {name}", err=True)
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
    tags: tuple[str, ...]
    resume: bool
    undo: str  # the run to undo, or empty
    force: bool  # the undo overwrites what was changed after that run
    dry_run: bool
    diff: bool
    break_lease: str
    config: Path | None
    sudo_passwords: dict[str, str]  # by the robot's name
    confirm: Callable[[str], bool]
    progress: Callable[[Event], None]


def _play_on_all(request: _Request, robots: list[Robot | None]) -> list[Result]:
    """Play or undo on each robot; None stands for the laptop alone."""
    from lupin_cli.connection.inventory import load as load_config
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.connection.options import open_target
    from lupin_cli.playbook import find_run_to_undo, play
    from lupin_cli.playbook.fleet import play_on_all
    from lupin_cli.playbook.serialized_target import SerializedTarget
    from lupin_cli.playbook.undo import undo

    laptop = SerializedTarget(LocalTarget())

    def play_one(robot: Robot | None, stop: threading.Event) -> Result:
        targets: dict[str, Target] = {"laptop": laptop}
        if robot is not None:
            password = request.sudo_passwords.get(robot.name)
            targets["robot"] = open_target(robot, load_config(request.config), sudo_password=password)
        try:
            if request.undo:
                run = find_run_to_undo(request.undo, request.playbook.name, robot.name if robot else "")
                return undo(
                    run, targets, dry_run=request.dry_run, force=request.force, confirm=request.confirm,
                    on_event=request.progress, stop=stop, take_lease_from=request.break_lease,
                )  # fmt: skip
            return play(
                request.playbook, targets, request.variables, dry_run=request.dry_run, diff=request.diff,
                from_step=request.from_step, tags=request.tags, resume=request.resume, confirm=request.confirm,
                on_event=request.progress, stop=stop, take_lease_from=request.break_lease,
            )  # fmt: skip
        finally:
            if robot is not None:
                targets["robot"].close()

    return play_on_all(robots, lambda robot: robot.name if robot else "", request.playbook.name, play_one, _announce_stop)


def ask_operator(yes: bool, progress: ProgressPrinter) -> Callable[[str], bool]:
    """Return a function that answers a step's question: yes if `yes`, else as the operator types; no without a terminal."""
    one_at_a_time = threading.Lock()

    def answer(question: str) -> bool:
        if yes or not sys.stdin.isatty():
            return yes
        with one_at_a_time, progress.paused():
            return confirm(question)

    return answer


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
        self._current: dict[str, str] = {}  # the step that each robot is at, shown with its time on a terminal
        self._is_paused = False
        self._repaints = not quiet and can_repaint(sys.stderr)
        if self._repaints:
            threading.Thread(target=self._repaint, name="lupin-progress", daemon=True).start()

    def __call__(self, event: Event) -> None:
        """Print one event of a run; several runs may call this at the same time."""
        with self._lock:
            self._print(event)

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Repaint nothing while a question is open."""
        with self._lock:
            self._is_paused = True
            if self._repaints:
                erase_status_line()
        try:
            yield
        finally:
            with self._lock:
                self._is_paused = False

    def _print(self, event: Event) -> None:
        if self._quiet:
            return
        prefix = f"[{event.robot}] " if self._several else ""
        place = f"{event.index + 1:>{len(str(event.total))}}/{event.total}"
        if self._repaints:
            erase_status_line()
        if event.kind == "step":
            self._started_s[event.robot] = time.monotonic()
            self._current[event.robot] = f"{prefix}{place} > {event.step}"
        elif event.kind == "difference" and event.text:
            echo(f"{prefix}{place}   {event.step}: {event.text}", err=True)
            if self._diff and event.diff:
                for line in event.diff.splitlines():
                    echo(f"{prefix}        {line}", wrap=False)
        elif event.kind == "line" and time.monotonic() - self._started_s.get(event.robot, 0.0) > _SHOW_OUTPUT_AFTER_S:
            echo(f"{prefix}        {event.text}", err=True)
        elif event.kind == "step-end":
            self._current.pop(event.robot, None)
            mark = _MARKS.get(event.state, "!")
            took = f" ({event.duration_s:.1f} s)" if event.duration_s >= 1.0 else ""
            state = "" if event.state in ("same", "changed") else f": {event.state}"
            echo(f"{prefix}{place} {mark} {event.step}{state}{took}", err=True)

    def _repaint(self) -> None:
        """Show the running steps with the time that they have taken, below what is printed."""
        while True:
            time.sleep(0.5)
            with self._lock:
                now = time.monotonic()
                steps = [f"{text} ({now - self._started_s[robot]:.0f} s)" for robot, text in self._current.items()]
                if steps and not self._is_paused:
                    show_status_line("  ".join(steps))


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
        print_next(result.next_command)
        if result.resume and result.resume not in result.next_command:
            print_next(result.resume, "then")
