"""Approach overrides: an operator's goals and standoffs for single tags, from a YAML file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import yaml

from lupin_runtime.atomic_file import MalformedFile, write_atomically
from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.yaml_text import compose_yaml, where_and_why

OVERRIDES_NAME = "overrides.yaml"  # of a run, in its directory
_KEYS = ("goal_x", "goal_y", "yaw", "standoff")


class OverridesError(ValueError):
    """An override file that cannot be used; the message names the file, the line and the problem."""


@dataclass(frozen=True)
class Override:
    """An operator's values for the approach to one tag, meters and radians; None keeps the computed value."""

    goal_x: float | None = None
    goal_y: float | None = None
    yaw: float | None = None
    standoff: float | None = None


def load_overrides(path: Path) -> dict[str, Override]:
    """Read an approach override file; return the overrides by tag id.

    Unknown keys are dropped, unknown tag ids are kept. Without the key `overrides` the result is empty. Raises OverridesError
    for a missing file, for text that is not YAML and for values of the wrong type.
    """
    try:
        root = compose_yaml(read_bounded_text(path))
    except OSError as error:
        raise OverridesError(f"{path}: cannot read the approach overrides: {error.strerror or error}") from error
    except yaml.YAMLError as error:
        raise OverridesError(str(MalformedFile(path, *where_and_why(error)))) from error
    if root is None:
        return {}
    entries = dict(_entries(path, "the file", root)).get("overrides")
    if entries is None:
        return {}
    result = {}
    for tag_id, entry in _entries(path, "overrides", entries):
        values = {
            key: _number(path, f"overrides.{tag_id}.{key}", value)
            for key, value in _entries(path, f"overrides.{tag_id}", entry)
            if key in _KEYS
        }
        result[tag_id] = Override(**values)
    return result


def save_overrides(path: Path, overrides: Mapping[str, Override]) -> None:
    """Write an approach override file. Raises OSError."""
    entries = {
        tag_id: {key: value for key, value in asdict(one).items() if value is not None} for tag_id, one in overrides.items()
    }
    write_atomically(path, yaml.safe_dump({"overrides": entries}, sort_keys=True))


class OverridesFile(Mapping[str, Override]):
    """The overrides in a file that may change while missions run: each look-up finds what the file says then.

    `report` is called once with each problem of the file. While it cannot be read, its last content counts.
    """

    def __init__(self, path: Path, report: Callable[[str], None]) -> None:
        self._path, self._report = path, report
        self._version: tuple[int, int, int] | None = None
        self._overrides: dict[str, Override] = {}
        self._problem = ""
        self._refresh()

    def __getitem__(self, tag_id: str) -> Override:
        self._refresh()
        return self._overrides[tag_id]

    def __iter__(self) -> Iterator[str]:
        self._refresh()
        return iter(self._overrides)

    def __len__(self) -> int:
        self._refresh()
        return len(self._overrides)

    def _refresh(self) -> None:
        try:
            found = self._path.stat()
            version = (found.st_mtime_ns, found.st_ino, found.st_size)
        except OSError:
            version = None
        if version is not None and version == self._version:
            return
        self._version = version
        try:
            self._overrides = load_overrides(self._path)
            self._problem = ""
        except OverridesError as error:
            if str(error) != self._problem:
                self._report(str(error))
            self._problem = str(error)


def _entries(path: Path, name: str, node: yaml.Node) -> list[tuple[str, yaml.Node]]:
    if not isinstance(node, yaml.MappingNode):
        raise OverridesError(f"{path}:{node.start_mark.line + 1}: {name} is not a mapping of names to values")
    return [(str(key.value), value) for key, value in node.value]


def _number(path: Path, name: str, node: yaml.Node) -> float:
    try:
        value = float(node.value) if isinstance(node, yaml.ScalarNode) else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise OverridesError(f"{path}:{node.start_mark.line + 1}: {name} is {node.value!r}, expected a number")
    return value
