"""Values with `{{ expressions }}` in them, and the types that an argument or a variable may have."""

from __future__ import annotations

import dataclasses
import ipaddress
import re
import types
import typing
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, Literal, Union

from lupin_cli.quick_dataclass import dataclass
from lupin_cli.runbook.expressions import Expression, ExpressionError, Name, parse

_HOLE = re.compile(r"\{\{(.*?)\}\}", re.DOTALL)


@dataclass(frozen=True)
class Template:
    """Text with holes. A template that is one hole and nothing else keeps the type of what fills it."""

    parts: tuple[str | Expression, ...]

    def resolve(self, scope: Mapping[str, Any]) -> Any:
        """The value in `scope`; raises ExpressionError."""
        values = [part if isinstance(part, str) else part.evaluate(scope) for part in self.parts]
        if len(values) == 1:
            return values[0]
        return "".join(_as_text(value) for value in values)


def _as_text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value)


def read_template(text: str) -> Template | str:
    """Text without holes as it is, else a Template; raises ExpressionError with the column in `text`."""
    parts: list[str | Expression] = []
    at = 0
    for hole in _HOLE.finditer(text):
        if hole.start() > at:
            parts.append(text[at : hole.start()])
        try:
            parts.append(parse(hole.group(1)))
        except ExpressionError as error:
            raise ExpressionError(str(error), hole.start(1) + error.column) from error
        at = hole.end()
    if not parts:
        if "{{" in text:
            raise ExpressionError("'{{' is never closed with '}}'", text.index("{{"))
        return text
    if at < len(text):
        parts.append(text[at:])
    return Template(tuple(parts))


def resolve(value: Any, scope: Mapping[str, Any]) -> Any:
    """Every template within lists and mappings resolved."""
    if isinstance(value, Template):
        return value.resolve(scope)
    if isinstance(value, list):
        return [resolve(item, scope) for item in value]
    if isinstance(value, dict):
        return {key: resolve(item, scope) for key, item in value.items()}
    return value


def names_in(value: Any) -> Iterator[Name]:
    """Every name that a value's templates use."""
    if isinstance(value, Template):
        for part in value.parts:
            if isinstance(part, Expression):
                yield from part.names()
    elif isinstance(value, list):
        for item in value:
            yield from names_in(item)
    elif isinstance(value, dict):
        for item in value.values():
            yield from names_in(item)


def _arguments(operation: type) -> list[dataclasses.Field]:
    return [f for f in dataclasses.fields(operation) if f.init and f.name != "machine" and not f.name.startswith("_")]


@cache
def arguments_of(operation: type) -> dict[str, Any]:
    """The arguments of an operation by name, with their types: its fields, but for the machine, which the step says."""
    hints = typing.get_type_hints(operation)
    return {f.name: hints[f.name] for f in _arguments(operation)}


@cache
def required_of(operation: type) -> tuple[str, ...]:
    """The arguments that an operation can't do without."""
    return tuple(
        f.name for f in _arguments(operation) if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
    )


def coerce(value: Any, hint: Any) -> Any:
    """`value` as the type `hint`, where nothing is lost by it; raises ValueError with what was expected."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return value
    if origin in (Union, types.UnionType):
        if value is None and type(None) in inner:
            return None
        return coerce(value, next(part for part in inner if part is not type(None)))
    if origin is Literal:
        if value not in inner:
            raise ValueError(f"expected one of {', '.join(map(str, inner))}, found {value!r}")
        return value
    if origin is tuple:
        items = value if isinstance(value, (list, tuple)) else [value]
        return tuple(coerce(item, inner[0]) for item in items)
    if origin is dict:
        if not isinstance(value, dict):
            raise ValueError(f"expected a mapping, found {value!r}")
        return {str(key): coerce(item, inner[1]) for key, item in value.items()}
    return _scalar(value, hint)


def _scalar(value: Any, hint: Any) -> Any:
    if hint is bool and isinstance(value, bool):
        return value
    if hint is int and isinstance(value, int) and not isinstance(value, bool):
        return value
    if hint is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if hint is str and isinstance(value, str):
        return value
    names = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}
    quote = '; put it in quotes: "' + _as_text(value) + '"' if hint is str and isinstance(value, (int, float)) else ""
    raise ValueError(f"expected {names.get(hint, hint)}, found {value!r}{quote}")


def _address(value: Any) -> str:
    try:
        return str(ipaddress.IPv4Address(value if isinstance(value, str) else repr(value)))
    except ValueError as error:
        raise ValueError(f"expected an IPv4 address such as 10.42.0.1, found {value!r}") from error


# The types of variables: name -> (how a value is checked, how the text of `-v name=text` becomes one).
VARIABLE_TYPES: dict[str, Any] = {
    "text": lambda value: coerce(value, str),
    "integer": lambda value: coerce(value, int),
    "number": lambda value: coerce(value, float),
    "truth": lambda value: coerce(value, bool),
    "address": _address,
    "list": lambda value: list(coerce(value, tuple[str, ...])),
    "secret": lambda value: coerce(value, str),
}


def from_command_line(text: str, type_name: str) -> Any:
    """What the text of `-v name=text` means for a variable of that type; raises ValueError."""
    if type_name in ("integer", "number"):
        try:
            return int(text) if type_name == "integer" else float(text)
        except ValueError as error:
            raise ValueError(
                f"expected {'a whole number' if type_name == 'integer' else 'a number'}, found {text!r}"
            ) from error
    if type_name == "truth":
        words = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
        if text.lower() not in words:
            raise ValueError(f"expected true or false, found {text!r}")
        return words[text.lower()]
    if type_name == "list":
        return [item for item in text.split(",") if item]
    return text
