"""The box of plants behind a tag, a rectangle in the map, and where a bearing of the arm's camera meets it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lupin_runtime.geometry import Pose2
from lupin_runtime.json_text import parse_json
from lupin_runtime.transforms import Quaternion, Vector

Point2 = tuple[float, float]

# The golden ratio's fraction: successive columns get well-spread, deterministic depths (a Weyl sequence).
GOLDEN_FRACTION = 0.6180339887498949


class MalformedBoxes(ValueError):
    """A box geometry message that violates its contract."""


@dataclass(frozen=True)
class BoxSize:
    """Meters: along the front, away from it, and up."""

    width: float = 0.80
    depth: float = 0.40
    height: float = 0.30


@dataclass(frozen=True)
class Box:
    """A rectangle in the map. `origin` is the middle of its front edge, `normal` the unit vector out of that front."""

    origin: Point2
    normal: Point2
    size: BoxSize

    @property
    def lateral(self) -> Point2:
        """Along the front: to the right of an observer who faces the box."""
        return -self.normal[1], self.normal[0]

    @property
    def degenerate(self) -> bool:
        """A box without an area has no footprint, and contains nothing."""
        return not (self.size.width > 0.0 and self.size.depth > 0.0)

    def place(self, fraction: float, depth: float) -> Point2:
        """The point at `fraction` (-1 to 1) along the front and `depth` (0 front, 1 back) into the box."""
        (lx, ly), (nx, ny) = self.lateral, self.normal
        across, into = fraction * self.size.width / 2.0, depth * self.size.depth
        return self.origin[0] + lx * across - nx * into, self.origin[1] + ly * across - ny * into

    def coordinates(self, x: float, y: float) -> tuple[float, float]:
        """(fraction, depth) of a point: the inverse of `place`. Raises ZeroDivisionError for a degenerate box."""
        dx, dy = x - self.origin[0], y - self.origin[1]
        (lx, ly), (nx, ny) = self.lateral, self.normal
        return (dx * lx + dy * ly) / (self.size.width / 2.0), -(dx * nx + dy * ny) / self.size.depth

    def contains(self, x: float, y: float, margin_m: float = 0.0) -> bool:
        """Whether a point lies within the footprint grown by a margin; a degenerate box contains nothing."""
        if self.degenerate:
            return False
        fraction, depth = self.coordinates(x, y)
        slack = margin_m / self.size.depth
        return abs(fraction) <= 1.0 + margin_m / (self.size.width / 2.0) and -slack <= depth <= 1.0 + slack

    def footprint(self) -> tuple[Point2, ...]:
        """Corners front-left, front-right, back-right, back-left; none for a degenerate box."""
        if self.degenerate:
            return ()
        return self.place(1.0, 0.0), self.place(-1.0, 0.0), self.place(-1.0, 1.0), self.place(1.0, 1.0)

    def center(self) -> Pose2:
        """The middle of the box, heading out of its front."""
        x, y = self.place(0.0, 0.5)
        return Pose2(x, y, math.atan2(self.normal[1], self.normal[0]))


def tag_normal(orientation: Quaternion) -> Point2 | None:
    """A tag's +z axis projected onto the floor, unit length; None if it points straight up or down."""
    qx, qy, qz, qw = orientation
    nx, ny = 2.0 * (qx * qz + qw * qy), 2.0 * (qy * qz - qw * qx)
    length = math.hypot(nx, ny)
    return None if length < 1e-6 else (nx / length, ny / length)


def box_from_tag(
    position: Vector, orientation: Quaternion, size: BoxSize, lateral_offset_m: float = 0.0, robot: Point2 | None = None
) -> Box | None:
    """Guess the box behind a tag, with the tag on its front.

    Its normal is the tag's, or if that points up, the direction to the robot; None without either.
    """
    normal = tag_normal(orientation)
    if normal is None and robot is not None:
        dx, dy = robot[0] - position[0], robot[1] - position[1]
        away = math.hypot(dx, dy)
        normal = (dx / away, dy / away) if away > 1e-6 else None
    if normal is None:
        return None
    lx, ly = -normal[1], normal[0]
    return Box((position[0] + lx * lateral_offset_m, position[1] + ly * lateral_offset_m), normal, size)


