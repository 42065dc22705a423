"""A small greenhouse with a tag that is visible but not reachable: it is behind a fence of posts."""

from __future__ import annotations

import math

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_sim.world import Box, Pillar, World
from lupin_sim.worlds.flower_placement import place_all_flowers
from lupin_sim.worlds.tag_placement import place_tag

FENCED_TAG = 5
_SOUTH, _NORTH, _WEST = -math.pi / 2, math.pi / 2, math.pi
# Posts 0.30 m apart: a camera sees through them, a robot 0.44 m wide does not fit through.
_FENCE_X, _POST_SPACING_M, _POST_RADIUS_M = 4.3, 0.30, 0.03


def walled(seed: int = 0) -> World:
    """5.5 by 4 meters, three tags; the east end, with tag 5, is fenced off."""
    boxes = (
        Box("bench_middle", 2.3, 2.0, _SOUTH, 1.4, 0.5),
        Box("bench_fenced", 5.3, 2.0, _WEST, 1.2, 0.4),
    )
    tags = (
        place_tag(boxes[0], _SOUTH, -0.2, 1),
        place_tag(boxes[0], _NORTH, -0.3, 2),
        place_tag(boxes[1], _WEST, 0.0, FENCED_TAG),
    )
    count = 2 * round(2.0 / _POST_SPACING_M)  # even, so that no post is directly in front of the tag
    fence = tuple(Pillar(f"fence{i}", _FENCE_X, (i + 0.5) * 4.0 / count, _POST_RADIUS_M, 0.6) for i in range(count))
    rng = np.random.default_rng(np.random.SeedSequence((seed, 0xFE2C)))
    return World(
        name="walled",
        seed=seed,
        bounds=(0.0, 0.0, 5.5, 4.0),
        boxes=boxes,
        tags=tags,
        start=Pose2(0.8, 0.8, 0.0),
        flowers=place_all_flowers({box.name: box for box in boxes}, tags, rng),
        pillars=fence,
    ).with_outer_walls()
