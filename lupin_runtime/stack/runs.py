"""Run directories, which hold the logs, state, recording and report of one run of the stack, and the functions that find them.

A run is in `${XDG_STATE_HOME:-~/.local/state}/lupin/runs/<id>/`. It is live while its supervisor holds a lock on the file
`lock`, so no run seems live after its supervisor has crashed.
"""

from __future__ import annotations

import fcntl
import json
import os
import secrets
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_runtime.atomic_file import read_json_object, write_atomically
from lupin_runtime.json_text import conform

PROCESS_UMASK = 0o077  # of a run's processes: what they write, such as the recording, is for their user only
LATEST = "latest"  # names the newest run
MAX_LISTED = 10  # an error lists this many runs
# What readers of `state.json` rely on. The file may be incomplete, of another version, or damaged.
_STATE: dict[str, Any] = {
    "id": "",
    "age_s": 0.0,
    "stages": [
        {
            "name": "",
            "phase": "",
            "pid": None,
            "start_ticks": None,
            "trouble": "",
            "up_after_s": None,
            "waiting_for": [""],
            "waiting_s": 0.0,
            "cpu_percent": 0.0,
            "memory_mb": 0.0,
            "restarts": 0,
            "why": "",
        }
    ],
    "deaths": [{"stage": "", "status": "", "consequence": "", "ends_run": False}],
    "alarms": [""],
    "silent_s": {},
    "rates_hz": {},
    "mission": {},
    "events": [{"clock_s": None, "text": ""}],
    "robot": {
        "pose": [0.0],
        "trail": [[0.0]],
        "plan": [[0.0]],
        "tags": [{"id": "", "x": None, "y": None, "read": False}],
        "map": {"x": 0.0, "y": 0.0, "cell_m": 0.0, "rows": [""], "free_m2": None},
        "distance_m": None,
        "speed_m_s": None,
        "battery": None,
        "real_time_factor": None,
    },
}
_MISSION: dict[str, Any] = {
    "lifecycle_state": "",
    "mission_phase": "",
    "current_target": "",
    "last_event": "",
    "estop_engaged": False,
    "paused": False,
    "battery_low": False,
    "tags_discovered": 0,
    "targets_total": 0,
    "targets_completed": 0,
    "targets_failed": 0,
    "targets_unreachable": 0,
    "clock_s": None,
}


class RunError(RuntimeError):
    """A run cannot be created, is not found, or is ambiguous; the message gives the command to type."""


def state_directory() -> Path:
    """Return the folder of all state that Lupin keeps for this user."""
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(base) / "lupin"


def make_state_folder(folder: Path) -> None:
    """Make a folder that only this user may enter; `state_directory()` is closed to others if it was open. Raises OSError.

    In it are locks, which others could hold, and logs and recordings, which are not theirs. `write_atomically` lets nobody else
    read what it writes there.
    """
    home = state_directory()
    inner = [path for path in (folder, *folder.parents) if path != home and path.is_relative_to(home)]
    for path in (home, *reversed(inner)) if folder.is_relative_to(home) else (folder,):
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
    if home.is_dir() and home.stat().st_mode & 0o077 and home.stat().st_uid == os.getuid():
        home.chmod(0o700)


