"""Reads CARMEN logs: laser scans with odometry, as text, one message per line.

Formats: `FLASER n r1..rn  x y yaw  odom_x odom_y odom_yaw  ipc_time host logger_time` and, of later versions,
`ROBOTLASER1` with its own field of view. The first pose is the laser's, the second the robot's, both by odometry.
See CARMEN's `param` and `readlog` documentation, http://carmen.sourceforge.net/logger_playback.html.
"""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TextIO, cast

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.bounded_file import open_regular, open_text
from lupin_runtime.geometry import Pose2

# A laser with 180 degrees of view, readings from right to left. 180 or 181 readings: 1 degree apart; 360 or 361: 0.5;
# 401: 0.25 over 100 degrees.
_HALF_TURN = math.pi / 2.0
_STEPS_DEG = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}
# A file with a larger share of broken scan lines is of another format, or damaged: it is refused.
MAX_BROKEN_SHARE = 0.1
# The offset of a mount is constant: one that varies by more than rounding comes from two estimates of the pose.
_MOUNT_SPREAD_M, _MOUNT_SPREAD_RAD = 0.005, 0.005
_MOUNT_PARAMETERS = ("robot_frontlaser_offset", "robot_frontlaser_side_offset", "robot_frontlaser_angular_offset")
_KEPT_PROBLEMS = 20
_MAX_LINE_CHARACTERS = 1 << 20  # a scan of 1081 ranges has 10 000; the rest of a longer line counts as a line


@dataclass(frozen=True)
class LogScan:
    """One scan: `ranges` (N,) in meters, the angle of the first and between two, the robot's odometry, the stamp as written."""

    stamp: str
    ranges: NDArray[np.float64]
    angle_min: float
    angle_step: float
    odom: Pose2
    laser: Pose2
    line: int


@dataclass(frozen=True)
class CarmenLog:
    """The scans in the order of the file, the laser's pose on the robot, and the unusable lines (`line: reason`)."""

    scans: list[LogScan]
    mount: Pose2
    problems: list[str] = field(default_factory=list)
    broken: int = 0


def read_carmen(path: Path) -> CarmenLog:
    """Read a log, plain or compressed by gzip.

    Broken lines are listed in `problems` and skipped; a file with too many of them, or without scans, is refused.

    Raises MalformedFile, OSError.
    """
    with open_regular(path) as stream:
        packed = stream.read(2) == b"\x1f\x8b"
    try:
        with _open_packed(path) if packed else open_text(path) as lines:
            return parse_carmen(iter(lambda: lines.readline(_MAX_LINE_CHARACTERS), ""), path)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise MalformedFile(path, None, f"the compressed log is damaged: {error}") from None


def _open_packed(path: Path) -> TextIO:
    return cast(TextIO, gzip.open(path, "rt", encoding="utf-8-sig", errors="replace"))


def parse_carmen(lines: Iterable[str], name: Path | str = "log") -> CarmenLog:
    """Parse the lines of a log as `read_carmen` does; `name` is the file's name in errors."""
    scans: list[LogScan] = []
    problems: list[str] = []
    broken, first_broken, mount_parameters = 0, (0, ""), dict[str, float]()
    for number, text in enumerate(lines, start=1):
        fields = text.split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            if fields[0] == "FLASER":
                scans.append(_flaser(fields, number))
            elif fields[0] == "ROBOTLASER1":
                scans.append(_robotlaser(fields, number))
            elif fields[0] == "PARAM" and len(fields) > 2 and fields[1] in _MOUNT_PARAMETERS:
                mount_parameters[fields[1]] = float(fields[2])
        except ValueError as error:
            broken += 1
            first_broken = first_broken if broken > 1 else (number, str(error))
            if len(problems) < _KEPT_PROBLEMS:
                problems.append(f"line {number}: {fields[0]}: {error}")
    if broken and broken > MAX_BROKEN_SHARE * (broken + len(scans)):
        raise MalformedFile(
            name, first_broken[0], f"{first_broken[1]} ({broken} of {broken + len(scans)} scan lines are broken)"
        )
    if not scans:
        raise MalformedFile(name, None, "no FLASER or ROBOTLASER1 line: expected a CARMEN log with laser scans")
    if len(problems) < broken:
        problems.append(f"and {broken - len(problems)} more")
    if len(scans) > 1 and _is_constant([scan.odom for scan in scans]) and not _is_constant([scan.laser for scan in scans]):
        # Some writers fill in the first pose only.
        scans = [replace(scan, odom=scan.laser) for scan in scans]
        problems.append("the robot's pose never changes: the laser's pose is used as odometry")
    stated = Pose2(*(mount_parameters.get(name, 0.0) for name in _MOUNT_PARAMETERS)) if mount_parameters else None
    mount, warning = _mount(scans, stated)
    return CarmenLog(scans, mount, problems + ([warning] if warning else []), broken)


