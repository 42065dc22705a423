"""Undoes a run: restores the state before each of its changes, in reverse order."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lupin_cli.connection.base import Target, TargetError, Unreachable
from lupin_cli.operations.base import Operation, OperationError
from lupin_cli.operations.table import OPERATIONS
from lupin_cli.playbook.argument_types import arguments_of, coerce
from lupin_cli.playbook.journal import Journal, JournalError, Mask, journal_folder
from lupin_cli.playbook.lease import LeaseTaken
from lupin_cli.playbook.model import DEFAULT_TIMEOUT_S
from lupin_cli.playbook.results import Result, StepResult
from lupin_cli.playbook.run_context import Confirm, OnEvent, RunContext, RunOptions, open_run
from lupin_cli.playbook.run_record import RunRecord, StepRecord


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
    """Undo what a run changed, even one that was cut off. Steps with `undo: false` stay changed.

    The undo is a run of its own in the journal. It stops at the first change that cannot be undone; undoing the run again
    continues there, since an undone step stays undone. Raises JournalError before anything is changed.
    """
    robot = targets["robot"].name if "robot" in targets else ""
    _require_undoable(run, robot)
    steps = [step for step in reversed(run.steps) if step.before is not None and step.undo]
    for step in steps:
        if step.operation not in OPERATIONS:
            raise JournalError(f"{run.run} used the operation {step.operation!r}, which this version of Lupin does not have")
    steps.sort(key=lambda step: OPERATIONS[step.operation].undo_last)  # a stable sort keeps the reverse order otherwise
    if confirm is not None and steps and not dry_run and not confirm(f"Undo {len(steps)} changes of {run.run}?"):
        return Result(run.playbook, robot, "declined", message="not confirmed", next_command="--yes")
    log = None
    if not dry_run:
        start = {"playbook": run.playbook, "file": run.file, "digest": run.digest, "robot": robot, "undo_of": run.run}
        log = Journal.begin(journal or journal_folder(), f"undo-{run.playbook}", robot, Mask(), {**start, "pid": os.getpid()})
    with open_run(
        targets,
        RunOptions(dry_run, False, confirm, on_event, stop or threading.Event(), break_lease, journal),
        steps=len(steps),
        mask=Mask(),
        journal=log,
        lease_purpose=f"lupin play {run.playbook} --undo" if run.exclusive else "",
    ) as context:
        return _Rollback(run, context).undo_all(steps)


def _require_undoable(run: RunRecord, robot: str) -> None:
    if run.state == "running":
        raise JournalError(f"the run {run.run} is still going on", f"lupin journal show {run.run}")
    if run.undo_of:
        raise JournalError(f"{run.run} is itself the undo of {run.undo_of}", f"lupin play {run.playbook}")
    if robot != run.robot:
        raise JournalError(
            f"{run.run} was on {run.robot or 'the laptop'}, not on {robot or 'the laptop'}", f"--robot {run.robot}"
        )


class _Rollback:
    """The undo of one run."""

    def __init__(self, run: RunRecord, context: RunContext) -> None:
        self._run = run
        self._context = context
        self._command = f"lupin play {run.playbook} --undo {run.run}"

    def undo_all(self, steps: list[StepRecord]) -> Result:
        """Undo the steps in this order, until one cannot be undone."""
        results: list[StepResult] = []
        state, message, next_command = "done", "", ""
        try:
            for index, step in enumerate(steps):
                if self._context.options.stop.is_set():
                    raise KeyboardInterrupt
                results.append(self._undo_step(index, step))
        except (OperationError, TargetError) as error:
            state = "unreachable" if isinstance(error, Unreachable) else "failed"
            message, next_command = f"{step.name}: {error}", error.next_command or self._command
            if isinstance(error, LeaseTaken):
                next_command = f"{self._command} --break-lease"
            results.append(StepResult(index, step.name, step.operation, step.machine, "failed", error=str(error)))
        except JournalError as error:
            state, message, next_command = "failed", str(error), error.next_command
        except KeyboardInterrupt:
            state, message, next_command = "interrupted", "interrupted", self._command
        context = self._context
        context.reachable = state != "unreachable"
        context.write("end", state=state, message=message)
        context.emit("end", state=state, text=message)
        return Result(
            playbook=self._run.playbook,
            robot=context.robot,
            state=state,
            steps=tuple(results),
            run=context.run_id,
            dry_run=context.options.dry_run,
            message=message,
            next_command=next_command,
        )

    def _undo_step(self, index: int, step: StepRecord) -> StepResult:
        context = self._context
        started = time.monotonic()
        summary = f"undo: {step.summary}"
        context.emit("step", index, step.name)
        if context.options.dry_run:
            context.emit("difference", index, step.name, text=summary)
            return StepResult(index, step.name, step.operation, step.machine, "would-change", summary)
        operation = _recorded_operation(step)
        target = context.targets[step.machine]
        target.deadline = time.monotonic() + max(DEFAULT_TIMEOUT_S, 2 * step.duration_s)
        context.write(
            "step", index=index, name=step.name, operation=step.operation, machine=step.machine, arguments=step.arguments
        )
        try:
            with context.recording(index, target):
                if context.lease is not None and step.machine == "robot":
                    context.lease.take()
                with target.reserved():
                    operation.undo(target, step.before or {})
        except BaseException as error:
            context.write("step-end", index=index, state="failed", error=str(error) or type(error).__name__)
            context.emit("step-end", index, step.name, state="failed", text=str(error))
            raise
        if context.lease is not None and step.operation == "reboot":
            context.lease.forget()
        end: dict[str, Any] = {"state": "changed", "duration_s": round(time.monotonic() - started, 3)}
        context.write("step-end", index=index, **end)
        context.emit("step-end", index, step.name, text=summary, **end)
        return StepResult(index, step.name, step.operation, step.machine, summary=summary, **end)


def _recorded_operation(step: StepRecord) -> Operation:
    """Return the operation with the arguments in the journal, except those that this version of Lupin does not know."""
    operation = OPERATIONS[step.operation]
    hints = arguments_of(operation)
    values = {name: coerce(value, hints[name]) for name, value in step.arguments.items() if name in hints}
    return operation(**values, machine=step.machine)
