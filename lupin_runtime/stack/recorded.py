"""The processes that a run recorded in its files. A signal is sent only if the PID still belongs to the same process.

The files may be damaged, outdated, or written by another user for root to read: a PID counts only if its process started at the
recorded time and belongs to the user who owns the run's directory.
"""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_runtime.stack.runs import Run
from lupin_runtime.stack.usage import start_ticks


@dataclass(frozen=True)
class RecordedProcess:
    """A process by the values in a run's files, which may be outdated or damaged."""

    name: str
    pid: Any
    start_ticks: Any
    user_id: int  # of the user whose files name it

    def exists(self) -> bool:
        """Return whether this very process exists: a PID above 1, started at the recorded time, and of that user."""
        if type(self.pid) is not int or self.pid <= 1 or type(self.start_ticks) is not int:
            return False
        try:
            owner = Path(f"/proc/{self.pid}").stat().st_uid
        except OSError:
            return False
        return owner == self.user_id and start_ticks(self.pid) == self.start_ticks

    def signal(self, number: signal.Signals) -> bool:
        """Send a signal; return whether the process existed."""
        if not self.exists():
            return False
        try:
            descriptor = os.pidfd_open(self.pid)
        except OSError:
            return False
        try:
            if not self.exists():  # from here on, the descriptor names the process, whoever gets its PID next
                return False
            signal.pidfd_send_signal(descriptor, number)
        except ProcessLookupError:
            return False
        finally:
            os.close(descriptor)
        return True


def supervisor_of(run: Run) -> RecordedProcess:
    """Return the supervisor of a run."""
    info = run.info()
    return RecordedProcess("the supervisor", info.get("pid"), info.get("start_ticks"), _owner(run))


def is_supervised(run: Run) -> bool:
    """Return whether the supervisor that a live run's files name exists on this machine, or none is named yet.

    Its lock may be held by another process: on a home directory that several machines share, or by a tampering program.
    """
    return "pid" not in run.info() or supervisor_of(run).exists()


def processes_of(run: Run) -> list[RecordedProcess]:
    """Return the processes of a run except its supervisor, from its last state."""
    stages, owner = run.state().get("stages"), _owner(run)
    return [
        RecordedProcess(str(stage.get("name")), stage.get("pid"), stage.get("start_ticks"), owner)
        for stage in (stages if isinstance(stages, list) else [])
        if isinstance(stage, dict)
    ]


def _owner(run: Run) -> int:
    """Return the id of the user who owns a run's directory; -1, which owns no process, if there is no directory."""
    try:
        return run.path.stat().st_uid
    except OSError:
        return -1