def _numbers(fields: list[str], start: int, count: int, what: str) -> list[float]:
    taken = fields[start : start + count]
    if len(taken) < count:
        raise ValueError(f"expected {count} fields for {what} from field {start + 1}, found {len(taken)}")
    return [float(value) for value in taken]


def _pose(values: list[float], what: str) -> Pose2:
    if not all(map(math.isfinite, values)):
        raise ValueError(f"{what} is not finite")
    return Pose2(values[0], values[1], values[2])


def _count(text: str) -> int:
    count = int(text)
    if not 2 <= count <= 10_000:
        raise ValueError(f"{count} readings are invalid")
    return count


def _stamp(fields: list[str], at: int) -> str:
    if len(fields) <= at:
        raise ValueError("the time stamp is missing")
    if not math.isfinite(float(fields[at])):
        raise ValueError(f"the time stamp {fields[at]} is not finite")
    return fields[at]


def _flaser(fields: list[str], line: int) -> LogScan:
    if len(fields) < 2:
        raise ValueError("the number of readings is missing")
    count = _count(fields[1])
    ranges = np.array(_numbers(fields, 2, count, "the readings"))
    poses = _numbers(fields, 2 + count, 6, "the poses of laser and robot")
    if count == 401:
        first, step = -math.radians(50.0), math.radians(0.25)
    else:
        first, step = -_HALF_TURN, math.radians(_STEPS_DEG.get(count, 180.0 / (count - 1)))
    return LogScan(
        _stamp(fields, 8 + count),
        ranges,
        first,
        step,
        _pose(poses[3:], "the odometry"),
        _pose(poses[:3], "the laser's pose"),
        line,
    )


def _robotlaser(fields: list[str], line: int) -> LogScan:
    _, first, _, step = _numbers(fields, 1, 4, "type, start angle, field of view, resolution")
    if not (math.isfinite(first) and math.isfinite(step) and step > 0.0):
        raise ValueError(f"start angle {first} and resolution {step} are invalid")
    if len(fields) < 9:
        raise ValueError("the number of readings is missing")
    count = _count(fields[8])
    ranges = np.array(_numbers(fields, 9, count, "the readings"))
    at = 9 + count
    if len(fields) <= at:
        raise ValueError("the number of remissions is missing")
    at += 1 + int(fields[at])
    poses = _numbers(fields, at, 6, "the poses of laser and robot")
    # tv, rv, two safety distances, turn axis
    return LogScan(
        _stamp(fields, at + 11),
        ranges,
        first,
        step,
        _pose(poses[3:], "the odometry"),
        _pose(poses[:3], "the laser's pose"),
        line,
    )


def _is_constant(poses: list[Pose2]) -> bool:
    return all(pose == poses[0] for pose in poses)


def _mount(scans: list[LogScan], parameter: Pose2 | None) -> tuple[Pose2, str]:
    """Return the laser's pose on the robot, from the offset between the poses of each line if it is constant, and a problem."""
    offsets = [scan.odom.inverse() @ scan.laser for scan in scans]
    values = np.array([(o.x, o.y, math.cos(o.yaw), math.sin(o.yaw)) for o in offsets])
    middle = np.median(values, axis=0)
    spread = np.median(np.abs(values - middle), axis=0)
    if max(spread[:2]) < _MOUNT_SPREAD_M and max(spread[2:]) < _MOUNT_SPREAD_RAD:
        return Pose2(float(middle[0]), float(middle[1]), math.atan2(middle[3], middle[2])), ""
    if parameter is not None:
        return parameter, ""
    return Pose2(), "the laser's offset from the odometry is not constant: the laser is assumed at the robot's origin"
