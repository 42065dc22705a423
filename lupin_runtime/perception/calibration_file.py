"""Reads a camera's calibration from YAML as ROS's camera_calibration writes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.bounded_file import NotUtf8, read_bounded_text
from lupin_runtime.perception.tag_pose_estimation import Intrinsics
from lupin_runtime.yaml_text import load_yaml

MAX_BYTES = 1 << 20
MAX_COEFFICIENTS = 14  # of OpenCV's models


def load_calibration(path: Path) -> tuple[Intrinsics, int]:
    """Return the camera and the width in pixels of the images that it was calibrated with. Raises MalformedFile and OSError."""
    try:
        content = read_bounded_text(path, MAX_BYTES)
    except NotUtf8 as error:
        raise MalformedFile(path, error.line, error.problem) from error
    try:
        document = load_yaml(content)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise MalformedFile(path, None, f"not YAML: {error}") from error
    if not isinstance(document, dict):
        raise MalformedFile(path, None, f"expected a calibration, not {type(document).__name__}")
    matrix = _numbers(path, document, "camera_matrix")
    distortion = _numbers(path, document, "distortion_coefficients") if "distortion_coefficients" in document else []
    width = document.get("image_width")
    if len(matrix) != 9 or matrix[0] <= 0.0 or matrix[4] <= 0.0:
        raise MalformedFile(path, None, "camera_matrix: expected nine numbers with focal lengths above 0")
    if len(distortion) > MAX_COEFFICIENTS:
        raise MalformedFile(path, None, f"distortion_coefficients: expected at most {MAX_COEFFICIENTS} numbers")
    if not isinstance(width, int) or isinstance(width, bool) or not 0 < width < 1 << 20:
        raise MalformedFile(path, None, f"image_width: expected pixels, found {width!r}")
    return Intrinsics.from_camera_info(np.array(matrix), np.array(distortion), width), width


def _numbers(path: Path, document: dict[Any, Any], key: str) -> list[float]:
    entry = document.get(key)
    data = entry.get("data") if isinstance(entry, dict) else None
    if not isinstance(data, list) or not all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in data):
        raise MalformedFile(path, None, f"{key}: expected an entry data with a list of numbers")
    try:
        values = [float(value) for value in data]
    except OverflowError:
        values = [float("inf")]
    if not np.isfinite(values).all():
        raise MalformedFile(path, None, f"{key}: expected finite numbers")
    return values
