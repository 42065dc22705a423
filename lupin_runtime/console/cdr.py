"""Decodes serialized ROS messages to plain values for JSON and CBOR, without creating message objects.

For each type and format, a decoder is generated as Python source from the type's fields. Consecutive fields of fixed size are
read by one `struct` call, because one call per field would take ten times as long.

The encoding is OMG's CDR, version 1: a header of four bytes, then values aligned to their size, relative to the end of the
header.
"""

from __future__ import annotations

import base64
import enum
import functools
import struct
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

from lupin_runtime.ros.type_names import message_class_of

HEADER_BYTES = 4

# For each basic type: its `struct` character, and the tag of a little-endian typed array (RFC 8746). Bytes have no tag, because
# the protocol sends them as a byte string; neither have arrays of booleans.
_BASIC = {
    "boolean": ("?", None),
    "octet": ("B", None),
    "uint8": ("B", None),
    "char": ("B", None),
    "int8": ("b", 72),
    "uint16": ("H", 69),
    "int16": ("h", 77),
    "uint32": ("I", 70),
    "int32": ("i", 78),
    "uint64": ("Q", 71),
    "int64": ("q", 79),
    "float": ("f", 85),
    "double": ("d", 86),
}
_LENGTH = BasicType("uint32")
_PLACEHOLDER = BasicType("uint8")
BYTE_TYPES = ("octet", "uint8", "char")

Decoder = Callable[[bytes], dict[str, Any]]


class Format(enum.Enum):
    """The format that a decoder's values are for: JSON has no bytes, CBOR has typed arrays."""

    JSON = "json"
    CBOR = "cbor"


class UnsupportedType(ValueError):
    """A type with a field for which no decoder can be generated."""


class MalformedMessage(ValueError):
    """Serialized data that is incomplete or not of the expected type."""


@functools.cache
def decoder(message_class: Any, form: Format) -> Decoder:
    """Return the decoder of a message class, which converts serialized data to nested dicts with the message's field names.

    Values for JSON contain numpy arrays, whose NaN and infinities orjson writes as null, and base64 text for bytes. Values for
    CBOR contain byte strings and tagged typed arrays. Raises UnsupportedType; the decoder raises MalformedMessage.
    """
    little, big = (_compile(message_class, form, order) for order in "<>")

    def decode(data: bytes) -> dict[str, Any]:
        try:
            return (little if data[1] & 1 else big)(data[HEADER_BYTES:])
        except (struct.error, IndexError, ValueError) as error:
            raise MalformedMessage(f"{message_class.__name__} of {len(data)} bytes: {error}") from error

    return decode


def _compile(message_class: Any, form: Format, order: str) -> Decoder:
    source = _Source(form, order)
    result = source.message(message_class)
    source.flush()
    lines = "\n".join(f"    {line}" for line in source.lines)
    scope = dict(source.names)
    exec(f"def decode(data):\n    o = 0\n{lines}\n    return {result}", scope)  # noqa: S102  # contains only known field names
    return scope["decode"]  # type: ignore[no-any-return]


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _slice(data: bytes, start: int, length: int) -> bytes:
    """Return a slice. Raises IndexError if it exceeds the data, where Python's own slice would just be shorter."""
    part = data[start : start + length]
    if len(part) != length:
        raise IndexError(f"{length} bytes expected at {start}, {len(part)} found")
    return part


def _count(count: int, data: bytes, start: int) -> int:
    """Return a sequence's length. Raises IndexError if the data is too short for it, so that a wrong length costs no time."""
    if count > len(data) - start:
        raise IndexError(f"{count} elements expected at {start} of {len(data)} bytes")
    return count


