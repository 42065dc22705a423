"""Run directories, which hold the logs, state, recording and report of one run of the stack, and the functions that find them.

A run is in `${XDG_STATE_HOME:-~/.local/state}/lupin/runs/<id>/`. It is alive while its supervisor holds a lock on the file
`lock`, so no run seems alive after its supervisor has crashed.
"""

from __future__ import annotations

import fcntl
import json
import os
import secrets
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_runtime.atomic_file import write_atomically


class RunError(RuntimeError):
    """A run cannot be created, is not found, or is ambiguous; the message gives the command to type."""


def state_home() -> Path:
    """Return the folder of all state that Lupin keeps for this user."""
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(base) / "lupin"


@dataclass(frozen=True)
class Run:
    """The directory of one run."""

    path: Path

    @property
    def id(self) -> str:
        """The run's name."""
        return self.path.name

    @property
    def logs(self) -> Path:
        """The folder of log files, one per process."""
        return self.path / "logs"

    @property
    def recording(self) -> Path:
        """The recording of the graph."""
        return self.path / "recording.mcap"

    @property
    def report(self) -> Path:
        """The folder of the report."""
        return self.path / "report"

    def info(self) -> dict[str, Any]:
        """Return how the run was started: pid, DDS domain, options, environment. Empty if it ended before writing that."""
        return _read(self.path / "run.json")

    def state(self) -> dict[str, Any]:
        """Return the last state that the supervisor wrote: stages, processes, mission."""
        return _read(self.path / "state.json")

    def write_info(self, info: Mapping[str, Any]) -> None:
        """Write `run.json`, see `info`."""
        write_atomically(self.path / "run.json", json.dumps(dict(info), indent=1))

    def write_state(self, state: Mapping[str, Any]) -> None:
        """Write `state.json`, see `state`."""
        write_atomically(self.path / "state.json", json.dumps(dict(state)))

    def is_kept(self) -> bool:
        """Return whether a person protected it from removal."""
        return (self.path / "keep").exists()

    def keep(self, kept: bool) -> None:
        """Protect it from removal, or let it be removed again. Raises OSError."""
        if kept:
            (self.path / "keep").touch()
        else:
            (self.path / "keep").unlink(missing_ok=True)

    def alive(self) -> bool:
        """Return whether its supervisor is alive."""
        try:
            descriptor = os.open(self.path / "lock", os.O_RDWR)
        except OSError:
            return False
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return True
        else:
            return False
        finally:
            os.close(descriptor)


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def runs_directory() -> Path:
    """Return the folder of all runs."""
    return state_home() / "runs"


def create_run() -> tuple[Run, int]:
    """Create a run. Return it with the descriptor of its lock; the run is alive until that is closed. Raises RunError."""
    run = Run(runs_directory() / f"{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(2)}")
    try:
        run.logs.mkdir(parents=True)
    except OSError as error:
        reason = f"cannot make the run directory {run.path}: {error.strerror}; free space or set XDG_STATE_HOME"
        raise RunError(reason) from error
    lock = os.open(run.path / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    fcntl.flock(lock, fcntl.LOCK_EX)
    return run, lock


def all_runs() -> list[Run]:
    """Return all runs, oldest first."""
    folder = runs_directory()
    if not folder.is_dir():
        return []
    return [Run(path) for path in sorted(folder.iterdir()) if path.is_dir() and not path.is_symlink()]


def live_runs() -> list[Run]:
    """Return the runs whose supervisor is alive, oldest first."""
    return [run for run in all_runs() if run.alive()]


def find_live_run(name: str | None = None) -> Run:
    """Return the live run whose id contains `name`, or the only live run. Raises RunError unless there is exactly one."""
    candidates = [run for run in live_runs() if name is None or name in run.id]
    if len(candidates) == 1:
        return candidates[0]
    if not candidates:
        pattern = f" like {name!r}" if name else ""
        raise RunError(f"no run{pattern} is up; start one with: lupin up")
    raise RunError(f"several runs are up; choose one with --run: {', '.join(run.id for run in candidates)}")


def find_run(name: str | None = None) -> Run:
    """Return the newest live run whose id contains `name`, or else the newest ended one. Raises RunError."""
    runs = [run for run in all_runs() if name is None or name in run.id]
    if not runs:
        raise RunError(f"there is no run{f' like {name!r}' if name else ''}; start one with: lupin up")
    alive = [run for run in runs if run.alive()]
    return (alive or runs)[-1]
