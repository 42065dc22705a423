"""A random greenhouse for every seed. The robot can drive to a pose in front of each of its tags."""

from __future__ import annotations

import math

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_sim.reachability import FreeSpace
from lupin_sim.world import TAG_PLATE_M, Box, Pillar, Tag, World
from lupin_sim.worlds.flower_placement import place_all_flowers
from lupin_sim.worlds.tag_placement import place_tag

AISLE_M = 1.0
# The ids for which the packaged greenhouse has readings.
KNOWN_IDS = tuple(tag_id for tag_id in range(1, 31) if tag_id != 8)
TAG_COUNT = (6, 12)
ROOM_M = ((6.5, 9.5), (5.5, 7.5))
PLANTER_COUNT = (4, 8)
WIDTH_M, DEPTH_M = (0.9, 2.4), (0.40, 0.60)
# Minimum distance of tags on one planter, so that no image shows the flowers of both, also across the planter.
MIN_TAG_DISTANCE_M = 0.80
# Poses of the robot in front of a tag (forward and left, m); all of them must be reachable.
APPROACHES = ((0.5, 0.0), (0.4, 0.0), (0.65, 0.0), (0.5, 0.1), (0.5, -0.1))
ATTEMPTS = 500
_PLACEMENT_ATTEMPTS = 300
_DIRECTIONS = (-math.pi / 2, 0.0, math.pi / 2, math.pi)


def random_world(seed: int) -> World:
    """Return the greenhouse of a seed, always the same one. Draws with too few planters or tags are discarded and repeated."""
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng(np.random.SeedSequence((seed, attempt, 0x6A2D)))
        world = _draw(rng, seed)
        if world is not None:
            return world
    raise RuntimeError(f"no valid greenhouse for seed {seed} in {ATTEMPTS} attempts")


def _draw(rng: np.random.Generator, seed: int) -> World | None:
    length, breadth = (round(float(rng.uniform(*side)), 2) for side in ROOM_M)
    start = Pose2(0.9, 0.9, 0.0)
    boxes = _planters(rng, length, breadth, start)
    if len(boxes) < PLANTER_COUNT[0]:
        return None
    pillars = _pillars(rng, length, breadth, start, boxes)
    empty = World("random", (0.0, 0.0, length, breadth), boxes, (), start, pillars=pillars, seed=seed)
    tags = _tags(rng, empty)
    if len(tags) < TAG_COUNT[0]:
        return None
    flowers = place_all_flowers({box.name: box for box in boxes}, tags, rng)
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
    count = int(rng.integers(PLANTER_COUNT[0], PLANTER_COUNT[1] + 1))
    boxes: list[Box] = []
    for _ in range(_PLACEMENT_ATTEMPTS):
        if len(boxes) == count:
            break
        width, depth = (round(float(rng.uniform(*span)), 2) for span in (WIDTH_M, DEPTH_M))
        yaw = float(rng.choice(_DIRECTIONS))
        half_x, half_y = (depth, width) if abs(math.cos(yaw)) > 0.5 else (width, depth)
        half_x, half_y = half_x / 2, half_y / 2
        x, y = _middle(rng, length, half_x), _middle(rng, breadth, half_y)
        box = Box(f"planter{len(boxes)}", x, y, yaw, width, depth)
        if box.distance_to(start.x, start.y) < 0.6 or any(_distance(box, other) < AISLE_M for other in boxes):
            continue
        boxes.append(box)
    return tuple(boxes)


def _middle(rng: np.random.Generator, side: float, half: float) -> float:
    """Return a coordinate for the middle of an object of half width `half`: an aisle away from both walls, or touching one."""
    if rng.random() < 0.2:
        return half if rng.random() < 0.5 else side - half
    low, high = AISLE_M + half, side - AISLE_M - half
    return round(float(rng.uniform(low, high)), 3) if low < high else side / 2


def _distance(one: Box, other: Box) -> float:
    """Return the distance between two axis-aligned footprints, m."""
    spans = []
    for axis in (0, 1):
        a, b = [c[axis] for c in one.corners()], [c[axis] for c in other.corners()]
        spans.append(max(0.0, max(min(a), min(b)) - min(max(a), max(b))))
    return math.hypot(*spans)


def _pillars(
    rng: np.random.Generator, length: float, breadth: float, start: Pose2, boxes: tuple[Box, ...]
) -> tuple[Pillar, ...]:
    """Place up to two posts that break the symmetry of the room and leave at least an aisle free."""
    found: list[Pillar] = []
    for _ in range(60):
        if len(found) == 2:
            break
        radius = float(rng.uniform(0.06, 0.15))
        x, y = float(rng.uniform(0.0, length)), float(rng.uniform(0.0, breadth))
        to_wall = min(x, length - x, y, breadth - y) - radius
        clear = min([box.distance_to(x, y) - radius for box in boxes], default=math.inf)
        apart = min([math.hypot(x - p.x, y - p.y) for p in found], default=math.inf)
        is_near_or_far_from_wall = 0.0 < to_wall < 0.05 or to_wall > AISLE_M
        if is_near_or_far_from_wall and clear > AISLE_M and apart > 2.0 and math.hypot(x - start.x, y - start.y) > 1.2:
            found.append(Pillar(f"post{len(found)}", round(x, 3), round(y, 3), round(radius, 3)))
    return tuple(found)


def _tags(rng: np.random.Generator, world: World) -> tuple[Tag, ...]:
    space = FreeSpace(world)
    count = int(rng.integers(TAG_COUNT[0], TAG_COUNT[1] + 1))
    ids = iter(int(i) for i in rng.permutation(KNOWN_IDS))
    sides = [
        (box, face.yaw, along)
        for box in world.boxes
        for face, width in box.faces()
        for along in np.arange(-(width - TAG_PLATE_M) / 2, (width - TAG_PLATE_M) / 2 + 1e-9, 0.15)
    ]
    tags: list[Tag] = []
    for index in rng.permutation(len(sides)):
        if len(tags) == count:
            break
        box, side, along = sides[int(index)]
        tag = place_tag(box, side, float(along), 0)
        if not any(_visible_together(tag, other) for other in tags) and all(
            space.reaches(*tag.pose.apply(*place)) for place in APPROACHES
        ):
            tags.append(Tag(next(ids), tag.x, tag.y, tag.yaw, box=box.name))
    return tuple(sorted(tags, key=lambda tag: tag.id))


def _visible_together(tag: Tag, other: Tag) -> bool:
    """Return whether a camera in front of one tag would see the flowers of the other beside its own."""
    if tag.box != other.box:
        return False
    across = abs(tag.pose.inverse().apply(other.x, other.y)[1])
    opposite = math.cos(tag.yaw - other.yaw) < -0.5
    return math.hypot(tag.x - other.x, tag.y - other.y) < MIN_TAG_DISTANCE_M or (opposite and across < MIN_TAG_DISTANCE_M)
