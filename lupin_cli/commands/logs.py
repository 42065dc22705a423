"""`lupin logs`: print the logs of a run's processes, merged by time."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from lupin_cli.completion import log_levels, processes
from lupin_cli.exit_codes import UNREACHABLE, USAGE_ERROR
from lupin_cli.run.run_option import ANY_RUN
from lupin_cli.terminal import echo
from lupin_runtime.bounded_file import open_regular

if TYPE_CHECKING:
    from lupin_runtime.stack.log_lines import LogLine
    from lupin_runtime.stack.runs import Run

FOLLOW_PERIOD_S = 0.2


def command(
    process: list[str] = typer.Argument(None, autocompletion=processes, help="Names of processes; without one, all."),
    run: ANY_RUN = None,
    lines: int = typer.Option(100, "--lines", "-n", min=0, help="Print this many of the last lines."),
    level: str = typer.Option("debug", "--level", "-l", autocompletion=log_levels, help="Leave out what is below this level."),
    follow: bool = typer.Option(False, "--follow", "-f", help="Print new lines until the run ends or Ctrl-C."),
    as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output; not with --follow."),
) -> None:
    """Print the logs of a run's processes, merged by time: time of day, level, process, text.

    Levels are debug, info, warn, error and fatal. Lines that a process printed itself, such as a stack trace, have the level
    of the line before.
    Exit status: 0 printed, 2 usage, or the run has no such process, 3 no such run.

    Example: lupin logs nav slam --level warn -f
    """
    from lupin_runtime.stack.log_lines import LEVELS, merged
    from lupin_runtime.stack.runs import RunError, find_run

    if level not in LEVELS:
        raise typer.BadParameter(f"{level!r} is none of: {', '.join(LEVELS)}", param_hint="--level")
    if as_json and follow:
        raise typer.BadParameter("excludes --follow", param_hint="--json")
    try:
        found = find_run(run)
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    files = sorted(found.logs.glob("*.log"))
    known = [path.stem for path in files]
    for name in process or []:
        if name not in known:
            echo(f"run {found.id} has no process {name!r}; it has: {', '.join(known)}", err=True)
            raise typer.Exit(USAGE_ERROR)
    selected = [path for path in files if not process or path.stem in process]
    tails = {path: _Tail(path) for path in selected}
    logs = [tail.lines(unfinished=not follow) for tail in tails.values()]
    shown = [line for line in merged(logs) if line.is_at_least(level)]
    shown = shown[len(shown) - min(lines, len(shown)) :]
    if as_json:
        print(json.dumps([_plain(line) for line in shown]))
        return
    show = _printer(known)
    show(shown)
    if follow:
        _follow(found, process or [], tails, level, show)


def _plain(line: LogLine) -> dict[str, object]:
    time_s = line.time_s or None
    return {"time_s": time_s, "level": line.level or None, "process": line.process, "node": line.node, "text": line.text}


def _printer(names: Sequence[str]) -> Callable[[Sequence[LogLine]], None]:
    """Return a function that prints lines; the level is colored on a terminal."""
    from rich.text import Text

    from lupin_cli.safe_console import SafeConsole

    console = SafeConsole()
    width = max((len(name) for name in names), default=0)
    today = time.strftime("%m-%d")
    styles = {"warn": "yellow", "error": "bold red", "fatal": "bold red", "debug": "dim"}

    def show(lines: Sequence[LogLine]) -> None:
        for line in lines:
            stamp = "" if line.continues else _time_text(line.time_s, today)
            level = "" if line.continues else line.level
            # A node's name says more than the process's only if it differs.
            text = f"{line.node}: {line.text}" if line.node and not line.continues else line.text
            head = f"{stamp:12}  {level:5}"
            console.print(Text.assemble((head, styles.get(level, "")), f"  {line.process:{width}}  {text}"), soft_wrap=True)

    return show


def _time_text(time_s: float, today: str) -> str:
    """Return the time of day with milliseconds, before it month and day unless they are today's."""
    local = time.localtime(time_s)
    day = time.strftime("%m-%d", local)
    return f"{'' if day == today else f'{day} '}{time.strftime('%H:%M:%S', local)}.{int(time_s * 1000) % 1000:03d}"


class _Tail:
    """The lines of a log, read as it grows. A log that was truncated is read from its beginning."""

    def __init__(self, path: Path) -> None:
        from lupin_runtime.stack.log_lines import LogParser

        self._path = path
        self._parser = LogParser(path.stem)
        self._position = 0
        self._rest = b""

    def lines(self, *, unfinished: bool = False) -> list[LogLine]:
        """Return the lines that were completed since the last call; the first call returns all of them.

        With `unfinished`, the last line is returned although its process has not completed it.
        """
        try:
            with open_regular(self._path) as log:
                if log.seek(0, 2) < self._position:
                    self._position, self._rest = 0, b""
                log.seek(self._position)
                data = log.read()
        except OSError:
            return []  # being replaced, or the disk fails: the next call tries again
        self._position += len(data)
        *complete, self._rest = (self._rest + data).split(b"\n")
        if unfinished and self._rest:
            complete.append(self._rest)
        return [self._parser.parse(line.decode(errors="replace").rstrip()) for line in complete]


def _follow(
    run: Run, names: list[str], tails: dict[Path, _Tail], level: str, show: Callable[[Sequence[LogLine]], None]
) -> None:
    """Print new lines until the run has ended, also those of processes that start later, unless some were named."""
    from lupin_runtime.stack.log_lines import merged

    alive = True
    while alive:
        alive = run.is_live()  # read first, so that what a process writes at its end is printed too
        paths = [path for path in sorted(run.logs.glob("*.log")) if not names or path.stem in names]
        new = merged([tails.setdefault(path, _Tail(path)).lines() for path in paths])
        show([line for line in new if line.is_at_least(level)])
        if alive:
            time.sleep(FOLLOW_PERIOD_S)
