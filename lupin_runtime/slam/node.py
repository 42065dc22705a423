"""The nodes of this package, for the stack's table. Each is imported on first use: the mapper needs no AMCL."""

from __future__ import annotations

import importlib
from typing import Any

_MODULES = {
    "SlamNode": "slam_node",
    "SlamResetNode": "reset_node",
    "MapServer": "map_server",
    "AmclNode": "amcl_node",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"lupin_runtime.slam.{_MODULES[name]}"), name)
