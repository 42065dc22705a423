"""Random messages of every installed type, and the values that a client should receive for them."""

from __future__ import annotations

import base64
import functools
import importlib
import pkgutil
import random
from collections.abc import Iterator
from typing import Any

import numpy as np
from rosidl_parser.definition import AbstractNestedType, AbstractString, Array, BasicType, BoundedSequence, NamespacedType

from lupin_runtime.console.cdr import Format
from lupin_runtime.ros.type_names import message_class_of

PACKAGES = ("msg", "srv", "action")
BYTE_TYPES = ("octet", "uint8", "char")


@functools.cache
def installed_classes() -> list[Any]:
    """Return every message class of the installed interface packages, including those of services and actions.

    Types of wide strings, which only example interfaces have, are left out: the console names them as unsupported.
    """
    found: list[Any] = []
    for package in pkgutil.iter_modules():
        for kind in PACKAGES if package.ispkg and package.name.endswith(("_msgs", "_interfaces")) else ():
            try:
                module = importlib.import_module(f"{package.name}.{kind}")
            except ImportError:
                continue
            for value in vars(module).values():
                if isinstance(value, type):
                    found += _message_classes(value)
    return [one for one in found if not any("wstring" in kind for kind in one.get_fields_and_field_types().values())]


def _message_classes(value: Any) -> Iterator[Any]:
    if hasattr(value, "SLOT_TYPES"):
        yield value
    elif hasattr(value, "Goal"):
        yield from (value.Goal, value.Result, value.Feedback, value.Impl.FeedbackMessage)
    elif hasattr(value, "Request"):
        yield from (value.Request, value.Response)


def random_message(message_class: Any, rng: random.Random) -> Any:
    """Return a message with random values in all fields."""
    message = message_class()
    for name, kind in zip(message_class.get_fields_and_field_types(), message_class.SLOT_TYPES):
        setattr(message, name, _random_value(kind, rng))
    return message


def _random_value(kind: Any, rng: random.Random) -> Any:
    if isinstance(kind, AbstractNestedType):
        most = kind.maximum_size if isinstance(kind, BoundedSequence) else 4
        count = kind.size if isinstance(kind, Array) else rng.randint(0, min(4, most))
        return [_random_value(kind.value_type, rng) for _ in range(count)]
    if isinstance(kind, NamespacedType):
        return random_message(message_class_of(kind), rng)
    if isinstance(kind, AbstractString):
        return "".join(rng.choice('aé日 x\n"') for _ in range(rng.randrange(6)))
    return _random_number(kind.typename, rng)


def _random_number(typename: str, rng: random.Random) -> Any:
    if typename == "boolean":
        return rng.random() < 0.5
    if typename == "octet":
        return bytes([rng.randrange(256)])
    if typename in ("float", "double"):
        return rng.randrange(-1000, 1000) / 8  # exact as float and as double, so that both have the same text
    bits = int("".join(c for c in typename if c.isdigit()) or "8")
    return rng.randrange(-(2 ** (bits - 1)), 2 ** (bits - 1)) if typename.startswith("int") else rng.randrange(2**bits)


def expected(message: Any, form: Format) -> Any:
    """Return the values of a message in this format, read from the Python object."""
    kinds = zip(message.get_fields_and_field_types(), message.SLOT_TYPES)
    return {name: _expected_value(kind, getattr(message, name), form) for name, kind in kinds}


def _expected_value(kind: Any, value: Any, form: Format) -> Any:
    if isinstance(kind, AbstractNestedType):
        element = kind.value_type
        if isinstance(element, BasicType) and element.typename in BYTE_TYPES:
            data = b"".join(item if isinstance(item, bytes) else bytes([item]) for item in value)
            if form is Format.CBOR:
                return data
            return list(data) if isinstance(kind, BoundedSequence) else base64.b64encode(data).decode()
        return [_expected_value(element, item, form) for item in value]
    if isinstance(kind, NamespacedType):
        return expected(value, form)
    if isinstance(value, bytes):
        return value[0]
    return value.item() if isinstance(value, np.generic) else value
