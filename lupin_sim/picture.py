"""Pictures and films of a world for people: shadows, smooth edges, a camera that follows."""

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
from lupin_sim import body
from lupin_sim.cameras import GraphicsUnavailable
from lupin_sim.engine import Simulation
from lupin_sim.graphics import DISABLED, NO_GRAPHICS
from lupin_sim.scene import PRETTY_LOOK, Look
from lupin_sim.tour import HOME, INSPECT, Frame
from lupin_sim.world import World

CAMERAS = ("overview", "top", "follow", "front", "gripper")
_ON_ROBOT = {"front": body.BODY_CAMERA, "gripper": body.GRIPPER_CAMERA}
PICTURE_TYPES = (".png", ".jpg", ".jpeg")
FILM_TYPES = (".mp4", ".gif")
_PATH_RGBA = np.array([0.10, 0.45, 0.95, 0.9], np.float32)
_FOV_Y_DEG = 45.0  # MuJoCo's free camera
_FILM_LOOK = Look(shadow_px=2048, samples=4, slices=20, stacks=10, width=960, height=720)

Image = NDArray[np.uint8]
Writer = Callable[[Image], None]


class Studio:
    """A world with the robot in it and a renderer; use as a context manager, in one thread."""

    def __init__(self, world: World, look: Look = PRETTY_LOOK) -> None:
        if os.environ.get("MUJOCO_GL") == DISABLED:
            raise GraphicsUnavailable(NO_GRAPHICS)
        self._world = world
        self._simulation = Simulation(world, look=look)
        try:
            self._renderer = mujoco.Renderer(self._simulation.model, look.height, look.width)
        except Exception as error:
            # PyOpenGL raises whatever the driver's absence trips over.
            raise GraphicsUnavailable(f"{NO_GRAPHICS} ({type(error).__name__}: {error})") from error
        self._follow_yaw: float | None = None

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()

    def place(self, pose: Pose2, arm: Sequence[float] = HOME, leds: tuple[int, int, int] = (0, 255, 128)) -> None:
        """Stand the robot somewhere, without physics."""
        self._simulation.place(pose, arm)
        self._simulation.set_leds(*leds)

    def shoot(self, camera: str, path: Sequence[Pose2] = ()) -> Image:
        """A picture, RGB of shape (height, width, 3), with a driven path drawn on the floor."""
        if camera in _ON_ROBOT:
            self._renderer.update_scene(self._simulation.data, camera=_ON_ROBOT[camera])
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
            # From a long side, which lies across the picture.
            tall = y1 - y0 > x1 - x0
            across, away = (y1 - y0, x1 - x0) if tall else (x1 - x0, y1 - y0)
            view.lookat[:] = (x0 + x1) / 2 - 0.06 * away * tall, (y0 + y1) / 2 - 0.06 * away * (not tall), 0.0
            view.azimuth, view.elevation = 22.0 if tall else 68.0, -46.0
            view.distance = 1.04 * max(away / 2 / tangent, across / 2 / (tangent * aspect)) + 1.2
        else:
            raise ValueError(f"no camera {camera!r}; there are {', '.join(CAMERAS)}")
        return view

    def _smooth_yaw(self, yaw: float) -> float:
        """The follower turns after the robot, not with it."""
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


def picture(world: World, out: Path, camera: str = "overview", frames: Sequence[Frame] = ()) -> None:
    """Write one picture of a world (PNG or JPEG by the name of `out`). With `frames` the robot stands at their end and its
    path is drawn; else it stands at the start, or, for the cameras that it carries, half a metre in front of the first tag.

    Raises ValueError for a camera or a file type that does not exist, GraphicsUnavailable without OpenGL.
    """
    _check(camera, out, PICTURE_TYPES)
    with Studio(world) as studio:
        if frames:
            studio.place(frames[-1].pose, frames[-1].arm, frames[-1].leds)
        elif camera in _ON_ROBOT and world.tags:
            tag = world.tags[0]
            studio.place(Pose2(*tag.pose.apply(0.5, 0.0), wrap_angle(tag.yaw + math.pi)), INSPECT, (180, 0, 255))
        else:
            studio.place(world.start)
        image = studio.shoot(camera, _thinned([frame.pose for frame in frames]))
    if not cv2.imwrite(str(out), cv2.cvtColor(image, cv2.COLOR_RGB2BGR)):
        raise OSError(f"could not write {out}")


def film(world: World, out: Path, frames: Sequence[Frame], rate_hz: float, camera: str = "follow") -> None:
    """Write a film of a drive (MP4 or GIF by the name of `out`), with what the robot's two cameras see in the corners.

    Raises as `picture` does.
    """
    _check(camera, out, FILM_TYPES)
    if not frames:
        raise ValueError("a film needs at least one frame")
    with Studio(world, _FILM_LOOK) as studio, _writer(out, rate_hz) as write:
        for index, frame in enumerate(frames):
            studio.place(frame.pose, frame.arm, frame.leds)
            image = studio.shoot(camera, _thinned([f.pose for f in frames[: index + 1]]))
            image = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
            for corner, name in enumerate(_ON_ROBOT):
                _inset(image, cv2.cvtColor(studio.shoot(name), cv2.COLOR_RGB2BGR), corner)
            write(image)


def _check(camera: str, out: Path, types: Sequence[str]) -> None:
    if camera not in CAMERAS:
        raise ValueError(f"no camera {camera!r}; there are {', '.join(CAMERAS)}")
    if out.suffix.lower() not in types:
        raise ValueError(f"{out}: the name must end in {' or '.join(types)}")


def _thinned(path: Sequence[Pose2], step_m: float = 0.05) -> list[Pose2]:
    kept: list[Pose2] = []
    for pose in path:
        if not kept or pose.distance_to(kept[-1]) >= step_m:
            kept.append(pose)
    return kept


def _inset(image: Image, small: Image, corner: int) -> None:
    height, width = image.shape[0] // 4, image.shape[1] // 4
    scaled = cv2.resize(small, (width, height), interpolation=cv2.INTER_AREA)
    x = 12 if corner == 0 else image.shape[1] - width - 12
    image[12 : 12 + height, x : x + width] = scaled
    cv2.rectangle(image, (x - 1, 11), (x + width, 12 + height), (245, 245, 245), 1)


@contextmanager
def _writer(out: Path, rate_hz: float) -> Iterator[Writer]:
    if out.suffix.lower() == ".gif":
        animation = cv2.Animation()
        kept: list[Image] = []
        yield lambda image: kept.append(cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
        animation.frames = kept
        animation.durations = [round(1000.0 / rate_hz)] * len(kept)
        if not cv2.imwriteanimation(str(out), animation):
            raise OSError(f"could not write {out}")
        return
    video: cv2.VideoWriter | None = None

    def write(image: Image) -> None:
        nonlocal video
        if video is None:
            size = (image.shape[1], image.shape[0])
            video = cv2.VideoWriter(str(out), cv2.VideoWriter.fourcc(*"mp4v"), rate_hz, size)
            if not video.isOpened():
                raise OSError(f"could not write {out}")
        video.write(image)

    try:
        yield write
    finally:
        if video is not None:
            video.release()
