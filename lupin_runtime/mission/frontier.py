"""Frontiers of a map: free cells beside unknown ones (Yamauchi 1997), with enough room for the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import UNKNOWN, GridMap


@dataclass(frozen=True)
class FrontierSettings:
    """Thresholds are occupancies 0..100. `radius_cells` >= 0 overrides `clearance_m`.

    The clearance is in meters because a clearance of 4 cells (0.20 m) put goals inside the planner's inflation radius of
    0.25 m, in which no path can end.
    """

    free_thresh: int = 20
    occupied_thresh: int = 65
    min_cluster_cells: int = 6
    clearance_m: float = 0.35
    radius_cells: int = -1
    clearance_occupied_thresh: int = 65

    def radius(self, resolution_m: float) -> int:
        """Return half the side, in cells, of the square around a goal that must be free of obstacles."""
        if self.radius_cells >= 0:
            return self.radius_cells
        return math.ceil(self.clearance_m / resolution_m - 1e-9)


@dataclass(frozen=True)
class Frontier:
    """A cluster of frontier cells. `x` and `y` are its member cell nearest to the centroid, meters in the map frame."""

    x: float
    y: float
    cluster_size: int
    num_clusters: int
    score: float


def frontier_cells(grid: GridMap, settings: FrontierSettings) -> NDArray[np.bool_]:
    """Return a mask (height, width) of free cells with an unknown 4-neighbor and no obstacle in the clearance square."""
    cells = grid.cells
    unknown = cells == UNKNOWN
    next_to_unknown = np.zeros_like(unknown)
    next_to_unknown[1:, :] |= unknown[:-1, :]
    next_to_unknown[:-1, :] |= unknown[1:, :]
    next_to_unknown[:, 1:] |= unknown[:, :-1]
    next_to_unknown[:, :-1] |= unknown[:, 1:]
    frontier: NDArray[np.bool_] = next_to_unknown & (cells >= 0) & (cells <= settings.free_thresh)
    if not frontier.any():
        return frontier
    side = 2 * settings.radius(grid.resolution_m) + 1
    obstacle = (cells >= settings.clearance_occupied_thresh).astype(np.uint8)
    # The area outside the map counts as free of obstacles: a constant border of zeros.
    near = cv2.dilate(
        obstacle, np.ones((side, side), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=(0.0, 0.0, 0.0, 0.0)
    )
    clear: NDArray[np.bool_] = frontier & (near == 0)
    return clear


def find_frontiers(
    grid: GridMap, robot_xy: tuple[float, float] | None, settings: FrontierSettings | None = None
) -> list[Frontier]:
    """Return every frontier cluster that is large enough, best first.

    The score is size / (1 + distance to the robot in meters), or the size if the robot's position is unknown. Equal scores
    are ordered by the clusters' first cells, row-major.
    """
    settings = settings or FrontierSettings()
    if grid.cells.size == 0:
        return []
    mask = frontier_cells(grid, settings)
    rows, columns = np.nonzero(mask)
    if rows.size == 0:
        return []
    _, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    member_of = labels[rows, columns]
    _, first, cluster = np.unique(member_of, return_index=True, return_inverse=True)
    sizes = np.bincount(cluster)
    kept = np.flatnonzero(sizes >= settings.min_cluster_cells)
    kept = kept[np.argsort(first[kept], kind="stable")]
    mean_row = np.bincount(cluster, weights=rows) / sizes
    mean_column = np.bincount(cluster, weights=columns) / sizes
    off_center = (rows - mean_row[cluster]) ** 2 + (columns - mean_column[cluster]) ** 2
    found: list[Frontier] = []
    for index in kept:
        members = np.flatnonzero(cluster == index)
        best = members[np.argmin(off_center[members])]
        x, y = grid.center_of(int(rows[best]), int(columns[best]))
        size = int(sizes[index])
        score = size / (1.0 + math.hypot(x - robot_xy[0], y - robot_xy[1])) if robot_xy is not None else float(size)
        found.append(Frontier(x, y, size, kept.size, score))
    return sorted(found, key=lambda frontier: -frontier.score)  # stable: equal scores keep their order


def select_frontier_goal(
    grid: GridMap, robot_xy: tuple[float, float] | None, settings: FrontierSettings | None = None
) -> Frontier | None:
    """Return the best frontier to drive to, or None."""
    found = find_frontiers(grid, robot_xy, settings)
    return found[0] if found else None
