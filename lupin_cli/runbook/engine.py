"""Plays a playbook on a robot and a laptop: differs? → journal → change → verify, one step after another."""

from __future__ import annotations

import dataclasses
import os
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.runbook.ahead import AskedAhead
from lupin_cli.runbook.binding import Binding
from lupin_cli.runbook.expressions import ExpressionError
from lupin_cli.runbook.journal import Journal, JournalError, Mask, RunRecord, StepRecord, journal_folder, list_runs
from lupin_cli.runbook.language import Playbook, Step
from lupin_cli.runbook.lease import Lease, LeaseTaken
from lupin_cli.runbook.library import load
from lupin_cli.runbook.outcome import Event, Result, StepResult
from lupin_cli.runbook.source import PlaybookError, nearest
from lupin_cli.runbook.watched import WatchedTarget
from lupin_cli.target.base import (
    AuthenticationFailed,
    HostKeyChanged,
    HostKeyUnknown,
    RootRefused,
    Target,
    TargetError,
    Unreachable,
)

_FIRST_POLL_S, _LONGEST_POLL_S = 0.1, 1.0
_NO_WAY_IN = (Unreachable, AuthenticationFailed, HostKeyChanged, HostKeyUnknown)
_IN_VAIN = (HostKeyChanged, AuthenticationFailed, RootRefused)  # however often it is tried
_SETTLED = ("same", "changed", "skipped")

