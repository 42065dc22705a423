"""Calibrated pads: a file for a pad with one link, which is used instead of the rows of the table."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from lupin_runtime.atomic_file import MalformedFile, write_atomically
from lupin_runtime.bounded_file import read_bounded, read_bounded_text
from lupin_runtime.json_text import parse_json
from lupin_runtime.teleop.pad_maps import KERNEL_LAYOUT, TRANSPORTS, ArmControls, PadId, PadMap, find_map

CONTROLS = ("dead_man", "turbo", "lateral_axis", "forward_axis", "yaw_axis")
_MAX_CODE = 0x2FF  # KEY_MAX
_MAX_VALUE = 2**31 - 1


def map_folder() -> Path:
    """Return the folder of the calibrated pads."""
    base = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(base) / "lupin" / "pads"


def map_path(folder: Path, found: PadId) -> Path:
    """Return the file of a device, such as 045e-0b13-bluetooth.json."""
    link = TRANSPORTS.get(found.bus, f"bus-{found.bus:04x}").lower()
    return folder / f"{found.vendor:04x}-{found.product:04x}-{link}.json"


def read_map(path: Path, found: PadId) -> PadMap | None:
    """Return the calibrated row of a device; None if it has no file.

    Raises OSError if the file cannot be read, and MalformedFile if it is not one of `write_map`, or is not of this device.
    """
    try:
        text = read_bounded_text(path)
    except FileNotFoundError:
        return None
    try:
        content = parse_json(text)
    except ValueError as error:
        raise MalformedFile(path, None, f"not valid JSON: {error}") from error
    row = _row(content, found)
    if row is not None and (set(row.declares) != found.axes or row.version_bits != found.version & KERNEL_LAYOUT):
        raise MalformedFile(path, None, "is of another driver of this gamepad, with which its controls have other codes")
    if row is None or not row.fits(found):
        raise MalformedFile(path, None, "does not name the controls of this gamepad")
    return replace(row, arm=_arm_controls(row, found))


def _arm_controls(row: PadMap, found: PadId) -> ArmControls | None:
    """Return the table's controls of the arm for a calibrated pad; None if it has none, or one of them drives."""
    known = find_map(found)
    if known is None or known.arm is None:
        return None
    drives = {row.dead_man, row.turbo} & set(known.arm.buttons) or set(row.axes) & set(known.arm.ranges)
    return None if drives else known.arm


def write_map(path: Path, row: PadMap) -> Path | None:
    """Write a calibrated row; return the file to which the former one was copied, or None. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    backup = None
    with suppress(FileNotFoundError):
        former = read_bounded(path)
        backup = path.with_name(f"{path.name}.bak")
        write_atomically(backup, former)
    write_atomically(path, map_text(row), sync=True)
    return backup


def map_text(row: PadMap) -> str:
    """Return the content of a row's file."""
    values = asdict(row)
    names = ("name", "version_bits", "declares", *CONTROLS, "above_center", "axis_range")
    return json.dumps({name: values[name] for name in names}, indent=2) + "\n"


def _row(content: Any, found: PadId) -> PadMap | None:
    """Return the row of a file's content, or None if a value is missing, of another type, or out of range."""
    if not isinstance(content, dict):
        return None
    codes = _integers([content.get(name) for name in CONTROLS], 0, _MAX_CODE)
    above = _integers(content.get("above_center"), 0, _MAX_CODE)
    declares = _integers(content.get("declares"), 0, _MAX_CODE)
    driver = _integers([content.get("version_bits")], 0, KERNEL_LAYOUT)
    limits = _integers(content.get("axis_range"), -_MAX_VALUE, _MAX_VALUE)
    name = content.get("name")
    if codes is None or above is None or declares is None or driver is None or limits is None or not isinstance(name, str):
        return None
    if len(limits) != 2 or limits[0] >= limits[1]:
        return None
    dead_man, turbo, lateral_axis, forward_axis, yaw_axis = codes
    row = PadMap(
        name,
        (found.bus,),
        found.vendor,
        products=(found.product,),
        version_bits=driver[0],
        declares=tuple(declares),
        dead_man=dead_man,
        turbo=turbo,
        lateral_axis=lateral_axis,
        forward_axis=forward_axis,
        yaw_axis=yaw_axis,
        above_center=tuple(above),
        axis_range=(limits[0], limits[1]),
    )
    return row if len(set(row.axes)) == len(row.axes) and row.dead_man != row.turbo else None


def _integers(values: Any, low: int, high: int) -> list[int] | None:
    """Return a list of integers within a range; None for anything else."""
    if isinstance(values, list) and all(type(value) is int and low <= value <= high for value in values):
        return values
    return None
