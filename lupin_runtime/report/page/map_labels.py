"""Places the labels of tags on the map."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lupin_runtime.report.page.canvas import Canvas
from lupin_runtime.report.tags import TagResult


def place_labels(tags: Sequence[TagResult], canvas: Canvas) -> list[tuple[float, float]]:
    """Return the position of each tag's label: in front of its face, pushed apart until none overlap.

    Every tag has a pose.
    """
    if not tags:
        return []
    places = np.array([canvas.at(t.pose.x, t.pose.y) for t in tags if t.pose is not None], dtype=float)
    for row, item in zip(places, tags):
        facing = item.pose.facing_rad if item.pose is not None else None
        if facing is not None:
            row += np.array([math.cos(facing), -math.sin(facing)]) * canvas.symbol_size * 2.1
    min_distance = canvas.symbol_size * 2.1
    for _ in range(40):
        delta = places[:, None] - places[None, :]
        distance = np.hypot(delta[..., 0], delta[..., 1])
        np.fill_diagonal(distance, np.inf)
        overlapping = distance < min_distance
        if not overlapping.any():
            break
        # Labels at the same position have no direction to separate in: each gets one by its index.
        angle = np.arange(len(places))[:, None] * 2.4
        direction = np.where(
            (distance < 1e-6)[..., None],
            np.dstack([np.cos(angle), np.sin(angle)]),
            delta / np.maximum(distance, 1e-6)[..., None],
        )
        push = (
            np.where(overlapping, (min_distance - np.minimum(distance, min_distance)) / 2.0 + 0.1, 0.0)[..., None] * direction
        )
        places += push.sum(axis=1)
    inset = canvas.symbol_size
    places[:, 0] = places[:, 0].clip(inset, canvas.width - inset)
    places[:, 1] = places[:, 1].clip(inset, canvas.height - inset)
    return [(float(x), float(y)) for x, y in places]
