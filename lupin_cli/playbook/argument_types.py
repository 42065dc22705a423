"""The types that the arguments of operations and the variables of playbooks may have, and conversion to them."""

from __future__ import annotations

import dataclasses
import ipaddress
import types
import typing
from collections.abc import Callable
from functools import cache
from typing import Any, Literal, Union

from lupin_cli.operations.base import Operation


def _arguments(operation: type[Operation]) -> list[dataclasses.Field[Any]]:
    return [f for f in dataclasses.fields(operation) if f.init and f.name != "machine" and not f.name.startswith("_")]


@cache
def arguments_of(operation: type[Operation]) -> dict[str, Any]:
    """Return the types of an operation's arguments by name: its fields, except the machine, which the step names."""
    hints = typing.get_type_hints(operation)
    return {f.name: hints[f.name] for f in _arguments(operation)}


@cache
def required_of(operation: type[Operation]) -> tuple[str, ...]:
    """Return the arguments without a default."""
    return tuple(
        f.name for f in _arguments(operation) if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
    )


def coerce(value: Any, hint: Any) -> Any:
    """Convert `value` to the type `hint` if that loses nothing; raises ValueError with what was expected."""
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
    quote = '; put it in quotes: "' + str(value) + '"' if hint is str and isinstance(value, (int, float)) else ""
    raise ValueError(f"expected {names.get(hint, hint)}, found {value!r}{quote}")


def _address(value: Any) -> str:
    try:
        return str(ipaddress.IPv4Address(value if isinstance(value, str) else repr(value)))
    except ValueError as error:
        raise ValueError(f"expected an IPv4 address such as 10.42.0.1, found {value!r}") from error


def _network(value: Any) -> str:
    try:
        return str(ipaddress.IPv4Network(value if isinstance(value, str) else repr(value), strict=False))
    except ValueError as error:
        raise ValueError(f"expected an IPv4 network such as 10.42.0.0/24, found {value!r}") from error


# Each type of variables with the function that returns a valid value as that type, or raises ValueError.
VARIABLE_TYPES: dict[str, Callable[[Any], Any]] = {
    "text": lambda value: coerce(value, str),
    "integer": lambda value: coerce(value, int),
    "number": lambda value: coerce(value, float),
    "truth": lambda value: coerce(value, bool),
    "address": _address,
    "network": _network,
    "list": lambda value: list(coerce(value, tuple[str, ...])),
    "secret": lambda value: coerce(value, str),
}


def to_command_line(value: Any) -> str:
    """Return the text of `-v name=text` that `from_command_line` reads as this value."""
    if isinstance(value, bool):
        return str(value).lower()
    return ",".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def from_command_line(text: str, type_name: str) -> Any:
    """Return the value of `-v name=text` for a variable of that type; raises ValueError."""
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
