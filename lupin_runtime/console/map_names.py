"""Maps that clients save: by a plain name, in one folder. The services on the graph take any path of the robot's computer."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from lupin_runtime import graph
from lupin_runtime.stack.runs import state_home

_PLAIN = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_. -]{0,63}")


class BadMapName(ValueError):
    """The name would lead out of the folder, or is none; the text says what is expected."""


def maps_folder() -> Path:
    """Where maps are saved."""
    return state_home() / "maps"


def with_map_path(service: str, arguments: Any) -> Any:
    """The arguments of a service; where it writes a map, with the path in the folder that belongs to the name in them.

    Raises BadMapName, and OSError where the folder cannot be made.
    """
    if service == graph.SLAM_SAVE_MAP.name:
        name = arguments.get("name") if isinstance(arguments, dict) else None
        return {"name": {"data": _path(name.get("data") if isinstance(name, dict) else None)}}
    if service == graph.SLAM_SERIALIZE.name:
        return {"filename": _path(arguments.get("filename") if isinstance(arguments, dict) else None)}
    return arguments


def _path(name: Any) -> str:
    if not isinstance(name, str) or not _PLAIN.fullmatch(name):
        raise BadMapName(f"a map's name is up to 64 letters, digits, blanks, and . _ - without a folder, not {name!r:.100}")
    maps_folder().mkdir(parents=True, exist_ok=True)
    return str(maps_folder() / name)
