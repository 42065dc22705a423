"""Chooses a few viewpoints that together show all surfaces, and orders them into a short tour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_NO_PATH_M = 1e6


def greedy_cover(visible: NDArray[np.bool_], weights: NDArray[np.float64], min_gain: float, max_viewpoints: int) -> list[int]:
    """Return rows of `visible` (m viewpoints, n surfaces) that together cover almost all of `weights` (n,).

    Greedily adds the viewpoint with the largest new weight, until no viewpoint adds `min_gain` or `max_viewpoints` are chosen
    (Johnson 1974: within a factor ln n of the minimum).
    """
    remaining = weights.astype(np.float64).copy()
    matrix = visible.astype(np.float32)
    chosen: list[int] = []
    while len(chosen) < max_viewpoints and len(matrix):
        gains = matrix @ remaining
        best = int(np.argmax(gains))
        if gains[best] < min_gain:
            break
        chosen.append(best)
        remaining[visible[best]] = 0.0
    return chosen


def order_viewpoints(from_start: NDArray[np.float64], between: NDArray[np.float64]) -> list[int]:
    """Return the order of n viewpoints on a short open tour: nearest neighbor from the start, then 2-opt (Croes 1958).

    `from_start` (n,) and `between` (n, n) are travel distances, infinite if there is no path.
    """
    count = len(from_start)
    if count == 0:
        return []
    distances = np.where(np.isfinite(between), between, _NO_PATH_M)
    start_distances = np.where(np.isfinite(from_start), from_start, _NO_PATH_M)
    order, remaining = [int(np.argmin(start_distances))], set(range(count))
    remaining.discard(order[0])
    while remaining:
        current = order[-1]
        nearest = min(remaining, key=lambda viewpoint: (distances[current, viewpoint], viewpoint))
        order.append(nearest)
        remaining.discard(nearest)
    improved = True
    while improved:
        improved = False
        for i in range(count - 1):
            from_previous = start_distances if i == 0 else distances[order[i - 1]]
            for j in range(i + 1, count):
                old, new = from_previous[order[i]], from_previous[order[j]]
                if j + 1 < count:
                    old, new = old + distances[order[j], order[j + 1]], new + distances[order[i], order[j + 1]]
                if new < old - 1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    improved = True
    return order
