"""Names that clients use: of interfaces, as `package/Name` or `package/msg/Name`, and of topics, services and actions."""

from __future__ import annotations

import functools
import importlib
import re
from typing import Any

_PARTS = {"msg": ("SLOT_TYPES",), "srv": ("Request", "Response"), "action": ("Goal", "Result", "Feedback", "Impl")}
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class UnknownType(LookupError):
    """A type name that is malformed, or whose package or type is not installed here."""


@functools.lru_cache(maxsize=512)
def find(name: str, kind: str) -> Any:
    """The class of an interface; `kind` is `msg`, `srv` or `action`. Raises UnknownType.

    `package/action/Name_FeedbackMessage`, the type of an action's feedback topic, is found as a message.
    """
    words = [word for word in name.split("/") if word]
    if len(words) not in (2, 3) or not all(_NAME.fullmatch(word) for word in words):
        raise UnknownType(f"{name[:200]} is not a valid type string")
    package, type_name = words[0], words[-1]
    if kind == "msg" and type_name.endswith("_FeedbackMessage"):
        return find(f"{package}/{type_name.removesuffix('_FeedbackMessage')}", "action").Impl.FeedbackMessage
    try:
        module = importlib.import_module(f"{package}.{kind}")
    except ImportError as error:
        raise UnknownType(f"Unable to import {package}.{kind} from package {package}. Caused by: {error}") from error
    found = getattr(module, type_name, None)
    # `rclpy/ActionClient` is a class of a module `rclpy.action`, too, but no interface.
    if not isinstance(found, type) or not all(hasattr(found, part) for part in _PARTS[kind]):
        raise UnknownType(f"Unable to import {kind} class {type_name} from package {package}. Caused by {module.__name__}")
    return found


def full_name(name: str, kind: str) -> str:
    """`package/kind/Name` of a name that a client uses."""
    words = [word for word in name.split("/") if word]
    return f"{words[0]}/{kind}/{words[-1]}" if words else name


def absolute(name: str) -> str:
    """A topic's, service's or action's name with its leading slash."""
    return name if name.startswith("/") else f"/{name}"
