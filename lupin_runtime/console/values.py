"""Builds ROS messages from the plain values of a client's JSON or CBOR.

The rules and error texts are those of the rosbridge protocol, because clients show or parse them. In addition, numbers are
checked against the range of their field, and null becomes NaN, which is also sent as null.
"""

from __future__ import annotations

import base64
import binascii
import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from cbor2 import CBORTag
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    AbstractType,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

from lupin_runtime.console.cdr import BYTE_TYPES
from lupin_runtime.ros.type_names import message_class_of

_INTEGER_BITS = {f"{sign}int{bits}": bits for sign in ("", "u") for bits in (8, 16, 32, 64)}
_FLOATS = ("float", "double")
_FLOAT32_MAX = float(np.finfo(np.float32).max)
_TIMES = ("builtin_interfaces/Time", "builtin_interfaces/Duration")
_TIME_FIELDS = {"sec": ("sec", "secs"), "nanosec": ("nanosec", "nsecs")}
# Little-endian typed arrays (RFC 8746) by tag.
_TYPED_ARRAYS = {64: "u1", 69: "<u2", 70: "<u4", 71: "<u8", 72: "i1", 77: "<i2", 78: "<i4", 79: "<i8", 85: "<f4", 86: "<f8"}

Now = Callable[[], Any]  # returns the current ROS time as a builtin_interfaces/Time


class ValueMismatch(ValueError):
    """Values that do not fit the message type; the text names the field."""


def fill(message_class: Any, values: Any, now: Now) -> Any:
    """Build a message from the given values; fields that are not given keep their defaults.

    `now` gives the stamp of the message's own header if `values` has none, and times whose value is "now". Raises
    ValueMismatch.
    """
    message = _Filler(_type_name(message_class), now).message(message_class, values, ())
    if message_class.get_fields_and_field_types().get("header") == "std_msgs/Header" and "stamp" not in values.get(
        "header", {}
    ):
        message.header.stamp = now()
    return message


@functools.cache
def _type_name(message_class: Any) -> str:
    """Return `package/Name`, the form in the protocol's error texts."""
    return f"{message_class.__module__.split('.')[0]}/{message_class.__name__}"


@functools.cache
def _fields(message_class: Any) -> dict[str, tuple[str, AbstractType]]:
    kinds = message_class.get_fields_and_field_types()
    return {name: (kind, slot) for (name, kind), slot in zip(kinds.items(), message_class.SLOT_TYPES)}


