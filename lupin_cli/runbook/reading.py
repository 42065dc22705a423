"""From text to a checked playbook: the first fault ends it, with its place and the nearest word that would have done."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from lupin_cli.runbook.expressions import Expression, ExpressionError, Name
from lupin_cli.runbook.expressions import parse as parse_expression
from lupin_cli.runbook.language import (
    BUILTINS,
    DEFAULT_TIMEOUT_S,
    MACHINES,
    RESULT_VALUES,
    Frame,
    Playbook,
    Retry,
    Step,
    Variable,
)
from lupin_cli.runbook.source import Place, PlaybookError, Source, nearest
from lupin_cli.runbook.templates import (
    VARIABLE_TYPES,
    Template,
    arguments_of,
    coerce,
    names_in,
    read_template,
    required_of,
)

_TOP = ("name", "description", "exclusive", "vars", "steps")
_STEP = ("name", "on", "as", "when", "until", "retry", "timeout", "confirm", "undo", "always")
_INCLUDE = ("include", "name", "vars", "when")
_VARIABLE = ("type", "default", "choices", "help")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_RESERVED = {"and", "or", "not", "in", "true", "false", "none", *BUILTINS}
_DEEPEST_INCLUDE = 8

Finder = Callable[[str, Path], Path]


def read_playbook(path: Path, operations: Mapping[str, type], find: Finder) -> Playbook:
    """Read a playbook and all that it includes; raises PlaybookError.

    `operations` are the steps' words; `find(name, folder)` gives the file of an included playbook and raises FileNotFoundError
    whose text names the nearest one.
    """
    reader = _Reader(operations, find)
    name, description, frame, steps = reader.file(path, (), None, {}, None, None)
    digest = hashlib.sha256("\0".join(reader.texts).encode()).hexdigest()[:16]
    return Playbook(name, description, str(path), frame.variables, tuple(steps), digest, reader.exclusive)


class _Names:
    """The names that may be used at one place of one file: its variables, and the results of the steps before."""

    def __init__(self) -> None:
        self.known: dict[str, tuple[str, ...] | None] = dict(BUILTINS)  # None: a plain value without parts

    def check(self, name: Name, fail: Callable[[str], PlaybookError]) -> None:
        first, rest = name.path[0], name.path[1:]
        if first not in self.known:
            raise fail(f"{first!r} is neither a variable nor the result of an earlier step{nearest(first, self.known)}")
        parts = self.known[first]
        if parts is None and rest:
            raise fail(f"{first!r} is a plain value and has no {rest[0]!r}")
        if parts is not None and (not rest or rest[0] not in parts):
            word = rest[0] if rest else ""
            raise fail(
                f"{first!r} has no value {word!r}{nearest(word, parts)}"
                if rest
                else f"say which value of {first!r}: {', '.join(parts)}"
            )


class _Reader:
    def __init__(self, operations: Mapping[str, type], find: Finder) -> None:
        self._operations = operations
        self._find = find
        self.texts: list[str] = []
        self.exclusive = False  # one of the files says so

    def file(
        self,
        path: Path,
        chain: tuple[Path, ...],
        parent: Frame | None,
        given: Mapping[str, tuple[Any, Place]],
        when: Expression | None,
        at: Place | None,
    ) -> tuple[str, str, Frame, list[Step]]:
        source = Source.read(path)
        self.texts.append(source.text)
        top = source.mapping(source.root, "a playbook")
        self._known_keys(source, top, _TOP, "a playbook")
        for key in ("name", "description", "steps"):
            if key not in top:
                raise source.error(source.root, f"a playbook needs {key!r}")
        name = source.text_of(top["name"][1], "the name")
        if name != path.stem:
            raise source.error(top["name"][1], f"the name is {name!r}, but the file is {path.name!r}: they are the same")
        self.exclusive |= "exclusive" in top and self._truth(source, top["exclusive"][1])
        names = _Names()
        variables = self._variables(source, top["vars"][1], names) if "vars" in top else ()
        for word, (_, place) in given.items():
            if word not in {variable.name for variable in variables}:
                raise PlaybookError(f"{name!r} has no variable {word!r}{nearest(word, [v.name for v in variables])}", place)
        if at is not None:
            for variable in variables:
                if not variable.has_default and variable.name not in given:
                    raise PlaybookError(f"{name!r} needs the variable {variable.name!r}: vars: {{{variable.name}: ...}}", at)
        frame = Frame(variables, given, parent, when, at)
        nodes = source.sequence(top["steps"][1], "'steps'")
        if not nodes:
            raise source.error(top["steps"][1], "a playbook has at least one step")
        steps: list[Step] = []
        taken: dict[str, int] = {}
        for node in nodes:
            entries = source.mapping(node, "a step")
            if "include" in entries:
                steps += self._include(source, node, entries, frame, names, (*chain, path.resolve()))
                continue
            step = self._step(source, node, entries, frame, names)
            if step.name in taken:
                raise source.error(entries["name"][1], f"two steps are named {step.name!r}; first in line {taken[step.name]}")
            taken[step.name] = step.place.line
            steps.append(step)
        return name, source.text_of(top["description"][1], "the description"), frame, steps

    def _known_keys(self, source: Source, entries: Mapping[str, Any], known: tuple[str, ...], what: str) -> None:
        for key, (node, _) in entries.items():
            if key not in known:
                raise source.error(node, f"{what} has no key {key!r}{nearest(key, known)}")

    def _variables(self, source: Source, node: yaml.Node, names: _Names) -> tuple[Variable, ...]:
        variables: list[Variable] = []
        for word, (key, value) in source.mapping(node, "'vars'").items():
            if not _WORD.match(word) or word in _RESERVED:
                raise source.error(
                    key, f"{word!r} can't name a variable: letters, digits and _, and none of {', '.join(sorted(_RESERVED))}"
                )
            variables.append(self._variable(source, word, value, names))
            names.known[word] = None
        return tuple(variables)

    def _variable(self, source: Source, word: str, node: yaml.Node, names: _Names) -> Variable:
        place = source.place(node)
        if not isinstance(node, yaml.MappingNode):
            default = self._value(source, node, names)
            return Variable(word, _type_of(default), place, default, True)
        entries = source.mapping(node, f"the variable {word!r}")
        self._known_keys(source, entries, _VARIABLE, "a variable")
        type_name = source.text_of(entries["type"][1], "a type") if "type" in entries else "text"
        if type_name not in VARIABLE_TYPES:
            raise source.error(entries["type"][1], f"there is no type {type_name!r}{nearest(type_name, VARIABLE_TYPES)}")
        choices: tuple[Any, ...] = ()
        if "choices" in entries:
            choices = tuple(source.plain(item) for item in source.sequence(entries["choices"][1], "'choices'"))
        text = source.text_of(entries["help"][1], "the help") if "help" in entries else ""
        variable = Variable(word, type_name, place, None, False, choices, text)
        if "default" not in entries:
            return variable
        default = self._value(source, entries["default"][1], names)
        if not list(names_in(default)):
            try:
                default = check_variable(variable, default)
            except ValueError as error:
                raise source.error(entries["default"][1], f"the default of {word!r}: {error}") from error
        return Variable(word, type_name, place, default, True, choices, text)

    def _include(
        self,
        source: Source,
        node: yaml.Node,
        entries: dict[str, tuple[yaml.Node, yaml.Node]],
        frame: Frame,
        names: _Names,
        chain: tuple[Path, ...],
    ) -> list[Step]:
        self._known_keys(source, entries, _INCLUDE, "an include")
        target = entries["include"][1]
        name = source.text_of(target, "an include")
        try:
            path = self._find(name, chain[-1].parent)
        except FileNotFoundError as error:
            raise source.error(target, str(error)) from error
        if path.resolve() in chain:
            circle = " → ".join(p.stem for p in (*chain[chain.index(path.resolve()) :], path))
            raise source.error(target, f"includes itself: {circle}")
        if len(chain) >= _DEEPEST_INCLUDE:
            raise source.error(target, f"includes go {_DEEPEST_INCLUDE} deep at most")
        given: dict[str, tuple[Any, Place]] = {}
        if "vars" in entries:
            for word, (_, value) in source.mapping(entries["vars"][1], "'vars'").items():
                given[word] = (self._value(source, value, names), source.place(value))
        when = self._expression(source, entries["when"][1], names) if "when" in entries else None
        prefix = source.text_of(entries["name"][1], "the name") if "name" in entries else name
        _, _, _, steps = self.file(path, chain, frame, given, when, source.place(target))
        return [_renamed(step, f"{prefix} / {step.name}") for step in steps]

    def _step(
        self, source: Source, node: yaml.Node, entries: dict[str, tuple[yaml.Node, yaml.Node]], frame: Frame, names: _Names
    ) -> Step:
        words = [word for word in entries if word not in _STEP]
        for word in words:
            if word not in self._operations:
                known = [*self._operations, *_STEP, "include"]
                raise source.error(
                    entries[word][0], f"a step has no key, and there is no operation, {word!r}{nearest(word, known)}"
                )
        if len(words) != 1:
            found = f"found {' and '.join(words)}" if words else "found none"
            raise source.error(entries[words[1]][0] if words else node, f"a step has exactly one operation; {found}")
        if "name" not in entries:
            raise source.error(node, "a step needs a 'name': a sentence of what holds after it")
        operation = self._operations[words[0]]
        machine = source.text_of(entries["on"][1], "'on'") if "on" in entries else "robot"
        if machine not in MACHINES:
            raise source.error(entries["on"][1], f"there is no machine {machine!r}{nearest(machine, MACHINES)}")
        arguments = self._arguments(source, words[0], operation, entries[words[0]], names, machine)
        when = self._expression(source, entries["when"][1], names) if "when" in entries else None
        result = self._result(source, entries, operation, names)
        return Step(
            name=source.text_of(entries["name"][1], "the name"),
            place=source.place(node),
            operation=operation,
            arguments=arguments,
            frame=frame,
            machine=machine,
            result=result,
            when=when,
            until=self._expression(source, entries["until"][1], names) if "until" in entries else None,
            retry=self._retry(source, entries["retry"][1]) if "retry" in entries else Retry(),
            timeout_s=self._number(source, entries["timeout"][1], "'timeout'") if "timeout" in entries else DEFAULT_TIMEOUT_S,
            confirm=self._value(source, entries["confirm"][1], names) if "confirm" in entries else None,
            always=self._truth(source, entries["always"][1]) if "always" in entries else False,
            undo=self._truth(source, entries["undo"][1]) if "undo" in entries else True,
        )

    def _result(self, source: Source, entries: dict[str, tuple[yaml.Node, yaml.Node]], operation: type, names: _Names) -> str:
        if "as" not in entries:
            return ""
        node = entries["as"][1]
        word = source.text_of(node, "'as'")
        if not _WORD.match(word) or word in _RESERVED or word in names.known:
            raise source.error(node, f"{word!r} can't name a result: letters, digits and _, and nothing that has that name yet")
        names.known[word] = (*RESULT_VALUES, *getattr(operation, "reports", ()))
        return word

    def _arguments(
        self, source: Source, word: str, operation: type, entry: tuple[yaml.Node, yaml.Node], names: _Names, machine: str
    ) -> dict[str, tuple[Any, Place]]:
        key, node = entry
        hints = arguments_of(operation)
        entries = {} if node.tag.endswith(":null") else source.mapping(node, f"the arguments of {word}")
        arguments: dict[str, tuple[Any, Place]] = {}
        for name, (name_node, value_node) in entries.items():
            if name not in hints:
                raise source.error(name_node, f"{word} has no argument {name!r}{nearest(name, hints)}")
            value = self._value(source, value_node, names)
            if not list(names_in(value)):
                try:
                    coerce(value, hints[name])
                except ValueError as error:
                    raise source.error(value_node, f"{name!r} of {word}: {error}") from error
            arguments[name] = (value, source.place(value_node))
        for name in required_of(operation):
            if name not in arguments:
                raise source.error(key, f"{word} needs the argument {name!r}")
        if not any(True for value, _ in arguments.values() for _ in names_in(value)):
            build(operation, {name: value for name, (value, _) in arguments.items()}, machine, source.place(key), word)
        return arguments

    def _value(self, source: Source, node: yaml.Node, names: _Names) -> Any:
        if isinstance(node, yaml.MappingNode):
            return {key: self._value(source, value, names) for key, (_, value) in source.mapping(node, "this mapping").items()}
        if isinstance(node, yaml.SequenceNode):
            return [self._value(source, item, names) for item in node.value]
        value = source.plain(node)
        if not isinstance(value, str):
            return value
        try:
            template = read_template(value)
        except ExpressionError as error:
            raise source.error(node, f"in {{{{ }}}}: {error}", error.column) from error
        for name in names_in(template):
            names.check(name, lambda message: source.error(node, message))
        return template

    def _expression(self, source: Source, node: yaml.Node, names: _Names) -> Expression:
        text = node.value if isinstance(node, yaml.ScalarNode) else source.text_of(node, "a condition")
        try:
            expression = parse_expression(text)
        except ExpressionError as error:
            raise source.error(node, f"the condition {text!r}: {error}", error.column) from error
        for name in expression.names():
            names.check(name, partial(self._condition_error, source, node, name.column))
        return expression

    @staticmethod
    def _condition_error(source: Source, node: yaml.Node, column: int, message: str) -> PlaybookError:
        return source.error(node, message, column)

    def _retry(self, source: Source, node: yaml.Node) -> Retry:
        if not isinstance(node, yaml.MappingNode):
            return Retry(self._whole(source, node, "'retry'"))
        entries = source.mapping(node, "'retry'")
        self._known_keys(source, entries, ("times", "pause_s"), "'retry'")
        return Retry(
            self._whole(source, entries["times"][1], "'times'") if "times" in entries else 1,
            self._number(source, entries["pause_s"][1], "'pause_s'") if "pause_s" in entries else 2.0,
        )

    def _whole(self, source: Source, node: yaml.Node, what: str) -> int:
        value = source.plain(node)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= 100:
            raise source.error(node, f"{what} is a whole number from 0 to 100, not {value!r}")
        return value

    def _number(self, source: Source, node: yaml.Node, what: str) -> float:
        value = source.plain(node)
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0 < value <= 3600:
            raise source.error(node, f"{what} is a number of seconds, more than 0 and at most 3600, not {value!r}")
        return float(value)

    def _truth(self, source: Source, node: yaml.Node) -> bool:
        value = source.plain(node)
        if not isinstance(value, bool):
            raise source.error(node, f"expected true or false, found {node.value!r}")
        return value


def build(operation: type, arguments: Mapping[str, Any], machine: str, place: Place, word: str) -> Any:
    """An operation of resolved arguments; raises PlaybookError where it won't have them."""
    hints = arguments_of(operation)
    values: dict[str, Any] = {}
    for name, value in arguments.items():
        try:
            values[name] = coerce(value, hints[name])
        except ValueError as error:
            raise PlaybookError(f"{name!r} of {word}: {error}", place) from error
    try:
        return operation(**values, machine=machine)
    except ValueError as error:  # an operation's own rules, in its __post_init__
        raise PlaybookError(f"{word}: {error}", place) from error


def check_variable(variable: Variable, value: Any) -> Any:
    """A variable's value, checked against its type and choices; raises ValueError."""
    checked = VARIABLE_TYPES[variable.type](value)
    if variable.choices and checked not in variable.choices:
        raise ValueError(f"expected one of {', '.join(map(str, variable.choices))}, found {checked!r}")
    return checked


def _type_of(value: Any) -> str:
    if isinstance(value, Template) or value is None:
        return "text"
    return {bool: "truth", int: "integer", float: "number", list: "list"}.get(type(value), "text")


def _renamed(step: Step, name: str) -> Step:
    return replace(step, name=name)