class _Source:
    """Generates a decoder's source. `_offset` is the position in the data modulo `_modulus`, which is what is known of it."""

    def __init__(self, form: Format, order: str) -> None:
        self._form = form
        self._order = order
        self.lines: list[str] = []
        self.names: dict[str, Any] = {
            "_array": np.frombuffer,
            "_base64": _base64,
            "_count": _count,
            "_slice": _slice,
            "_tag": CBORTag,
        }
        self._indent = ""
        self._modulus, self._offset = 8, 0
        self._format, self._targets = "", 0
        self._variables = 0
        self._pending = ""

    # -- lines --------------------------------------------------------------------------------------------------------
    def _line(self, text: str) -> None:
        self.lines.append(self._indent + text)

    def _variable(self) -> str:
        self._variables += 1
        return f"v{self._variables}"

    def _name(self, prefix: str, value: Any) -> str:
        name = f"{prefix}{len(self.names)}"
        self.names[name] = value
        return name

    def flush(self) -> None:
        """Emit the `struct` call for the fields collected so far."""
        if self._format:
            layout = struct.Struct(self._order + self._format)
            self._line(f"{self._pending} = {self._name('s', layout.unpack_from)}(data, o)")
            self._line(f"o += {layout.size}")
            self._format, self._targets, self._pending = "", 0, ""

    def _align(self, size: int) -> None:
        """Align the position to `size`: if it is known, by padding the current `struct`, or else at run time."""
        if self._modulus % size == 0:
            pad = -self._offset % size
            if pad:
                if not self._format:
                    self._pending = self._variable()
                self._format += f"{pad}x"
                self._offset = (self._offset + pad) % self._modulus
            return
        self.flush()
        self._line(f"o = (o + {size - 1}) & {-size}")
        self._modulus, self._offset = size, 0

    def _forget_position(self) -> None:
        self._modulus, self._offset = 1, 0

    # -- values -------------------------------------------------------------------------------------------------------
    def message(self, message_class: Any) -> str:
        """Emit the reading of a message, and return the expression of its dict."""
        if not message_class.SLOT_TYPES:
            self._fixed(_PLACEHOLDER)  # a message without fields is serialized as one byte
            return "{}"
        names = message_class.get_fields_and_field_types()
        fields = ", ".join(f"{name!r}: {self._value(kind)}" for name, kind in zip(names, message_class.SLOT_TYPES))
        return f"{{{fields}}}"

    def _value(self, kind: AbstractType) -> str:
        if isinstance(kind, BasicType):
            return self._fixed(kind)
        if isinstance(kind, AbstractString):
            return self._string(kind)
        if isinstance(kind, NamespacedType):
            return self.message(message_class_of(kind))
        if isinstance(kind, AbstractNestedType):
            return self._elements(kind)
        raise UnsupportedType(f"{kind} has no decoder")

    def _basic(self, kind: BasicType) -> tuple[str, int | None]:
        if kind.typename not in _BASIC:
            raise UnsupportedType(f"{kind.typename} has no decoder")
        return _BASIC[kind.typename]

    def _size(self, kind: BasicType) -> int:
        return struct.calcsize("<" + self._basic(kind)[0])

    def _fixed(self, kind: BasicType) -> str:
        """Add a value to the current `struct`, and return its expression."""
        self._align(self._size(kind))
        if not self._format:
            self._pending = self._variable()
        self._format += self._basic(kind)[0]
        self._offset = (self._offset + self._size(kind)) % self._modulus
        self._targets += 1
        return f"{self._pending}[{self._targets - 1}]"

    def _read_count(self) -> str:
        """Emit the reading of a length of four bytes, and return its variable."""
        length = self._fixed(_LENGTH)
        self.flush()
        variable = self._variable()
        self._line(f"{variable} = {length}")
        return variable

    def _string(self, kind: AbstractString) -> str:
        if type(kind).__name__.endswith("WString"):
            raise UnsupportedType("wstring has no decoder")
        length, text = self._read_count(), self._variable()
        # The length includes the terminating zero byte, but some senders write 0 for an empty string.
        self._line(f"{text} = _slice(data, o, {length})[:-1].decode('utf-8', 'replace')")
        self._line(f"o += {length}")
        self._forget_position()
        return text

    def _elements(self, kind: AbstractNestedType) -> str:
        element = kind.value_type
        fixed = kind.size if isinstance(kind, Array) else None
        if isinstance(element, BasicType):
            return self._numbers(element, fixed, bounded=isinstance(kind, BoundedSequence))
        count = str(fixed) if fixed is not None else self._read_count()
        self.flush()
        items = self._variable()
        self._line(f"{items} = []")
        self._line(f"for _ in range({count if fixed is not None else f'_count({count}, data, o)'}):")
        outer, self._indent = self._indent, self._indent + "    "
        self._forget_position()
        expression = self._value(element)
        self.flush()
        self._line(f"{items}.append({expression})")
        self._indent = outer
        self._forget_position()
        return items

    def _numbers(self, element: BasicType, fixed: int | None, bounded: bool) -> str:
        character, tag = self._basic(element)
        size = self._size(element)
        count = str(fixed) if fixed is not None else self._read_count()
        if fixed is None:
            # Before an empty sequence's elements there is no padding.
            if size > 4:
                self._line(f"if {count}: o = (o + {size - 1}) & {-size}")
            self._forget_position()
        else:
            self._align(size)
        self.flush()
        raw, value = self._variable(), self._variable()
        self._line(f"{raw} = _slice(data, o, {count} * {size})")
        self._line(f"o += {count} * {size}")
        if fixed is None:
            self._forget_position()
        else:
            self._offset = (self._offset + fixed * size) % self._modulus
        if element.typename in BYTE_TYPES:
            # In JSON, the protocol sends a bounded sequence of bytes as numbers.
            text = f"list({raw})" if bounded else f"_base64({raw})"
            expression = raw if self._form is Format.CBOR else text
        elif tag is None:
            expression = f"[b != 0 for b in {raw}]"
        else:
            array = f"_array({raw}, {self._name('t', np.dtype(self._order + character))})"
            native = array if self._order == "<" else f"{array}.astype({self._name('n', np.dtype('<' + character))})"
            expression = native if self._form is Format.JSON else f"_tag({tag}, {native}.tobytes())"
        self._line(f"{value} = {expression}")
        return value
