"""What the journal says about a run: its steps, and whether it ended, is running or was cut off."""

from __future__ import annotations

import fcntl
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from lupin_cli.package_data import shipped_folder
from lupin_cli.playbook.journal import JournalError, journal_folder
from lupin_cli.printed_commands import lupin
from lupin_runtime.bounded_file import is_file, open_regular, read_bounded
from lupin_runtime.json_text import conform, parse_json
from lupin_runtime.stack.runs import LATEST, RunError, choose_id

MAX_JOURNAL_BYTES = 256 << 20  # undo keeps up to 1 MB of each file that a step replaces
# What readers of a journal rely on, by event. It may be of another version, or damaged.
_STEP: dict[str, Any] = {"name": "", "operation": "", "machine": "", "arguments": {}, "undo": True}
_LINES: dict[str, dict[str, Any]] = {
    "start": {
        **dict.fromkeys(("playbook", "file", "robot", "digest", "time", "from_step", "undo_of", "command", "operator"), ""),
        "variables": {},
        "secrets": [""],
        "exclusive": False,
        "tags": [""],
    },
    "step": _STEP,
    "change": {"summary": "", "diff": "", "before": {}, "found": {}},
    "output": {"text": ""},
    "step-end": {"state": "failed", "error": "", "duration_s": 0.0, "result": {}, "left": {}},
    "end": {"state": "failed", "closed": False},
}


@dataclass(frozen=True)
class StepRecord:
    """What the journal says about one step."""

    index: int
    name: str
    operation: str
    machine: str
    arguments: dict[str, Any]
    state: str  # begun | changing | same | changed | skipped | failed | lost | declined | interrupted
    undo: bool = True
    summary: str = ""
    diff: str = ""
    before: dict[str, Any] | None = None  # the state before the first attempt
    found: dict[str, str] = field(default_factory=dict)  # digests of what `undo` overwrites, before the first attempt
    left: dict[str, str] = field(default_factory=dict)  # the same after the step; empty if it did not end
    result: dict[str, Any] = field(default_factory=dict)
    error: str = ""
    duration_s: float = 0.0
    outputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class RunRecord:
    """What the journal says about one run."""

    run: str
    path: Path
    playbook: str
    file: str
    robot: str
    digest: str
    started: str
    variables: dict[str, Any]
    secrets: tuple[str, ...]  # the names of secret variables, whose values are not written
    from_step: str
    undo_of: str
    state: str  # done | failed | unreachable | declined | interrupted | running | cut off
    steps: tuple[StepRecord, ...]
    torn_lines: int = 0
    exclusive: bool = False  # it took the robot's lease
    closed: bool = False  # it failed and then ran its `always` steps: it can be played again, but not resumed
    command: str = ""  # what the operator typed to start it
    operator: str = ""  # user@machine
    tags: tuple[str, ...] = ()  # with which its steps were chosen
    duration_s: float = 0.0  # from its start to the last line of its journal, pauses before a --resume included

    @property
    def finished(self) -> bool:
        """Whether there is nothing to resume."""
        return self.state in ("done", "running")

    @property
    def undoable_steps(self) -> tuple[StepRecord, ...]:
        """The steps that changed something, or began to, except those with `undo: false`."""
        return tuple(step for step in self.steps if step.before is not None and step.undo)


def resume_command(run: RunRecord) -> str:
    """Return what an operator types to continue a run."""
    return lupin("play", _typed_name(run), "--resume", robot=run.robot)


def undo_command(run: RunRecord) -> str:
    """Return what an operator types to undo a run."""
    return lupin("play", _typed_name(run), "--undo", run.run, robot=run.robot)


def _typed_name(run: RunRecord) -> str:
    shipped = Path(run.file).parent == shipped_folder("playbooks")
    return run.playbook if shipped else run.file


def read_run(path: Path) -> RunRecord:
    """Read a journal; unreadable lines are counted in `torn_lines`. Raises JournalError if its `start` cannot be read."""
    try:
        data = read_bounded(path, MAX_JOURNAL_BYTES)
    except OSError as error:
        raise JournalError(f"{path} cannot be read: {error.strerror or error}", "lupin journal list") from error
    lines, torn = [], 0
    for raw in data.split(b"\n"):
        if not raw.strip():
            continue
        try:
            line = parse_json(raw)
            if not isinstance(line, dict) or not isinstance(line.get("event"), str):
                raise ValueError("not an event")
            lines.append(conform(line, _LINES.get(line["event"], {})))
        except ValueError:
            torn += 1
    start = next((line for line in lines if line["event"] == "start"), None)
    if start is None:
        raise JournalError(f"{path} does not contain the start of a run", "lupin journal list")
    ends = [line.get("state") or "failed" for line in lines if line["event"] in ("end", "resume")]
    state = ends[-1] if ends and lines[-1]["event"] == "end" else ""
    return RunRecord(
        run=path.stem,
        path=path,
        playbook=start["playbook"],
        file=start["file"],
        robot=start["robot"],
        digest=start["digest"],
        started=start["time"],
        variables=start["variables"],
        secrets=tuple(start["secrets"]),
        from_step=start["from_step"],
        undo_of=start["undo_of"],
        exclusive=start["exclusive"],
        state=state or ("running" if _is_locked(path) else "cut off"),
        steps=_steps(lines),
        torn_lines=torn,
        closed=lines[-1]["event"] == "end" and lines[-1].get("closed") is True,
        command=start["command"],
        operator=start["operator"],
        tags=tuple(start["tags"]),
        duration_s=_seconds_between(start["time"], lines[-1].get("time", "")),
    )


