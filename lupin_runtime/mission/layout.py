"""What is known before the first drive: the greenhouse's layout file, and an operator's approach overrides.

Every error names the file, and the line where the file's format has lines.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml

_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_LARGEST = 1e9  # no greenhouse is larger in any unit; a whole number may be too large to be a float at all
_OVERRIDE_KEYS = ("goal_x", "goal_y", "yaw", "standoff")


class LayoutError(ValueError):
    """A layout or override file that cannot be used; the message names the file and the place in it."""


@dataclass(frozen=True)
class Table:
    """The footprint of a table: metres, sides along the axes."""

    x0: float
    x1: float
    y0: float
    y1: float

    @property
    def centre(self) -> tuple[float, float]:
        """The middle of the footprint."""
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2

    def contains(self, x: float, y: float) -> bool:
        """Whether a point lies on the table, edges included."""
        return self.x0 <= x <= self.x1 and self.y0 <= y <= self.y1


@dataclass(frozen=True)
class TagLocation:
    """Where a layout puts a tag, metres."""

    x: float
    y: float


@dataclass(frozen=True)
class Layout:
    """The tables and tags that are known a priori."""

    tables: Mapping[str, Table] = field(default_factory=dict)
    tags: Mapping[str, TagLocation] = field(default_factory=dict)


@dataclass(frozen=True)
class Override:
    """What an operator pins for the approach to one tag; None leaves the geometry's value."""

    goal_x: float | None = None
    goal_y: float | None = None
    yaw: float | None = None
    standoff: float | None = None


def packaged_layout_path() -> Path:
    """The layout inside the greenhouse simulator's package. Raises LayoutError if it is not installed."""
    spec = find_spec("greenhouse_sim")
    if spec is None or not spec.submodule_search_locations:
        raise LayoutError("package greenhouse_sim is not installed; expected its configs/tag_locations.json; run: make setup")
    return Path(next(iter(spec.submodule_search_locations))) / "configs" / "tag_locations.json"


def load_layout(path: Path | None = None) -> Layout:
    """Read a layout file (None: the packaged one). Raises LayoutError."""
    path = path or packaged_layout_path()
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise LayoutError(f"{path}: cannot read the layout: {error}") from error
    except json.JSONDecodeError as error:
        raise LayoutError(f"{path}:{error.lineno}: not JSON: {error.msg}") from error
    except (ValueError, RecursionError) as error:  # numbers of thousands of digits, brackets of thousands of levels
        raise LayoutError(f"{path}: not JSON that can be read: {error}") from error
    if not isinstance(document, dict):
        raise LayoutError(f"{path}: expected an object with tables and tags, found {type(document).__name__}")
    unit = document.get("units", "m")
    if unit not in _METRES:
        raise LayoutError(f"{path}: units are {unit!r}, expected one of {', '.join(_METRES)}")
    scale = _METRES[unit]
    tables = {
        name: Table(**_numbers(path, f"tables.{name}", entry, ("x0", "x1", "y0", "y1"), scale))
        for name, entry in _mapping(path, "tables", document.get("tables", {})).items()
    }
    tags = {
        name: TagLocation(**_numbers(path, f"tags.{name}", entry, ("x", "y"), scale))
        for name, entry in _mapping(path, "tags", document.get("tags", {})).items()
    }
    ordered = {name: _upright(table) for name, table in tables.items()}
    return Layout(ordered, tags)


def _upright(table: Table) -> Table:
    return Table(min(table.x0, table.x1), max(table.x0, table.x1), min(table.y0, table.y1), max(table.y0, table.y1))


def _mapping(path: Path, where: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise LayoutError(f"{path}: {where} is {type(value).__name__}, expected an object")
    return value


def _numbers(path: Path, where: str, entry: Any, keys: tuple[str, ...], scale: float) -> dict[str, float]:
    entry = _mapping(path, where, entry)
    result = {}
    for key in keys:
        value = entry.get(key)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= _LARGEST:
            raise LayoutError(f"{path}: {where}.{key} is {value!r}, expected a number")
        result[key] = value * scale
    return result


def load_overrides(path: Path) -> dict[str, Override]:
    """Read an approach override file: tag id to what is pinned for it.

    Unknown keys are dropped, unknown tag ids kept; a file without `overrides` pins nothing. Raises LayoutError (a
    ValueError) with file and line for a missing file, for text that is not YAML and for values of the wrong kind.
    """
    try:
        root = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
    except (OSError, UnicodeDecodeError) as error:
        raise LayoutError(f"{path}: cannot read the approach overrides: {error}") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        raise LayoutError(f"{path}{line}: not YAML: {getattr(error, 'problem', None) or error}") from error
    except RecursionError as error:
        raise LayoutError(f"{path}: brackets of too many levels to be read") from error
    if root is None:
        return {}
    entries = dict(_entries(path, "the file", root)).get("overrides")
    if entries is None:
        return {}
    result = {}
    for tag_id, entry in _entries(path, "overrides", entries):
        pinned = {
            key: _number(path, f"overrides.{tag_id}.{key}", value)
            for key, value in _entries(path, f"overrides.{tag_id}", entry)
            if key in _OVERRIDE_KEYS
        }
        result[tag_id] = Override(**pinned)
    return result


def _entries(path: Path, where: str, node: yaml.Node) -> list[tuple[str, yaml.Node]]:
    if not isinstance(node, yaml.MappingNode):
        raise LayoutError(f"{path}:{node.start_mark.line + 1}: {where} is not a mapping of names to values")
    return [(str(key.value), value) for key, value in node.value]


def _number(path: Path, where: str, node: yaml.Node) -> float:
    try:
        value = float(node.value) if isinstance(node, yaml.ScalarNode) else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise LayoutError(f"{path}:{node.start_mark.line + 1}: {where} is {node.value!r}, expected a number")
    return value
