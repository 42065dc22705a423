"""`lupin tags detect`: JSON, table and exit status."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from lupin_cli.commands.tags import app
from lupin_runtime.apriltag import tag_image
from tests.support import tag_views as tag_views_module


def lupin(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "lupin_cli.app", "tags", "detect", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.fixture
def tag_views() -> ModuleType:
    """Renders views of tags with their true corners and poses."""
    return tag_views_module


@pytest.fixture
def tag_image_file(tmp_path: Path) -> tuple[str, list[list[float]]]:
    """Return an image of tags 7 and 300, and the corners of the first."""
    image = np.full((300, 500, 3), 255, np.uint8)
    for tag_id, left in ((300, 280), (7, 60)):
        tag = tag_image(tag_id, 14, quiet_modules=0)
        image[80 : 80 + tag.shape[0], left : left + tag.shape[1]] = tag[..., None]
    path = tmp_path / "two.png"
    cv2.imwrite(str(path), image)
    low, high = 59.5, 59.5 + 8 * 14
    return str(path), [[low, 79.5], [high, 79.5], [high, 79.5 + 112], [low, 79.5 + 112]]


@pytest.mark.parametrize("engine", ["auto", "apriltag", "aruco"])
def test_json_output_has_ids_and_corners_of_each_image(tag_image_file: tuple[str, list[list[float]]], engine: str) -> None:
    path, corners = tag_image_file
    done = lupin(path, path, "--json", "--engine", engine)
    assert (done.returncode, done.stderr) == (0, "")
    first, second = json.loads(done.stdout)
    assert first == second
    assert (first["image"], first["width"], first["height"]) == (path, 500, 300)
    assert [tag["id"] for tag in first["tags"]] == [7, 300]
    assert np.abs(np.array(first["tags"][0]["corners"]) - corners).max() < 0.1


def test_table_names_the_corners(tag_image_file: tuple[str, list[list[float]]]) -> None:
    path, _ = tag_image_file
    done = lupin(path)
    assert done.returncode == 0
    for text in (f"{path}: 2 tags, 500 x 300 pixels", "top-left", "bottom-left", "59.", "300"):
        assert text in done.stdout


def test_image_without_tags_is_no_failure(tmp_path: Path) -> None:
    path = tmp_path / "empty.png"
    cv2.imwrite(str(path), np.full((60, 80), 200, np.uint8))
    done = lupin(str(path))
    assert (done.returncode, done.stderr) == (0, "")
    assert "0 tags" in done.stdout


def test_picture_of_a_pixel_per_module_gets_a_hint(tmp_path: Path) -> None:
    path = tmp_path / "official.png"
    cv2.imwrite(str(path), tag_image(7, 1))
    done = lupin(str(path))
    assert (done.returncode, done.stderr) == (0, "")
    assert "0 tags, 10 x 10 pixels" in done.stdout
    assert "too small for a tag, which needs at least 30 x 30; enlarge it without smoothing" in done.stdout
    assert "too small" in json.loads(lupin("--json", str(path)).stdout)[0]["hint"]


def test_unreadable_image_is_named_and_the_others_are_read(
    tag_image_file: tuple[str, list[list[float]]], tmp_path: Path
) -> None:
    path, _ = tag_image_file
    text = tmp_path / "notes.png"
    text.write_text("no picture")
    done = lupin(str(tmp_path / "gone.png"), str(text), path, "--json")
    assert done.returncode == 1
    gone, notes, good = json.loads(done.stdout)
    assert "No such file" in gone["error"] and gone["tags"] == []
    assert "is no PNG" in notes["error"]
    assert len(good["tags"]) == 2 and "error" not in good
    assert "gone.png: cannot be read" in done.stderr


CALIBRATION = """image_width: 640
image_height: 480
camera_name: front
camera_matrix: {rows: 3, cols: 3, data: [554.254691191187, 0, 319.5, 0, 554.254691191187, 239.5, 0, 0, 1]}
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""


def test_pose_is_in_the_cameras_frame_at_any_image_size(tag_views: ModuleType, tmp_path: Path) -> None:
    """The calibration was made with images of 640 x 480; the second image is twice as large."""
    place = np.array([0.15, -0.1, 0.9])
    view = tag_views.render(12, tag_views.tag_rotation(0.4), place, np.random.default_rng(1))
    cv2.imwrite(str(tmp_path / "small.png"), view.image)
    cv2.imwrite(str(tmp_path / "large.png"), cv2.resize(view.image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC))
    (tmp_path / "front.yaml").write_text(CALIBRATION)
    images = [str(tmp_path / "small.png"), str(tmp_path / "large.png")]
    done = lupin(*images, "--pose", "--camera", str(tmp_path / "front.yaml"), "--json")
    assert (done.returncode, done.stderr) == (0, "")
    for result in json.loads(done.stdout):
        (tag,) = result["tags"]
        assert np.abs(np.array(tag["pose"]["position"]) - place).max() < 0.01
        x, y, z, w = tag["pose"]["orientation"]
        outward = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        assert outward @ view.rotation[:, 2] > np.cos(0.05)
    table = lupin(images[0], "--pose", "--edge", "0.2")
    assert "assumed camera" in table.stderr and "position, m" in table.stdout and "1.8" in table.stdout


