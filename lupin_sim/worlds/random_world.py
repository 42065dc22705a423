"""A fresh greenhouse for every seed, always solvable: each tag has a place in front of it that the robot can drive to."""

from __future__ import annotations

import math

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_sim.reach import FreeSpace
from lupin_sim.tag_family import KNOWN_IDS
from lupin_sim.world import TAG_PLATE_M, Box, Pillar, Tag, World
from lupin_sim.worlds.hanging import on_side
from lupin_sim.worlds.planting import plant_all

AISLE_M = 1.0
TAGS = (6, 12)
ROOM_M = ((6.5, 9.5), (5.5, 7.5))
PLANTERS = (4, 8)
WIDTH_M, DEPTH_M = (0.9, 2.4), (0.40, 0.60)
# Tags closer than this on one planter would share blooms in one picture, also across the planter.
APART_M = 0.80
# Where a robot may come to stand in front of a tag: all of these must be free and connected.
APPROACH = ((0.5, 0.0), (0.4, 0.0), (0.65, 0.0), (0.5, 0.1), (0.5, -0.1))
ATTEMPTS = 500
_PLACE_TRIES = 300
_QUARTERS = (-math.pi / 2, 0.0, math.pi / 2, math.pi)


def random_world(seed: int) -> World:
    """The greenhouse of a seed. Attempts that come out too small are thrown away and drawn anew, so that a seed always
    names the same world."""
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng(np.random.SeedSequence((seed, attempt, 0x6A2D)))
        world = _draw(rng, seed)
        if world is not None:
            return world
    raise RuntimeError(f"seed {seed} made no solvable greenhouse in {ATTEMPTS} attempts")


def _draw(rng: np.random.Generator, seed: int) -> World | None:
    length, breadth = (round(float(rng.uniform(*side)), 2) for side in ROOM_M)
    start = Pose2(0.9, 0.9, 0.0)
    boxes = _planters(rng, length, breadth, start)
    if len(boxes) < PLANTERS[0]:
        return None
    pillars = _pillars(rng, length, breadth, start, boxes)
    empty = World("random", (0.0, 0.0, length, breadth), boxes, (), start, pillars=pillars, seed=seed)
    tags = _tags(rng, empty)
    if len(tags) < TAGS[0]:
        return None
    flowers = plant_all({box.name: box for box in boxes}, tags, rng)
    return World(
        name=f"random:{seed}",
        bounds=empty.bounds,
        boxes=boxes,
        tags=tags,
        start=start,
        flowers=flowers,
        pillars=pillars,
        seed=seed,
    ).with_outer_walls()


def _planters(rng: np.random.Generator, length: float, breadth: float, start: Pose2) -> tuple[Box, ...]:
    wanted = int(rng.integers(PLANTERS[0], PLANTERS[1] + 1))
    boxes: list[Box] = []
    for _ in range(_PLACE_TRIES):
        if len(boxes) == wanted:
            break
        width, depth = (round(float(rng.uniform(*span)), 2) for span in (WIDTH_M, DEPTH_M))
        yaw = float(rng.choice(_QUARTERS))
        half_x, half_y = (depth, width) if abs(math.cos(yaw)) > 0.5 else (width, depth)
        half_x, half_y = half_x / 2, half_y / 2
        x, y = _along(rng, length, half_x), _along(rng, breadth, half_y)
        box = Box(f"planter{len(boxes)}", x, y, yaw, width, depth)
        if box.distance_to(start.x, start.y) < 0.6 or any(_gap(box, other) < AISLE_M for other in boxes):
            continue
        boxes.append(box)
    return tuple(boxes)


def _along(rng: np.random.Generator, side: float, half: float) -> float:
    """A middle between two walls: an aisle away from both, or flush with one of them."""
    if rng.random() < 0.2:
        return half if rng.random() < 0.5 else side - half
    low, high = AISLE_M + half, side - AISLE_M - half
    return round(float(rng.uniform(low, high)), 3) if low < high else side / 2


def _gap(one: Box, other: Box) -> float:
    """Metres between two axis-aligned footprints."""
    spans = []
    for axis in (0, 1):
        a, b = [c[axis] for c in one.corners()], [c[axis] for c in other.corners()]
        spans.append(max(0.0, max(min(a), min(b)) - min(max(a), max(b))))
    return math.hypot(*spans)


def _pillars(
    rng: np.random.Generator, length: float, breadth: float, start: Pose2, boxes: tuple[Box, ...]
) -> tuple[Pillar, ...]:
    """Up to two posts that break the room's symmetry and narrow nothing below an aisle."""
    found: list[Pillar] = []
    for _ in range(60):
        if len(found) == 2:
            break
        radius = float(rng.uniform(0.06, 0.15))
        x, y = float(rng.uniform(0.0, length)), float(rng.uniform(0.0, breadth))
        to_wall = min(x, length - x, y, breadth - y) - radius
        clear = min([box.distance_to(x, y) - radius for box in boxes], default=math.inf)
        apart = min([math.hypot(x - p.x, y - p.y) for p in found], default=math.inf)
        in_corner = 0.0 < to_wall < 0.05 or to_wall > AISLE_M
        if in_corner and clear > AISLE_M and apart > 2.0 and math.hypot(x - start.x, y - start.y) > 1.2:
            found.append(Pillar(f"post{len(found)}", round(x, 3), round(y, 3), round(radius, 3)))
    return tuple(found)


def _tags(rng: np.random.Generator, world: World) -> tuple[Tag, ...]:
    space = FreeSpace(world)
    wanted = int(rng.integers(TAGS[0], TAGS[1] + 1))
    ids = iter(int(i) for i in rng.permutation(KNOWN_IDS))
    sides = [
        (box, face.yaw, along)
        for box in world.boxes
        for face, width in box.faces()
        for along in np.arange(-(width - TAG_PLATE_M) / 2, (width - TAG_PLATE_M) / 2 + 1e-9, 0.15)
    ]
    tags: list[Tag] = []
    for index in rng.permutation(len(sides)):
        if len(tags) == wanted:
            break
        box, side, along = sides[int(index)]
        tag = on_side(box, side, float(along), 0)
        if not any(_share_a_picture(tag, other) for other in tags) and all(
            space.reaches(*tag.pose.apply(*place)) for place in APPROACH
        ):
            tags.append(Tag(next(ids), tag.x, tag.y, tag.yaw, box=box.name))
    return tuple(sorted(tags, key=lambda tag: tag.id))


def _share_a_picture(tag: Tag, other: Tag) -> bool:
    """Whether a camera in front of one tag has the blooms of the other near them."""
    if tag.box != other.box:
        return False
    across = abs(tag.pose.inverse().apply(other.x, other.y)[1])
    opposite = math.cos(tag.yaw - other.yaw) < -0.5
    return math.hypot(tag.x - other.x, tag.y - other.y) < APART_M or (opposite and across < APART_M)
