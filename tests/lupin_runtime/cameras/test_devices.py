"""Finds the connected cameras by the names that the kernel and the vendor's udev rules give them."""

from __future__ import annotations

from pathlib import Path

import pytest

from lupin_runtime.cameras.configuration import CameraConfiguration, Color, Depth, Gripper
from lupin_runtime.cameras.devices import BODY, GRIPPER, find_camera, is_enabled

DEFAULT = CameraConfiguration()


def plug_gripper(root: Path, number: int, name: str = "HD Camera: HD Camera", index: str = "0") -> None:
    folder = root / f"sys/class/video4linux/video{number}"
    folder.mkdir(parents=True)
    (folder / "name").write_text(f"{name}\n")
    (folder / "index").write_text(f"{index}\n")


def plug_body(root: Path, *links: str) -> None:
    usb = root / "sys/bus/usb/devices/1-1"
    usb.mkdir(parents=True)
    for name, text in (("idVendor", "2bc5"), ("busnum", "1"), ("devnum", "7")):
        (usb / name).write_text(f"{text}\n")
    (root / "dev/bus/usb/001").mkdir(parents=True)
    device = root / "dev/bus/usb/001/007"
    device.touch()
    for link in links:
        (root / "dev" / link).symlink_to(device)


def test_machine_without_cameras_has_none(tmp_path: Path) -> None:
    assert find_camera(BODY, DEFAULT, tmp_path) is None and find_camera(GRIPPER, DEFAULT, tmp_path) is None


@pytest.mark.parametrize("name", ["HD Camera: HD Camera", "USB 2.0 PC Cam"])
def test_gripper_camera_is_found_by_its_name(tmp_path: Path, name: str) -> None:
    plug_gripper(tmp_path, 0, "cedrus")
    plug_gripper(tmp_path, 11, name)
    plug_gripper(tmp_path, 4, name)
    plug_gripper(tmp_path, 3, name, index="1")  # another device file of the same camera, without images
    plug_gripper(tmp_path, 2, "Astra Pro HD Camera: Astra Pro")
    found = find_camera(GRIPPER, CameraConfiguration(gripper=Gripper(True, 320, 240, 15.0, "mjpeg2rgb")), tmp_path)
    assert found is not None and found.devices == (tmp_path / "dev/video4",)
    command = " ".join(found.command)
    assert command.startswith("ros2 run usb_cam usb_cam_node_exe --ros-args -r __ns:=/gripper_camera -r __node:=gripper_camera")
    for parameter in ("video_device:=/dev/video4", "image_width:=320", "framerate:=15.0", "pixel_format:=mjpeg2rgb"):
        assert f"-p {parameter}" in command


@pytest.mark.parametrize(
    ("links", "launch"),
    [
        (("astradepth", "astrauvc"), "ros2 launch astra_camera astra_pro_plus.launch.xml"),
        (("astra_mini_pro",), "ros2 launch orbbec_camera astra.launch.py"),
    ],
)
def test_body_camera_is_found_by_its_links(tmp_path: Path, links: tuple[str, ...], launch: str) -> None:
    plug_body(tmp_path, *links)
    found = find_camera(BODY, CameraConfiguration(color=Color(fps=10), depth=Depth(True, 7)), tmp_path)
    assert found is not None and found.devices == (tmp_path / "dev/bus/usb/001/007",)
    command = " ".join(found.command)
    assert command.startswith(launch)
    for argument in ("color_fps:=10", "enable_color:=true", "enable_depth:=true", "depth_fps:=7", "enable_point_cloud:=false"):
        assert argument in command


def test_incomplete_body_camera_is_not_found(tmp_path: Path) -> None:
    plug_body(tmp_path, "astradepth")
    assert find_camera(BODY, DEFAULT, tmp_path) is None


def test_cameras_may_be_switched_off() -> None:
    assert is_enabled(BODY, DEFAULT) and is_enabled(GRIPPER, DEFAULT)
    assert not is_enabled(BODY, CameraConfiguration(color=Color(enabled=False)))
    assert is_enabled(BODY, CameraConfiguration(color=Color(enabled=False), depth=Depth(True)))
    assert not is_enabled(GRIPPER, CameraConfiguration(gripper=Gripper(enabled=False)))
