"""Stored poses and sequences of the arm: their names and their JSON format."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from itertools import pairwise
from typing import Any

from lupin_runtime.arm.limits import Arm
from lupin_runtime.json_text import parse_json

VERSION = 1
_MAX_NUMBER = 1e6  # rad or s; also rejects integers that are too large for a float
_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}")


class LibraryError(ValueError):
    """A request that cannot be fulfilled; the message gives the reason."""


@dataclass(frozen=True)
class StoredPose:
    """`arm` and `gripper` in rad; with `gripper` None the gripper is not moved. `created` is ISO 8601, UTC, seconds."""

    arm: Arm
    gripper: float | None = None
    created: str = ""
    note: str = ""


@dataclass(frozen=True)
class Waypoint:
    """A point of a sequence; `t` is seconds from its start, the rest is as in a pose."""

    t: float
    arm: Arm
    gripper: float | None = None


@dataclass(frozen=True)
class StoredSequence:
    """A recorded motion. `mode` is kinesthetic or teleop."""

    mode: str
    include_gripper: bool
    duration_s: float
    waypoints: tuple[Waypoint, ...]
    created: str = ""
    note: str = ""


@dataclass
class Library:
    """All stored poses and sequences, by name."""

    poses: dict[str, StoredPose] = field(default_factory=dict)
    sequences: dict[str, StoredSequence] = field(default_factory=dict)


def valid_name(name: str) -> str:
    """Return the stored form of a name: trimmed and lower-case.

    A name has up to 32 characters of a–z, 0–9, _ and -, and begins with a letter or digit. Raises LibraryError.
    """
    key = name.strip().lower()
    if not _NAME.fullmatch(key):
        raise LibraryError(f"{name!r} is not a valid name: use up to 32 of a-z, 0-9, _ and -, beginning with a letter or digit")
    return key


def now_text() -> str:
    """Return the current time in the library's format."""
    return datetime.now(timezone.utc).isoformat(timespec="seconds")


# -- JSON --------------------------------------------------------------------------------------------------------------
def to_json(library: Library) -> str:
    """Return the text of the library's file."""
    document = {
        "version": VERSION,
        "poses": {name: asdict(pose) for name, pose in sorted(library.poses.items())},
        "sequences": {name: asdict(sequence) for name, sequence in sorted(library.sequences.items())},
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def from_json(text: str) -> Library:
    """Parse the text of a library's file. Raises LibraryError, which names the invalid entry."""
    try:
        document = parse_json(text)
    except ValueError as error:
        raise LibraryError(f"not JSON: {error}") from error
    if not isinstance(document, dict) or document.get("version") != VERSION:
        found = document.get("version") if isinstance(document, dict) else type(document).__name__
        raise LibraryError(f"expected an object with version {VERSION}, found {found!r}")
    return Library(
        _entries(document, "poses", _pose),
        _entries(document, "sequences", _sequence),
    )


def _entries(document: dict[str, Any], key: str, parse: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    section = document.get(key, {})
    if not isinstance(section, dict):
        raise LibraryError(f"expected {key} to be an object, found {type(section).__name__}")
    entries = {}
    for name, entry in section.items():
        try:
            entries[valid_name(name)] = parse(entry)
        except (KeyError, TypeError, ValueError) as error:
            raise LibraryError(f"{key}.{name}: {error!r}") from error
    return entries


def _pose(entry: dict[str, Any]) -> StoredPose:
    return StoredPose(_arm(entry["arm"]), _gripper(entry), str(entry.get("created", "")), str(entry.get("note", "")))


def _sequence(entry: dict[str, Any]) -> StoredSequence:
    waypoints = tuple(Waypoint(_number(w["t"]), _arm(w["arm"]), _gripper(w)) for w in entry["waypoints"])
    if not waypoints or any(a.t > b.t for a, b in pairwise(waypoints)):
        raise LibraryError("expected at least one waypoint, in the order of time")
    return StoredSequence(
        str(entry["mode"]),
        bool(entry["include_gripper"]),
        _number(entry["duration_s"]),
        waypoints,
        str(entry.get("created", "")),
        str(entry.get("note", "")),
    )


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= _MAX_NUMBER:
        raise LibraryError(f"expected a finite number, found {value!r}")
    return float(value)


def _arm(values: Any) -> Arm:
    pan, lift, elbow, wrist = (_number(value) for value in values)
    return pan, lift, elbow, wrist


def _gripper(entry: dict[str, Any]) -> float | None:
    value = entry.get("gripper")
    return None if value is None else _number(value)
