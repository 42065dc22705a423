"""Finds the Python classes of interfaces. Type names may come from recordings and clients: they choose no other module."""

from __future__ import annotations

import functools
import importlib
import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

_KINDS = ("msg", "srv", "action")


@functools.lru_cache(maxsize=512)
def is_interface_package(name: str) -> bool:
    """Return whether an installed package holds ROS interfaces, which its compiled type support tells. Imports nothing."""
    if not name.isidentifier():
        return False
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return False
    folders = spec.submodule_search_locations if spec is not None else None
    return any(next(Path(folder).glob(f"{name}_s__rosidl_typesupport_c*.so"), None) for folder in folders or ())


def interface_module(package: str, kind: str) -> ModuleType:
    """Import the module of a package's messages, services or actions. Raises ImportError for other packages and kinds."""
    if kind not in _KINDS or not is_interface_package(package):
        raise ModuleNotFoundError(f"No module named {package!r}", name=package)
    return importlib.import_module(f"{package}.{kind}")


def interface(type_name: str) -> Any:
    """Return the Python class of an interface such as `geometry_msgs/msg/Twist`.

    Raises ValueError for a malformed name, ImportError or AttributeError if it is not installed.
    """
    package, kind, name = type_name.split("/")
    return getattr(interface_module(package, kind), name)
