"""The journal: what a run was asked, did, saw and left, as JSON lines that are on the disk before the next thing is done.

One file a run, under $XDG_STATE_HOME/lupin/journal/, readable by its owner only: what `undo` needs (`before`) is kept as it
was. All else goes through the mask. A run holds a lock on its file while it goes on, so a run without an end whose lock nobody
holds was cut off, and can be resumed.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import threading
from collections.abc import Iterable, Mapping
from dataclasses import field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from lupin_cli.masking import MASK, mask_secrets
from lupin_cli.quick_dataclass import dataclass

_SHORTEST_SECRET = 3


class JournalError(Exception):
    """A journal that can't be written or isn't there, and the next command to type."""

    def __init__(self, message: str, next_command: str = "") -> None:
        super().__init__(message)
        self.next_command = next_command


def journal_folder() -> Path:
    """Where journals are kept."""
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(state) / "lupin" / "journal"


@dataclass(frozen=True)
class Mask:
    """Takes secrets out of whatever is written down: those that were given, and `psk=...` in somebody's output."""

    secrets: tuple[str, ...] = ()

    def __call__(self, value: Any) -> Any:
        if isinstance(value, str):
            for secret in self.secrets:
                if len(secret) >= _SHORTEST_SECRET:
                    value = value.replace(secret, MASK)
            return mask_secrets(value)
        if isinstance(value, Mapping):
            return {key: self(item) for key, item in value.items()}
        if isinstance(value, (list, tuple)):
            return [self(item) for item in value]
        return value


class Journal:
    """The open journal of one run."""

    def __init__(self, path: Path, descriptor: int, mask: Mask) -> None:
        self.path = path
        self.run = path.stem
        self._descriptor = descriptor
        self._mask = mask
        self._lock = threading.Lock()

    @classmethod
    def begin(cls, folder: Path, playbook: str, robot: str, mask: Mask, start: Mapping[str, Any]) -> Journal:
        """Open the journal of a new run; raises JournalError."""
        stamp = datetime.now(timezone.utc).strftime("%Y%m%d-%H%M%S")
        stem = re.sub(r"[^A-Za-z0-9_.-]+", "-", f"{stamp}-{playbook}" + (f"-{robot}" if robot else ""))
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            for count in range(1000):
                path = folder / (f"{stem}.jsonl" if count == 0 else f"{stem}.{count}.jsonl")
                try:
                    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
                    break
                except FileExistsError:
                    continue
            else:
                raise JournalError(f"{folder} has a thousand journals of this second")
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            directory = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            os.fsync(directory)
            os.close(directory)
        except OSError as error:
            raise JournalError(
                f"no journal can be written in {folder}: {error.strerror or error}", "export XDG_STATE_HOME=..."
            ) from error
        journal = cls(path, descriptor, mask)
        journal.write("start", **start)
        return journal

    @classmethod
    def again(cls, path: Path, mask: Mask) -> Journal:
        """Open the journal of a run that was cut off, to go on with it; raises JournalError where it still runs."""
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC)
        except OSError as error:
            raise JournalError(f"{path} cannot be written: {error.strerror or error}") from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(descriptor)
            raise JournalError(f"the run {path.stem} is still going on", f"lupin journal show {path.stem}") from error
        journal = cls(path, descriptor, mask)
        size = os.fstat(descriptor).st_size
        if size and os.pread(descriptor, 1, size - 1) != b"\n":
            os.write(descriptor, b"\n")  # the line that was torn stays torn: nobody can read it, and the next one is whole
        journal.write("resume")
        return journal

    def write(self, event: str, *, sync: bool = True, before: Mapping[str, Any] | None = None, **values: Any) -> None:
        """Add one line, and wait until the disk has it. `before` is not masked: undo writes it back as it was."""
        line = {"event": event, "time": datetime.now(timezone.utc).isoformat(timespec="milliseconds"), **self._mask(values)}
        if before is not None:
            line["before"] = dict(before)
        data = json.dumps(line, ensure_ascii=False).encode("utf-8", "surrogateescape") + b"\n"
        with self._lock:
            try:
                while data:
                    data = data[os.write(self._descriptor, data) :]
                if sync:
                    os.fdatasync(self._descriptor)
            except OSError as error:
                raise JournalError(f"{self.path} cannot be written: {error.strerror or error}", "lupin journal list") from error

    def close(self) -> None:
        """Let the lock go."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


@dataclass(frozen=True)
class StepRecord:
    """What a journal tells of one step."""

    index: int
    name: str
    operation: str
    machine: str
    arguments: dict[str, Any]
    state: str  # begun | changing | same | changed | skipped | failed | lost | declined | interrupted
    undo: bool = True
    summary: str = ""
    diff: str = ""
    before: dict[str, Any] | None = None  # the first one: what was there before the first attempt
    result: dict[str, Any] = field(default_factory=dict)
    error: str = ""
    duration_s: float = 0.0
    outputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class RunRecord:
    """What a journal tells of one run."""

    run: str
    path: Path
    playbook: str
    file: str
    robot: str
    digest: str
    started: str
    variables: dict[str, Any]
    secrets: tuple[str, ...]  # names of the variables that were not written down
    from_step: str
    undo_of: str
    state: str  # done | failed | unreachable | declined | interrupted | running | cut off
    steps: tuple[StepRecord, ...]
    torn_lines: int = 0
    exclusive: bool = False  # it takes the robot's lease
    closed: bool = False  # it failed, and then did what is to be done always: it isn't resumed but played anew

    @property
    def finished(self) -> bool:
        """Whether there is nothing to resume."""
        return self.state in ("done", "running")


def read_run(path: Path) -> RunRecord:
    """Read a journal; lines that can't be read are counted, not fatal. Raises JournalError where no start can be read."""
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
        raise JournalError(f"{path} holds no start of a run", "lupin journal list")
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
    """All runs whose journal can be read, the newest first."""
    folder = folder or journal_folder()
    runs = []
    for path in sorted(folder.glob("*.jsonl"), key=lambda p: (p.stat().st_mtime_ns, p.name), reverse=True):
        try:
            runs.append(read_run(path))
        except JournalError:
            continue  # a journal that was cut off before its first line tells nothing
    return runs


def find_run(name: str, folder: Path | None = None) -> RunRecord:
    """The run that `name` means: its id, the beginning of it if only one has it, or: latest. Raises JournalError."""
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
