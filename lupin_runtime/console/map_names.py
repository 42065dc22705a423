"""Confines the maps that clients save and load to one folder, by plain names: the services on the graph accept any path."""

from __future__ import annotations

import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_runtime import graph
from lupin_runtime.console.short_text import short_repr
from lupin_runtime.stack.runs import make_state_folder, state_directory

_GRAPH = ".posegraph"
_SUFFIXES = (".yaml", ".pgm", ".png", _GRAPH)  # of what belongs to a map
_PLAIN = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_. -]{0,63}")


class BadMapName(ValueError):
    """The name is missing or not a plain file name; the text says what is expected."""


def maps_folder() -> Path:
    """Return the folder in which maps are saved."""
    return state_directory() / "maps"


def with_map_path(service: str, arguments: Any) -> Any:
    """Return a service's arguments; if it writes or reads a map, with the map's name replaced by the path in the folder.

    Raises BadMapName, and OSError if the folder cannot be created.
    """
    if service == graph.SLAM_SAVE_MAP.name:
        name = arguments.get("name") if isinstance(arguments, dict) else None
        return {"name": {"data": _path(name.get("data") if isinstance(name, dict) else None)}}
    if service in (graph.SLAM_SERIALIZE.name, graph.SLAM_DESERIALIZE.name):
        given = arguments if isinstance(arguments, dict) else {}
        return {**given, "filename": _path(given.get("filename"))}
    return arguments


def _path(name: Any) -> str:
    plain = _checked(name)
    make_state_folder(maps_folder())
    return str(maps_folder() / plain)


def _checked(name: Any) -> str:
    if not isinstance(name, str) or not _PLAIN.fullmatch(name):
        raise BadMapName(f"a map's name must be 1 to 64 letters, digits, spaces, and . _ - (no folder), not {short_repr(name)}")
    return name


@dataclass(frozen=True)
class SavedMap:
    """A map in the folder. `yaml` is None if only its pose graph was saved; `is_loadable`: SLAM can go on in it."""

    name: str
    yaml: Path | None
    is_loadable: bool
    saved_s: float  # Unix time


def saved_maps() -> list[SavedMap]:
    """Return the maps in the folder, by name; files that no client could have saved are ignored. Raises OSError."""
    files = {path.name: path for path in maps_folder().glob("*") if path.suffix in (".yaml", _GRAPH) and path.is_file()}
    found = []
    for name in sorted({path.stem for path in files.values()}):
        own = [files[name + suffix] for suffix in (".yaml", _GRAPH) if name + suffix in files]
        if _PLAIN.fullmatch(name):
            is_loadable = not pose_graph_problem(str(maps_folder() / name))
            found.append(SavedMap(name, files.get(f"{name}.yaml"), is_loadable, max(path.stat().st_mtime for path in own)))
    return found


def delete_map(name: Any) -> None:
    """Delete a map's files. Raises BadMapName, FileNotFoundError if there is no such map, and OSError."""
    plain = _checked(name)
    if plain not in [each.name for each in saved_maps()]:
        raise FileNotFoundError(plain)
    # The YAML and the graph, by which it is listed, go last: if one of the others stays, it can be deleted again.
    for suffix in sorted(_SUFFIXES, key=lambda each: each in (".yaml", _GRAPH)):
        (maps_folder() / f"{plain}{suffix}").unlink(missing_ok=True)


def pose_graph_problem(path: str) -> str:
    """Return why SLAM could not load the graph at a path without suffix; empty if nothing speaks against it."""
    file = Path(path).with_name(Path(path).name + _GRAPH)
    if not file.is_file():
        return f"there is no {file.name}; only maps that were saved while SLAM ran can be loaded"
    return "" if zipfile.is_zipfile(file) else f"{file.name} is damaged"
