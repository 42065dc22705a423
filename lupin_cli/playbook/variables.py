"""The variables of a playbook: reads their declarations and checks their values."""

from __future__ import annotations

import re
from typing import Any

import yaml

from lupin_cli.playbook.argument_types import VARIABLE_TYPES
from lupin_cli.playbook.model import BUILTINS, Variable
from lupin_cli.playbook.templates import Template, names_in
from lupin_cli.playbook.yaml_source import YamlSource, suggest
from lupin_cli.playbook.yaml_values import NameScope, read_value, require_known_keys

WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
RESERVED = {"and", "or", "not", "in", "true", "false", "none", *BUILTINS}
_KEYS = ("type", "default", "choices", "help")


def check_variable(variable: Variable, value: Any) -> Any:
    """Return a variable's value, checked against its type and choices; raises ValueError."""
    checked = VARIABLE_TYPES[variable.type](value)
    if variable.choices and checked not in variable.choices:
        if variable.type == "secret":
            raise ValueError("it is none of its choices")
        raise ValueError(f"expected one of {', '.join(map(str, variable.choices))}, found {checked!r}")
    return checked


def _type_of(value: Any) -> str:
    if isinstance(value, Template) or value is None:
        return "text"
    return {bool: "truth", int: "integer", float: "number", list: "list"}.get(type(value), "text")


def read_variables(source: YamlSource, node: yaml.Node, names: NameScope) -> tuple[Variable, ...]:
    """Read the declarations under `vars`, and add them to `names`; raises PlaybookError."""
    variables: list[Variable] = []
    for word, (key, value) in source.mapping(node, "'vars'").items():
        if not WORD.match(word) or word in RESERVED:
            raise source.error(
                key, f"{word!r} cannot name a variable: letters, digits and _, and none of {', '.join(sorted(RESERVED))}"
            )
        variables.append(_variable(source, word, value, names))
        names.known[word] = None
    return tuple(variables)


def _variable(source: YamlSource, word: str, node: yaml.Node, names: NameScope) -> Variable:
    place = source.place(node)
    if not isinstance(node, yaml.MappingNode):
        default = read_value(source, node, names)
        return Variable(word, _type_of(default), place, default, True)
    entries = source.mapping(node, f"the variable {word!r}")
    require_known_keys(source, entries, _KEYS, "a variable")
    type_name = source.text_of(entries["type"][1], "a type") if "type" in entries else "text"
    if type_name not in VARIABLE_TYPES:
        raise source.error(entries["type"][1], f"there is no type {type_name!r}{suggest(type_name, VARIABLE_TYPES)}")
    choices: tuple[Any, ...] = ()
    if "choices" in entries:
        choices = tuple(source.plain(item) for item in source.sequence(entries["choices"][1], "'choices'"))
    text = source.text_of(entries["help"][1], "the help") if "help" in entries else ""
    variable = Variable(word, type_name, place, None, False, choices, text)
    if "default" not in entries:
        return variable
    default = read_value(source, entries["default"][1], names)
    if not list(names_in(default)):
        try:
            default = check_variable(variable, default)
        except ValueError as error:
            raise source.error(entries["default"][1], f"the default of {word!r}: {error}") from error
    return Variable(word, type_name, place, default, True, choices, text)
