"""Finds the robot's cameras as the vendor's launch files do, and the command that starts the vendor's driver of each."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.cameras.configuration import CameraConfiguration

BODY, GRIPPER = "body", "gripper"
# The names that the drivers of the vendor's gripper cameras report.
GRIPPER_NAMES = ("HD Camera: HD Camera", "USB 2.0 PC Cam")
_ORBBEC = "2bc5"  # USB vendor id


@dataclass(frozen=True)
class Camera:
    """A connected camera: its device files, and the command that runs its driver."""

    devices: tuple[Path, ...]
    command: tuple[str, ...]


def find_camera(kind: str, configuration: CameraConfiguration, root: Path = Path("/")) -> Camera | None:
    """Find the camera BODY or GRIPPER; None if it is not connected. `root` is the folder that contains /dev and /sys."""
    return _find_body(configuration, root) if kind == BODY else _find_gripper(configuration, root)


def is_enabled(kind: str, configuration: CameraConfiguration) -> bool:
    """Return whether the camera is switched on in the configuration."""
    return configuration.color.enabled or configuration.depth.enabled if kind == BODY else configuration.gripper.enabled


def _find_body(configuration: CameraConfiguration, root: Path) -> Camera | None:
    """Find the depth camera. The links that the vendor's udev rules make in /dev show which of the two models it is."""
    links = {path.name for path in (root / "dev").glob("astra*")}
    if {"astradepth", "astrauvc"} <= links:
        launch = ("astra_camera", "astra_pro_plus.launch.xml")
    elif "astra_mini_pro" in links:
        launch = ("orbbec_camera", "astra.launch.py")
    else:
        return None
    color, depth = configuration.color, configuration.depth
    arguments = {
        "enable_color": color.enabled,
        "color_width": color.width,
        "color_height": color.height,
        "color_fps": color.fps,
        "enable_depth": depth.enabled,
        "depth_fps": depth.fps,
        "enable_point_cloud": configuration.point_cloud.enabled,
    }
    written = (f"{name}:={str(value).lower()}" for name, value in arguments.items())
    return Camera(_orbbec_devices(root), ("ros2", "launch", *launch, *written))


def _find_gripper(configuration: CameraConfiguration, root: Path) -> Camera | None:
    """Find the first camera with a known name. Of a camera's device files, the one with index 0 delivers the images."""
    found = []
    for folder in (root / "sys/class/video4linux").glob("video*"):
        number = folder.name.removeprefix("video")
        if number.isdecimal() and _text(folder / "name") in GRIPPER_NAMES and _text(folder / "index") in ("0", ""):
            found.append(int(number))
    if not found:
        return None
    device = root / f"dev/video{min(found)}"
    gripper = configuration.gripper
    parameters = {
        "video_device": f"/dev/{device.name}",
        "image_width": gripper.width,
        "image_height": gripper.height,
        "framerate": gripper.framerate,
        "pixel_format": gripper.pixel_format,
    }
    command = ["ros2", "run", "usb_cam", "usb_cam_node_exe", "--ros-args"]
    command += ["-r", "__ns:=/gripper_camera", "-r", "__node:=gripper_camera"]
    for name, value in parameters.items():
        command += ["-p", f"{name}:={value}"]
    return Camera((device,), tuple(command))


def _orbbec_devices(root: Path) -> tuple[Path, ...]:
    """Return the device files of the depth camera: the udev links' targets, and those on the USB bus."""
    found = [path.resolve() for path in sorted((root / "dev").glob("astra*"))]
    for folder in sorted((root / "sys/bus/usb/devices").glob("*")):
        bus, device = _text(folder / "busnum"), _text(folder / "devnum")
        if _text(folder / "idVendor") == _ORBBEC and re.fullmatch(r"\d+", bus) and re.fullmatch(r"\d+", device):
            found.append(root / f"dev/bus/usb/{int(bus):03d}/{int(device):03d}")
    return tuple(dict.fromkeys(found))


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""
