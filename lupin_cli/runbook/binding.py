"""What names mean in a run: variables, machines and the results so far, frame by frame."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lupin_cli.runbook.expressions import Expression, ExpressionError
from lupin_cli.runbook.language import Frame, Playbook, Step
from lupin_cli.runbook.reading import build, check_variable
from lupin_cli.runbook.source import Place, PlaybookError, nearest
from lupin_cli.runbook.templates import resolve
from lupin_cli.target.base import Target


class Binding:
    """The values of one run of a playbook. Made before anything runs: what can be checked by then is checked here."""

    def __init__(self, playbook: Playbook, variables: Mapping[str, Any], targets: Mapping[str, Target] | None) -> None:
        """`targets` of None: only to be asked which machines it takes.

        Raises PlaybookError for unknown, missing and unfit variables, a machine that nobody named, unfit arguments.
        """
        self._playbook = playbook
        self._given = dict(variables)
        self._machines = _machines(targets or {})
        self._results: dict[int, dict[str, Any]] = {}
        known = {variable.name for variable in playbook.variables}
        for name in variables:
            if name not in known:
                raise PlaybookError(f"{playbook.name!r} has no variable {name!r}{nearest(name, known)}", playbook.file)
        root = playbook.steps[0].frame
        while root.parent is not None:
            root = root.parent
        self.variables = self._variables(root)
        if targets is None:
            return
        self._check_arguments()
        for machine in sorted(self.machines()):
            if machine not in targets:
                raise PlaybookError(f"{playbook.name!r} works on the {machine}, and none is named: --robot NAME", playbook.file)

    @property
    def secrets(self) -> dict[str, str]:
        """The values of secret variables, by name."""
        return {v.name: str(self.variables[v.name]) for v in self._playbook.variables if v.type == "secret"}

    def _check_arguments(self) -> None:
        for step in self._playbook.steps:
            try:
                self.operation(step)
            except ExpressionError:
                continue  # waits for the result of an earlier step

    def machines(self) -> set[str]:
        """The machines that steps may need: those whose conditions hold, or wait for a result."""
        return {step.machine for step in self._playbook.steps if self._may_run(step)}

    def _may_run(self, step: Step) -> bool:
        try:
            return self.wanted(step)
        except (PlaybookError, ExpressionError):
            return True

    def scope(self, frame: Frame) -> dict[str, Any]:
        """Every name that a step of this frame may use."""
        return {**self._variables(frame), **self._results.get(id(frame), {})}

    def _variables(self, frame: Frame) -> dict[str, Any]:
        values: dict[str, Any] = dict(self._machines)
        parent = self.scope(frame.parent) if frame.parent is not None else {}
        for variable in frame.variables:
            place: Place | str = variable.place
            if frame.parent is None and variable.name in self._given:
                value, place = self._given[variable.name], f"-v {variable.name}"
            elif variable.name in frame.given:
                template, place = frame.given[variable.name]
                value = resolve(template, parent)
            elif variable.has_default:
                value = resolve(variable.default, values)
            else:
                hint = f" ({variable.help})" if variable.help else ""
                raise PlaybookError(f"{variable.name!r} must be given{hint}: -v {variable.name}=...", variable.place)
            try:
                values[variable.name] = check_variable(variable, value)
            except ValueError as error:
                raise PlaybookError(f"{variable.name!r}: {error}", place) from error
        return values

    def wanted(self, step: Step) -> bool:
        """Whether its conditions hold, and those of everything that includes it."""
        frame = step.frame
        while frame.parent is not None:
            if frame.when is not None and not self._holds(frame.when, self.scope(frame.parent), frame.when_place):
                return False
            frame = frame.parent
        return step.when is None or self._holds(step.when, self.scope(step.frame), step.place)

    def holds(self, step: Step, result: Mapping[str, Any]) -> bool:
        """Whether `until` holds, given the step's own result."""
        assert step.until is not None
        return self._holds(step.until, {**self.scope(step.frame), step.result: result}, step.place)

    def _holds(self, condition: Expression, scope: Mapping[str, Any], place: Place | None) -> bool:
        try:
            return bool(condition.evaluate(scope))
        except ExpressionError as error:
            raise PlaybookError(f"the condition {condition.text!r}: {error}", place or self._playbook.file) from error

    def operation(self, step: Step) -> Any:
        """The step's operation with its arguments; raises ExpressionError where a result isn't there yet."""
        arguments = self.arguments(step)
        place = next((place for _, place in step.arguments.values()), step.place)
        return build(step.operation, arguments, step.machine, place, step.operation.name)  # type: ignore[attr-defined]

    def arguments(self, step: Step) -> dict[str, Any]:
        """The step's arguments, resolved."""
        scope = self.scope(step.frame)
        return {name: resolve(value, scope) for name, (value, _) in step.arguments.items()}

    def text(self, step: Step, value: Any) -> str:
        """A template of the step as text."""
        return str(resolve(value, self.scope(step.frame)))

    def remember(self, step: Step, result: Mapping[str, Any]) -> None:
        """Keep a step's result for those after it."""
        if step.result:
            self._results.setdefault(id(step.frame), {})[step.result] = dict(result)


def _machines(targets: Mapping[str, Target]) -> dict[str, Any]:
    robot, laptop = targets.get("robot"), targets.get("laptop")
    return {
        "robot": {
            "name": robot.name if robot else "",
            "user": robot.user if robot else "",
            "address": str(getattr(robot, "address", "")) if robot else "",
        },
        "laptop": {
            "name": laptop.name if laptop else "laptop",
            "user": laptop.user if laptop else os.environ.get("USER", ""),
            "home": str(Path.home()),
        },
    }
