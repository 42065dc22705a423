"""The values of names in a run: variables, machines and the results so far, for each included file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from lupin_cli.connection.base import Target
from lupin_cli.operations.base import Operation
from lupin_cli.playbook.expressions import Expression, ExpressionError
from lupin_cli.playbook.model import Playbook, PlaybookFrame, Step
from lupin_cli.playbook.parser import build
from lupin_cli.playbook.templates import resolve
from lupin_cli.playbook.variables import check_variable
from lupin_cli.playbook.yaml_source import Place, PlaybookError, suggest


class Binding:
    """The values of one run of a playbook. Created before anything runs, so most mistakes are found before any change."""

    def __init__(self, playbook: Playbook, variables: Mapping[str, Any], targets: Mapping[str, Target] | None) -> None:
        """Check variables, arguments and machines. Without `targets` (None), only `machines` may be called.

        Raises PlaybookError for an unknown, missing or invalid variable, an invalid argument, or a machine without a target.
        """
        self._playbook = playbook
        self._given = dict(variables)
        self._machines = _machines(targets or {})
        self._results: dict[int, dict[str, Any]] = {}
        known = {variable.name for variable in playbook.variables}
        for name in variables:
            if name not in known:
                raise PlaybookError(f"{playbook.name!r} has no variable {name!r}{suggest(name, known)}", playbook.file)
        root = playbook.steps[0].frame
        while root.parent is not None:
            root = root.parent
        self.variables = self._variables(root)
        if targets is None:
            return
        self._check_arguments()
        for machine in sorted(self.needed_machines()):
            if machine not in targets:
                raise PlaybookError(
                    f"{playbook.name!r} works on the {machine}, but no {machine} was named; name one with --robot NAME",
                    playbook.file,
                )

    @property
    def secret_values(self) -> tuple[str, ...]:
        """The values of all secret variables, also of included playbooks unless they need the result of a step."""
        found: dict[str, None] = {}
        for frame in {id(step.frame): step.frame for step in self._playbook.steps}.values():
            names = [variable.name for variable in frame.variables if variable.type == "secret"]
            with suppress(ExpressionError, PlaybookError):
                found |= dict.fromkeys(str(self._variables(frame)[name]) for name in names)
        names = [variable.name for variable in self._playbook.variables if variable.type == "secret"]
        return (*dict.fromkeys([*(str(self.variables[name]) for name in names), *found]),)

    @property
    def secret_names(self) -> tuple[str, ...]:
        """The variables of the playbook whose values are secrets: by their type, or since an included playbook says so."""
        values = set(self.secret_values)
        named = self._playbook.variables
        return tuple(sorted(v.name for v in named if v.type == "secret" or str(self.variables[v.name]) in values))

    def _check_arguments(self) -> None:
        for step in self._playbook.steps:
            try:
                self.operation(step)
            except ExpressionError:
                continue  # it needs the result of an earlier step

    def needed_machines(self) -> set[str]:
        """Return the machines of the steps whose conditions hold, or need the result of an earlier step."""
        return {step.machine for step in self._playbook.steps if self._may_run(step)}

    def _may_run(self, step: Step) -> bool:
        try:
            return self.should_run(step)
        except (PlaybookError, ExpressionError):
            return True

    def scope(self, frame: PlaybookFrame) -> dict[str, Any]:
        """Return the value of every name that a step of this frame may use."""
        return {**self._variables(frame), **self._results.get(id(frame), {})}

    def _variables(self, frame: PlaybookFrame) -> dict[str, Any]:
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
                option = f"--hidden {variable.name}" if variable.type == "secret" else f"-v {variable.name}=..."
                raise PlaybookError(f"{variable.name!r} must be given{hint}: {option}", variable.place)
            try:
                values[variable.name] = check_variable(variable, value)
            except ValueError as error:
                raise PlaybookError(f"{variable.name!r}: {error}", place) from error
        return values

    def should_run(self, step: Step) -> bool:
        """Return whether the step's condition holds, and the conditions of the includes that it comes from."""
        frame = step.frame
        while frame.parent is not None:
            if frame.when is not None and not self._holds(frame.when, self.scope(frame.parent), frame.when_place):
                return False
            frame = frame.parent
        return step.when is None or self._holds(step.when, self.scope(step.frame), step.place)

    def holds(self, step: Step, result: Mapping[str, Any]) -> bool:
        """Return whether `until` holds, given the step's own result."""
        assert step.until is not None
        return self._holds(step.until, {**self.scope(step.frame), step.result: result}, step.place)

    def _holds(self, condition: Expression, scope: Mapping[str, Any], place: Place | None) -> bool:
        try:
            return bool(condition.evaluate(scope))
        except ExpressionError as error:
            raise PlaybookError(f"the condition {condition.text!r}: {error}", place or self._playbook.file) from error

    def operation(self, step: Step) -> Operation:
        """Return the step's operation with its arguments; raises ExpressionError if they need a later result."""
        arguments = self.arguments(step)
        place = next((place for _, place in step.arguments.values()), step.place)
        return build(step.operation, arguments, step.machine, place, step.operation.name)

    def arguments(self, step: Step) -> dict[str, Any]:
        """Return the step's arguments with templates resolved."""
        scope = self.scope(step.frame)
        return {name: resolve(value, scope) for name, (value, _) in step.arguments.items()}

    def text(self, step: Step, value: Any) -> str:
        """Return a template of the step as text."""
        return str(resolve(value, self.scope(step.frame)))

    def remember(self, step: Step, result: Mapping[str, Any]) -> None:
        """Keep a step's result for later steps."""
        if step.result:
            self._results.setdefault(id(step.frame), {})[step.result] = dict(result)


def _machines(targets: Mapping[str, Target]) -> dict[str, Any]:
    robot, laptop = targets.get("robot"), targets.get("laptop")
    return {
        "robot": {
            "name": robot.name if robot else "",
            "user": robot.user if robot else "",
            "address": robot.address if robot else "",
            "login": robot.login_command if robot else "",
        },
        "laptop": {
            "name": laptop.name if laptop else "laptop",
            "user": laptop.user if laptop else os.environ.get("USER", ""),
            "home": str(Path.home()),
        },
    }
