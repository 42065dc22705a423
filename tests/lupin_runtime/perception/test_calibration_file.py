"""Calibrations as camera_calibration, camera_calibration_parsers (yaml-cpp) and OpenCV's FileStorage write them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from lupin_runtime.perception.calibration_file import load_calibration

MATRIX = np.array([[554.25, 0.0, 319.5], [0.0, 554.25, 239.5], [0.0, 0.0, 1.0]])
# One exponent without a point, which YAML 1.1 takes for text.
COEFFICIENTS = np.array([-0.25, 0.03, 1e-05, -2.5e-04, 0.0])
PARSERS = """
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [554.25, 0.00000, 319.5, 0.00000, 554.25, 239.5, 0.00000, 0.00000, 1.00000]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.25, 0.03, 1e-05, -2.5e-04, 0.00000]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
"""


@pytest.mark.parametrize("text", [PARSERS, "\ufeff" + PARSERS, PARSERS.replace("640", "'640'").replace("1e-05", '"1e-05"')])
def test_calibration_of_ros_is_read(tmp_path: Path, text: str) -> None:
    (tmp_path / "ost.yaml").write_text(text, encoding="utf-8")
    camera, width = load_calibration(tmp_path / "ost.yaml")
    assert width == 640
    np.testing.assert_allclose(camera.matrix, MATRIX)
    np.testing.assert_allclose(camera.distortion, COEFFICIENTS)


@pytest.mark.parametrize("header", ["%YAML:1.0", "%YAML 1.2"])
def test_calibration_of_opencv_is_read(tmp_path: Path, header: str) -> None:
    """OpenCV 4 and earlier begin with what is no directive of YAML."""
    path = tmp_path / "out_camera_data.yml"
    written = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    written.write("image_width", 640)
    written.write("image_height", 480)
    written.write("camera_matrix", MATRIX)
    written.write("distortion_coefficients", COEFFICIENTS.reshape(5, 1))
    written.release()
    path.write_text("\n".join([header, *path.read_text().splitlines()[1:], ""]))
    camera, width = load_calibration(path)
    assert width == 640
    np.testing.assert_allclose(camera.matrix, MATRIX)
    np.testing.assert_allclose(camera.distortion, COEFFICIENTS)
