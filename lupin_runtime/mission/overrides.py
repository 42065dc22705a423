"""Approach overrides: an operator's goals and standoffs for single tags, from a YAML file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import yaml

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
        root = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
    except (OSError, UnicodeDecodeError) as error:
        raise OverridesError(f"{path}: cannot read the approach overrides: {error}") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        raise OverridesError(f"{path}{line}: not YAML: {getattr(error, 'problem', None) or error}") from error
    except RecursionError as error:
        raise OverridesError(f"{path}: brackets are nested too deeply to be read") from error
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
