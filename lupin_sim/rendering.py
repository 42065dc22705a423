"""Pictures and films of a world, with shadows and antialiasing, from fixed, following and onboard cameras."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_sim import robot_model
from lupin_sim.cameras import GraphicsUnavailable
from lupin_sim.engine import Simulation
from lupin_sim.flythrough import HOME, INSPECT, FilmFrame
from lupin_sim.graphics import DISABLED, NO_GRAPHICS
from lupin_sim.scene import PRETTY_LOOK, Look
from lupin_sim.world import World

CAMERAS = ("overview", "top", "follow", "front", "gripper")
_ROBOT_CAMERAS = {"front": robot_model.BODY_CAMERA, "gripper": robot_model.GRIPPER_CAMERA}
PICTURE_TYPES = (".png", ".jpg", ".jpeg")
FILM_TYPES = (".mp4", ".gif")
_PATH_RGBA = np.array([0.10, 0.45, 0.95, 0.9], np.float32)
_FOV_Y_DEG = 45.0  # of MuJoCo's free camera
_FILM_LOOK = Look(shadow_px=2048, samples=4, slices=20, stacks=10, width=960, height=720)

Image = NDArray[np.uint8]
Writer = Callable[[Image], None]


class Renderer:
    """Renders a world with the robot. Use it as a context manager, in one thread."""

    def __init__(self, world: World, look: Look = PRETTY_LOOK) -> None:
        if os.environ.get("MUJOCO_GL") == DISABLED:
            raise GraphicsUnavailable(NO_GRAPHICS)
        self._world = world
        self._simulation = Simulation(world, look=look)
        try:
            self._renderer = mujoco.Renderer(self._simulation.model, look.height, look.width)
        except Exception as error:
            # Without a driver, PyOpenGL raises one of several unrelated errors.
            raise GraphicsUnavailable(f"{NO_GRAPHICS} ({type(error).__name__}: {error})") from error
        self._follow_yaw: float | None = None

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()

    def place(self, pose: Pose2, arm: Sequence[float] = HOME, leds: tuple[int, int, int] = (0, 255, 128)) -> None:
        """Set the robot's pose, arm (rad) and LED color (0..255), without physics."""
        self._simulation.place(pose, arm)
        self._simulation.set_leds(*leds)

    def render(self, camera: str, path: Sequence[Pose2] = ()) -> Image:
        """Return an RGB image of shape (height, width, 3). The free cameras show `path` on the floor. Raises ValueError."""
        if camera in _ROBOT_CAMERAS:
            self._renderer.update_scene(self._simulation.data, camera=_ROBOT_CAMERAS[camera])
        else:
            self._renderer.update_scene(self._simulation.data, camera=self._free_camera(camera))
            self._draw_path(path)
        return np.asarray(self._renderer.render())

    def _free_camera(self, camera: str) -> mujoco.MjvCamera:
        x0, y0, x1, y1 = self._world.bounds
        pose = self._simulation.true_pose
        view = mujoco.MjvCamera()
        aspect = self._renderer.width / self._renderer.height
        tangent = math.tan(math.radians(_FOV_Y_DEG / 2))
        if camera == "follow":
            view.lookat[:] = pose.x + 0.25 * math.cos(pose.yaw), pose.y + 0.25 * math.sin(pose.yaw), 0.22
            view.distance, view.elevation = 1.7, -28.0
            view.azimuth = math.degrees(self._smooth_yaw(pose.yaw)) - 24.0
        elif camera == "top":
            view.lookat[:] = (x0 + x1) / 2, (y0 + y1) / 2, 0.0
            view.azimuth, view.elevation = 90.0, -89.9
            view.distance = 1.12 * max((y1 - y0) / 2 / tangent, (x1 - x0) / 2 / (tangent * aspect))
        elif camera == "overview":
            # From a long side of the world, which then spans the width of the picture.
            tall = y1 - y0 > x1 - x0
            across, away = (y1 - y0, x1 - x0) if tall else (x1 - x0, y1 - y0)
            view.lookat[:] = (x0 + x1) / 2 - 0.06 * away * tall, (y0 + y1) / 2 - 0.06 * away * (not tall), 0.0
            view.azimuth, view.elevation = 22.0 if tall else 68.0, -46.0
            view.distance = 1.04 * max(away / 2 / tangent, across / 2 / (tangent * aspect)) + 1.2
        else:
            raise ValueError(f"unknown camera {camera!r}; expected one of: {', '.join(CAMERAS)}")
        return view

    def _smooth_yaw(self, yaw: float) -> float:
        """Return the low-pass filtered yaw, so that the following camera turns smoothly."""
        if self._follow_yaw is None:
            self._follow_yaw = yaw
        self._follow_yaw += 0.06 * wrap_angle(yaw - self._follow_yaw)
        return self._follow_yaw

    def _draw_path(self, path: Sequence[Pose2]) -> None:
        scene = self._renderer.scene
        for one, two in pairwise(path):
            if scene.ngeom >= scene.maxgeom or math.hypot(one.x - two.x, one.y - two.y) < 1e-6:
                continue
            geom = scene.geoms[scene.ngeom]
            mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), np.zeros(9), _PATH_RGBA)
            mujoco.mjv_connector(
                geom,
                mujoco.mjtGeom.mjGEOM_CAPSULE,
                0.012,
                np.array([one.x, one.y, 0.012]),
                np.array([two.x, two.y, 0.012]),
            )
            scene.ngeom += 1


