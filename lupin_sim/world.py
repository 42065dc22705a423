"""A greenhouse as data: meters and radians in the world frame, which only the simulator knows."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from lupin_runtime.geometry import Pose2

TAG_EDGE_M = 0.100  # black square
TAG_PLATE_M = 0.125  # black square and white margin of one module on each side
TAG_HEIGHT_M = 0.15  # plate center above the floor
BOX_HEIGHT_M = 0.30
WALL_THICKNESS_M = 0.10
WALL_HEIGHT_M = 0.5  # above lidar and body camera, low enough for pictures from outside
SPECIES = ("tulip_red", "tulip_white", "tulip_pink")


@dataclass(frozen=True)
class Box:
    """A solid cuboid on the floor. `yaw` is the outward normal of its front, `depth` is along this normal, `width` across.

    `kind` is planter, crate or wall.
    """

    name: str
    x: float
    y: float
    yaw: float
    width: float
    depth: float
    height: float = BOX_HEIGHT_M
    kind: str = "planter"

    @property
    def pose(self) -> Pose2:
        """The center, heading along the normal of the front."""
        return Pose2(self.x, self.y, self.yaw)

    def corners(self) -> tuple[tuple[float, float], ...]:
        """Return the corners of the footprint, counterclockwise from front right."""
        d, w = self.depth / 2, self.width / 2
        return tuple(self.pose.apply(u, v) for u, v in ((d, -w), (d, w), (-d, w), (-d, -w)))

    def distance_to(self, x: float, y: float) -> float:
        """Return the distance from a point to the footprint, m; 0 inside."""
        u, v = self.pose.inverse().apply(x, y)
        return math.hypot(max(0.0, abs(u) - self.depth / 2), max(0.0, abs(v) - self.width / 2))

    def faces(self) -> tuple[tuple[Pose2, float], ...]:
        """Return the four sides: pose of the center, heading outwards, and width."""
        sides = (
            (self.depth / 2, 0.0, self.width),
            (self.width / 2, math.pi / 2, self.depth),
            (self.depth / 2, math.pi, self.width),
            (self.width / 2, -math.pi / 2, self.depth),
        )
        return tuple((self.pose @ Pose2(yaw=turn) @ Pose2(x=out), width) for out, turn, width in sides)


@dataclass(frozen=True)
class Pillar:
    """A round post."""

    name: str
    x: float
    y: float
    radius: float
    height: float = 0.7


@dataclass(frozen=True)
class Tag:
    """An AprilTag plate: its center, and the heading of its outward normal; `box` is the name of the box that it hangs on."""

    id: int
    x: float
    y: float
    yaw: float
    z: float = TAG_HEIGHT_M
    box: str = ""

    @property
    def pose(self) -> Pose2:
        """The center of the plate, heading along the outward normal."""
        return Pose2(self.x, self.y, self.yaw)


@dataclass(frozen=True)
class Flower:
    """A flower: `z` is the center of its head, `base_z` the start of its stem, `facing` the heading of a bug on it."""

    species: str
    bug: bool
    x: float
    y: float
    z: float
    base_z: float
    facing: float
    tag_id: int


@dataclass(frozen=True)
class World:
    """A whole greenhouse. `bounds` is (x0, y0, x1, y1) inside the outer walls; `start` is the robot's start pose."""

    name: str
    bounds: tuple[float, float, float, float]
    boxes: tuple[Box, ...]
    tags: tuple[Tag, ...]
    start: Pose2
    flowers: tuple[Flower, ...] = ()
    pillars: tuple[Pillar, ...] = ()
    seed: int = 0
    walls: tuple[Box, ...] = field(default=())

    def with_outer_walls(self) -> World:
        """Return the same world with walls around its bounds."""
        x0, y0, x1, y1 = self.bounds
        t = WALL_THICKNESS_M
        cx, cy = (x0 + x1) / 2, (y0 + y1) / 2

        def wall(name: str, x: float, y: float, yaw: float, width: float) -> Box:
            return Box(name, x, y, yaw, width, t, WALL_HEIGHT_M, "wall")

        return replace(
            self,
            walls=(
                wall("wall_south", cx, y0 - t / 2, math.pi / 2, x1 - x0),
                wall("wall_north", cx, y1 + t / 2, -math.pi / 2, x1 - x0),
                wall("wall_west", x0 - t / 2, cy, 0.0, y1 - y0 + 2 * t),
                wall("wall_east", x1 + t / 2, cy, math.pi, y1 - y0 + 2 * t),
            ),
        )

    def clearance(self, x: float, y: float) -> float:
        """Return the distance from a point to the nearest solid or the bounds, m; 0 inside a solid."""
        x0, y0, x1, y1 = self.bounds
        nearest = max(0.0, min(x - x0, x1 - x, y - y0, y1 - y))
        for box in self.boxes:
            nearest = min(nearest, box.distance_to(x, y))
        for pillar in self.pillars:
            nearest = min(nearest, max(0.0, math.hypot(x - pillar.x, y - pillar.y) - pillar.radius))
        return nearest

    @property
    def size_m(self) -> tuple[float, float]:
        """Length and breadth inside the walls, m."""
        x0, y0, x1, y1 = self.bounds
        return x1 - x0, y1 - y0

    def tag(self, tag_id: int) -> Tag:
        """Return the tag with this id. Raises KeyError."""
        for tag in self.tags:
            if tag.id == tag_id:
                return tag
        raise KeyError(f"world {self.name!r} has no tag {tag_id}; it has {sorted(t.id for t in self.tags)}")
