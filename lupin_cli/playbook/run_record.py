"""What the journal says about a run: its steps, and whether it ended, is running or was cut off."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lupin_cli.playbook.journal import JournalError, journal_folder


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

    @property
    def finished(self) -> bool:
        """Whether there is nothing to resume."""
        return self.state in ("done", "running")


def read_run(path: Path) -> RunRecord:
    """Read a journal; unreadable lines are counted in `torn_lines`. Raises JournalError if its `start` cannot be read."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise JournalError(f"{path} cannot be read: {error.strerror or error}", "lupin journal list") from error
    lines, torn = [], 0
    for raw in data.split(b"\n"):
        if not raw.strip():
            continue
        try:
            line = json.loads(raw)
            if not isinstance(line, dict) or "event" not in line:
                raise ValueError("not an event")
            lines.append(line)
        except ValueError:
            torn += 1
    start = next((line for line in lines if line["event"] == "start"), None)
    if start is None:
        raise JournalError(f"{path} does not contain the start of a run", "lupin journal list")
    ends = [line.get("state", "failed") for line in lines if line["event"] in ("end", "resume")]
    state = ends[-1] if ends and lines[-1]["event"] == "end" else ""
    return RunRecord(
        run=path.stem,
        path=path,
        playbook=start.get("playbook", ""),
        file=start.get("file", ""),
        robot=start.get("robot", ""),
        digest=start.get("digest", ""),
        started=start.get("time", ""),
        variables=start.get("variables", {}),
        secrets=tuple(start.get("secrets", ())),
        from_step=start.get("from_step") or "",
        undo_of=start.get("undo_of", ""),
        exclusive=start.get("exclusive") is True,
        state=state or ("running" if _is_locked(path) else "cut off"),
        steps=_steps(lines),
        torn_lines=torn,
        closed=lines[-1]["event"] == "end" and lines[-1].get("closed") is True,
    )


def _steps(lines: Iterable[dict[str, Any]]) -> tuple[StepRecord, ...]:
    steps: dict[int, dict[str, Any]] = {}
    for line in lines:
        index = line.get("index")
        if not isinstance(index, int):
            continue
        step = steps.setdefault(index, {"index": index, "outputs": [], "state": "begun"})
        if line["event"] == "step":
            step.update({key: line[key] for key in ("name", "operation", "machine", "arguments", "undo") if key in line})
            step["state"] = "begun"
        elif line["event"] == "change":
            step.update(summary=line.get("summary", ""), diff=line.get("diff", ""), state="changing")
            step.setdefault("before", line.get("before", {}))
        elif line["event"] == "output":
            step["outputs"].append(line.get("text", ""))
        elif line["event"] == "step-end":
            step.update({key: line[key] for key in ("state", "error", "duration_s", "result") if key in line})
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
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def list_runs(folder: Path | None = None) -> list[RunRecord]:
    """Return all runs whose journal can be read, the newest first."""
    folder = folder or journal_folder()
    runs = []
    for path in sorted(folder.glob("*.jsonl"), key=lambda p: (p.stat().st_mtime_ns, p.name), reverse=True):
        try:
            runs.append(read_run(path))
        except JournalError:
            continue  # the run was killed before its first line was complete
    return runs


def find_playbook_run(name: str, folder: Path | None = None) -> RunRecord:
    """Return a run by its id, a unique prefix of it, or "latest". Raises JournalError."""
    folder = folder or journal_folder()
    exact = folder / f"{name}.jsonl"
    if exact.is_file():
        return read_run(exact)
    runs = list_runs(folder)
    if name == "latest" and runs:
        return runs[0]
    matching = [run for run in runs if run.run.startswith(name)]
    if len(matching) == 1:
        return matching[0]
    what = f"{len(matching)} runs begin with {name!r}" if matching else f"there is no run {name!r}"
    raise JournalError(what, "lupin journal list")
