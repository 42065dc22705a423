"""Chooses a few stops that show everything, and puts them in the order of a short tour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_NO_PATH_M = 1e6


def greedy_cover(visible: NDArray[np.bool_], weights: NDArray[np.float64], min_gain: float, max_stops: int) -> list[int]:
    """Return rows of `visible` (m stops, n things) that together cover almost all of `weights` (n,).

    Greedily adds the stop with the largest new weight, until none adds `min_gain` or `max_stops` are chosen
    (Johnson 1974: within a factor ln n of the minimum).
    """
    remaining = weights.astype(np.float64).copy()
    matrix = visible.astype(np.float32)
    chosen: list[int] = []
    while len(chosen) < max_stops and len(matrix):
        gains = matrix @ remaining
        best = int(np.argmax(gains))
        if gains[best] < min_gain:
            break
        chosen.append(best)
        remaining[visible[best]] = 0.0
    return chosen


def order_stops(from_start: NDArray[np.float64], between: NDArray[np.float64]) -> list[int]:
    """Return the order of n stops on a short open tour: nearest neighbor from the start, then 2-opt (Croes 1958).

    `from_start` (n,) and `between` (n, n) are travel distances; infinite where no path leads.
    """
    count = len(from_start)
    if count == 0:
        return []
    finite = np.where(np.isfinite(between), between, _NO_PATH_M)
    first = np.where(np.isfinite(from_start), from_start, _NO_PATH_M)
    order, remaining = [int(np.argmin(first))], set(range(count))
    remaining.discard(order[0])
    while remaining:
        current = order[-1]
        nearest = min(remaining, key=lambda stop: (finite[current, stop], stop))
        order.append(nearest)
        remaining.discard(nearest)
    improved = True
    while improved:
        improved = False
        for i in range(count - 1):
            before = first if i == 0 else finite[order[i - 1]]
            for j in range(i + 1, count):
                old, new = before[order[i]], before[order[j]]
                if j + 1 < count:
                    old, new = old + finite[order[j], order[j + 1]], new + finite[order[i], order[j + 1]]
                if new < old - 1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    improved = True
    return order
