"""What the supervisor keeps of each process of a run."""

from __future__ import annotations

import enum
import subprocess
from collections import deque
from dataclasses import dataclass, field

from lupin_runtime.stack.table import Launch, ProcessRow


class Phase(enum.Enum):
    """The phase of a stage."""

    WAITING = "waiting"
    STARTING = "starting"
    UP = "up"
    FAILED = "failed"
    STOPPED = "stopped"


@dataclass
class Stage:
    """A process of the run as the supervisor sees it: its phase and what it uses."""

    launch: Launch
    phase: Phase = Phase.WAITING
    since_s: float = 0.0
    up_after_s: float | None = None
    process: subprocess.Popen[bytes] | None = None
    start_ticks: int | None = None  # identifies the process together with its PID
    killed_why: str = ""  # why the supervisor killed the process
    taken_over_s: float | None = None  # since when a person's own process has its place
    restarts: deque[float] = field(default_factory=deque)
    restart_count: int = 0
    was_given_up: bool = False  # of an optional one, that is started again: whether it comes and goes, it blocks no motion
    why: str = ""
    cpu_percent: float = 0.0
    memory_mb: float = 0.0
    cpu_seen: tuple[float, float] | None = None  # (time, processor time used until then), seconds

    @property
    def row(self) -> ProcessRow:
        """The stage's row of the table."""
        return self.launch.row


@dataclass(frozen=True)
class Death:
    """An unplanned exit of a process."""

    stage: str
    status: str
    consequence: str
    ends_run: bool = False


# Its stack trace is in the supervisor's own output.
LIVENESS_FAILED = Death("supervisor", "can no longer receive heartbeats", "nothing may move, so the run stops", ends_run=True)
