"""What a run tells while it goes on, and what it leaves."""

from __future__ import annotations

from dataclasses import asdict, field
from typing import Any

from lupin_cli.quick_dataclass import dataclass

# A run ends in one of these; the exit status of `lupin play` follows from it.
EXIT_CODES = {"done": 0, "failed": 1, "declined": 1, "unreachable": 3, "interrupted": 130}


@dataclass(frozen=True)
class Event:
    """One thing that happened, for whoever shows progress."""

    kind: str  # run | step | difference | change (it begins) | line | step-end | end
    robot: str = ""
    index: int = 0  # of the step, from 0
    total: int = 0
    step: str = ""
    state: str = ""
    text: str = ""
    diff: str = ""
    duration_s: float = 0.0


@dataclass(frozen=True)
class StepResult:
    """How a step ended: same | changed | would-change | skipped | declined | failed | lost | interrupted."""

    index: int
    name: str
    operation: str
    machine: str
    state: str
    summary: str = ""
    diff: str = ""
    error: str = ""
    duration_s: float = 0.0
    result: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Result:
    """How a run ended. Where it isn't done, `message` says why, `next_command` what to do now, and `resume` how the run goes on
    after that."""

    playbook: str
    robot: str
    state: str  # done | failed | declined | unreachable | interrupted
    steps: tuple[StepResult, ...] = ()
    run: str = ""  # the journal's id; empty for a dry run
    dry_run: bool = False
    message: str = ""
    next_command: str = ""
    resume: str = ""

    @property
    def changed(self) -> int:
        """How many steps changed something, or would."""
        return sum(step.state in ("changed", "would-change") for step in self.steps)

    @property
    def exit_code(self) -> int:
        return EXIT_CODES[self.state]

    def plain(self) -> dict[str, Any]:
        """For scripts, JSON-able."""
        return {**asdict(self), "exit_code": self.exit_code, "changed": self.changed}
