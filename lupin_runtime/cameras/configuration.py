"""Reads the configuration of the robot's cameras, `/etc/lupin/cameras.yaml`. Omitted keys have their default values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.bounded_file import NotUtf8, read_bounded_text
from lupin_runtime.yaml_text import load_yaml, where_and_why

CONFIGURATION = Path("/etc/lupin/cameras.yaml")
_MAX_BYTES = 100_000
# The smallest and largest value of each number, as far as any camera of this robot could support it.
_RANGES = {"width": (160, 4096), "height": (120, 2160), "fps": (1, 60), "framerate": (1.0, 60.0)}
_PIXEL_FORMATS = ("yuyv2rgb", "mjpeg2rgb", "uyvy2rgb", "yuyv", "raw_mjpeg")


@dataclass(frozen=True)
class Color:
    """The body camera's color images. The sensor offers 10, 15 and 30 fps at 640 × 480, and 7 at 1280 × 960."""

    enabled: bool = True
    width: int = 640
    height: int = 480
    fps: int = 30


@dataclass(frozen=True)
class Depth:
    """The body camera's depth images, the stream with the highest CPU load on the robot."""

    enabled: bool = False
    fps: int = 10


@dataclass(frozen=True)
class PointCloud:
    """The point cloud, computed from the depth images."""

    enabled: bool = False


@dataclass(frozen=True)
class Gripper:
    """The USB camera at the gripper."""

    enabled: bool = True
    width: int = 640
    height: int = 480
    framerate: float = 20.0
    pixel_format: str = "yuyv2rgb"


@dataclass(frozen=True)
class CameraConfiguration:
    """All settings. Sizes are in pixels, rates in frames per second."""

    color: Color = field(default_factory=Color)
    depth: Depth = field(default_factory=Depth)
    point_cloud: PointCloud = field(default_factory=PointCloud)
    gripper: Gripper = field(default_factory=Gripper)


def read_configuration(path: Path = CONFIGURATION) -> CameraConfiguration:
    """Read the settings in a file; the defaults if there is no file. Raises MalformedFile and OSError."""
    try:
        content = read_bounded_text(path, _MAX_BYTES)
    except FileNotFoundError:
        return CameraConfiguration()
    except NotUtf8 as error:
        raise MalformedFile(path, error.line, error.problem) from error
    try:
        read = load_yaml(content)
    except (yaml.YAMLError, ValueError) as error:
        raise MalformedFile(path, *where_and_why(error)) from error
    kinds = {"color": Color, "depth": Depth, "point_cloud": PointCloud, "gripper": Gripper}
    try:
        sections = _mapping(read if read is not None else {}, "the file", kinds)
        made = {name: _section(name, kinds[name], value) for name, value in sections.items()}
    except ValueError as error:
        raise MalformedFile(path, None, str(error)) from error
    configuration = CameraConfiguration(**made)
    if configuration.point_cloud.enabled and not configuration.depth.enabled:
        raise MalformedFile(path, None, "point_cloud.enabled needs depth.enabled")
    return configuration


def _section(name: str, kind: Any, value: Any) -> Any:
    defaults = {each.name: each.default for each in fields(kind)}
    values = _mapping(value, name, defaults)
    return kind(**{key: _checked(f"{name}.{key}", key, each, defaults[key]) for key, each in values.items()})


def _mapping(value: Any, name: str, known: Mapping[str, Any]) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{name}: expected keys and values, found {value!r:.60}")
    for key in value:
        if key not in known:
            raise ValueError(f"{name} has no key {key!r:.60}; known keys: {', '.join(known)}")
    return value


def _checked(name: str, key: str, value: Any, default: Any) -> Any:
    if isinstance(default, bool):
        if not isinstance(value, bool):
            raise ValueError(f"{name} must be true or false, not {value!r:.60}")
        return value
    if isinstance(default, str):
        if value not in _PIXEL_FORMATS:
            raise ValueError(f"{name} must be one of {', '.join(_PIXEL_FORMATS)}, not {value!r:.60}")
        return value
    low, high = _RANGES[key]
    numbers = (int,) if isinstance(default, int) else (int, float)
    if isinstance(value, bool) or not isinstance(value, numbers) or not low <= value <= high:
        kind = "a whole number" if isinstance(default, int) else "a number"
        raise ValueError(f"{name} must be {kind} from {low} to {high}, not {value!r:.60}")
    return type(default)(value)
