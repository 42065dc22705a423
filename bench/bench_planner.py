"""Global planning on 2000 x 2000 cells: its time, and the length of its paths compared with an exact reference and a peer.

The exact reference is the tangent graph over the boxes' corners. The peer is SciPy's Dijkstra over the 8-neighborhood, on a
quarter of the map only: its graph of the whole map would take a gigabyte.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from bench.runner import Figures, benchmark
from lupin_runtime.gridmap import GridMap
from lupin_runtime.navigation.costmap import GlobalCostmap
from lupin_runtime.navigation.costmap.kernels import squared_distances
from lupin_runtime.navigation.planning import plan
from lupin_runtime.navigation.planning.shortest_path import find_shortest_path
from tests.support.tangent_graph import random_boxes, shortest_length

CELLS, RESOLUTION_M, RADIUS_M = 2000, 0.05, 0.22
RUNS = 7


def serpentine(corridors: int) -> GridMap:
    """Return a map of corridors back and forth; the only path leads through all of them."""
    grid = np.zeros((CELLS, CELLS), np.int8)
    pitch = CELLS // corridors
    for i in range(1, corridors):
        grid[i * pitch : i * pitch + 3, slice(0, -30) if i % 2 else slice(30, None)] = 100
    return GridMap(grid, RESOLUTION_M, 0.0, 0.0)


def clutter(share: float) -> GridMap:
    """Return a map of single occupied cells at random, with free start and goal corners."""
    grid = (np.random.default_rng(3).random((CELLS, CELLS)) < share).astype(np.int8) * 100
    grid[:40, :40] = grid[-40:, -40:] = 0
    return GridMap(grid, RESOLUTION_M, 0.0, 0.0)


def rooms() -> GridMap:
    """Return a map of 10 x 10 rooms with a door of 1 m in most walls."""
    random = np.random.default_rng(4)
    grid = np.zeros((CELLS, CELLS), np.int8)
    for at in range(200, CELLS, 200):
        grid[at : at + 4, :] = grid[:, at : at + 4] = 100
    for i in range(10):
        for at in range(200, CELLS, 200):
            for across in (True, False):
                if random.random() < 0.75:
                    door = slice(200 * i + (j := int(random.integers(20, 160))), 200 * i + j + 20)
                    grid[(door, slice(at, at + 4)) if across else (slice(at, at + 4), door)] = 0
    return GridMap(grid, RESOLUTION_M, 0.0, 0.0)


def measure_ms(work: Callable[[], Any]) -> tuple[float, float, Any]:
    """Return the median CPU time and the shortest wall time of RUNS runs, ms, and the last result."""
    cpu, wall, result = [], [], None
    for _ in range(RUNS):
        began, began_cpu = time.perf_counter(), time.thread_time()
        result = work()
        cpu.append((time.thread_time() - began_cpu) * 1e3)
        wall.append((time.perf_counter() - began) * 1e3)
    return float(np.median(cpu)), min(wall), result


def plan_with_peer(grid: GridMap, start: tuple[int, int], goal: tuple[int, int]) -> tuple[float, float]:
    """Plan with SciPy's Dijkstra over free cells; return the CPU time in ms, with the graph's construction, and the meters."""
    began = time.thread_time()
    squares = squared_distances((grid.cells >= 65).view(np.uint8), 8, to_edges=True)
    free = squares >= (2 * RADIUS_M / RESOLUTION_M) ** 2
    index = np.arange(free.size, dtype=np.int32).reshape(free.shape)
    a, b, w = [], [], []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, free.shape[0] - dy), slice(max(0, -dx), free.shape[1] - max(0, dx)))
        there = (slice(dy, None), slice(max(0, dx), free.shape[1] + min(0, dx)))
        both = free[here] & free[there]
        a.append(index[here][both])
        b.append(index[there][both])
        w.append(np.full(len(a[-1]), math.hypot(dx, dy) * RESOLUTION_M))
    graph = csr_matrix((np.concatenate(w), (np.concatenate(a), np.concatenate(b))), shape=(free.size, free.size))
    meters = dijkstra(graph, directed=False, indices=index[start])[index[goal]]
    return (time.thread_time() - began) * 1e3, float(meters)


@benchmark(at_most={"maps.*.cpu_ms": 100.0, "length_ratio_2000": 1.01, "worst_length_ratio_of_10": 1.01})
def main() -> Figures:
    """Plan on every map with Lupin and the references."""
    far = CELLS * RESOLUTION_M - 0.5
    start, goal = (0.5, 0.5), (far, far)
    boxes_grid, boxes = random_boxes(CELLS, 60, (60, 320), 11)
    maps = {
        "60 boxes": boxes_grid,
        "1500 boxes": random_boxes(CELLS, 1500, (4, 40), 1)[0],
        "rooms": rooms(),
        "serpentine 20": serpentine(20),
        "serpentine 40": serpentine(40),
        "clutter 0.3 %": clutter(0.003),
        "empty": GridMap(np.zeros((CELLS, CELLS), np.int8), RESOLUTION_M, 0.0, 0.0),
    }
    cases: dict[str, dict[str, float]] = {}
    for name, grid in maps.items():
        cpu, wall, found = measure_ms(partial(find_shortest_path, grid, start, goal, RADIUS_M))
        cases[name] = {"cpu_ms": cpu, "wall_ms": wall, "length_m": found.length_m}
    exact_m = shortest_length(boxes, start, goal, RADIUS_M, CELLS * RESOLUTION_M, chords=3)
    length_ratios = []
    for seed in range(10):
        grid, small = random_boxes(300, 40, (10, 50), seed)
        exact = shortest_length(small, (0.5, 0.5), (14.5, 14.5), RADIUS_M, 15.0, chords=3)
        if math.isfinite(exact):
            length_ratios.append(find_shortest_path(grid, (0.5, 0.5), (14.5, 14.5), RADIUS_M).length_m / exact)

    costmap = GlobalCostmap()
    costmap.set_map(maps["1500 boxes"])
    nav_cpu, _, path = measure_ms(lambda: plan(costmap.snapshot(None), start, goal))

    quarter = GridMap(maps["1500 boxes"].cells[:1000, :1000].copy(), RESOLUTION_M, 0.0, 0.0)
    quarter.cells[-40:, -40:] = 0
    peer_ms, peer_m = plan_with_peer(quarter, (10, 10), (989, 989))
    ours_ms, _, ours = measure_ms(lambda: find_shortest_path(quarter, (0.525, 0.525), (49.475, 49.475), RADIUS_M))
    return {
        "length_ratio_2000": cases["60 boxes"]["length_m"] / exact_m,
        "worst_length_ratio_of_10": max(length_ratios),
        "costmap_and_plan_cpu_ms": nav_cpu,
        "plan_over_shortest_path": path.length_m / cases["1500 boxes"]["length_m"],
        "peer_1000_ms": peer_ms,
        "ours_1000_ms": ours_ms,
        "times_faster_than_peer": peer_ms / ours_ms,
        "share_shorter_than_peer": 1.0 - ours.length_m / peer_m,
        "maps": cases,
    }


if __name__ == "__main__":
    sys.exit(main())
