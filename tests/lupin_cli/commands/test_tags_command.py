"""`lupin tags detect`: JSON, table and exit status."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from lupin_runtime.apriltag import tag_image


def lupin(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "lupin_cli.app", "tags", "detect", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


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
    assert "not an image that OpenCV can read" in notes["error"]
    assert len(good["tags"]) == 2 and "error" not in good
    assert "gone.png: cannot be read" in done.stderr


@pytest.mark.parametrize("arguments", [(), ("--engine", "sift", "x.png"), ("--nonsense",)])
def test_usage_error_exits_2(arguments: tuple[Any, ...]) -> None:
    assert lupin(*arguments).returncode == 2
