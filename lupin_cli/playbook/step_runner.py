"""Runs one step: examine, ask, take the lease, journal, change, verify, report.

The intended change and the previous state are synced to disk before the change (write-ahead).
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from lupin_cli.connection.base import (
    AuthenticationFailed,
    HostKeyChanged,
    HostKeyUnknown,
    Output,
    RootRefused,
    TargetError,
    Unreachable,
)
from lupin_cli.operations.base import Difference, Operation, OperationError
from lupin_cli.operations.restored_state import digests_of
from lupin_cli.operations.shell import observe
from lupin_cli.playbook.binding import Binding
from lupin_cli.playbook.expressions import ExpressionError
from lupin_cli.playbook.lease import LeaseTaken
from lupin_cli.playbook.model import Step
from lupin_cli.playbook.probe_batch import ProbeBatch
from lupin_cli.playbook.results import StepResult
from lupin_cli.playbook.run_context import RunContext, RunStopped
from lupin_cli.playbook.run_record import StepRecord
from lupin_cli.playbook.yaml_source import PlaybookError
from lupin_cli.printed_commands import complete

_FIRST_POLL_S, _MAX_POLL_S = 0.1, 1.0
_POLL_GROWTH = 1.5
NO_ACCESS = (Unreachable, AuthenticationFailed, HostKeyChanged, HostKeyUnknown)
_NOT_RETRIED = (HostKeyChanged, AuthenticationFailed, RootRefused)
_SETTLED = ("same", "changed", "skipped")


@dataclass(frozen=True)
class Commands:
    """What an operator types to play again, and to resume; the latter is empty in a dry run."""

    play: str
    resume: str


class StepRunner:
    """Runs the steps of one playbook run, one after another."""

    def __init__(
        self,
        context: RunContext,
        binding: Binding,
        commands: Commands,
        probes: ProbeBatch | None,
        answered: frozenset[int] = frozenset(),
        present: Binding | None = None,
    ) -> None:
        """`probes` are the robot's; the laptop's are not prefetched, since it is local and several runs may share it.

        `answered` are the indices of the steps whose questions were answered with yes before the run. `present`, of a resumed
        run, is another binding: it gets the results that read-only steps have now, and steps that guard the run use it. All
        other steps use what the run found before it was cut off, since that is what it decided by.
        """
        self._context = context
        self._binding = binding
        self._present = present if present is not None else binding
        self._probes = probes
        self._dry_run = context.options.dry_run
        self.commands = commands
        self._answered = answered
        self.locked_out = False  # by another run's lease
        self._left: dict[str, str] = {}  # by the current step: digests of what its undo will overwrite
        self.results: list[StepResult] = []

    def prefetch(self, steps: dict[int, Step]) -> None:
        """Run in one batch the probes of those robot steps that run whatever earlier steps find. `steps` are by index."""
        if self._probes is None:
            return
        operations: dict[int, Operation] = {}
        for index, step in steps.items():
            if step.machine != "robot" or not step.operation.prefetchable or step.until is not None:
                continue
            try:
                if self._binding.should_run(step):
                    operations[index] = self._binding.operation(step)
            except (ExpressionError, PlaybookError):
                continue  # it needs an earlier step's result, or is invalid, which its turn will report
        probes = {index: script for index, each in operations.items() if (script := each.probe()) is not None}
        self._probes.fetch(probes, [operations[index].prepare for index in probes])

    def run(self, index: int, step: Step, *, reached: bool, prior: StepRecord | None) -> None:
        """Run a step and add its result. If it is not `reached`, it runs only if it is read-only. `prior` is its record in a
        resumed run.

        Raises RunStopped, JournalError or KeyboardInterrupt.
        """
        blank = StepResult(index, step.name, step.operation.name, step.machine, "skipped")
        if prior is not None and prior.state in _SETTLED and (not step.operation.guards or prior.state == "skipped"):
            self._binding.remember(step, prior.result)
            if self._present is not self._binding:
                self._present.remember(step, self._examine_again(step, prior))
            self.results.append(dataclasses.replace(blank, state=prior.state, summary=prior.summary, result=prior.result))
            self._context.emit("step-end", index, step.name, state=f"{prior.state} before")
            return
        started = time.monotonic()
        self._context.emit("step", index, step.name)
        outcome, self._left = blank, {}
        try:
            outcome = self._run(index, step, blank, reached, prior)
            for binding in (self._binding, self._present):
                binding.remember(step, outcome.result)
        except (ExpressionError, PlaybookError) as error:
            outcome = dataclasses.replace(blank, state="failed", error=str(error))
            raise RunStopped("failed", "failed", f"{step.name}: {error}") from error
        except RunStopped as error:
            outcome = dataclasses.replace(blank, state=error.step_state, error=str(error))
            raise
        except BaseException as error:  # the end of the step is reported, whatever caused it
            outcome = dataclasses.replace(blank, state="interrupted", error=type(error).__name__)
            raise
        finally:
            duration_s = round(time.monotonic() - started, 3)
            mask = self._context.mask
            masked = dataclasses.replace(outcome, error=mask(outcome.error), result=mask(outcome.result), duration_s=duration_s)
            self.results.append(masked)
            end = {"state": outcome.state, "duration_s": duration_s}
            self._context.write("step-end", index=index, error=masked.error, result=masked.result, left=self._left, **end)
            self._context.emit("step-end", index, step.name, text=masked.error or masked.summary, **end)

    def _run(self, index: int, step: Step, blank: StepResult, reached: bool, prior: StepRecord | None) -> StepResult:
        line = {"index": index, "name": step.name, "operation": step.operation.name, "machine": step.machine}
        if not (reached or step.operation.read_only) or not self._binding.should_run(step):
            self._context.write("step", **line)
            return dataclasses.replace(blank, result={"changed": False, "skipped": True})
        binding = self._present if step.operation.guards else self._binding
        operation = binding.operation(step)
        self._context.write("step", sync=False, **line, arguments=binding.arguments(step), undo=step.undo)
        target = self._context.targets[step.machine]
        target.deadline = time.monotonic() + step.timeout_s
        may_have_changed = prior is not None and prior.before is not None  # an earlier attempt may have changed something
        if prior is not None and prior.before is not None:
            operation = operation.with_baseline(prior.before)
        for number in range(step.retry.times + 1):
            try:
                outcome = self._attempt(index, step, operation, blank, may_have_changed)
                target.deadline = float("inf")
                return outcome
            except (OperationError, TargetError) as error:
                out_of_time = time.monotonic() + step.retry.pause_s >= target.deadline
                if self._dry_run or number == step.retry.times or out_of_time or isinstance(error, _NOT_RETRIED):
                    raise self._as_run_stopped(step, error) from error
                may_have_changed = True
                text = self._context.mask(f"{error}; trying again in {step.retry.pause_s:g} s")
                self._context.emit("line", index, step.name, text=text)
                self._context.pause(step.retry.pause_s)
        raise AssertionError("the last attempt returns or raises")

    def _examine_again(self, step: Step, prior: StepRecord) -> dict[str, Any]:
        """Return what a read-only step reports now, and the recorded result of any other step. Raises RunStopped."""
        if not (step.operation.read_only and step.result) or prior.state == "skipped":
            return prior.result
        target = self._context.targets[step.machine]
        target.deadline = time.monotonic() + step.timeout_s
        try:
            operation = self._present.operation(step)
            return {"changed": False, "skipped": False, **operation.report(observe(operation, target))}
        except (OperationError, TargetError) as error:
            raise self._as_run_stopped(step, error) from error
        except (ExpressionError, PlaybookError) as error:
            raise RunStopped("failed", "failed", f"{step.name}: {error}") from error

    def _as_run_stopped(self, step: Step, error: OperationError | TargetError) -> RunStopped:
        no_access = isinstance(error, NO_ACCESS)
        target = self._context.targets[step.machine]
        robot = self._context.robot if step.machine == "robot" else ""
        next_command = complete(error.next_command, robot=robot, login=target.login_command)
        if isinstance(error, RootRefused):
            next_command = with_sudo(self.commands.resume or self.commands.play, step.machine)
        step_state, run_state = ("lost", "unreachable") if no_access else ("failed", "failed")
        return RunStopped(step_state, run_state, f"{step.name}: {error}", next_command)

    def _attempt(self, index: int, step: Step, operation: Operation, blank: StepResult, may_have_changed: bool) -> StepResult:
        state = "changed" if may_have_changed else "same"
        summary = diff = question = ""
        if operation.only_waits and self._would_change():
            result = {"changed": True, "skipped": False}
            summary = "wait for what the steps above start"
            return dataclasses.replace(blank, state="would-change", summary=summary, result=result)
        with self._context.targets[step.machine].reserved():
            try:
                output = self._observe(index, step, operation)
                difference = operation.judge(output)
            except OperationError as error:
                if self._would_change():
                    summary = f"not known before the steps above are done: {error}"
                    result = {"changed": True, "skipped": False}
                    return dataclasses.replace(
                        blank, state="would-change", summary=summary, result=result, question=self._question(step)
                    )
                raise
            if difference is not None:
                summary, diff = self._context.mask(difference.summary), self._context.mask(difference.diff)
                shown = diff if self._context.options.diff else ""
                self._context.emit("difference", index, step.name, text=summary, diff=shown)
                if self._dry_run:
                    state, question = "would-change", self._question(step)
                else:
                    self._confirm(index, step)
                    if self._take_lease(step):
                        output = self._observe(index, step, operation)
                        difference = operation.judge(output)
                    if difference is not None:
                        output = self._change(index, step, operation, difference, output)
                        operation = operation.with_baseline(difference.before)
                        state = "changed"
            if state == "changed":
                self._left = digests_of(operation, output)
        result = self._report(index, step, operation, output, state != "same")
        return dataclasses.replace(blank, state=state, summary=summary, diff=diff, result=result, question=question)

    def _would_change(self) -> bool:
        """Return whether this is a dry run in which an earlier step would change something."""
        return any(result.state == "would-change" for result in self.results)

    def _observe(self, index: int, step: Step, operation: Operation) -> Output:
        """Return what the operation judges; its probe may have been prefetched."""
        script = operation.probe()
        prefetched = None
        if self._probes is not None and step.machine == "robot" and script is not None:
            prefetched = self._probes.take(index, script)
        return observe(operation, self._context.targets[step.machine], prefetched)

    def _question(self, step: Step) -> str:
        return "" if step.confirm is None else str(self._context.mask(self._binding.text(step, step.confirm)))

    def _confirm(self, index: int, step: Step) -> None:
        """Ask the step's question, unless it was answered before the run. Raises RunStopped."""
        question = self._question(step)
        if not question or index in self._answered:
            return
        confirm = self._context.options.confirm
        if confirm is None or not confirm(question):
            next_command = f"{self.commands.resume} --yes" if self.commands.resume else ""
            raise RunStopped("declined", "declined", f"{step.name}: not confirmed: {question}", next_command)

    def _take_lease(self, step: Step) -> bool:
        """Return whether the robot's lease was taken just now: its last holder may have changed the robot since the probe."""
        if self._context.lease is None or self._probes is None or step.machine != "robot":
            return False
        try:
            taken = self._context.lease.take()
        except LeaseTaken:
            self.locked_out = True
            raise
        if taken:
            self._probes.clear()
        return taken

    def _change(self, index: int, step: Step, operation: Operation, difference: Difference, output: Output) -> Output:
        """Journal the intended change, make it and wait until nothing differs; returns the probe's last output.

        `output` is the one that showed the difference.
        """
        context = self._context
        target = context.targets[step.machine]
        found = digests_of(operation, output)
        context.write(
            "change", index=index, summary=difference.summary, diff=difference.diff, before=difference.before, found=found
        )
        context.emit("change", index, step.name)
        if self._probes is not None and step.machine == "robot":
            self._probes.clear()

        def emit_line(line: str) -> None:
            context.emit("line", index, step.name, text=context.mask(line))

        with context.recording(index, target, emit_line):
            operation.change(target, difference)
        if context.lease is not None and operation.name == "reboot":
            context.lease.forget()
        operation = operation.with_baseline(difference.before)
        deadline = min(target.deadline, time.monotonic() + operation.settle_s)
        for pause_s in poll_pauses():
            output = observe(operation, target)
            remaining = operation.judge(output)
            if remaining is None:
                return output
            if time.monotonic() + pause_s >= deadline:
                raise OperationError(f"the change did not hold; still to do: {remaining.summary}", operation.inspect_command)
            context.pause(pause_s)
        raise AssertionError("the pauses do not end")

    def _report(self, index: int, step: Step, operation: Operation, output: Output, changed: bool) -> dict[str, Any]:
        """Return the step's result; with `until`, poll until it holds."""
        target = self._context.targets[step.machine]
        for pause_s in poll_pauses():
            values = operation.report(output) if step.result or step.until is not None else {}
            result = {"changed": changed, "skipped": False, **values}
            if step.until is None or self._dry_run or self._binding.holds(step, result):
                return result
            found = ", ".join(f"{key} = {value!r}" for key, value in values.items())
            timeout_error = OperationError(f"{step.until.text!r} did not hold within {step.timeout_s:g} s; at the end: {found}")
            if time.monotonic() + pause_s >= target.deadline:
                raise timeout_error
            self._context.pause(pause_s)
            self._context.emit("line", index, step.name, text=f"waiting until {step.until.text}")
            try:
                output = observe(operation, target)
            except OperationError as error:
                # The step's timeout cuts off the last probe of a wait; in that case the wait has failed, not the probe.
                if time.monotonic() < target.deadline - _FIRST_POLL_S:
                    raise
                raise timeout_error from error
        raise AssertionError("the pauses do not end")


def with_sudo(command: str, machine: str) -> str:
    """Return how to type a command again whose sudo on this machine needs a password: on the laptop, sudo itself asks."""
    return f"sudo -v && {command}" if machine == "laptop" else f"{command} --ask-sudo-password"


def poll_pauses() -> Iterator[float]:
    """Yield pauses between polls, s, which grow up to a maximum; never ends."""
    pause_s = _FIRST_POLL_S
    while True:
        yield pause_s
        pause_s = min(pause_s * _POLL_GROWTH, _MAX_POLL_S)