def picture(world: World, out: Path, camera: str = "overview", frames: Sequence[FilmFrame] = ()) -> None:
    """Write a picture of a world; the suffix of `out` selects PNG or JPEG.

    With `frames` the robot is at their end, and its path is drawn. Without, it is at the start; for its own cameras it is half
    a meter in front of the first tag. Raises ValueError for an unknown camera or file type, GraphicsUnavailable without OpenGL,
    OSError if the file cannot be written.
    """
    _check_arguments(camera, out, PICTURE_TYPES)
    with Renderer(world) as renderer:
        if frames:
            renderer.place(frames[-1].pose, frames[-1].arm, frames[-1].leds)
        elif camera in _ROBOT_CAMERAS and world.tags:
            tag = world.tags[0]
            renderer.place(Pose2(*tag.pose.apply(0.5, 0.0), wrap_angle(tag.yaw + math.pi)), INSPECT, (180, 0, 255))
        else:
            renderer.place(world.start)
        image = renderer.render(camera, _thin_out([frame.pose for frame in frames]))
    if not cv2.imwrite(str(out), cv2.cvtColor(image, cv2.COLOR_RGB2BGR)):
        raise OSError(f"{out} could not be written")


def film(
    world: World,
    out: Path,
    frames: Sequence[FilmFrame],
    rate_hz: float,
    camera: str = "follow",
    progress: Callable[[float], None] = lambda _: None,
) -> None:
    """Write a film of a drive, with the images of the robot's cameras in the corners; the suffix of `out` selects MP4 or GIF.

    `progress` gets the share of frames that are drawn, from 0 to 1.
    Raises like `picture`.
    """
    _check_arguments(camera, out, FILM_TYPES)
    if not frames:
        raise ValueError("a film needs at least one frame")
    with Renderer(world, _FILM_LOOK) as renderer, _writer(out, rate_hz) as write:
        for index, frame in enumerate(frames):
            renderer.place(frame.pose, frame.arm, frame.leds)
            image = renderer.render(camera, _thin_out([f.pose for f in frames[: index + 1]]))
            image = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
            for corner, name in enumerate(_ROBOT_CAMERAS):
                _paste(image, cv2.cvtColor(renderer.render(name), cv2.COLOR_RGB2BGR), corner)
            write(image)
            progress((index + 1) / len(frames))


def _check_arguments(camera: str, out: Path, types: Sequence[str]) -> None:
    if camera not in CAMERAS:
        raise ValueError(f"unknown camera {camera!r}; expected one of: {', '.join(CAMERAS)}")
    if out.suffix.lower() not in types:
        raise ValueError(f"{out}: the name must end in {' or '.join(types)}")


def _thin_out(path: Sequence[Pose2], step_m: float = 0.05) -> list[Pose2]:
    thinned: list[Pose2] = []
    for pose in path:
        if not thinned or pose.distance_to(thinned[-1]) >= step_m:
            thinned.append(pose)
    return thinned


def _paste(image: Image, small: Image, corner: int) -> None:
    height, width = image.shape[0] // 4, image.shape[1] // 4
    scaled = cv2.resize(small, (width, height), interpolation=cv2.INTER_AREA)
    x = 12 if corner == 0 else image.shape[1] - width - 12
    image[12 : 12 + height, x : x + width] = scaled
    cv2.rectangle(image, (x - 1, 11), (x + width, 12 + height), (245, 245, 245), 1)


@contextmanager
def _writer(out: Path, rate_hz: float) -> Iterator[Writer]:
    if out.suffix.lower() == ".gif":
        animation = cv2.Animation()
        images: list[Image] = []
        yield lambda image: images.append(cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
        animation.frames = images
        animation.durations = [round(1000.0 / rate_hz)] * len(images)
        if not cv2.imwriteanimation(str(out), animation):
            raise OSError(f"{out} could not be written")
        return
    video: cv2.VideoWriter | None = None

    def write(image: Image) -> None:
        nonlocal video
        if video is None:
            size = (image.shape[1], image.shape[0])
            video = cv2.VideoWriter(str(out), cv2.VideoWriter.fourcc(*"mp4v"), rate_hz, size)
            if not video.isOpened():
                raise OSError(f"{out} could not be written")
        video.write(image)

    try:
        yield write
    finally:
        if video is not None:
            video.release()
