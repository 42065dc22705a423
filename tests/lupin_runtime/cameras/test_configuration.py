"""`/etc/lupin/cameras.yaml`: defaults, and errors that name the key."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.cameras.configuration import CameraConfiguration, Color, Depth, Gripper, PointCloud, read_configuration


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "cameras.yaml"


@pytest.mark.parametrize("content", [None, "", "# nothing\n", "color: {}\n"])
def test_omitted_keys_have_default_values(file: Path, content: str | None) -> None:
    if content is not None:
        file.write_text(content)
    assert read_configuration(file) == CameraConfiguration(
        Color(True, 640, 480, 30), Depth(False, 10), PointCloud(False), Gripper(True, 640, 480, 20.0, "yuyv2rgb")
    )


def test_configured_values_are_used(file: Path) -> None:
    file.write_text(
        "color: {fps: 10}\ndepth: {enabled: true}\npoint_cloud: {enabled: true}\n"
        "gripper: {framerate: 15, pixel_format: mjpeg2rgb, width: 320, height: 240}\n"
    )
    read = read_configuration(file)
    assert read == CameraConfiguration(Color(fps=10), Depth(True), PointCloud(True), Gripper(True, 320, 240, 15.0, "mjpeg2rgb"))
    assert isinstance(read.gripper.framerate, float), "the driver accepts no integer"


@pytest.mark.parametrize(
    ("content", "expected_text"),
    [
        ("colour: {}", "colour"),
        ("color: {rate: 1}", "rate"),
        ("color: 7", "color: expected keys"),
        ("[]", "expected keys"),
        ("color: {fps: 0}", "color.fps must be a whole number from 1 to 60"),
        ("color: {fps: 30.5}", "color.fps"),
        ("color: {fps: true}", "color.fps"),
        ("color: {enabled: 1}", "color.enabled must be true or false"),
        ("gripper: {framerate: .nan}", "gripper.framerate"),
        ("gripper: {pixel_format: 'rgb; reboot'}", "gripper.pixel_format must be one of"),
        ("point_cloud: {enabled: true}", "point_cloud.enabled needs depth.enabled"),
        ("color: {", ":1: not YAML"),
        ("!!python/object/apply:os.system ['true']", "not YAML"),
        ("a: " + "[" * 5000, "not YAML"),
    ],
)
def test_errors_name_the_file_and_the_problem(file: Path, content: str, expected_text: str) -> None:
    file.write_text(content)
    with pytest.raises(MalformedFile) as raised:
        read_configuration(file)
    assert str(file) in str(raised.value) and expected_text in str(raised.value)


@given(st.binary(max_size=300))
def test_random_bytes_give_defaults_or_malformed_file(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    file = tmp_path_factory.mktemp("any") / "cameras.yaml"
    file.write_bytes(content)
    try:
        assert read_configuration(file) == CameraConfiguration()
    except MalformedFile:
        return
