"""A short way past several places: which places suffice, and in which order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def covering(sees: NDArray[np.bool_], weights: NDArray[np.float64], least: float, most: int) -> list[int]:
    """Rows of `sees` (m places, n things) that together see nearly everything: greedily the one that adds the most weight,
    until none adds `least`, or `most` are chosen (Johnson 1974: within ln n of the fewest)."""
    left = weights.astype(np.float64).copy()
    matrix = sees.astype(np.float32)
    chosen: list[int] = []
    while len(chosen) < most and len(matrix):
        gains = matrix @ left
        best = int(np.argmax(gains))
        if gains[best] < least:
            break
        chosen.append(best)
        left[sees[best]] = 0.0
    return chosen


def short_order(from_start: NDArray[np.float64], between: NDArray[np.float64]) -> list[int]:
    """The order of n places on a short open path: nearest neighbour from the start, then 2-opt (Croes 1958).

    `from_start` (n,) and `between` (n, n) are lengths of road; infinite where none leads.
    """
    count = len(from_start)
    if count == 0:
        return []
    finite = np.where(np.isfinite(between), between, 1e6)
    first = np.where(np.isfinite(from_start), from_start, 1e6)
    order, left = [int(np.argmin(first))], set(range(count))
    left.discard(order[0])
    while left:
        here = order[-1]
        nearest = min(left, key=lambda place: (finite[here, place], place))
        order.append(nearest)
        left.discard(nearest)
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
