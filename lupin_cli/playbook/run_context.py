"""What playing and undoing share: options, targets, journal, lease and progress events of one playbook run."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lupin_cli.connection.base import Target
from lupin_cli.operations.step_target import StepTarget
from lupin_cli.playbook.journal import Journal, Mask
from lupin_cli.playbook.lease import Lease
from lupin_cli.playbook.results import Event
from lupin_cli.playbook.serialized_target import SerializedTarget

Confirm = Callable[[str], bool]
OnEvent = Callable[[Event], None]


class RunStopped(Exception):
    """Stops a run. `step_state` is the state of the step that stopped it, `run_state` the run's."""

    def __init__(self, step_state: str, run_state: str, message: str, next_command: str = "") -> None:
        super().__init__(message)
        self.step_state = step_state
        self.run_state = run_state
        self.next_command = next_command


@dataclass(frozen=True)
class RunOptions:
    """The options of a run."""

    dry_run: bool = False
    diff: bool = False  # whether events contain diffs
    confirm: Confirm | None = None  # answers questions; None answers no
    on_event: OnEvent | None = None  # receives progress, in the run's thread
    stop: threading.Event = field(default_factory=threading.Event)  # stops the run after the current step
    take_lease_from: str = ""  # the holder whose lease is taken, if it is taken at all
    journal_folder: Path | None = None


@dataclass
class RunContext:
    """The targets, journal, lease and events of one run."""

    robot: str  # its name, or empty
    options: RunOptions
    targets: Mapping[str, StepTarget]
    steps: int
    mask: Mask
    journal: Journal | None
    lease: Lease | None

    @property
    def run_id(self) -> str:
        """The run's name in the journal; empty in a dry run."""
        return self.journal.run if self.journal else ""

    def write(self, event: str, **values: Any) -> None:
        """Add a line to the journal, if the run has one. Raises JournalError."""
        if self.journal is not None:
            self.journal.write(event, **values)

    def emit(self, kind: str, index: int = 0, step: str = "", **values: Any) -> None:
        """Send an event to `on_event`."""
        if self.options.on_event is not None:
            self.options.on_event(Event(kind, self.robot, index, self.steps, step, **values))

    def pause(self, seconds: float) -> None:
        """Sleep; raises RunStopped when the run is interrupted."""
        if self.options.stop.wait(seconds):
            raise RunStopped("interrupted", "interrupted", "interrupted")

    @contextmanager
    def recording(self, index: int, target: StepTarget, on_line: Callable[[str], None] | None = None) -> Iterator[None]:
        """Write the output of scripts that change the target into the journal, as output of this step."""
        target.record = lambda text: self.write("output", sync=False, index=index, text=text)
        target.on_line = on_line
        try:
            yield
        finally:
            target.record = target.on_line = None


@contextmanager
def held_lease(targets: Mapping[str, Target], options: RunOptions, purpose: str) -> Iterator[Lease | None]:
    """Take the robot's lease; give it back at the end. Yields None if the run needs none: a dry run, or one without a robot.

    `purpose`, the command that the operator typed, tells other operators why the robot is in use; if it is empty, the run needs
    no lease. Raises LeaseTaken, OperationError or TargetError.
    """
    if not purpose or options.dry_run or "robot" not in targets:
        yield None
        return
    lease = Lease(targets["robot"], purpose, take_from=options.take_lease_from)
    try:
        lease.take()
        yield lease
    finally:
        lease.end()


@contextmanager
def open_run(
    targets: Mapping[str, Target],
    options: RunOptions,
    *,
    steps: int,
    mask: Mask,
    journal: Journal | None,
    lease: Lease | None,
) -> Iterator[RunContext]:
    """Open a run's context; close its journal at the end."""
    robot = targets["robot"].name if "robot" in targets else ""
    step_targets = {machine: _step_target(target) for machine, target in targets.items()}
    try:
        yield RunContext(robot, options, step_targets, steps, mask, journal, lease)
    finally:
        if journal is not None:
            journal.close()


def _step_target(target: Target) -> StepTarget:
    return StepTarget(target, target.reserved if isinstance(target, SerializedTarget) else nullcontext)
