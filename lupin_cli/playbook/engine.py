"""Plays a playbook on a robot and a laptop, one step after another; see `step_runner` for what a step does."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lupin_cli.connection.base import Target
from lupin_cli.playbook.binding import Binding
from lupin_cli.playbook.journal import Journal, JournalError, Mask, journal_folder
from lupin_cli.playbook.model import Playbook
from lupin_cli.playbook.playbook_files import load
from lupin_cli.playbook.probe_batch import ProbeBatch
from lupin_cli.playbook.results import Result
from lupin_cli.playbook.resume import find_unfinished, index_of_step, merge_variables
from lupin_cli.playbook.run_context import Confirm, OnEvent, RunContext, RunOptions, RunStopped, open_run
from lupin_cli.playbook.run_record import RunRecord, StepRecord
from lupin_cli.playbook.step_runner import StepRunner


def play(
    playbook: Playbook | str | Path,
    targets: Mapping[str, Target],
    variables: Mapping[str, Any] | None = None,
    *,
    dry_run: bool = False,
    diff: bool = False,
    from_step: str = "",
    resume: bool = False,
    confirm: Confirm | None = None,
    journal: Path | None = None,
    on_event: OnEvent | None = None,
    stop: threading.Event | None = None,
    break_lease: bool = False,
) -> Result:
    """Play a playbook, or show what it would change.

    `playbook` is a loaded playbook, the name of a shipped one, or a file. `targets` has "robot", "laptop" or both, as its steps
    need. `variables` are values of the playbook's `vars`. `from_step` is a step's name or number (from 1): before it, only
    read-only steps run. `resume` continues the newest unfinished run of this playbook on this robot, with that run's variables
    and results. `confirm` answers a step's question (None answers no). `journal` replaces `journal_folder()`. `on_event`
    receives progress, in this thread. `stop` stops the run after the current step. An exclusive playbook takes the robot's
    lease before its first change there; `break_lease` takes it from its holder.

    Raises FileNotFoundError, PlaybookError or JournalError before anything is changed. Later problems are in the result: a step
    that failed, a lost connection, an interrupt.
    """
    if not isinstance(playbook, Playbook):
        playbook = load(playbook)
    options = RunOptions(dry_run, diff, confirm, on_event, stop or threading.Event(), break_lease, journal)
    robot = targets["robot"].name if "robot" in targets else ""
    prior = find_unfinished(playbook, robot, journal) if resume else None
    if resume and prior is None:
        return Result(playbook.name, robot, "done", message=f"there is no unfinished run of {playbook.name}")
    if prior is not None:
        variables = merge_variables(playbook, prior, variables or {})
        from_step = prior.from_step
    binding = Binding(playbook, variables or {}, targets)
    first = index_of_step(playbook, from_step) if from_step else 0
    mask = Mask(tuple(binding.secrets.values()))
    with open_run(
        targets,
        options,
        steps=len(playbook.steps),
        mask=mask,
        journal=None if dry_run else _open_journal(playbook, robot, binding, from_step, prior, journal, mask),
        lease_purpose=f"lupin play {playbook.name}" if playbook.exclusive else "",
        resumed=prior is not None,
    ) as context:
        probes = ProbeBatch(targets["robot"]) if "robot" in targets else None
        runner = StepRunner(context, binding, playbook.name, probes)
        run = _PlaybookRun(playbook, context, runner, first)
        return run.play({step.index: step for step in prior.steps} if prior else {})


def _open_journal(
    playbook: Playbook, robot: str, binding: Binding, from_step: str, prior: RunRecord | None, folder: Path | None, mask: Mask
) -> Journal:
    if prior is not None:
        return Journal.reopen(prior.path, mask)
    secrets = sorted(binding.secrets)
    start = {
        "playbook": playbook.name,
        "file": playbook.file,
        "digest": playbook.digest,
        "robot": robot,
        "variables": {v.name: binding.variables[v.name] for v in playbook.variables if v.name not in secrets},
        "secrets": secrets,
        "from_step": from_step,
        "exclusive": playbook.exclusive,
        "pid": os.getpid(),
    }
    return Journal.begin(folder or journal_folder(), playbook.name, robot, mask, start)


class _PlaybookRun:
    """Plays the steps of a playbook, from the step `first` on."""

    def __init__(self, playbook: Playbook, context: RunContext, runner: StepRunner, first: int) -> None:
        self._playbook = playbook
        self._context = context
        self._runner = runner
        self._first = first

    def play(self, prior: Mapping[int, StepRecord]) -> Result:
        """Run the steps. `prior` has the records of the steps of the run that is resumed, by index."""
        context, runner = self._context, self._runner
        context.emit("run", text=context.run_id)
        state, message, next_command, closed = "done", "", "", False
        index = 0
        runner.prefetch({i: s for i, s in enumerate(self._playbook.steps) if i >= self._first and i not in prior})
        try:
            for index, step in enumerate(self._playbook.steps):
                if context.options.stop.is_set():
                    raise RunStopped("interrupted", "interrupted", "interrupted before this step")
                runner.run(index, step, reached=index >= self._first, prior=prior.get(index))
        except RunStopped as error:
            state, message = error.run_state, str(error)
            closed = state != "unreachable" and self._run_always_steps(index)
            next_command = error.next_command or (runner.play_command if closed else runner.resume_command)
            if runner.locked_out:
                next_command = f"{runner.play_command if closed else runner.resume_command} --break-lease"
        except JournalError as error:
            # What cannot be journaled must not be done: the run could neither be resumed nor undone.
            state, message, next_command = "failed", str(error), error.next_command
        except KeyboardInterrupt:
            closed = self._run_always_steps(index)
            state, message = "interrupted", "interrupted"
            next_command = runner.play_command if closed else runner.resume_command
        context.reachable = state != "unreachable"
        context.write("end", state=state, message=message, closed=closed)
        context.emit("end", state=state, text=message)
        return Result(
            playbook=self._playbook.name,
            robot=context.robot,
            state=state,
            steps=tuple(runner.results),
            run=context.run_id,
            dry_run=context.options.dry_run,
            message=context.mask(message),
            next_command=next_command,
            resume="" if closed or state == "done" else runner.resume_command,
        )

    def _run_always_steps(self, failed: int) -> bool:
        """Run the `always` steps after a failed step. Returns whether at least one of them was not skipped."""
        if self._context.options.dry_run:
            return False
        ran = False
        for index, step in enumerate(self._playbook.steps):
            if index <= failed or index < self._first or not step.always:
                continue
            self._context.options.stop.clear()
            try:
                self._runner.run(index, step, reached=True, prior=None)
                ran |= self._runner.results[-1].state != "skipped"
            except RunStopped:
                ran = True  # its result says why; the other steps are still tried
        return ran
