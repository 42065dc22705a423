"""Images of tags as a camera would see them, with the true corners and the true pose; for tests and benchmarks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.apriltag import tag_image

WIDTH, HEIGHT = 640, 480
FOCAL_PX = 554.254691191187
CAMERA = np.array([[FOCAL_PX, 0.0, 319.5], [0.0, FOCAL_PX, 239.5], [0.0, 0.0, 1.0]])
EDGE_M = 0.1
SUPERSAMPLING = 4


@dataclass(frozen=True)
class View:
    """A gray image of one tag, with its true corners TL, TR, BR, BL in pixels (pixel centers are whole numbers) and pose."""

    image: NDArray[np.uint8]
    tag_id: int
    corners: NDArray[np.float64]
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]


def rectangles(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a random background of gray rectangles with shading."""
    image = np.full((HEIGHT, WIDTH), rng.integers(90, 170), np.float32)
    for _ in range(14):
        x, y = rng.integers(0, WIDTH), rng.integers(0, HEIGHT)
        w, h = rng.integers(20, 260), rng.integers(20, 200)
        cv2.rectangle(image, (int(x), int(y)), (int(x + w), int(y + h)), float(rng.integers(40, 220)), -1)
    image *= np.linspace(rng.uniform(0.8, 1.0), rng.uniform(0.8, 1.0), WIDTH, dtype=np.float32)
    return np.clip(image, 0, 255).astype(np.uint8)


