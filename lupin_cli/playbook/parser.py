"""Parse YAML into a checked playbook. The first mistake raises PlaybookError with its place and the most similar valid word."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from lupin_cli.operations.base import Operation
from lupin_cli.playbook.argument_types import arguments_of, coerce, required_of
from lupin_cli.playbook.expressions import Expression
from lupin_cli.playbook.model import DEFAULT_TIMEOUT_S, MACHINES, RESULT_VALUES, Playbook, PlaybookFrame, Retry, Step, Variable
from lupin_cli.playbook.templates import names_in
from lupin_cli.playbook.variables import RESERVED, WORD, read_variables
from lupin_cli.playbook.yaml_source import MAX_BYTES, Place, PlaybookError, YamlSource, suggest
from lupin_cli.playbook.yaml_values import (
    Entries,
    NameScope,
    read_condition,
    read_count,
    read_seconds,
    read_truth,
    read_value,
    require_known_keys,
)

_TOP = ("name", "description", "exclusive", "vars", "steps")
_STEP = ("name", "on", "as", "when", "until", "retry", "timeout", "confirm", "undo", "always", "tags")
_INCLUDE = ("include", "name", "vars", "when", "tags")
_MAX_INCLUDE_DEPTH = 8
# Of a playbook with all that it includes. Includes multiply: ten files that include ten, six deep, would have a million steps.
MAX_STEPS = 2000
MAX_FILES = 100
MAX_CHARACTERS = 2 * MAX_BYTES

Finder = Callable[[str, Path], Path]


def read_playbook(path: Path, operations: Mapping[str, type[Operation]], find: Finder) -> Playbook:
    """Read a playbook and all that it includes; raises PlaybookError.

    `operations` has each operation by its word in steps. `find(name, folder)` returns the file of an included playbook and
    raises FileNotFoundError, whose message names the most similar one.
    """
    parser = _PlaybookParser(operations, find)
    parsed = parser.parse_file(path, (), None)
    digest = hashlib.sha256("\0".join(parser.texts).encode()).hexdigest()[:16]
    return Playbook(parsed.name, parsed.description, str(path), parsed.variables, parsed.steps, digest, parser.exclusive)


@dataclass(frozen=True)
class _Include:
    """The step that includes a file."""

    frame: PlaybookFrame
    given: Mapping[str, tuple[Any, Place]]  # values of the file's variables
    when: Expression | None
    place: Place


@dataclass(frozen=True)
class _ParsedFile:
    """A file with the steps of all that it includes."""

    name: str
    description: str
    variables: tuple[Variable, ...]
    steps: tuple[Step, ...]


class _PlaybookParser:
    def __init__(self, operations: Mapping[str, type[Operation]], find: Finder) -> None:
        self._operations = operations
        self._find = find
        self.texts: list[str] = []
        self.exclusive = False  # whether one of the files is

    def parse_file(self, path: Path, chain: tuple[Path, ...], included_by: _Include | None) -> _ParsedFile:
        """Parse a file; `chain` are the files that include it, the outermost first."""
        source = YamlSource.read(path)
        self.texts.append(source.text)
        if len(self.texts) > MAX_FILES or sum(map(len, self.texts)) > MAX_CHARACTERS:
            limit = f"a playbook includes at most {MAX_FILES} files with {MAX_CHARACTERS} characters in total"
            raise PlaybookError(limit, included_by.place if included_by else str(path))
        top = source.mapping(source.root, "a playbook")
        require_known_keys(source, top, _TOP, "a playbook")
        for key in ("name", "description", "steps"):
            if key not in top:
                raise source.error(source.root, f"a playbook needs {key!r}")
        name = source.text_of(top["name"][1], "the name")
        if name != path.stem:
            raise source.error(top["name"][1], f"the name is {name!r}, but the file is {path.name!r}: they must be the same")
        self.exclusive |= "exclusive" in top and read_truth(source, top["exclusive"][1])
        names = NameScope()
        variables = read_variables(source, top["vars"][1], names) if "vars" in top else ()
        for word, (_, place) in (included_by.given if included_by else {}).items():
            if word not in {variable.name for variable in variables}:
                raise PlaybookError(f"{name!r} has no variable {word!r}{suggest(word, [v.name for v in variables])}", place)
        frame = PlaybookFrame(variables)
        if included_by is not None:
            for variable in variables:
                if not variable.has_default and variable.name not in included_by.given:
                    message = f"{name!r} needs the variable {variable.name!r}: vars: {{{variable.name}: ...}}"
                    raise PlaybookError(message, included_by.place)
            frame = PlaybookFrame(variables, included_by.given, included_by.frame, included_by.when, included_by.place)
        nodes = source.sequence(top["steps"][1], "'steps'")
        if not nodes:
            raise source.error(top["steps"][1], "a playbook has at least one step")
        steps: list[Step] = []
        taken: dict[str, int] = {}
        for node in nodes:
            entries = source.mapping(node, "a step")
            if len(steps) > MAX_STEPS:
                raise source.error(node, f"a playbook has at most {MAX_STEPS} steps, with those that it includes")
            if "include" in entries:
                steps += self._include(source, entries, frame, names, (*chain, path.resolve()))
                continue
            step = self._step(source, node, entries, frame, names)
            if step.name in taken:
                raise source.error(entries["name"][1], f"two steps are named {step.name!r}; first in line {taken[step.name]}")
            taken[step.name] = step.place.line
            steps.append(step)
        return _ParsedFile(name, source.text_of(top["description"][1], "the description"), variables, tuple(steps))

    def _include(
        self,
        source: YamlSource,
        entries: Entries,
        frame: PlaybookFrame,
        names: NameScope,
        chain: tuple[Path, ...],
    ) -> list[Step]:
        require_known_keys(source, entries, _INCLUDE, "an include")
        target = entries["include"][1]
        name = source.text_of(target, "an include")
        try:
            path = self._find(name, chain[-1].parent)
        except FileNotFoundError as error:
            raise source.error(target, str(error)) from error
        if path.resolve() in chain:
            circle = " → ".join(p.stem for p in (*chain[chain.index(path.resolve()) :], path))
            raise source.error(target, f"includes itself: {circle}")
        if len(chain) >= _MAX_INCLUDE_DEPTH:
            raise source.error(target, f"includes go {_MAX_INCLUDE_DEPTH} deep at most")
        given: dict[str, tuple[Any, Place]] = {}
        if "vars" in entries:
            for word, (_, value) in source.mapping(entries["vars"][1], "'vars'").items():
                given[word] = (read_value(source, value, names), source.place(value))
        when = read_condition(source, entries["when"][1], names) if "when" in entries else None
        prefix = source.text_of(entries["name"][1], "the name") if "name" in entries else name
        parsed = self.parse_file(path, chain, _Include(frame, given, when, source.place(target)))
        tags = self._tags(source, entries)
        return [replace(step, name=f"{prefix} / {step.name}", tags=step.tags | tags) for step in parsed.steps]

    def _step(self, source: YamlSource, node: yaml.Node, entries: Entries, frame: PlaybookFrame, names: NameScope) -> Step:
        words = [word for word in entries if word not in _STEP]
        for word in words:
            if word not in self._operations:
                known = [*self._operations, *_STEP, "include"]
                raise source.error(entries[word][0], f"unknown step key or operation {word!r}{suggest(word, known)}")
        if len(words) != 1:
            found = f"found {' and '.join(words)}" if words else "found none"
            raise source.error(entries[words[1]][0] if words else node, f"a step has exactly one operation; {found}")
        if "name" not in entries:
            raise source.error(node, "a step needs a 'name': what it does, in a few words")
        operation = self._operations[words[0]]
        machine = source.text_of(entries["on"][1], "'on'") if "on" in entries else "robot"
        if machine not in MACHINES:
            raise source.error(entries["on"][1], f"there is no machine {machine!r}{suggest(machine, MACHINES)}")
        arguments = self._arguments(source, words[0], operation, entries[words[0]], names, machine)
        when = read_condition(source, entries["when"][1], names) if "when" in entries else None
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
            until=read_condition(source, entries["until"][1], names) if "until" in entries else None,
            retry=self._retry(source, entries["retry"][1]) if "retry" in entries else Retry(),
            timeout_s=read_seconds(source, entries["timeout"][1], "'timeout'") if "timeout" in entries else DEFAULT_TIMEOUT_S,
            confirm=read_value(source, entries["confirm"][1], names) if "confirm" in entries else None,
            always=read_truth(source, entries["always"][1]) if "always" in entries else False,
            undo=read_truth(source, entries["undo"][1]) if "undo" in entries else True,
            tags=self._tags(source, entries),
        )

    def _tags(self, source: YamlSource, entries: Entries) -> frozenset[str]:
        if "tags" not in entries:
            return frozenset()
        tags = {source.text_of(node, "a tag"): node for node in source.sequence(entries["tags"][1], "'tags'")}
        for tag, node in tags.items():
            if not WORD.match(tag):
                raise source.error(node, f"{tag!r} cannot be a tag: it must consist of letters, digits and _")
        return frozenset(tags)

    def _result(self, source: YamlSource, entries: Entries, operation: type[Operation], names: NameScope) -> str:
        if "as" not in entries:
            return ""
        node = entries["as"][1]
        word = source.text_of(node, "'as'")
        if not WORD.match(word) or word in RESERVED or word in names.known:
            raise source.error(node, f"{word!r} cannot name a result: it must be a new name of letters, digits and _")
        names.known[word] = (*RESULT_VALUES, *operation.report_keys)
        return word

    def _arguments(
        self,
        source: YamlSource,
        word: str,
        operation: type[Operation],
        entry: tuple[yaml.Node, yaml.Node],
        names: NameScope,
        machine: str,
    ) -> dict[str, tuple[Any, Place]]:
        key, node = entry
        hints = arguments_of(operation)
        entries = {} if node.tag.endswith(":null") else source.mapping(node, f"the arguments of {word}")
        arguments: dict[str, tuple[Any, Place]] = {}
        for name, (name_node, value_node) in entries.items():
            if name not in hints:
                raise source.error(name_node, f"{word} has no argument {name!r}{suggest(name, hints)}")
            value = read_value(source, value_node, names)
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

    def _retry(self, source: YamlSource, node: yaml.Node) -> Retry:
        if not isinstance(node, yaml.MappingNode):
            return Retry(read_count(source, node, "'retry'"))
        entries = source.mapping(node, "'retry'")
        require_known_keys(source, entries, ("times", "pause_s"), "'retry'")
        return Retry(
            read_count(source, entries["times"][1], "'times'") if "times" in entries else 1,
            read_seconds(source, entries["pause_s"][1], "'pause_s'") if "pause_s" in entries else 2.0,
        )


def build(operation: type[Operation], arguments: Mapping[str, Any], machine: str, place: Place, word: str) -> Operation:
    """Return an operation with resolved arguments; raises PlaybookError if they are invalid."""
    hints = arguments_of(operation)
    values: dict[str, Any] = {}
    for name, value in arguments.items():
        try:
            values[name] = coerce(value, hints[name])
        except ValueError as error:
            raise PlaybookError(f"{name!r} of {word}: {error}", place) from error
    try:
        return operation(**values, machine=machine)
    except ValueError as error:  # of the operation's __post_init__
        raise PlaybookError(f"{word}: {error}", place) from error
