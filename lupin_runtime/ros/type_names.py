"""Resolves the names that clients use: interface types, as `package/Name` or `package/msg/Name`, and names on the graph.

Error texts are those of rosbridge_suite, because its tests compare them.
"""

from __future__ import annotations

import functools
import importlib
import re
from typing import Any

from rosidl_parser.definition import NamespacedType

from lupin_runtime.ros.interfaces import interface_module

_REQUIRED_ATTRIBUTES = {
    "msg": ("SLOT_TYPES",),
    "srv": ("Request", "Response"),
    "action": ("Goal", "Result", "Feedback", "Impl"),
}
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class UnknownType(LookupError):
    """A type name that is malformed, or whose package or type is not installed here."""


@functools.lru_cache(maxsize=512)
def find(name: str, kind: str) -> Any:
    """Return the class of an interface; `kind` is `msg`, `srv` or `action`. Raises UnknownType.

    `package/action/Name_FeedbackMessage`, the type of an action's feedback topic, is found as a message.
    """
    words = [word for word in name.split("/") if word]
    if len(words) not in (2, 3) or not all(_NAME.fullmatch(word) for word in words):
        raise UnknownType(f"{name[:200]} is not a valid type string")
    package, type_name = words[0], words[-1]
    if kind == "msg" and type_name.endswith("_FeedbackMessage"):
        return find(f"{package}/{type_name.removesuffix('_FeedbackMessage')}", "action").Impl.FeedbackMessage
    try:
        module = interface_module(package, kind)
    except ImportError as error:
        raise UnknownType(f"Unable to import {package}.{kind} from package {package}. Caused by: {error}") from error
    found = getattr(module, type_name, None)
    # Not every class in such a module is an interface: `rclpy/ActionClient` finds rclpy.action.ActionClient.
    if not isinstance(found, type) or not all(hasattr(found, part) for part in _REQUIRED_ATTRIBUTES[kind]):
        raise UnknownType(f"Unable to import {kind} class {type_name} from package {package}. Caused by {module.__name__}")
    return found


def message_class_of(kind: NamespacedType) -> Any:
    """Return the Python class of a nested message type."""
    module = importlib.import_module(".".join(kind.namespaces))
    # The module has no names for the parts of an action: `Fibonacci_Goal` is `Fibonacci.Goal`.
    owner, _, part = kind.name.rpartition("_")
    return getattr(module, kind.name) if hasattr(module, kind.name) else getattr(getattr(module, owner), part)


def full_name(name: str, kind: str) -> str:
    """Return `package/kind/Name` for a type name with or without its kind."""
    words = [word for word in name.split("/") if word]
    return f"{words[0]}/{kind}/{words[-1]}" if words else name


def absolute(name: str) -> str:
    """Return the name of a topic, service or action with a leading slash."""
    return name if name.startswith("/") else f"/{name}"
