"""The processes that a run recorded in its files. A signal is sent only if the PID still belongs to the same process."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from typing import Any

from lupin_runtime.stack.runs import Run
from lupin_runtime.stack.usage import start_ticks


@dataclass(frozen=True)
class RecordedProcess:
    """A process by the values in a run's files, which may be outdated or damaged."""

    name: str
    pid: Any
    start_ticks: Any

    def exists(self) -> bool:
        """Return whether this very process exists: a PID greater than 1 that started at the recorded time."""
        if type(self.pid) is not int or self.pid <= 1 or type(self.start_ticks) is not int:
            return False
        return start_ticks(self.pid) == self.start_ticks

    def signal(self, number: signal.Signals) -> bool:
        """Send a signal; return whether the process existed."""
        if not self.exists():
            return False
        try:
            os.kill(self.pid, number)
        except ProcessLookupError:
            return False
        return True


def supervisor_of(run: Run) -> RecordedProcess:
    """Return the supervisor of a run."""
    info = run.info()
    return RecordedProcess("the supervisor", info.get("pid"), info.get("start_ticks"))


def processes_of(run: Run) -> list[RecordedProcess]:
    """Return the processes of a run except its supervisor, from its last state."""
    stages = run.state().get("stages")
    return [
        RecordedProcess(str(stage.get("name")), stage.get("pid"), stage.get("start_ticks"))
        for stage in (stages if isinstance(stages, list) else [])
        if isinstance(stage, dict)
    ]
