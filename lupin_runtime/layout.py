"""Layout files: the tables and tags of a greenhouse that are known without discovery.

The format: `{"units": "m", "tables": {NAME: {"x0", "x1", "y0", "y1"}}, "tags": {ID: {"x", "y", "sensors": [...]}}}`, units m
(the default), cm or mm. Other keys are ignored. Only the greenhouse's climate needs `sensors`: `Layout` is without them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.json_text import parse_json

_METERS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_MAX_NUMBER = 1e9  # no greenhouse is larger in any unit; an integer may even be too large for a float


class LayoutError(ValueError):
    """A layout file that cannot be used; the message names the file, the line if it is known, and the problem."""


@dataclass(frozen=True)
class Table:
    """The footprint of a table: meters, sides along the axes."""

    x0: float
    x1: float
    y0: float
    y1: float

    @property
    def center(self) -> tuple[float, float]:
        """The middle of the footprint."""
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2

    def contains(self, x: float, y: float) -> bool:
        """Return whether a point lies on the table, edges included."""
        return self.x0 <= x <= self.x1 and self.y0 <= y <= self.y1

    def upright(self) -> Table:
        """Return the same footprint with x0 <= x1 and y0 <= y1."""
        return Table(min(self.x0, self.x1), max(self.x0, self.x1), min(self.y0, self.y1), max(self.y0, self.y1))


@dataclass(frozen=True)
class TagLocation:
    """The position of a tag in a layout, in meters."""

    x: float
    y: float


@dataclass(frozen=True)
class Layout:
    """Tables by name and tags by id, in the layout's own frame."""

    tables: Mapping[str, Table] = field(default_factory=dict)
    tags: Mapping[str, TagLocation] = field(default_factory=dict)


def packaged_layout_path() -> Path:
    """Locate the layout inside the greenhouse simulator's package. Raises LayoutError if it is not installed."""
    spec = find_spec("greenhouse_sim")
    if spec is None or not spec.submodule_search_locations:
        raise LayoutError("package greenhouse_sim is not installed; expected its configs/tag_locations.json; run: make setup")
    return Path(next(iter(spec.submodule_search_locations))) / "configs" / "tag_locations.json"


def load_layout(path: Path | None = None) -> Layout:
    """Read a layout file (None: the packaged one); a table's corners may be swapped. Raises LayoutError."""
    layout = LayoutText.read(path or packaged_layout_path()).parse()
    return Layout({name: table.upright() for name, table in layout.tables.items()}, layout.tags)


class LayoutText:
    """The text of a layout file; `error` finds the line of a problem in it."""

    def __init__(self, text: str, source: str) -> None:
        """`source` names the file in error messages."""
        self._text, self._source = text, source

    @classmethod
    def read(cls, path: Path) -> LayoutText:
        """Read a file as UTF-8. Raises LayoutError."""
        try:
            return cls(read_bounded_text(path), str(path))
        except OSError as error:
            raise LayoutError(f"{path}: the layout cannot be read: {error.strerror or error}") from error

    def parse(self) -> Layout:
        """Parse the layout, corners as they are written. Raises LayoutError."""
        root = self._root()
        unit = root.get("units", "m")
        if not isinstance(unit, str) or unit not in _METERS:
            raise self.error("units", f"units must be one of {', '.join(_METERS)}, found {_found(unit)}")
        scale = _METERS[unit]
        tables = {
            name: Table(*self._numbers(f"tables.{name}", name, value, ("x0", "x1", "y0", "y1"), scale))
            for name, value in self._object(root.get("tables", {}), "tables", "tables").items()
        }
        tags = {
            name: TagLocation(*self._numbers(f"tags.{name}", name, value, ("x", "y"), scale))
            for name, value in self._object(root.get("tags", {}), "tags", "tags").items()
        }
        return Layout(tables, tags)

    def sensors(self) -> dict[str, tuple[str, ...]]:
        """Parse the names of each tag's sensors, by tag id; here `tags` must not be missing. Raises LayoutError."""
        root = self._root()
        found = {}
        for name, value in self._object(root.get("tags"), "tags", "tags" if "tags" in root else "").items():
            sensors = self._object(value, f"tags.{name}", name).get("sensors")
            if not isinstance(sensors, list) or not all(isinstance(sensor, str) for sensor in sensors):
                raise self.error(name, f"tags.{name}.sensors must be a list of names, found {_found(sensors)}")
            found[name] = tuple(sensors)
        return found

    def error(self, key: str, problem: str) -> LayoutError:
        """Build the error for a problem with the value of `key`.

        The json module keeps no positions, so the line is the first one that contains the quoted key; an empty key means the
        whole file.
        """
        if not key:
            return LayoutError(f"{self._source}:1: {problem}")
        for number, line in enumerate(self._text.splitlines(), 1):
            if f'"{key}"' in line:
                return LayoutError(f"{self._source}:{number}: {problem}")
        return LayoutError(f"{self._source}: {problem}")

    def _root(self) -> Mapping[str, Any]:
        try:
            document = parse_json(self._text)
        except json.JSONDecodeError as error:
            raise LayoutError(f"{self._source}:{error.lineno}: not JSON: {error.msg}") from error
        except ValueError as error:  # numbers with thousands of digits, brackets thousands of levels deep
            raise LayoutError(f"{self._source}: not JSON that can be read: {error}") from error
        return self._object(document, "the file", "")

    def _object(self, value: Any, name: str, key: str) -> Mapping[str, Any]:
        if not isinstance(value, dict):
            raise self.error(key, f"{name} must be an object, found {_found(value)}")
        return value

    def _numbers(self, name: str, key: str, value: Any, parts: tuple[str, ...], scale: float) -> list[float]:
        entry = self._object(value, name, key)
        numbers = []
        for part in parts:
            number = entry.get(part)
            if isinstance(number, bool) or not isinstance(number, (int, float)) or not abs(number) <= _MAX_NUMBER:
                raise self.error(key, f"{name}.{part} must be a number, found {_found(number)}")
            numbers.append(number * scale)
        return numbers


def _found(value: Any) -> str:
    return "nothing" if value is None else f"{value!r:.40}"
