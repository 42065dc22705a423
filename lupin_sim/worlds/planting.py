"""Which flowers stand behind which tag."""

from __future__ import annotations

import math

import numpy as np

from lupin_sim.world import SPECIES, Box, Flower, Tag

# Blooms stand this far behind the face that carries the tag, so that a gripper camera half a metre in front of the tag
# has all of them in one frame.
ROW_DEPTH_M = 0.09
SPACING_M = 0.12
EDGE_MARGIN_M = 0.04
BLOOM_HEIGHTS_M = (0.42, 0.50)


def plant(box: Box, tag: Tag, species: str, count: int, bugs: int, rng: np.random.Generator) -> tuple[Flower, ...]:
    """`count` flowers of one species in a row behind the tag, `bugs` of them infested (the first ones after a shuffle).

    They stay inside the box's footprint; a narrow face gets a tighter row. Raises ValueError for an unknown species.
    """
    if species not in SPECIES:
        raise ValueError(f"species {species!r} is not one of {', '.join(SPECIES)}")
    face_width = min(width for face, width in box.faces() if math.cos(face.yaw - tag.yaw) > 0.999)
    face_depth = min(width for face, width in box.faces() if abs(math.cos(face.yaw - tag.yaw)) < 0.001)
    depth = min(ROW_DEPTH_M, face_depth / 2)
    spacing = min(SPACING_M, (face_width - 2 * EDGE_MARGIN_M) / max(1, count))
    infested = set(rng.permutation(count)[:bugs].tolist())
    # Lateral room on either side of the tag, which may hang off the middle of its face.
    across = tag.pose.inverse().apply(box.x, box.y)[1]
    low, high = across - face_width / 2 + EDGE_MARGIN_M, across + face_width / 2 - EDGE_MARGIN_M
    row = (count - 1) * spacing
    first = min(max(-row / 2, low), high - row)
    flowers = []
    for index in range(count):
        jitter_u, jitter_v = rng.uniform(-0.015, 0.015, 2)
        v = min(max(first + index * spacing + float(jitter_v), low), high)
        x, y = tag.pose.apply(-depth + float(jitter_u), v)
        z = float(rng.uniform(*BLOOM_HEIGHTS_M))
        flowers.append(Flower(species, index in infested, x, y, z, box.height, tag.yaw, tag.id))
    return tuple(flowers)


def plant_all(boxes: dict[str, Box], tags: tuple[Tag, ...], rng: np.random.Generator) -> tuple[Flower, ...]:
    """0 to 3 flowers per tag, every species and at least one bug among them where there are tags enough."""
    flowers: list[Flower] = []
    kinds = [SPECIES[i % len(SPECIES)] for i in range(len(tags))]
    order = rng.permutation(len(tags))
    for rank, index in enumerate(order):
        tag = tags[int(index)]
        # The first of the shuffle are never bare, so that each species stands somewhere.
        count = int(rng.integers(1 if rank < len(SPECIES) else 0, 4))
        infested = rank == 0 or rng.random() < 0.25
        bugs = 1 if count and infested else 0
        flowers += plant(boxes[tag.box], tag, kinds[rank], count, bugs, rng)
    return tuple(flowers)