def _seconds_between(start: str, end: str) -> float:
    try:
        return max(0.0, (datetime.fromisoformat(end) - datetime.fromisoformat(start)).total_seconds())
    except (TypeError, ValueError):  # an old or damaged journal
        return 0.0


def _steps(lines: Iterable[dict[str, Any]]) -> tuple[StepRecord, ...]:
    steps: dict[int, dict[str, Any]] = {}
    for line in lines:
        index = line.get("index")
        if type(index) is not int or index < 0:
            continue
        step = steps.setdefault(index, {"index": index, "outputs": [], "state": "begun"})
        if line["event"] == "step":
            step.update({key: line[key] for key in ("name", "operation", "machine", "arguments", "undo") if key in line})
            step.update(state="begun", left={})
        elif line["event"] == "change":
            step.update(summary=line.get("summary", ""), diff=line.get("diff", ""), state="changing")
            step.setdefault("before", line.get("before", {}))
            step.setdefault("found", line.get("found", {}))
        elif line["event"] == "output":
            step["outputs"].append(line.get("text", ""))
        elif line["event"] == "step-end":
            step.update({key: line[key] for key in ("state", "error", "duration_s", "result", "left") if key in line})
    keep = StepRecord.__dataclass_fields__
    defaults = {"name": "", "operation": "", "machine": "", "arguments": {}}
    return tuple(
        StepRecord(
            **{**defaults, **{key: value for key, value in step.items() if key in keep}, "outputs": tuple(step["outputs"])}
        )
        for _, step in sorted(steps.items())
    )


def _is_locked(path: Path) -> bool:
    try:
        with open_regular(path) as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def list_runs(folder: Path | None = None) -> list[RunRecord]:
    """Return all runs whose journal can be read, the newest first."""
    folder = folder or journal_folder()
    runs = []
    for path in _journals(folder):
        try:
            runs.append(read_run(path))
        except JournalError:
            continue  # the run was killed before its first line was complete
    return runs


def undone_runs(runs: Iterable[RunRecord]) -> frozenset[str]:
    """Return the ids of the runs whose undo, at least of a part, is among these."""
    return frozenset(run.undo_of for run in runs if run.undo_of and run.steps)


def find_run_to_undo(name: str, playbook: str, robot: str = "", folder: Path | None = None) -> RunRecord:
    """Return the run of `playbook` to undo: by its name (see `find_playbook_run`), on `robot` if one is given.

    The latest one is the newest that has something to undo. Raises JournalError, also for a run of another playbook, and for a
    run that is itself an undo.
    """
    if name == LATEST:
        mine = [run for run in list_runs(folder) if run.playbook == playbook and not run.undo_of and robot in ("", run.robot)]
        for run in mine:
            if run.undoable_steps or run.state == "running":
                return run
        did = "has changed nothing" if mine else "has not been played"
        on_robot = f" on {robot}" if robot else ""
        raise JournalError(f"{playbook} {did}{on_robot}: there is nothing to undo", "lupin journal list")
    run = find_playbook_run(name, folder)
    if run.playbook != playbook:
        message = f"{run.run} is a run of {run.playbook}, not of {playbook}"
        raise JournalError(message, undo_command(run))
    return run


def find_playbook_run(name: str, folder: Path | None = None) -> RunRecord:
    """Return the run called `name`, by the same rule as runs of the stack (see `choose_id`). Raises JournalError."""
    folder = folder or journal_folder()
    if name == LATEST and (runs := list_runs(folder)):
        return runs[0]  # the newest that can be read
    try:
        chosen = choose_id(name, [path.stem for path in _journals(folder)][::-1])
    except RunError as error:
        raise JournalError(str(error), "lupin journal list") from error
    return read_run(folder / f"{chosen}.jsonl")


def _journals(folder: Path) -> list[Path]:
    """Return the files of all runs, the newest first."""
    files = [path for path in folder.glob("*.jsonl") if is_file(path)]
    return sorted(files, key=lambda path: (path.stat().st_mtime_ns, path.name), reverse=True)
