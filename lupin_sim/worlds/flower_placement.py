"""Places flowers on the planters, behind the tags."""

from __future__ import annotations

import math

import numpy as np

from lupin_sim.world import SPECIES, Box, Flower, Tag

# Distance of the flowers behind the side with the tag. At this distance the gripper camera, half a meter in front of the tag,
# sees all of them in one image.
ROW_DEPTH_M = 0.09
SPACING_M = 0.12
EDGE_MARGIN_M = 0.04
FLOWER_HEIGHTS_M = (0.42, 0.50)


def place_flowers(box: Box, tag: Tag, species: str, count: int, bugs: int, rng: np.random.Generator) -> tuple[Flower, ...]:
    """Place `count` flowers of a species in a row behind the tag, `bugs` of them infested (chosen at random).

    They stay inside the box's footprint; the row on a narrow side is tighter. Raises ValueError for an unknown species.
    """
    if species not in SPECIES:
        raise ValueError(f"species {species!r} is not one of {', '.join(SPECIES)}")
    face_width = min(width for face, width in box.faces() if math.cos(face.yaw - tag.yaw) > 0.999)
    face_depth = min(width for face, width in box.faces() if abs(math.cos(face.yaw - tag.yaw)) < 0.001)
    depth = min(ROW_DEPTH_M, face_depth / 2)
    spacing = min(SPACING_M, (face_width - 2 * EDGE_MARGIN_M) / max(1, count))
    infested = set(rng.permutation(count)[:bugs].tolist())
    # The lateral range of the row; the tag may be off the middle of its side.
    across = tag.pose.inverse().apply(box.x, box.y)[1]
    low, high = across - face_width / 2 + EDGE_MARGIN_M, across + face_width / 2 - EDGE_MARGIN_M
    row = (count - 1) * spacing
    first = min(max(-row / 2, low), high - row)
    flowers = []
    for index in range(count):
        jitter_u, jitter_v = rng.uniform(-0.015, 0.015, 2)
        v = min(max(first + index * spacing + float(jitter_v), low), high)
        x, y = tag.pose.apply(-depth + float(jitter_u), v)
        z = float(rng.uniform(*FLOWER_HEIGHTS_M))
        flowers.append(Flower(species, index in infested, x, y, z, box.height, tag.yaw, tag.id))
    return tuple(flowers)


def place_all_flowers(boxes: dict[str, Box], tags: tuple[Tag, ...], rng: np.random.Generator) -> tuple[Flower, ...]:
    """Place 0 to 3 flowers at each tag, with all species and at least one bug if there are enough tags."""
    flowers: list[Flower] = []
    kinds = [SPECIES[i % len(SPECIES)] for i in range(len(tags))]
    order = rng.permutation(len(tags))
    for rank, index in enumerate(order):
        tag = tags[int(index)]
        # The first tags of the shuffled order have at least one flower, so that every species occurs.
        count = int(rng.integers(1 if rank < len(SPECIES) else 0, 4))
        infested = rank == 0 or rng.random() < 0.25
        bugs = 1 if count and infested else 0
        flowers += place_flowers(boxes[tag.box], tag, kinds[rank], count, bugs, rng)
    return tuple(flowers)