@dataclass(frozen=True)
class Run:
    """The directory of one run."""

    path: Path

    @property
    def id(self) -> str:
        """The name of its directory, such as 20261124-071233-ab12."""
        return self.path.name

    @property
    def logs(self) -> Path:
        """The folder of log files, one per process."""
        return self.path / "logs"

    @property
    def recording(self) -> Path:
        """The MCAP recording of the graph; missing if the run was started with `--no-record`."""
        return self.path / "recording.mcap"

    @property
    def report(self) -> Path:
        """The folder of the report, which a mission writes at its end, and `lupin report`."""
        return self.path / "report"

    def info(self) -> dict[str, Any]:
        """Return how the run was started: pid, DDS domain, options, environment. Empty without a readable `run.json`."""
        return read_json_object(self.path / "run.json")

    def state(self) -> dict[str, Any]:
        """Return the supervisor's last state: processes (`stages`), alarms, mission. Empty without a readable `state.json`."""
        found = read_json_object(self.path / "state.json")
        if not found:
            return {}
        state: dict[str, Any] = conform(found, _STATE)
        if mission := state.get("mission"):
            state["mission"] = conform(mission, _MISSION)
        for topics in ("silent_s", "rates_hz"):
            state[topics] = {name: value for name, value in state.get(topics, {}).items() if conform(value, None) is not None}
        return state

    def write_info(self, info: Mapping[str, Any]) -> None:
        """Write `run.json`, see `info`."""
        write_atomically(self.path / "run.json", json.dumps(dict(info), indent=1))

    def write_state(self, state: Mapping[str, Any]) -> None:
        """Write `state.json`, see `state`."""
        write_atomically(self.path / "state.json", json.dumps(dict(state)))

    def is_kept(self) -> bool:
        """Return whether a person protected it from removal."""
        return (self.path / "keep").exists()

    def set_kept(self, kept: bool) -> None:
        """Protect it from removal, or let it be removed again. Raises OSError."""
        if kept:
            (self.path / "keep").touch(mode=0o600)
        else:
            (self.path / "keep").unlink(missing_ok=True)

    def is_live(self) -> bool:
        """Return whether its supervisor still runs."""
        try:
            descriptor = os.open(self.path / "lock", os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
        except OSError:
            return False
        try:
            # Shared: two commands that ask at the same moment must not take each other for the supervisor.
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
        else:
            return False
        finally:
            os.close(descriptor)


def runs_directory() -> Path:
    """Return the folder of all runs."""
    return state_directory() / "runs"


def create_run() -> tuple[Run, int]:
    """Create a run. Return it with the descriptor of its lock; the run is live until that is closed. Raises RunError."""
    run = Run(runs_directory() / f"{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(2)}")
    try:
        make_state_folder(run.logs)
        lock = os.open(run.path / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        fcntl.flock(lock, fcntl.LOCK_EX)
    except OSError as error:
        reason = f"cannot make the run directory {run.path}: {error.strerror}; free space or set XDG_STATE_HOME"
        raise RunError(reason) from error
    return run, lock


def all_runs(folder: Path | None = None) -> list[Run]:
    """Return all runs, oldest first. `folder` replaces the folder of all runs."""
    folder = folder or runs_directory()
    if not folder.is_dir():
        return []
    return [Run(path) for path in sorted(folder.iterdir()) if path.is_dir() and not path.is_symlink()]


def live_runs() -> list[Run]:
    """Return the live runs, oldest first."""
    return [run for run in all_runs() if run.is_live()]


def choose_id(name: str, ids: Sequence[str]) -> str:
    """Return the id that an operator calls `name`: `latest`, an id, or any part of an id that only one of `ids` has.

    All commands name runs by this rule. `ids` are oldest first. Raises RunError, which lists what can be chosen.
    """
    if name == LATEST and ids:
        return ids[-1]
    matching = [one for one in ids if name == one] or [one for one in ids if name in one]
    if len(matching) == 1:
        return matching[0]
    if matching:
        raise RunError(f"{len(matching)} runs have {name!r} in their ids; type more of one: {_listed(matching)}")
    raise RunError(f"no run has {name!r} in its id; the newest: {_listed(ids) or 'none'}")


def choose_run(name: str, runs: Sequence[Run]) -> Run:
    """Return the one of `runs`, oldest first, that an operator calls `name`; see `choose_id`. Raises RunError."""
    chosen = choose_id(name, [run.id for run in runs])
    return next(run for run in runs if run.id == chosen)


def find_live_run(name: str | None = None) -> Run:
    """Return the live run called `name` (see `choose_run`), or the only live run. Raises RunError."""
    live = live_runs()
    if not live:
        raise RunError("no run is up; start one with: lupin up")
    if name is None:
        if len(live) > 1:
            raise RunError(f"several runs are up; choose one with --run: {_listed([run.id for run in live])}")
        return live[0]
    try:
        return choose_run(name, live)
    except RunError as error:
        raise RunError(f"of the runs that are up, {error}") from error


def find_run(name: str | None = None) -> Run:
    """Return the run called `name` (see `choose_run`), or the newest live one, or else the newest one. Raises RunError."""
    runs = all_runs()
    if not runs:
        raise RunError("there is no run; start one with: lupin up")
    if name is not None:
        return choose_run(name, runs)
    return ([run for run in runs if run.is_live()] or runs)[-1]


def _listed(ids: Sequence[str]) -> str:
    """Return the ids, the newest first; of many, the newest."""
    return ", ".join([*reversed(ids[-MAX_LISTED:]), *(["…"] if len(ids) > MAX_LISTED else [])])
