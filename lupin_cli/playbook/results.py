"""Progress events and results of a playbook run."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from lupin_cli.exit_codes import FAILURE, INTERRUPTED, SUCCESS, UNREACHABLE

_EXIT_CODES = {  # by the state in which a playbook run ends
    "done": SUCCESS,
    "failed": FAILURE,
    "declined": FAILURE,
    "unreachable": UNREACHABLE,
    "interrupted": INTERRUPTED,
}


@dataclass(frozen=True)
class Event:
    """Progress of a run."""

    kind: str  # run | step | difference | change (begins) | line | step-end | end
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
    """The result of a step. `state` is same, changed, would-change, skipped, declined, failed, lost or interrupted."""

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
    question: str = ""  # of a dry run: what is asked before this change


@dataclass(frozen=True)
class Result:
    """The result of a run. Unless it is done, `message` says why, `next_command` what to type now, and `resume` what to type
    then to continue it."""

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
        """The number of steps that changed something, or would."""
        return sum(step.state in ("changed", "would-change") for step in self.steps)

    @property
    def exit_code(self) -> int:
        """The exit status of the command line for this result."""
        return _EXIT_CODES[self.state]

    def plain(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        return {**asdict(self), "exit_code": self.exit_code, "changed": self.changed}
