"""The default greenhouse: three rows of planters with wide aisles and a loop around them for the map to close."""

from __future__ import annotations

import math

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_sim.world import Box, Flower, Pillar, Tag, World
from lupin_sim.worlds.flower_placement import place_flowers
from lupin_sim.worlds.tag_placement import place_tag

SOUTH, NORTH, WEST, EAST = -math.pi / 2, math.pi / 2, math.pi, 0.0

# name, x, y, front, width, depth. The lengths differ because a scan matcher could confuse equal aisles.
_PLANTERS = (
    ("south_west", 3.0, 2.0, SOUTH, 2.0, 0.5),
    ("south_east", 6.2, 2.0, SOUTH, 2.4, 0.5),
    ("middle_west", 2.9, 3.6, SOUTH, 1.8, 0.5),
    ("middle_east", 6.1, 3.6, SOUTH, 2.2, 0.5),
    ("north_west", 3.1, 5.2, SOUTH, 2.2, 0.5),
    ("north_east", 6.3, 5.2, SOUTH, 2.0, 0.5),
    ("wall_bench_north", 4.6, 6.80, SOUTH, 1.6, 0.4),
    ("wall_bench_east", 8.8, 3.4, WEST, 1.6, 0.4),
)
_CRATES = (
    ("crate_west", 0.30, 3.3, EAST, 0.5, 0.4),
    ("crate_corner", 8.45, 6.45, SOUTH, 0.6, 0.5),
)
_PILLARS = (Pillar("post_south", 8.4, 0.55, 0.10), Pillar("post_north", 0.6, 6.3, 0.14))

# id, planter, side, offset along the side from its middle (m, positive is left when facing outwards), species, flowers, bugs.
# Tags on opposite sides have different offsets, because a camera sees the flowers of both sides across a planter.
_TAGS = (
    (1, "south_west", SOUTH, -0.6, "tulip_red", 3, 0),
    (2, "south_west", NORTH, -0.6, "tulip_white", 2, 0),
    (3, "south_east", SOUTH, -0.3, "tulip_pink", 3, 1),
    (4, "south_east", EAST, 0.0, "tulip_red", 1, 1),
    (5, "middle_west", WEST, 0.0, "tulip_white", 2, 0),
    (6, "middle_east", NORTH, -0.4, "tulip_pink", 2, 0),
    (7, "north_west", SOUTH, -0.65, "tulip_red", 2, 0),
    (9, "north_west", NORTH, -0.65, "tulip_white", 3, 1),
    (10, "north_east", NORTH, 0.2, "tulip_pink", 1, 0),
    (11, "north_east", EAST, 0.0, "tulip_red", 2, 0),
    (12, "wall_bench_north", SOUTH, 0.0, "tulip_white", 1, 0),
    (13, "wall_bench_east", WEST, 0.25, "tulip_pink", 3, 0),
)


def demo(seed: int = 0) -> World:
    """Return the greenhouse `demo`. The seed only moves each flower by about a centimeter."""
    rng = np.random.default_rng(np.random.SeedSequence((seed, 0xDE30)))
    boxes = [Box(*row) for row in _PLANTERS] + [Box(*row, kind="crate") for row in _CRATES]
    named = {box.name: box for box in boxes}
    tags: list[Tag] = []
    flowers: list[Flower] = []
    for tag_id, name, side, along, species, count, bugs in _TAGS:
        tag = place_tag(named[name], side, along, tag_id)
        tags.append(tag)
        flowers += place_flowers(named[name], tag, species, count, bugs, rng)
    return World(
        name="demo",
        seed=seed,
        bounds=(0.0, 0.0, 9.0, 7.0),
        boxes=tuple(boxes),
        tags=tuple(tags),
        flowers=tuple(flowers),
        pillars=_PILLARS,
        start=Pose2(1.0, 0.9, 0.0),
    ).with_outer_walls()
