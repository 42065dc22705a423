"""The exact shortest path of a disc among boxes, from the visibility graph over the arcs around their corners.

It is an independent reference for the planner, and shares neither grid nor search with it. Arcs are replaced by inscribed
chords, so the length is at most the true one; it is too short by less than 0.2 % of the arcs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from lupin_runtime.gridmap import GridMap

Box = tuple[float, float, float, float]  # x0, y0, x1, y1
_PAIRS_AT_ONCE = 400_000


def keeps_clear(a: NDArray[np.float64], b: NDArray[np.float64], boxes: Sequence[Box], min_m: float) -> NDArray[np.bool_]:
    """Return whether each segment from a_i to b_i, arrays (n, 2), keeps `min_m` from every box; with 0 it may touch them."""
    clear = np.ones(len(a), bool)
    d = b - a
    square = np.maximum((d * d).sum(axis=1), 1e-18)
    with np.errstate(divide="ignore", invalid="ignore"):
        for x0, y0, x1, y1 in boxes:
            enters, leaves = np.zeros(len(a)), np.ones(len(a))
            for axis, low, high in ((0, x0, x1), (1, y0, y1)):
                still = np.abs(d[:, axis]) < 1e-12
                t = np.sort(np.stack(((low - a[:, axis]) / d[:, axis], (high - a[:, axis]) / d[:, axis])), axis=0)
                between = (a[:, axis] > low) & (a[:, axis] < high)
                enters = np.maximum(enters, np.where(still, np.where(between, -np.inf, np.inf), t[0]))
                leaves = np.minimum(leaves, np.where(still, np.where(between, np.inf, -np.inf), t[1]))
            clear &= ~(enters < leaves - 1e-12)
            for end in (a, b):
                dx = np.maximum(np.maximum(x0 - end[:, 0], end[:, 0] - x1), 0.0)
                dy = np.maximum(np.maximum(y0 - end[:, 1], end[:, 1] - y1), 0.0)
                clear &= np.hypot(dx, dy) >= min_m
            for corner in ((x0, y0), (x1, y0), (x0, y1), (x1, y1)):
                t = np.clip(((np.array(corner) - a) * d).sum(axis=1) / square, 0.0, 1.0)
                clear &= np.hypot(*(a + t[:, None] * d - corner).T) >= min_m
    return clear


def shortest_length(
    boxes: Sequence[Box], start: tuple[float, float], goal: tuple[float, float], radius_m: float, size_m: float, chords: int = 5
) -> float:
    """Return the meters from start to goal within the square from (0, 0) to (size_m, size_m), infinity without a path."""
    points = [start, goal]
    for x0, y0, x1, y1 in boxes:
        for x, y, from_rad in ((x1, y1, 0.0), (x0, y1, 0.5), (x0, y0, 1.0), (x1, y0, 1.5)):
            for i in range(chords + 1):
                angle = math.pi * (from_rad + 0.5 * i / chords)
                points.append((x + radius_m * math.cos(angle), y + radius_m * math.sin(angle)))
    nodes = np.array(points)
    dips = radius_m * math.cos(math.pi / 4 / chords) - 1e-9
    inside = ((nodes >= 0.0) & (nodes <= size_m)).all(axis=1)
    nodes = nodes[inside & keeps_clear(nodes, nodes, boxes, dips)]
    head, tail = np.triu_indices(len(nodes), 1)
    seen = np.concatenate(
        [
            keeps_clear(nodes[head[k : k + _PAIRS_AT_ONCE]], nodes[tail[k : k + _PAIRS_AT_ONCE]], boxes, dips)
            for k in range(0, len(head), _PAIRS_AT_ONCE)
        ]
    )
    head, tail = head[seen], tail[seen]
    graph = csr_matrix((np.hypot(*(nodes[head] - nodes[tail]).T), (head, tail)), shape=(len(nodes), len(nodes)))
    return float(dijkstra(graph, directed=False, indices=0)[1])


def random_boxes(
    cells: int, count: int, sides: tuple[int, int], seed: int, resolution_m: float = 0.05
) -> tuple[GridMap, list[Box]]:
    """Return a square map with random boxes along cell borders and two free opposite corners, and the boxes in meters."""
    random = np.random.default_rng(seed)
    grid = np.zeros((cells, cells), np.int8)
    boxes = []
    for _ in range(count):
        x, y = (int(v) for v in random.integers(0, cells, 2))
        w, h = (int(v) for v in random.integers(sides[0], sides[1], 2))
        x1, y1 = min(cells, x + w), min(cells, y + h)
        if (x < 20 and y < 20) or (x1 > cells - 20 and y1 > cells - 20):
            continue
        grid[y:y1, x:x1] = 100
        boxes.append((x * resolution_m, y * resolution_m, x1 * resolution_m, y1 * resolution_m))
    return GridMap(grid, resolution_m, 0.0, 0.0), boxes
