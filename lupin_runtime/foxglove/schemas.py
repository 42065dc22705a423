"""The definition of a message type in Foxglove's format, for every type that a topic on the graph can have."""

from __future__ import annotations

import functools
from typing import Any

from rosidl_parser.definition import AbstractNestedType, NamespacedType

from lupin_runtime.record.definitions import schema_text
from lupin_runtime.ros import type_names
from lupin_runtime.ros.type_names import message_class_of


@functools.lru_cache(maxsize=512)
def ros2msg_schema(type_name: str) -> str:
    """Return the definition of `package/msg/Name` and of all types that it contains; also for an action's feedback topic.

    Raises type_names.UnknownType if a type is not installed.
    """
    classes: dict[str, Any] = {}
    _collect(type_name, type_names.find(type_name, "msg"), classes)
    return schema_text(type_name, fields=lambda name: _fields(classes, name))


def _collect(type_name: str, message_class: Any, classes: dict[str, Any]) -> None:
    """Add a class and those of all its fields by package and name, because parts of an action have no full type name."""
    package, name = type_name.split("/")[0], type_name.split("/")[-1]
    if (key := f"{package}/{name}") in classes:
        return
    classes[key] = message_class
    kinds = (kind.value_type if isinstance(kind, AbstractNestedType) else kind for kind in message_class.SLOT_TYPES)
    for kind in kinds:
        if isinstance(kind, NamespacedType):
            _collect(f"{kind.namespaces[0]}/{kind.name}", message_class_of(kind), classes)


def _fields(classes: dict[str, Any], type_name: str) -> dict[str, str]:
    package, _, name = type_name.split("/")
    fields: dict[str, str] = classes[f"{package}/{name}"].get_fields_and_field_types()
    return fields
