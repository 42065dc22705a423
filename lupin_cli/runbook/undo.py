"""Takes a run back: its changes in reverse, each with what was there before."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lupin_cli.operations import OPERATIONS
from lupin_cli.operations.base import OperationError
from lupin_cli.runbook.engine import Confirm, OnEvent
from lupin_cli.runbook.journal import Journal, JournalError, Mask, RunRecord, StepRecord, journal_folder
from lupin_cli.runbook.language import DEFAULT_TIMEOUT_S
from lupin_cli.runbook.lease import Lease, LeaseTaken
from lupin_cli.runbook.outcome import Event, Result, StepResult
from lupin_cli.runbook.templates import arguments_of, coerce
from lupin_cli.runbook.watched import WatchedTarget
from lupin_cli.target.base import Target, TargetError, Unreachable


def undo(
    run: RunRecord,
    targets: Mapping[str, Target],
    *,
    dry_run: bool = False,
    confirm: Confirm | None = None,
    journal: Path | None = None,
    on_event: OnEvent | None = None,
    stop: threading.Event | None = None,
    break_lease: bool = False,
) -> Result:
    """Take back what a run changed, also one that was cut off. Steps with `undo: false` stay as they are.

    The way back is a run of its own in the journal. It stops at the first change that can't be taken back; doing it again goes
    on from there, since what is back already stays as it is. Raises JournalError before anything is changed.
    """
    if run.state == "running":
        raise JournalError(f"the run {run.run} is still going on", f"lupin journal show {run.run}")
    if run.undo_of:
        raise JournalError(f"{run.run} is itself the way back of {run.undo_of}", f"lupin play {run.playbook}")
    robot = targets["robot"].name if "robot" in targets else ""
    if robot != run.robot:
        raise JournalError(
            f"{run.run} was on {run.robot or 'the laptop'}, not on {robot or 'the laptop'}", f"--robot {run.robot}"
        )
    steps = [step for step in reversed(run.steps) if step.before is not None and step.undo]
    for step in steps:
        if step.operation not in OPERATIONS:
            raise JournalError(f"{run.run} used the operation {step.operation!r}, which this Lupin doesn't know")
    steps.sort(key=lambda step: bool(getattr(OPERATIONS[step.operation], "undo_last", False)))  # stable: all else as it was
    if confirm is not None and steps and not dry_run and not confirm(f"Take back {len(steps)} changes of {run.run}?"):
        return Result(run.playbook, robot, "declined", message="not confirmed", next_command="--yes")
    log = None
    if not dry_run:
        start = {"playbook": run.playbook, "file": run.file, "digest": run.digest, "robot": robot, "undo_of": run.run}
        log = Journal.begin(journal or journal_folder(), f"undo-{run.playbook}", robot, Mask(), {**start, "pid": os.getpid()})
    lease = None
    if run.exclusive and not dry_run and "robot" in targets:
        lease = Lease(targets["robot"], f"lupin play {run.playbook} --undo", break_it=break_lease)
    reachable = True
    try:
        result = _Way(run, robot, targets, log, on_event, stop or threading.Event(), lease).back(steps)
        reachable = result.state != "unreachable"
        return result
    finally:
        if lease is not None:
            lease.end(reachable=reachable)
        if log is not None:
            log.close()


class _Way:
    def __init__(
        self,
        run: RunRecord,
        robot: str,
        targets: Mapping[str, Target],
        journal: Journal | None,
        on_event: OnEvent | None,
        stop: threading.Event,
        lease: Lease | None,
    ) -> None:
        self._run = run
        self._lease = lease
        self._robot = robot
        self._targets = {machine: WatchedTarget(target) for machine, target in targets.items()}
        self._journal = journal
        self._on_event = on_event
        self._stop = stop

    def back(self, steps: list[StepRecord]) -> Result:
        results: list[StepResult] = []
        state, message, next_command = "done", "", ""
        try:
            for index, step in enumerate(steps):
                if self._stop.is_set():
                    raise KeyboardInterrupt
                results.append(self._one(index, len(steps), step))
        except (OperationError, TargetError) as error:
            state = "unreachable" if isinstance(error, Unreachable) else "failed"
            message, next_command = f"{step.name}: {error}", error.next_command or self._again()
            if isinstance(error, LeaseTaken):
                next_command = f"{self._again()} --break-lease"
            results.append(StepResult(index, step.name, step.operation, step.machine, "failed", error=str(error)))
        except JournalError as error:
            state, message, next_command = "failed", str(error), error.next_command
        except KeyboardInterrupt:
            state, message, next_command = "interrupted", "interrupted", self._again()
        self._write("end", state=state, message=message)
        self._tell("end", 0, len(steps), state=state, text=message)
        run = self._journal.run if self._journal else ""
        return Result(self._run.playbook, self._robot, state, tuple(results), run, self._journal is None, message, next_command)

    def _again(self) -> str:
        return f"lupin play {self._run.playbook} --undo {self._run.run}"

    def _one(self, index: int, total: int, step: StepRecord) -> StepResult:
        before: dict[str, Any] = step.before or {}
        started = time.monotonic()
        self._tell("step", index, total, step=step.name)
        blank = StepResult(index, step.name, step.operation, step.machine, "would-change", f"takes back: {step.summary}")
        if self._journal is None:
            self._tell("difference", index, total, step=step.name, text=blank.summary)
            return blank
        operation = OPERATIONS[step.operation]
        hints = arguments_of(operation)
        values = {name: coerce(value, hints[name]) for name, value in step.arguments.items() if name in hints}
        target = self._targets[step.machine]
        target.deadline = time.monotonic() + max(DEFAULT_TIMEOUT_S, 2 * step.duration_s)
        self._write(
            "step", index=index, name=step.name, operation=step.operation, machine=step.machine, arguments=step.arguments
        )
        target.record = lambda text: self._write("output", sync=False, index=index, text=text)
        try:
            if self._lease is not None and step.machine == "robot":
                self._lease.take()
            with target.alone():
                operation(**values, machine=step.machine).undo(target, before)
        except BaseException as error:
            self._write("step-end", index=index, state="failed", error=str(error) or type(error).__name__)
            self._tell("step-end", index, total, step=step.name, state="failed", text=str(error))
            raise
        finally:
            target.record = None
        if self._lease is not None and step.operation == "reboot":
            self._lease.forget()
        duration_s = round(time.monotonic() - started, 3)
        self._write("step-end", index=index, state="changed", duration_s=duration_s)
        self._tell("step-end", index, total, step=step.name, state="changed", text=blank.summary, duration_s=duration_s)
        return StepResult(index, step.name, step.operation, step.machine, "changed", blank.summary, duration_s=duration_s)

    def _write(self, event: str, **values: Any) -> None:
        if self._journal is not None:
            self._journal.write(event, **values)

    def _tell(self, kind: str, index: int, total: int, **values: Any) -> None:
        if self._on_event is not None:
            self._on_event(Event(kind, self._robot, index, total, **values))
