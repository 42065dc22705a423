"""Describes message types for clients, as rosapi's `TypeDef` values and as the text of their definitions."""

from __future__ import annotations

import functools
from typing import Any

from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractType,
    AbstractWString,
    Array,
    BasicType,
    NamespacedType,
)

from lupin_runtime.record.definitions import schema_text
from lupin_runtime.ros import type_names
from lupin_runtime.ros.type_names import message_class_of

# Between the definitions in a schema: https://mcap.dev/spec/registry#ros2msg, which is rosapi's format too.
_SEPARATOR = "\n" + "=" * 80 + "\nMSG: "


def type_definitions(message_class: Any) -> list[dict[str, Any]]:
    """Return the `TypeDef` of a message class, then those of all types that it contains: depth first, each once."""
    found: dict[str, dict[str, Any]] = {}

    def add(message_class: Any) -> None:
        name = _type_name(message_class)
        if name not in found:
            found[name] = _type_definition(message_class)
            for contained in _contained_classes(message_class):
                add(contained)

    add(message_class)
    return list(found.values())


@functools.lru_cache(maxsize=512)
def full_text(type_name: str) -> str:
    """Return the definition of `package/msg/Name`, followed by those of all types that it contains.

    The order is rosapi's: of the pending types, the one that was found last comes next. For a type that is not installed, the
    text is a comment with the reason.
    """
    try:
        return _full_text(type_name)
    except (LookupError, OSError, ValueError) as error:
        return f"# failed to get full definition text for {type_name}: {error}"


def _full_text(type_name: str) -> str:
    root = type_names.find(type_name, "msg")
    schema = schema_text(type_name, fields=lambda name: type_names.find(name, "msg").get_fields_and_field_types())
    text, *others = schema.split(_SEPARATOR)
    texts = {name: body for name, _, body in (other.partition("\n") for other in others)}
    parts = [text]
    pending = list(dict.fromkeys(_contained_classes(root)))
    seen = set(pending)
    while pending:
        message_class = pending.pop()
        name = _type_name(message_class)
        parts.append(f"{name}\n{texts[name]}")
        for contained in _contained_classes(message_class):
            if contained not in seen:
                seen.add(contained)
                pending.append(contained)
    return _SEPARATOR.join(parts)


def _type_name(message_class: Any) -> str:
    """Return `package/Name`; for the parts of services and actions, `package/Name_Request` and so on."""
    return f"{message_class.__module__.split('.')[0]}/{message_class.__name__}"


def _contained_classes(message_class: Any) -> list[Any]:
    """Return the classes of those fields that are messages, in the order of the fields."""
    kinds = (kind.value_type if isinstance(kind, AbstractNestedType) else kind for kind in message_class.SLOT_TYPES)
    return [message_class_of(kind) for kind in kinds if isinstance(kind, NamespacedType)]


def _type_definition(message_class: Any) -> dict[str, Any]:
    message = message_class()
    names = list(message_class.get_fields_and_field_types())
    constants = _constants(message_class)
    return {
        "type": _type_name(message_class),
        "fieldnames": names,
        "fieldtypes": [_field_type(kind) for kind in message_class.SLOT_TYPES],
        "fieldarraylen": [_array_length(kind) for kind in message_class.SLOT_TYPES],
        "examples": [_example(kind, getattr(message, name)) for name, kind in zip(names, message_class.SLOT_TYPES)],
        "constnames": list(constants),
        "constvalues": [_as_text(value) for value in constants.values()],
    }


def _constants(message_class: Any) -> dict[str, Any]:
    metaclass = type(message_class)
    return dict(vars(metaclass)[f"_{metaclass.__name__}__constants"])


def _field_type(kind: AbstractType) -> str:
    """Return `package/Name`, or the IDL's name of a basic type. For an array it is the element's type; bounds are left out."""
    if isinstance(kind, AbstractNestedType):
        kind = kind.value_type
    if isinstance(kind, NamespacedType):
        return f"{kind.namespaces[0]}/{kind.name}"
    if isinstance(kind, BasicType):
        return str(kind.typename)
    return "wstring" if isinstance(kind, AbstractWString) else "string"


def _array_length(kind: AbstractType) -> int:
    """Return an array's fixed length, 0 for an array of variable length, or -1 for a single value."""
    if not isinstance(kind, AbstractNestedType):
        return -1
    return int(kind.size) if isinstance(kind, Array) else 0


def _example(kind: AbstractType, default: Any) -> str:
    if isinstance(kind, AbstractNestedType):
        return "[]"
    return "{}" if isinstance(kind, NamespacedType) else _as_text(default)


def _as_text(value: Any) -> str:
    """Convert a value to text; an octet, which in Python is one byte, becomes a number."""
    return str(value[0] if isinstance(value, bytes) else value)
