"""Reads a camera's calibration from YAML: as ROS's camera_calibration writes it, or OpenCV's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.bounded_file import NotUtf8, read_bounded_text
from lupin_runtime.cpp_number import parse_number
from lupin_runtime.perception.tag_pose_estimation import Intrinsics
from lupin_runtime.yaml_fields import YamlFields

MAX_BYTES = 1 << 20
_OPENCV_HEADER = "%YAML:1.0"  # of OpenCV 4 and earlier; no directive of YAML


def load_calibration(path: Path) -> tuple[Intrinsics, int]:
    """Return the camera and the width in pixels of the images that it was calibrated with. Raises MalformedFile and OSError.

    Numbers are those of yaml-cpp and OpenCV, such as 1e-05.
    """
    try:
        content = read_bounded_text(path, MAX_BYTES)
    except NotUtf8 as error:
        raise MalformedFile(path, error.line, error.problem) from error
    text = content.replace(_OPENCV_HEADER, "#", 1) if content.startswith(_OPENCV_HEADER) else content
    fields = _Fields(path, text, "a calibration, with camera_matrix and image_width")
    matrix = fields.numbers("camera_matrix")
    width = fields.scalar("image_width")
    if len(matrix) != 9 or matrix[0] <= 0.0 or matrix[4] <= 0.0:
        raise fields.refuse("camera_matrix", "expected nine numbers with focal lengths above 0")
    if not (width.isascii() and width.isdigit() and 0 < int(width) < 1 << 20):
        raise fields.refuse("image_width", f"expected pixels, found {width[:40]!r}")
    distortion = fields.numbers("distortion_coefficients", required=False)
    try:
        camera = Intrinsics.from_camera_info(
            np.array(matrix), np.array(distortion), int(width), fields.scalar("distortion_model", required=False)
        )
    except ValueError as error:
        line = fields.line("distortion_model" if "distortion_model" in str(error) else "distortion_coefficients")
        raise MalformedFile(path, line, str(error)) from error
    return camera, int(width)


class _Fields(YamlFields):
    """The values of a calibration."""

    def scalar(self, key: str, *, required: bool = True) -> str:
        """Return a plain value; empty without one that is not required."""
        node = self.nodes.get(key)
        if isinstance(node, yaml.ScalarNode):
            return str(node.value).strip()
        if node is None and not required:
            return ""
        raise self.refuse(key, "expected a plain value")

    def numbers(self, key: str, *, required: bool = True) -> list[float]:
        """Return the numbers of the entry `data` of a matrix; none without one that is not required."""
        node = self.nodes.get(key)
        if node is None and not required:
            return []
        entries = node.value if isinstance(node, yaml.MappingNode) else ()
        data = next((value for name, value in entries if isinstance(name, yaml.ScalarNode) and name.value == "data"), None)
        items = data.value if isinstance(data, yaml.SequenceNode) else None
        values = [parse_number(item.value) if isinstance(item, yaml.ScalarNode) else None for item in items or ()]
        if items is None or any(value is None for value in values):
            raise self.refuse(key, "expected an entry data with a list of numbers")
        found = [value for value in values if value is not None]
        if not np.isfinite(found).all():
            raise self.refuse(key, "expected finite numbers")
        return found