Confirm = Callable[[str], bool]
OnEvent = Callable[[Event], None]


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

    `playbook` is a loaded one, a shipped one's name or a file. `targets` has "robot", "laptop" or both: whichever its steps are
    `on`. `variables` are values of the playbook's `vars`. `from_step` is a step's name or number (from 1): what changes before
    it is skipped, what only reads is read. `resume` goes on with the newest unfinished run of this playbook on this robot, with
    that run's variables and results; `confirm` answers a step's question (None: no). `journal` is another folder than
    `journal_folder()`. `on_event` gets progress, in this thread. `stop` ends the run after what is under way. An exclusive
    playbook takes the robot's lease before its first change there; `break_lease` takes it from whoever holds it.

    Raises FileNotFoundError, PlaybookError or JournalError before anything is changed. Everything after that is in the result:
    a step that failed, a link that went, an interrupt.
    """
    book = playbook if isinstance(playbook, Playbook) else load(playbook)
    robot = targets["robot"].name if "robot" in targets else ""
    prior = _unfinished(book, robot, journal) if resume else None
    if resume and prior is None:
        return Result(book.name, robot, "done", message=f"no run of {book.name} was left unfinished")
    if prior is not None:
        variables = _same_variables(book, prior, variables or {})
        from_step = prior.from_step
    binding = Binding(book, variables or {}, targets)
    first = _index_of(book, from_step) if from_step else 0
    mask = Mask(tuple(binding.secrets.values()))
    log: Journal | None = None
    if prior is not None:
        log = Journal.again(prior.path, mask)
    elif not dry_run:
        start = _start(book, robot, binding, from_step)
        log = Journal.begin(journal or journal_folder(), book.name, robot, mask, start)
    lease = None
    if book.exclusive and not dry_run and "robot" in targets:
        lease = Lease(targets["robot"], f"lupin play {book.name}", break_it=break_lease)
    run = _Run(book, targets, binding, log, dry_run, diff, confirm, mask, on_event, stop or threading.Event(), robot, lease)
    reachable = True
    try:
        result = run.all(first, {step.index: step for step in prior.steps} if prior else {})
        reachable = result.state != "unreachable"
        return result
    finally:
        if lease is not None:
            lease.end(reachable=reachable, resumed=prior is not None)
        if log is not None:
            log.close()


def _start(book: Playbook, robot: str, binding: Binding, from_step: str) -> dict[str, Any]:
    secrets = sorted(binding.secrets)
    given = {v.name: binding.variables[v.name] for v in book.variables if v.name not in secrets}
    return {
        "playbook": book.name,
        "file": book.file,
        "digest": book.digest,
        "robot": robot,
        "variables": given,
        "secrets": secrets,
        "from_step": from_step,
        "exclusive": book.exclusive,
        "pid": os.getpid(),
    }


def _unfinished(book: Playbook, robot: str, folder: Path | None) -> RunRecord | None:
    for run in list_runs(folder):
        if (run.playbook, run.robot) != (book.name, robot) or run.undo_of:
            continue
        if run.state == "running":
            raise JournalError(f"the run {run.run} is still going on", f"lupin journal show {run.run}")
        if run.finished:
            return None
        if run.closed:
            command = f"lupin play {book.name}" + (f" --robot {robot}" if robot else "")
            raise JournalError(f"{run.run} failed and was put in order: there is nothing half-way to go on with", command)
        if run.digest != book.digest:
            raise PlaybookError(f"has changed since {run.run} was cut off: play it anew, or undo that run first", book.file)
        return run
    return None


def _same_variables(book: Playbook, prior: RunRecord, given: Mapping[str, Any]) -> dict[str, Any]:
    for name, value in given.items():
        if name in prior.variables and prior.variables[name] != value:
            raise PlaybookError(f"{prior.run} was begun with {name}={prior.variables[name]}, not {value}", f"-v {name}")
    missing = [name for name in prior.secrets if name not in given]
    if missing:
        raise PlaybookError(
            f"secrets are not written down; give them again: {' '.join(f'-v {n}=...' for n in missing)}", book.file
        )
    return {**prior.variables, **given}


def _index_of(book: Playbook, word: str) -> int:
    names = [step.name for step in book.steps]
    if word.isdecimal() and 1 <= int(word) <= len(names):
        return int(word) - 1
    if word in names:
        return names.index(word)
    raise PlaybookError(f"there is no step {word!r}{nearest(word, names)}, or a number from 1 to {len(names)}", book.file)


def _begun(operation: Any, before: Mapping[str, Any]) -> Any:
    return operation.begun(before) if hasattr(operation, "begun") else operation


class _Stopped(Exception):
    """Ends the run. `state` is the step's, `ending` the run's."""

    def __init__(self, state: str, ending: str, message: str, next_command: str = "") -> None:
        super().__init__(message)
        self.state = state
        self.ending = ending
        self.next_command = next_command


class _Run:
    def __init__(
        self,
        book: Playbook,
        targets: Mapping[str, Target],
        binding: Binding,
        journal: Journal | None,
        dry_run: bool,
        diff: bool,
        confirm: Confirm | None,
        mask: Mask,
        on_event: OnEvent | None,
        stop: threading.Event,
        robot: str,
        lease: Lease | None,
    ) -> None:
        self._book = book
        # The laptop is near, and several runs may share it: it is asked when it is a step's turn.
        self._ahead = AskedAhead(targets["robot"]) if "robot" in targets else None
        watched = targets if self._ahead is None else {**targets, "robot": self._ahead}
        self._targets = {machine: WatchedTarget(target) for machine, target in watched.items()}
        self._binding = binding
        self._journal = journal
        self._dry_run = dry_run
        self._diff = diff
        self._confirm = confirm
        self._mask = mask
        self._on_event = on_event
        self._stop = stop
        self._robot = robot
        self._lease = lease
        self._kept_out = False  # by another run's lease
        self._results: list[StepResult] = []

    def all(self, first: int, prior: Mapping[int, StepRecord]) -> Result:
        self._tell("run", text=self._journal.run if self._journal else "")
        state, message, next_command, closed = "done", "", "", False
        self._ask_ahead(step for index, step in enumerate(self._book.steps) if index >= first and index not in prior)
        try:
            for index, step in enumerate(self._book.steps):
                if self._stop.is_set():
                    raise _Stopped("interrupted", "interrupted", "interrupted before this step")
                result = self._step(index, step, index >= first, prior.get(index))
                self._results.append(result)
        except _Stopped as stopped:
            state, message = stopped.ending, str(stopped)
            next_command = stopped.next_command or self._resume_command()
            if state != "unreachable" and self._put_in_order(index, first):
                closed, next_command = True, stopped.next_command or self._command()
            if self._kept_out:
                next_command = f"{self._command() if closed else self._resume_command()} --break-lease"
        except JournalError as error:
            # What can't be written down isn't done: the run could be neither resumed nor taken back.
            state, message, next_command = "failed", str(error), error.next_command
        except KeyboardInterrupt:
            state, message, next_command = "interrupted", "interrupted", self._resume_command()
            if self._put_in_order(index, first):
                closed, next_command = True, self._command()
        self._write("end", state=state, message=message, closed=closed)
        self._tell("end", state=state, text=message)
        run = self._journal.run if self._journal else ""
        steps = tuple(self._results)
        resume = "" if closed or state == "done" else self._resume_command()
        return Result(self._book.name, self._robot, state, steps, run, self._dry_run, self._mask(message), next_command, resume)

    def _ask_ahead(self, steps: Iterable[Step]) -> None:
        """Ask the robot, in one batch, what those steps will look at first that are sure to be reached as things stand."""
        if self._ahead is None:
            return
        looks, meanwhile = [], []
        for step in steps:
            if step.machine != "robot" or not getattr(step.operation, "stands", False) or step.until is not None:
                continue
            try:
                if not self._binding.wanted(step):
                    continue
                operation = self._binding.operation(step)
            except (ExpressionError, PlaybookError):
                continue  # waits for the result of an earlier step, or is told when it is its turn
            looks.append(operation.report if getattr(operation, "read_only", False) else operation.differs)
            if hasattr(operation, "prepare"):
                meanwhile.append(operation.prepare)
        self._ahead.ask(looks, meanwhile)

    def _command(self) -> str:
        return f"lupin play {self._book.name}" + (f" --robot {self._robot}" if self._robot else "")

    def _resume_command(self) -> str:
        return "" if self._dry_run else f"{self._command()} --resume"

    def _put_in_order(self, failed: int, first: int) -> bool:
        """Do what is to be done always, after a step that failed. True where there was such a thing."""
        waiting = [(i, step) for i, step in enumerate(self._book.steps) if i > failed and i >= first and step.always]
        done = False
        for index, step in waiting if not self._dry_run else ():
            self._stop.clear()
            try:
                result = self._step(index, step, True, None)
            except _Stopped:
                done = True
                continue  # it is among the results; the others are tried all the same
            self._results.append(result)
            done |= result.state != "skipped"
        return done

    def _step(self, index: int, step: Step, reached: bool, prior: StepRecord | None) -> StepResult:
        word = step.operation.name  # type: ignore[attr-defined]
        blank = StepResult(index, step.name, word, step.machine, "skipped")
        if prior is not None and prior.state in _SETTLED:
            self._binding.remember(step, prior.result)
            done = dataclasses.replace(blank, state=prior.state, summary=prior.summary, result=prior.result)
            self._tell("step-end", index, step, state=f"{prior.state} before")
            return done
        started = time.monotonic()
        self._tell("step", index, step)
        ended = blank
        try:
            if (not reached and not getattr(step.operation, "read_only", False)) or not self._binding.wanted(step):
                self._binding.remember(step, {"changed": False, "skipped": True})
                self._write("step", index=index, name=step.name, operation=word, machine=step.machine)
                ended = dataclasses.replace(blank, result={"changed": False, "skipped": True})
                return ended
            operation = self._binding.operation(step)
            self._write(
                "step", sync=False, index=index, name=step.name, operation=word, machine=step.machine,
                arguments=self._binding.arguments(step), undo=step.undo,
            )  # fmt: skip
            ended = self._attempts(index, step, operation, blank, prior)
            self._binding.remember(step, ended.result)
            return ended
        except (ExpressionError, PlaybookError) as error:
            ended = dataclasses.replace(blank, state="failed", error=str(error))
            raise _Stopped("failed", "failed", f"{step.name}: {error}") from error
        except _Stopped as stopped:
            ended = dataclasses.replace(blank, state=stopped.state, error=str(stopped))
            raise
        except BaseException as error:
            ended = dataclasses.replace(blank, state="interrupted", error=type(error).__name__)
            raise
        finally:
            ended = dataclasses.replace(ended, duration_s=round(time.monotonic() - started, 3))
            if ended.state not in (*_SETTLED, "would-change"):
                self._results.append(dataclasses.replace(ended, error=self._mask(ended.error)))
            self._write(
                "step-end", index=index, state=ended.state, error=ended.error, result=ended.result, duration_s=ended.duration_s
            )
            self._tell(
                "step-end", index, step, state=ended.state, text=ended.error or ended.summary, duration_s=ended.duration_s
            )

    def _attempts(self, index: int, step: Step, operation: Any, blank: StepResult, prior: StepRecord | None) -> StepResult:
        target = self._targets[step.machine]
        target.deadline = time.monotonic() + step.timeout_s
        touched = prior is not None and prior.before is not None
        if prior is not None and prior.before is not None:
            operation = _begun(operation, prior.before)
        for attempt in range(step.retry.times + 1):
            try:
                ended = self._attempt(index, step, operation, target, blank, touched)
                target.deadline = float("inf")
                return ended
            except (OperationError, TargetError) as error:
                out_of_time = time.monotonic() + step.retry.pause_s >= target.deadline
                if attempt == step.retry.times or out_of_time or isinstance(error, _IN_VAIN):
                    raise self._ended(step, error) from error
                touched = True
                self._tell("line", index, step, text=f"{error}; trying again in {step.retry.pause_s:g} s")
                self._pause(step.retry.pause_s)
        raise AssertionError("unreachable: the last attempt returns or raises")

    def _ended(self, step: Step, error: OperationError | TargetError) -> _Stopped:
        lost = isinstance(error, _NO_WAY_IN)
        next_command = error.next_command
        if isinstance(error, RootRefused):
            next_command = f"{self._resume_command() or self._command()} --ask-sudo-password"
        return _Stopped(
            "lost" if lost else "failed", "unreachable" if lost else "failed", f"{step.name}: {error}", next_command
        )

    def _attempt(
        self, index: int, step: Step, operation: Any, target: WatchedTarget, blank: StepResult, touched: bool
    ) -> StepResult:
        with target.alone():
            try:
                difference = operation.differs(target)
            except OperationError as error:
                if self._dry_run and any(result.state == "would-change" for result in self._results):
                    summary = f"can't be told before the steps above are done: {error}"
                    return dataclasses.replace(
                        blank, state="would-change", summary=summary, result={"changed": True, "skipped": False}
                    )
                raise
            state = "changed" if touched else "same"
            summary = text = ""
            if difference is not None:
                summary, text = self._mask(difference.summary), self._mask(difference.diff)
                self._tell("difference", index, step, text=summary, diff=text if self._diff else "")
                state = "would-change"
                if not self._dry_run:
                    difference = self._agreed(step, operation, target, difference)
                    state = "changed" if touched or difference is not None else "same"
                if difference is not None and not self._dry_run:
                    self._change(index, step, operation, target, difference)
                    operation = _begun(operation, difference.before)
        result = self._report(index, step, operation, target, state != "same")
        return dataclasses.replace(blank, state=state, summary=summary, diff=text, result=result)

    def _agreed(self, step: Step, operation: Any, target: WatchedTarget, difference: Difference) -> Difference | None:
        """What is left to change once a person and the robot's lease allow it. Raises _Stopped or LeaseTaken."""
        self._ask(step)
        if self._lease is None or self._ahead is None or step.machine != "robot":
            return difference
        try:
            taken = self._lease.take()
        except LeaseTaken:
            self._kept_out = True
            raise
        if not taken:
            return difference
        self._ahead.forget()  # whoever had it until now may have been at work here
        found: Difference | None = operation.differs(target)
        return found

    def _ask(self, step: Step) -> None:
        if step.confirm is None:
            return
        question = self._binding.text(step, step.confirm)
        if self._confirm is None or not self._confirm(question):
            command = self._resume_command()
            raise _Stopped(
                "declined", "declined", f"{step.name}: not confirmed: {question}", f"{command} --yes" if command else ""
            )

    def _change(self, index: int, step: Step, operation: Any, target: WatchedTarget, difference: Difference) -> None:
        self._write("change", index=index, summary=difference.summary, diff=difference.diff, before=difference.before)
        self._tell("change", index, step)
        target.record = lambda text: self._write("output", sync=False, index=index, text=text)
        target.on_line = lambda line: self._tell("line", index, step, text=self._mask(line))
        try:
            operation.change(target, difference)
        finally:
            target.record = target.on_line = None
        if self._lease is not None and operation.name == "reboot":
            self._lease.forget()
        operation = _begun(operation, difference.before)
        settle_s = float(getattr(operation, "settle_s", 0.0))
        limit = min(target.deadline, time.monotonic() + settle_s)
        pause_s = _FIRST_POLL_S
        while True:
            left = operation.differs(target)
            if left is None:
                return
            if time.monotonic() + pause_s >= limit:
                raise OperationError(f"it was changed, but {left.summary}", getattr(operation, "look_command", ""))
            self._pause(pause_s)
            pause_s = min(pause_s * 1.5, _LONGEST_POLL_S)

    def _report(self, index: int, step: Step, operation: Any, target: WatchedTarget, changed: bool) -> dict[str, Any]:
        asked = step.result or step.until is not None  # nobody's question is not asked
        report = getattr(operation, "report", None) if asked else None
        pause_s = _FIRST_POLL_S
        result: dict[str, Any] = {}
        while True:
            try:
                result = {"changed": changed, "skipped": False, **(report(target) if report is not None else {})}
            except OperationError:
                # The last question of a wait is cut by the step's end: then the wait is what failed.
                if not result or time.monotonic() < target.deadline - _FIRST_POLL_S:
                    raise
            if step.until is None or self._dry_run or self._binding.holds(step, result):
                return result
            if time.monotonic() + pause_s >= target.deadline:
                seen = ", ".join(f"{key} = {value!r}" for key, value in result.items() if key not in ("changed", "skipped"))
                raise OperationError(f"{step.until.text!r} did not hold within {step.timeout_s:g} s; at the end: {seen}")
            self._pause(pause_s)
            pause_s = min(pause_s * 1.5, _LONGEST_POLL_S)
            self._tell("line", index, step, text=f"waiting until {step.until.text}")

    def _pause(self, seconds: float) -> None:
        if self._stop.wait(seconds):
            raise _Stopped("interrupted", "interrupted", "interrupted")

    def _write(self, event: str, **values: Any) -> None:
        if self._journal is not None:
            self._journal.write(event, **values)

    def _tell(self, kind: str, index: int = 0, step: Step | None = None, **values: Any) -> None:
        if self._on_event is not None:
            total = len(self._book.steps)
            self._on_event(Event(kind, self._robot, index, total, step.name if step else "", **values))
