"""Run directories: where one run of the stack keeps its logs, state, recording and report, and how others find it.

`${XDG_STATE_HOME:-~/.local/state}/lupin/runs/<id>/`. A run is alive while its supervisor holds the lock file, so a crashed
supervisor needs no clean-up to be seen as dead.
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


class RunError(RuntimeError):
    """A run cannot be made, found or told apart; the message says what to type."""


def state_home() -> Path:
    """The folder of everything that runs leave behind."""
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(base) / "lupin"


def write_atomically(path: Path, text: str) -> None:
    """Replace a file in one step: a reader sees the old text or the new, never half."""
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    partial.write_text(text)
    partial.replace(path)


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
        """One log file per process."""
        return self.path / "logs"

    @property
    def recording(self) -> Path:
        """What was said on the graph."""
        return self.path / "recording.mcap"

    @property
    def report(self) -> Path:
        """Folder of the report."""
        return self.path / "report"

    def info(self) -> dict[str, Any]:
        """What the run was started as: pid, domain, target, world, environment. Empty where it never got that far."""
        return _read(self.path / "run.json")

    def state(self) -> dict[str, Any]:
        """The supervisor's last word: stages, processes, mission."""
        return _read(self.path / "state.json")

    def write_info(self, info: Mapping[str, Any]) -> None:
        """Say what the run was started as."""
        write_atomically(self.path / "run.json", json.dumps(dict(info), indent=1))

    def write_state(self, state: Mapping[str, Any]) -> None:
        """Say how it goes."""
        write_atomically(self.path / "state.json", json.dumps(dict(state)))

    def alive(self) -> bool:
        """Whether its supervisor lives."""
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
    """The folder of all runs."""
    return state_home() / "runs"


def create_run() -> tuple[Run, int]:
    """A new run and the descriptor of its lock, held until this process ends or closes it."""
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
    """Every run there is, oldest first."""
    folder = runs_directory()
    if not folder.is_dir():
        return []
    return [Run(path) for path in sorted(folder.iterdir()) if path.is_dir()]


def live_runs() -> list[Run]:
    """The runs whose supervisor lives, oldest first."""
    return [run for run in all_runs() if run.alive()]


def find_live_run(name: str | None = None) -> Run:
    """The live run called `name` (a unique part is enough), or the only one. Raises RunError."""
    candidates = [run for run in live_runs() if name is None or name in run.id]
    if len(candidates) == 1:
        return candidates[0]
    if not candidates:
        wanted = f" like {name!r}" if name else ""
        raise RunError(f"no run{wanted} is up; start one with: lupin up")
    raise RunError(f"several runs are up; say which with --run: {', '.join(run.id for run in candidates)}")


def find_run(name: str | None = None) -> Run:
    """A live run, or else the newest ended one. Raises RunError."""
    runs = [run for run in all_runs() if name is None or name in run.id]
    if not runs:
        raise RunError(f"there is no run{f' like {name!r}' if name else ''}; start one with: lupin up")
    alive = [run for run in runs if run.alive()]
    return (alive or runs)[-1]