def test_annotated_copies_outline_the_tags(tag_image_file: tuple[str, list[list[float]]], tmp_path: Path) -> None:
    path, corners = tag_image_file
    done = lupin(path, "--annotate", str(tmp_path / "new" / "copies"), "--json")
    assert (done.returncode, done.stderr) == (0, "")
    (result,) = json.loads(done.stdout)
    assert result["annotated"] == str(tmp_path / "new" / "copies" / "two.png")
    before, copy = cv2.imread(path), cv2.imread(result["annotated"])
    assert before is not None and copy is not None and before.shape == copy.shape
    colored = np.abs(copy.astype(int) - before).max(axis=2) > 60
    for (x1, y1), (x2, y2) in zip(corners, [*corners[1:], corners[0]]):
        assert colored[round((y1 + y2) / 2), round((x1 + x2) / 2)], "an outline passes between two corners"
    assert not colored[10:60].any()


def test_copies_that_would_replace_something_are_refused(tag_image_file: tuple[str, list[list[float]]], tmp_path: Path) -> None:
    path, _ = tag_image_file
    before = Path(path).read_bytes()
    itself = lupin(path, "--annotate", str(tmp_path))
    assert itself.returncode == 2 and "would replace the image itself" in itself.stderr
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "two.jpg").write_bytes(before)
    both = lupin(path, str(tmp_path / "other" / "two.jpg"), "--annotate", str(tmp_path / "copies"))
    assert both.returncode == 2 and "would both be written" in both.stderr
    assert Path(path).read_bytes() == before and not (tmp_path / "copies").exists()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "expected a calibration"),
        ("a: [", "not YAML"),
        ("image_width: 640\n", "camera_matrix: expected an entry data"),
        (CALIBRATION.replace("[554.254691191187, 0", "[-1, 0"), "focal lengths above 0"),
        (CALIBRATION.replace("239.5", ".nan"), "camera_matrix: expected finite numbers"),
        (CALIBRATION.replace("image_width: 640", "image_width: wide"), "image_width: expected pixels, found 'wide'"),
        (CALIBRATION.replace("[0, 0, 0, 0, 0]", str([0] * 15)), "expected 0 or 4 or 5 or 8 or 12 or 14 numbers, found 15"),
        (CALIBRATION.replace("[0, 0, 0, 0, 0]", "[0, 0, 0]"), "front.yaml:5: distortion_coefficients: expected 0 or 4"),
        (f"{CALIBRATION}distortion_model: equidistant\n", "distortion_coefficients: expected 0 or 4 numbers, found 5"),
        (f"{CALIBRATION}distortion_model: fov\n", "expected plumb_bob, rational_polynomial, equidistant, found 'fov'"),
        (None, "No such file or directory; expected a calibration"),
    ],
)
def test_unusable_calibration_is_named(tmp_path: Path, text: str | None, says: str) -> None:
    if text is not None:
        (tmp_path / "front.yaml").write_text(text)
    done = CliRunner().invoke(app, ["detect", "x.png", "--pose", "--camera", str(tmp_path / "front.yaml")])
    assert done.exit_code == 2
    assert says in done.stderr and "front.yaml" in done.stderr


def test_other_families_are_found_by_name(tmp_path: Path) -> None:
    """The same picture has a tag of each family; OpenCV draws the second."""
    drawn = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_25h9), 3, 140)
    image = np.full((300, 500), 255, np.uint8)
    image[80:220, 60:200] = drawn
    image[80:192, 300:412] = tag_image(7, 14, quiet_modules=0)
    cv2.imwrite(str(tmp_path / "both.png"), image)
    for family, expected in (("tag25h9", 3), ("tag36h11", 7), ("tag16h5", None)):
        done = lupin(str(tmp_path / "both.png"), "--family", family, "--json")
        assert done.returncode == 0, done.stderr
        assert [tag["id"] for tag in json.loads(done.stdout)[0]["tags"]] == ([expected] if expected else [])


@pytest.mark.parametrize(
    "arguments",
    [(), ("--engine", "sift", "x.png"), ("--nonsense",), ("x.png", "--family", "tag9"), ("x.png", "--pose", "--edge", "0")],
)
def test_usage_error_exits_2(arguments: tuple[Any, ...]) -> None:
    assert CliRunner().invoke(app, ["detect", *arguments]).exit_code == 2


def test_aruco_engine_refuses_other_families() -> None:
    done = CliRunner().invoke(app, ["detect", "x.png", "--engine", "aruco", "--family", "tag25h9"])
    assert done.exit_code == 2 and "finds tag36h11 only" in done.stderr
