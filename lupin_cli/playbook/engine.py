"""Plays a playbook on a robot and a laptop, one step after another; see `step_runner` for what a step does."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_cli.connection.base import RootRefused, Target, TargetError
from lupin_cli.connection.this_operator import this_operator
from lupin_cli.operations.base import OperationError
from lupin_cli.playbook.binding import Binding
from lupin_cli.playbook.journal import Journal, JournalError, Mask, journal_folder
from lupin_cli.playbook.lease import Lease, LeaseTaken
from lupin_cli.playbook.model import Playbook, Step
from lupin_cli.playbook.playbook_files import load
from lupin_cli.playbook.probe_batch import ProbeBatch
from lupin_cli.playbook.results import Result
from lupin_cli.playbook.resume import (
    find_unfinished,
    index_of_step,
    merge_variables,
    play_command,
    resume_command,
    select_steps,
)
from lupin_cli.playbook.run_context import Confirm, OnEvent, RunContext, RunOptions, RunStopped, held_lease, open_run
from lupin_cli.playbook.run_record import RunRecord, StepRecord
from lupin_cli.playbook.step_runner import NO_ACCESS, Commands, StepRunner, with_sudo


def play(
    playbook: Playbook | str | Path,
    targets: Mapping[str, Target],
    variables: Mapping[str, Any] | None = None,
    *,
    dry_run: bool = False,
    diff: bool = False,
    from_step: str = "",
    tags: Iterable[str] = (),
    resume: bool = False,
    confirm: Confirm | None = None,
    journal: Path | None = None,
    on_event: OnEvent | None = None,
    stop: threading.Event | None = None,
    take_lease_from: str = "",
    command: str = "",
) -> Result:
    """Play a playbook, or show what it would change.

    `playbook` is a loaded playbook, the name of a shipped one, or a file. `targets` has "robot", "laptop" or both, as its steps
    need. `variables` are values of the playbook's `vars`. `from_step` is a step's name or number (from 1): before it, only
    read-only steps run; with `tags`, of the others only those that have one of these tags. `resume` continues the newest
    unfinished run of this playbook on this robot, with that run's variables and results. `confirm` answers a step's question
    (None answers no); all questions that can be foreseen are asked before the first change. `journal` replaces
    `journal_folder()`. `on_event` receives progress, in this thread. `stop` stops the run after the current step. An exclusive
    playbook takes the robot's lease before its first step; `take_lease_from` names a holder from whom it is taken. `command` is
    what the operator typed, if not `lupin play`.

    Raises FileNotFoundError, PlaybookError or JournalError before anything is changed. Later problems are in the result: a step
    that failed, a lost connection, an interrupt.
    """
    if not isinstance(playbook, Playbook):
        playbook = load(playbook)
    options = RunOptions(dry_run, diff, confirm, on_event, stop or threading.Event(), take_lease_from, journal)
    robot = targets["robot"].name if "robot" in targets else ""
    prior = find_unfinished(playbook, robot, journal) if resume else None
    if resume and prior is None:
        return Result(playbook.name, robot, "done", message=f"there is no unfinished run of {playbook.name}")
    given = dict(variables or {})
    if prior is not None:
        given = merge_variables(playbook, prior, given)
        from_step, tags = prior.from_step, prior.tags
    binding = Binding(playbook, given, targets)
    first = index_of_step(playbook, from_step) if from_step else 0
    chosen = select_steps(playbook, first, tags)
    fresh = command or play_command(playbook, robot, given, from_step, tags)
    again = fresh if prior is None else resume_command(playbook, robot)
    request = _Request(playbook, targets, given, chosen, {step.index: step for step in prior.steps} if prior else {}, again)
    try:
        with held_lease(targets, options, again if playbook.exclusive else "") as lease:
            answered = frozenset[int]() if dry_run else _ask_beforehand(request, options)
            mask = Mask(binding.secret_values)
            log = None if dry_run else _open_journal(request, robot, binding, from_step, tags, prior, journal, mask)
            return _run(request, options, binding, log, lease, answered)
    except RunStopped as error:
        state, message, next_command = error.run_state, str(error), error.next_command
    except (OperationError, TargetError) as error:
        # Nothing has begun: the lease was refused, or could not be asked for.
        state, message = "unreachable" if isinstance(error, NO_ACCESS) else "failed", str(error)
        next_command = error.next_command
        if isinstance(error, LeaseTaken):
            next_command = f"{next_command} && {again}"
        elif isinstance(error, RootRefused):
            next_command = with_sudo(again, "robot")
    return Result(playbook.name, robot, state, message=message, next_command=next_command)


@dataclass(frozen=True)
class _Request:
    """What is to be played."""

    playbook: Playbook
    targets: Mapping[str, Target]
    variables: Mapping[str, Any]
    chosen: frozenset[int]  # the indices of the steps that may change something
    prior: Mapping[int, StepRecord]  # the records of the run that is resumed, by the steps' index
    command: str  # what starts it again


def _run(
    request: _Request,
    options: RunOptions,
    binding: Binding,
    journal: Journal | None,
    lease: Lease | None,
    answered: frozenset[int] = frozenset(),
) -> Result:
    playbook, targets = request.playbook, request.targets
    mask = Mask(binding.secret_values)
    with open_run(targets, options, steps=len(playbook.steps), mask=mask, journal=journal, lease=lease) as context:
        probes = ProbeBatch(targets["robot"]) if "robot" in targets else None
        commands = Commands(request.command, "" if options.dry_run else resume_command(playbook, context.robot))
        resumes_guarded = request.prior and any(step.operation.guards for step in playbook.steps)
        present = Binding(playbook, request.variables, targets) if resumes_guarded else None
        runner = StepRunner(context, binding, commands, probes, answered, present)
        return _PlaybookRun(playbook, context, runner, request.chosen).play(request.prior)


def _ask_beforehand(request: _Request, options: RunOptions) -> frozenset[int]:
    """Ask the questions of all steps that will change something, as far as a dry run can tell; return the steps' indices.

    Raises RunStopped if one is declined.
    """
    if all(request.playbook.steps[index].confirm is None for index in request.chosen):
        return frozenset()
    dry = dataclasses.replace(options, dry_run=True, diff=False, confirm=None, on_event=None)
    plan = _run(request, dry, Binding(request.playbook, request.variables, request.targets), None, None)
    for step in plan.steps:
        if step.question and not (options.confirm is not None and options.confirm(step.question)):
            message = f"{step.name}: not confirmed: {step.question} Nothing was changed"
            raise RunStopped("declined", "declined", message, f"{request.command} --yes")
    return frozenset(step.index for step in plan.steps if step.question)


def _open_journal(
    request: _Request,
    robot: str,
    binding: Binding,
    from_step: str,
    tags: Iterable[str],
    prior: RunRecord | None,
    folder: Path | None,
    mask: Mask,
) -> Journal:
    if prior is not None:
        return Journal.reopen(prior.path, mask)
    playbook, secrets = request.playbook, binding.secret_names
    start = {
        "playbook": playbook.name,
        "file": playbook.file,
        "digest": playbook.digest,
        "robot": robot,
        "variables": {v.name: binding.variables[v.name] for v in playbook.variables if v.name not in secrets},
        "secrets": secrets,
        "from_step": from_step,
        "tags": sorted(tags),
        "exclusive": playbook.exclusive,
        "command": request.command,
        "operator": this_operator(),
        "pid": os.getpid(),
    }
    return Journal.begin(folder or journal_folder(), playbook.name, robot, mask, start)


class _PlaybookRun:
    """Plays the chosen steps of a playbook, and the read-only ones among the others."""

    def __init__(self, playbook: Playbook, context: RunContext, runner: StepRunner, chosen: frozenset[int]) -> None:
        self._playbook = playbook
        self._context = context
        self._runner = runner
        self._chosen = chosen
        self._always_errors: list[str] = []  # of `always` steps that ran after another one had failed

    def play(self, prior: Mapping[int, StepRecord]) -> Result:
        """Run the steps. `prior` has the records of the steps of the run that is resumed, by index."""
        context, runner, journal = self._context, self._runner, self._context.journal
        context.emit("run", text=context.run_id)
        state, message, next_command, closed = "done", "", "", False
        ended = 0  # how many steps have ended, one that failed not included
        runner.prefetch({i: s for i, s in enumerate(self._playbook.steps) if i in self._chosen and i not in prior})
        try:
            for index, step in enumerate(self._playbook.steps):
                if context.options.stop.is_set():
                    raise RunStopped("interrupted", "interrupted", f"before the step {step.name!r}")
                runner.run(index, step, reached=index in self._chosen, prior=prior.get(index))
                ended = index + 1
        except RunStopped as error:
            state, message = error.run_state, str(error)
            # A step that failed has had its turn. One that was interrupted, or was next, has not.
            first = ended if error.step_state == "interrupted" else ended + 1
            closed = state != "unreachable" and self._run_always_steps(first)
            again = runner.commands.play if closed else runner.commands.resume
            next_command = error.next_command or again
            if runner.locked_out:
                next_command = f"{next_command} && {again}"
        except JournalError as error:
            # What cannot be journaled must not be done, since it could neither be resumed nor undone; except to start what this
            # run has stopped.
            context.journal = None
            closed = self._run_always_steps(ended)
            state, message = "failed", str(error)
            next_command = runner.commands.play if closed else error.next_command
        except KeyboardInterrupt:
            closed = self._run_always_steps(ended)
            state, message = "interrupted", "interrupted"
            next_command = runner.commands.play if closed else runner.commands.resume
        if closed and (state == "interrupted" or context.journal is None):
            message = f"{message}; the playbook's 'always' steps ran"
        message = "; ".join([message, *self._always_errors])
        if context.lease is not None:
            context.lease.reachable = state != "unreachable"
        context.journal = journal
        with contextlib.suppress(JournalError):  # the run has ended all the same; without this line it counts as cut off
            context.write("end", state=state, message=message, closed=closed)
        context.emit("end", state=state, text=context.mask(message))
        return Result(
            playbook=self._playbook.name,
            robot=context.robot,
            state=state,
            steps=tuple(runner.results),
            run=context.run_id,
            dry_run=context.options.dry_run,
            message=context.mask(message),
            next_command=next_command,
            resume="" if closed or state == "done" else runner.commands.resume,
        )

    def _run_always_steps(self, first: int) -> bool:
        """Run the `always` steps from this index on. Returns whether at least one of them was not skipped."""
        context = self._context
        if context.options.dry_run:
            return False
        # Nothing stops these steps. The event may belong to the runs on other robots, too, so it is not cleared.
        context.options = dataclasses.replace(context.options, stop=threading.Event())
        ran = False
        for index, step in enumerate(self._playbook.steps):
            if index < first or index not in self._chosen or not step.always:
                continue
            try:
                self._run_always_step(index, step)
                ran |= self._runner.results[-1].state != "skipped"
            except RunStopped as error:
                ran = True
                self._always_errors.append(str(error))  # the other steps are still tried
        return ran

    def _run_always_step(self, index: int, step: Step) -> None:
        try:
            self._runner.run(index, step, reached=True, prior=None)
        except JournalError:
            self._context.journal = None  # to start what was stopped matters more than to record it
            self._runner.run(index, step, reached=True, prior=None)