def box_from_map(center: Pose2, size: BoxSize) -> Box:
    """A registered box: `center` in the map, its yaw out of the front."""
    normal = (math.cos(center.yaw), math.sin(center.yaw))
    half = size.depth / 2.0
    return Box((center.x + normal[0] * half, center.y + normal[1] * half), normal, size)


def read_boxes(text: str) -> dict[str, Box]:
    """Boxes by id of a `/perception/box_geometry_json` message: a list, or an object with `boxes`.

    Raises MalformedBoxes, naming the entry.
    """
    try:
        document = parse_json(text)
    except ValueError as error:
        raise MalformedBoxes(f"not JSON: {error}") from error
    if isinstance(document, dict):
        document = document.get("boxes")
    if not isinstance(document, list):
        raise MalformedBoxes("a list of boxes was expected, or an object with one under 'boxes'")
    boxes = {}
    for index, entry in enumerate(document):
        if not isinstance(entry, dict):
            raise MalformedBoxes(f"box {index} is {type(entry).__name__}, not an object")
        box_id = entry.get("id", entry.get("box_id"))
        if not isinstance(box_id, (str, int)) or isinstance(box_id, bool):
            raise MalformedBoxes(f"box {index} has the id {box_id!r}")
        numbers = []
        for key in ("x", "y", "yaw", "width", "depth", "height"):
            value = entry.get(key)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                raise MalformedBoxes(f"box {box_id} has {key} = {value!r}, not a number")
            numbers.append(float(value))
        x, y, yaw, width, depth, height = numbers
        boxes[str(box_id)] = box_from_map(Pose2(x, y, yaw), BoxSize(width, depth, height))
    return boxes


def lateral_fraction(
    pan_rad: float,
    center_rad: float,
    image_x: float,
    image_width: float = 640.0,
    half_span_rad: float = 0.5,
    half_fov_rad: float = 0.5,
    raw: bool = False,
) -> float:
    """The position of a detection along a box's front, -1 to 1, from the arm's pan and the detection's image column.

    `raw` does not clamp positions beyond the ends: a clamped one would be on the wrong bench.
    """
    across = min(1.0, max(-1.0, (image_x / image_width - 0.5) * 2.0))
    fraction = (pan_rad - center_rad + across * half_fov_rad) / (half_span_rad + half_fov_rad)
    return fraction if raw else min(1.0, max(-1.0, fraction))


def column_of(fraction: float, columns: int) -> int:
    """The column of a fraction along the front, 0 to columns - 1."""
    return min(columns - 1, max(0, int((fraction + 1.0) / 2.0 * columns)))


def column_center(column: int, columns: int) -> float:
    """The fraction in the middle of a column."""
    return -1.0 + (2 * column + 1) / columns


def column_depth(column: int, base: float, jitter: float) -> float:
    """The depth at which a column's flower is placed: about `base`, spread by `jitter`, within 0 to 1."""
    return min(1.0, max(0.0, base + ((column * GOLDEN_FRACTION % 1.0) - 0.5) * 2.0 * jitter))


def rigid_fit(source: Sequence[Point2], target: Sequence[Point2]) -> Pose2:
    """Fit target_from_source, the rigid motion that brings the source points closest to the target (Kabsch 1976, in the plane).

    The identity for empty or unequal lists; without rotation if the points do not determine one.
    """
    n = len(source)
    if n == 0 or n != len(target):
        return Pose2()
    sx, sy = sum(p[0] for p in source) / n, sum(p[1] for p in source) / n
    tx, ty = sum(p[0] for p in target) / n, sum(p[1] for p in target) / n
    cross = dot = 0.0
    for (ax, ay), (bx, by) in zip(source, target):
        ax, ay, bx, by = ax - sx, ay - sy, bx - tx, by - ty
        cross += ax * by - ay * bx
        dot += ax * bx + ay * by
    turn = math.atan2(cross, dot) if math.hypot(cross, dot) > 1e-12 else 0.0
    c, s = math.cos(turn), math.sin(turn)
    return Pose2(tx - c * sx + s * sy, ty - s * sx - c * sy, turn)