class _Filler:
    def __init__(self, root: str, now: Now) -> None:
        self._root = root
        self._now = now

    def _mismatch(self, path: tuple[str, ...], expected: str, found: Any) -> ValueMismatch:
        if not path:
            return ValueMismatch(f"Expected a JSON object for type {self._root} but received a {type(found)}")
        return ValueMismatch(f"{self._root} message requires a {expected} for field {'.'.join(path)}, but got a {type(found)}")

    def message(self, message_class: Any, values: Any, path: tuple[str, ...]) -> Any:
        name = _type_name(message_class)
        if name in _TIMES:
            return self._time(message_class, name, values, path)
        if not isinstance(values, dict):
            raise self._mismatch(path, name, values)
        message = message_class()
        fields = _fields(message_class)
        for key, value in values.items():
            inner = (*path, str(key))
            if key not in fields:
                raise ValueMismatch(f"Message type {self._root} does not have a field {'.'.join(inner)}")
            setattr(message, key, self._value(*fields[key], value, inner))
        return message

    def _time(self, message_class: Any, name: str, values: Any, path: tuple[str, ...]) -> Any:
        if values == "now" and name == _TIMES[0]:
            return self._now()
        if not isinstance(values, dict):
            raise self._mismatch(path, name, values)
        message = message_class()
        fields = _fields(message_class)
        for field, spellings in _TIME_FIELDS.items():
            given = next((key for key in spellings if key in values), None)
            if given is not None:
                setattr(message, field, self._value(*fields[field], values[given], (*path, given)))
        return message

    def _value(self, name: str, kind: AbstractType, value: Any, path: tuple[str, ...]) -> Any:
        if isinstance(kind, BasicType):
            return self._basic(kind.typename, value, path)
        if isinstance(kind, AbstractString):
            return self._string(kind, value, path)
        if isinstance(kind, NamespacedType):
            return self.message(message_class_of(kind), value, path)
        if isinstance(kind, AbstractNestedType):
            return self._array(name, kind, value, path)
        raise ValueMismatch(f"{self._root}: field {'.'.join(path)} has the type {name}, which is not supported")

    def _basic(self, typename: str, value: Any, path: tuple[str, ...]) -> Any:
        if typename == "boolean":
            if isinstance(value, bool):
                return value
        elif typename in _FLOATS:
            if value is None:
                return math.nan
            if isinstance(value, (int, float)) and not isinstance(value, bool):
                return self._float(typename, value, path)
        elif isinstance(value, int) and not isinstance(value, bool):
            return self._integer(typename, value, path)
        raise self._mismatch(path, typename, value)

    def _float(self, typename: str, value: float, path: tuple[str, ...]) -> float:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if typename == "float" and math.isfinite(number) and abs(number) > _FLOAT32_MAX:
            raise ValueMismatch(f"{self._root}: {value} is out of range for field {'.'.join(path)}, a float32")
        return number

    def _integer(self, typename: str, value: int, path: tuple[str, ...]) -> int | bytes:
        signed = typename.startswith("int")
        bits = _INTEGER_BITS.get(typename, 8)  # octet and char
        least, most = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
        if not least <= value <= most:
            raise ValueMismatch(f"{self._root}: {value} is out of range for field {'.'.join(path)}, which is {typename}")
        return bytes([value]) if typename == "octet" else value

    def _string(self, kind: AbstractString, value: Any, path: tuple[str, ...]) -> str:
        if not isinstance(value, str):
            raise self._mismatch(path, "string", value)
        limit = getattr(kind, "maximum_size", None)
        if limit is not None and len(value) > limit:
            raise ValueMismatch(f"{self._root}: field {'.'.join(path)} holds at most {limit} characters, got {len(value)}")
        # A lone surrogate from a JSON escape sequence can't be encoded.
        return value.encode("utf-8", "replace").decode("utf-8")

    def _array(self, name: str, kind: AbstractNestedType, value: Any, path: tuple[str, ...]) -> Any:
        element = kind.value_type
        if isinstance(value, CBORTag):
            value = self._typed_array(value, name, path)
        if isinstance(element, BasicType) and element.typename in BYTE_TYPES and isinstance(value, (str, bytes)):
            items: list[Any] = list(self._bytes(value, path))
            if element.typename == "octet":
                items = [bytes([item]) for item in items]
        elif isinstance(value, (list, tuple)):
            # All elements share one path, because with a path for each one, a map of a megabyte would take seconds.
            items = [self._value(name, element, item, path) for item in value]
        else:
            raise self._mismatch(path, name, value)
        if isinstance(kind, Array) and len(items) != kind.size:
            raise ValueMismatch(f"{self._root}: field {'.'.join(path)} has {kind.size} elements, got {len(items)}")
        if isinstance(kind, BoundedSequence) and len(items) > kind.maximum_size:
            raise ValueMismatch(
                f"{self._root}: field {'.'.join(path)} holds at most {kind.maximum_size} elements, got {len(items)}"
            )
        return items

    def _bytes(self, value: str | bytes, path: tuple[str, ...]) -> bytes:
        if isinstance(value, bytes):
            return value
        try:
            return base64.b64decode(value, validate=True)
        except (binascii.Error, ValueError) as error:
            raise ValueMismatch(f"{self._root}: field {'.'.join(path)} is not base64: {error}") from error

    def _typed_array(self, value: CBORTag, name: str, path: tuple[str, ...]) -> list[Any]:
        kind = _TYPED_ARRAYS.get(value.tag)
        if kind is None or not isinstance(value.value, bytes) or len(value.value) % np.dtype(kind).itemsize:
            raise self._mismatch(path, name, value)
        return list(np.frombuffer(value.value, kind).tolist())


def by_name(message_class: Any, arguments: Any) -> Any:
    """Return a request's arguments by field name: a list is in the order of the fields, and null means no arguments."""
    if arguments is None:
        return {}
    if isinstance(arguments, list):
        return dict(zip(message_class.get_fields_and_field_types(), arguments))
    return arguments