def to_gray(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Return the values as the pixels of a gray image."""
    return np.asarray(np.clip(values, 0, 255), np.uint8)


def octaves(rng: np.random.Generator, coarsest_px: int = 128, finest_px: int = 2, decay: float = 0.7) -> NDArray[np.float32]:
    """Return noise of several octaves, mean 0 and standard deviation 1: soil, gravel, plaster."""
    total, weight = np.zeros((HEIGHT, WIDTH), np.float32), 1.0
    cell = coarsest_px
    while cell >= finest_px:
        coarse = rng.normal(0, 1, (HEIGHT // cell + 2, WIDTH // cell + 2)).astype(np.float32)
        total += weight * cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
        weight, cell = weight * decay, cell // 2
    return np.asarray((total - total.mean()) / total.std(), np.float32)


def soil(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a background of noise in all sizes, the finest as strong as in a sharp photograph of gravel."""
    return to_gray(rng.uniform(90, 150) + rng.uniform(25, 45) * octaves(rng, decay=0.95))


def leaves(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a background of some hundred overlapping leaves with ribs and their shadows."""
    image = np.full((HEIGHT, WIDTH), rng.integers(20, 60), np.uint8)
    for _ in range(420):
        at = (int(rng.integers(0, WIDTH)), int(rng.integers(0, HEIGHT)))
        long_px = int(rng.integers(10, 46))
        axes, turn = (long_px, max(3, int(long_px * rng.uniform(0.25, 0.5)))), float(rng.uniform(0, 360))
        shade = int(rng.integers(50, 210))
        cv2.ellipse(image, (at[0] + 3, at[1] + 3), axes, turn, 0, 360, max(0, shade - 60), -1, cv2.LINE_AA)
        cv2.ellipse(image, at, axes, turn, 0, 360, shade, -1, cv2.LINE_AA)
        tip = np.array([math.cos(math.radians(turn)), math.sin(math.radians(turn))]) * long_px
        ends = [tuple(int(v) for v in np.array(at) + sign * tip) for sign in (-1, 1)]
        cv2.line(image, ends[0], ends[1], min(255, shade + 40), 1, cv2.LINE_AA)
    return to_gray(image + 10 * octaves(rng))


def bricks(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a background of a brick wall: bricks of several shades, light mortar, rough surfaces."""
    image = np.full((HEIGHT, WIDTH), rng.integers(150, 210), np.float32)
    height_px, width_px, mortar_px = int(rng.integers(14, 34)), int(rng.integers(36, 90)), int(rng.integers(2, 5))
    for row, y in enumerate(range(0, HEIGHT, height_px)):
        for x in range(-(row % 2) * width_px // 2, WIDTH, width_px):
            part = slice(max(0, y), y + height_px - mortar_px), slice(max(0, x), max(0, x + width_px - mortar_px))
            image[part] = rng.integers(50, 130)
    return to_gray(image + 16 * octaves(rng, decay=0.95))


BACKGROUNDS: dict[str, Callable[[np.random.Generator], NDArray[np.uint8]]] = {
    "rectangles": rectangles,
    "soil": soil,
    "leaves": leaves,
    "bricks": bricks,
}
TEXTURED = ("soil", "leaves", "bricks")


def tag_rotation(azimuth_rad: float, tilt_rad: float = 0.0, roll_rad: float = 0.0) -> NDArray[np.float64]:
    """Return the rotation camera_from_tag of an upright tag: turned by azimuth about its vertical axis, tilted, then rolled.

    Tag axes: x right, y up, z out of the marker toward the camera. Camera: x right, y down, z forward.
    """
    facing = np.diag([1.0, -1.0, -1.0])
    ca, sa, ct, st, cr, sr = (f(a) for a in (azimuth_rad, tilt_rad, roll_rad) for f in (math.cos, math.sin))
    yaw = np.array([[ca, 0, sa], [0, 1, 0], [-sa, 0, ca]])
    pitch = np.array([[1, 0, 0], [0, ct, -st], [0, st, ct]])
    roll = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
    return np.asarray(facing @ yaw @ pitch @ roll)


def render(
    tag_id: int,
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
    rng: np.random.Generator,
    blur_px: float = 0.7,
    noise: float = 4.0,
    contrast: tuple[float, float] = (25.0, 230.0),
    edge_m: float = EDGE_M,
    background: str = "rectangles",
    motion_px: int = 0,
) -> View:
    """Render one tag in front of a random background: super-sampled, then blurred, then with noise.

    `motion_px` is the length of a horizontal motion blur, about which the true corners are centered.
    """
    art = tag_image(tag_id, 24)
    art_edge_m = edge_m * 10 / 8
    corners_m = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * 0.5

    def project(size_m: float) -> NDArray[np.float64]:
        points = (rotation @ (corners_m * size_m).T).T + translation
        pixels = (CAMERA @ points.T).T
        return np.asarray(pixels[:, :2] / pixels[:, 2:])

    s = SUPERSAMPLING
    # In the super-sampled image, the pixel center x lies at s * x + (s - 1) / 2.
    plate_px = project(art_edge_m) * s + (s - 1) / 2
    n = art.shape[0]
    art_px = np.array([[-0.5, -0.5], [n - 0.5, -0.5], [n - 0.5, n - 0.5], [-0.5, n - 0.5]], np.float32)
    warp = cv2.getPerspectiveTransform(art_px, plate_px.astype(np.float32))
    size = (WIDTH * s, HEIGHT * s)
    low, high = contrast
    shown = cv2.warpPerspective(art, warp, size, flags=cv2.INTER_LINEAR).astype(np.float32)
    mask = cv2.warpPerspective(np.full_like(art, 255), warp, size, flags=cv2.INTER_NEAREST)
    shown = cv2.resize((low + shown * (high - low) / 255.0) * (mask > 0), (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    cover = cv2.resize(mask.astype(np.float32) / 255.0, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    image = BACKGROUNDS[background](rng) * (1 - cover) + shown
    if blur_px > 0:
        image = cv2.GaussianBlur(image, (0, 0), blur_px)
    if motion_px > 1:
        image = cv2.blur(image, (motion_px | 1, 1))
    image = image + rng.normal(0, noise, image.shape)
    gray = np.clip(np.round(image), 0, 255).astype(np.uint8)
    return View(gray, tag_id, project(edge_m), rotation, translation)


def at_range(
    tag_id: int, range_m: float, azimuth_rad: float, rng: np.random.Generator, tilt_rad: float = 0.0, **options: Any
) -> View:
    """Render a view from a distance of `range_m`, at `azimuth_rad` to the tag's normal, at a random position in the image."""
    bearing, elevation = rng.uniform(-0.35, 0.35), rng.uniform(-0.2, 0.2)
    direction = np.array([math.tan(bearing), math.tan(elevation), 1.0])
    translation = range_m * direction / np.linalg.norm(direction)
    # The azimuth is measured from the line of sight, not from the optical axis.
    rotation = tag_rotation(azimuth_rad - bearing, tilt_rad)
    return render(tag_id, rotation, translation, rng, **options)
