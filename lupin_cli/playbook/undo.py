"""Undoes a run: restores the state before each of its changes, in reverse order, unless somebody has changed it since."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lupin_cli.connection.base import RootRefused, Target, TargetError, Unreachable
from lupin_cli.connection.this_operator import this_operator
from lupin_cli.operations.base import Operation, OperationError
from lupin_cli.operations.restored_state import keep_copy, read_digests
from lupin_cli.operations.table import OPERATIONS
from lupin_cli.playbook.argument_types import arguments_of, coerce
from lupin_cli.playbook.journal import Journal, JournalError, Mask, journal_folder
from lupin_cli.playbook.lease import LeaseTaken
from lupin_cli.playbook.model import DEFAULT_TIMEOUT_S
from lupin_cli.playbook.results import Result, StepResult
from lupin_cli.playbook.run_context import Confirm, OnEvent, RunContext, RunOptions, held_lease, open_run
from lupin_cli.playbook.run_record import RunRecord, StepRecord, undo_command
from lupin_cli.playbook.step_runner import NO_ACCESS, with_sudo
from lupin_cli.printed_commands import complete, lupin


def undo(
    run: RunRecord,
    targets: Mapping[str, Target],
    *,
    dry_run: bool = False,
    force: bool = False,
    confirm: Confirm | None = None,
    journal: Path | None = None,
    on_event: OnEvent | None = None,
    stop: threading.Event | None = None,
    take_lease_from: str = "",
) -> Result:
    """Undo what a run changed, even one that was cut off. Steps with `undo: false` stay changed.

    What somebody has changed since the run is not overwritten: nothing is undone then. With `force` it is, and of a file a copy
    is kept beside it.

    The undo is a run of its own in the journal. It stops at the first change that cannot be undone; undoing the run again
    continues there, since an undone step stays undone. Raises JournalError before anything is changed.
    """
    robot = targets["robot"].name if "robot" in targets else ""
    _require_undoable(run, robot)
    steps = list(reversed(run.undoable_steps))
    for step in steps:
        if step.operation not in OPERATIONS:
            raise JournalError(f"{run.run} used the operation {step.operation!r}, which this version of Lupin does not have")
    steps.sort(key=lambda step: OPERATIONS[step.operation].undo_last)  # a stable sort keeps the reverse order otherwise
    command = undo_command(run) + " --force" * force
    options = RunOptions(dry_run, False, confirm, on_event, stop or threading.Event(), take_lease_from, journal)
    try:
        with held_lease(targets, options, command if run.exclusive else "") as lease:
            later = _find_later_changes(run, steps, targets, command)
            names = ", ".join(name for _, name in later)
            if later and not force:
                message = f"{next(iter(later.values())).name}: changed since the run: {names}; --force overwrites that"
                show = lupin("journal", "show", run.run)
                return Result(run.playbook, robot, "failed", message=message, next_command=show, resume=f"{command} --force")
            question = f"Undo {len(steps)} changes of {run.run}{f', and overwrite {names}' if later else ''}?"
            if confirm is not None and steps and not dry_run and not confirm(question):
                return Result(run.playbook, robot, "declined", message="not confirmed", next_command=f"{command} --yes")
            log = None if dry_run else _begin_journal(run, robot, command, journal)
            with open_run(targets, options, steps=len(steps), mask=Mask(), journal=log, lease=lease) as context:
                return _Rollback(run, context, command, set(later)).undo_all(steps)
    except (OperationError, TargetError) as error:
        # Nothing has begun: the lease was refused, or could not be asked for.
        state = "unreachable" if isinstance(error, NO_ACCESS) else "failed"
        next_command = f"{error.next_command} && {command}" if isinstance(error, LeaseTaken) else error.next_command
        return Result(run.playbook, robot, state, message=str(error), next_command=next_command)


def _begin_journal(run: RunRecord, robot: str, command: str, folder: Path | None) -> Journal:
    start = {
        "playbook": run.playbook,
        "file": run.file,
        "digest": run.digest,
        "robot": robot,
        "undo_of": run.run,
        "command": command,
        "operator": this_operator(),
        "pid": os.getpid(),
    }
    return Journal.begin(folder or journal_folder(), f"undo-{run.playbook}", robot, Mask(), start)


def _require_undoable(run: RunRecord, robot: str) -> None:
    if run.state == "running":
        raise JournalError(f"the run {run.run} is still going on", f"lupin journal show {run.run}")
    if run.undo_of:
        raise JournalError(f"{run.run} is itself the undo of {run.undo_of}", f"lupin journal show {run.undo_of}")
    if robot != run.robot:
        raise JournalError(f"{run.run} was on {run.robot or 'the laptop'}, not on {robot or 'the laptop'}", undo_command(run))


def _find_later_changes(
    run: RunRecord, steps: Sequence[StepRecord], targets: Mapping[str, Target], command: str
) -> dict[tuple[str, str], StepRecord]:
    """Return what somebody has changed since the run, as machine and name, each with the last step that changed it.

    `steps` are to be undone, in this order. A state that the run found or left anywhere is its own: an earlier undo of it may
    have restored that. Of a step that was cut off, it is not known what it left. Raises OperationError or TargetError.
    """
    known: dict[tuple[str, str], set[str]] = defaultdict(set)
    for step in run.steps:
        for name, digest in (*step.found.items(), *step.left.items()):
            known[step.machine, name].add(digest)
    later: dict[tuple[str, str], StepRecord] = {}
    examined: set[tuple[str, str]] = set()
    for step in steps:
        names = {(step.machine, name) for name in (step.left or step.found)} - examined
        examined |= names
        if not step.left or not names:
            continue
        try:
            now = read_digests(_recorded_operation(step), targets[step.machine])
        except (OperationError, TargetError) as error:
            error.next_command = _next_command(error, run, step, targets[step.machine].login_command, command)
            raise
        later |= {key: step for key in sorted(names) if key[1] in now and now[key[1]] not in known[key]}
    return later


def _next_command(error: OperationError | TargetError, run: RunRecord, step: StepRecord, login: str, command: str) -> str:
    """Return what to type after an error in the undo of a step; `command` is the one that undoes the run."""
    if isinstance(error, RootRefused):
        return with_sudo(command, step.machine)
    next_command = complete(error.next_command, robot=run.robot, login=login) or command
    return f"{next_command} && {command}" if isinstance(error, LeaseTaken) else next_command


class _Rollback:
    """The undo of one run."""

    def __init__(self, run: RunRecord, context: RunContext, command: str, to_copy: set[tuple[str, str]]) -> None:
        """`to_copy` are the machines and names of what was changed since the run."""
        self._run = run
        self._context = context
        self._command = command
        self._to_copy = to_copy

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
            login = self._context.targets[step.machine].login_command
            next_command = _next_command(error, self._run, step, login, self._command)
            message = f"{step.name}: {error}"
            results.append(StepResult(index, step.name, step.operation, step.machine, "failed", error=str(error)))
        except JournalError as error:
            state, message, next_command = "failed", str(error), error.next_command
        except KeyboardInterrupt:
            state, message, next_command = "interrupted", "interrupted", self._command
        context = self._context
        if context.lease is not None:
            context.lease.reachable = state != "unreachable"
        with contextlib.suppress(JournalError):  # it has ended all the same
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
                    self._keep_copies(index, step, operation)
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

    def _keep_copies(self, index: int, step: StepRecord, operation: Operation) -> None:
        """Keep a copy of each file of this step that was changed since the run, before the first undo that writes it."""
        for file in operation.restored_files():
            if (step.machine, file.path) in self._to_copy:
                self._to_copy.remove((step.machine, file.path))
                copy = keep_copy(self._context.targets[step.machine], file)
                self._context.emit("difference", index, step.name, text=f"the changed {file.path} is kept as {copy}")


def _recorded_operation(step: StepRecord) -> Operation:
    """Return the operation with the arguments in the journal, except those that this version of Lupin does not know."""
    operation = OPERATIONS[step.operation]
    hints = arguments_of(operation)
    values = {name: coerce(value, hints[name]) for name, value in step.arguments.items() if name in hints}
    return operation(**values, machine=step.machine)
