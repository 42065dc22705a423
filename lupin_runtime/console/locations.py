"""Named locations on the map, shared by all browsers. `home` is the map's origin until somebody moves it."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import Any

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.console.shared_file import change_object, read_object
from lupin_runtime.console.short_text import short_repr
from lupin_runtime.stack.runs import state_directory

MAX_LOCATIONS = 500
MAX_NAME = 64
MAX_COORDINATE_M = 10_000.0
HOME = "home"
TOO_MANY = f"there are {MAX_LOCATIONS} locations; remove one first"
BAD_NAME = f"a location's name must have 1 to {MAX_NAME} printable characters"
_AT_ORIGIN = {"x": 0.0, "y": 0.0, "yaw": 0.0}


class BadLocation(ValueError):
    """A location that can't be saved or removed; the text is the reason."""


def locations_file() -> Path:
    """Return the file of this user's locations."""
    return state_directory() / "console" / "locations.json"


def all_locations(path: Path) -> dict[str, dict[str, float]]:
    """Return the pose of each location on the map: x and y in m, yaw in rad. Raises MalformedFile and OSError."""
    stored = read_object(path)
    try:
        return {HOME: dict(_AT_ORIGIN), **{_checked_name(name): checked_pose(pose) for name, pose in stored.items()}}
    except BadLocation as error:
        raise MalformedFile(path, None, str(error)) from error


def save_location(path: Path, name: Any, pose: Any) -> dict[str, dict[str, float]]:
    """Save or replace a location; returns all locations. Raises BadLocation, MalformedFile and OSError."""
    added = {_checked_name(name): checked_pose(pose)}

    def add(locations: dict[str, Any]) -> dict[str, Any]:
        if not added.keys() <= locations.keys() and len(locations) >= MAX_LOCATIONS:
            raise BadLocation(TOO_MANY)
        return {**locations, **added}

    return {HOME: dict(_AT_ORIGIN), **change_object(path, add)}


def import_locations(path: Path, found: Any) -> dict[str, dict[str, float]]:
    """Add the locations that a browser stored before the console did; returns all locations.

    Those of the console are kept, and what is malformed or too much is left out. Raises BadLocation, MalformedFile and OSError.
    """
    if not isinstance(found, dict):
        raise BadLocation("locations must be an object of names and poses")

    def add(locations: dict[str, Any]) -> dict[str, Any]:
        merged = dict(locations)
        for name, pose in found.items():
            with contextlib.suppress(BadLocation):
                added = {_checked_name(name): checked_pose(pose)}
                if len(merged) < MAX_LOCATIONS and added != {HOME: _AT_ORIGIN}:
                    merged = {**added, **merged}
        return merged

    return {HOME: dict(_AT_ORIGIN), **change_object(path, add)}


def remove_location(path: Path, name: Any) -> dict[str, dict[str, float]]:
    """Remove a location, or reset `home`; returns all locations. Raises BadLocation, MalformedFile and OSError."""

    def remove(locations: dict[str, Any]) -> dict[str, Any]:
        if name not in (*locations, HOME):
            raise BadLocation(f"there is no location {short_repr(name, MAX_NAME)}")
        return {each: pose for each, pose in locations.items() if each != name}

    return {HOME: dict(_AT_ORIGIN), **change_object(path, remove)}


def _checked_name(name: Any) -> str:
    if not isinstance(name, str) or not name.strip() or len(name) > MAX_NAME or not name.isprintable():
        raise BadLocation(BAD_NAME)
    return name.strip()


def checked_pose(pose: Any) -> dict[str, float]:
    """Return a pose of a client: x and y in m, yaw in rad, wrapped. Raises BadLocation."""
    checked = {}
    for field in ("x", "y", "yaw"):
        value = pose.get(field) if isinstance(pose, dict) else None
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= MAX_COORDINATE_M:
            raise BadLocation(f"{field} must be a number up to ±{MAX_COORDINATE_M:g}: x and y in m, yaw in rad")
        checked[field] = float(value)
    checked["yaw"] = math.remainder(checked["yaw"], math.tau)
    return checked
