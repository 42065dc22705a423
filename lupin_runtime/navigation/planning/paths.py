"""Paths as arrays: length, even spacing, smoothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Plan:
    """A path (n, 2) of points (x, y) in meters from the start to `goal`, which may be beside the requested goal."""

    points: NDArray[np.float64]

    @property
    def goal(self) -> tuple[float, float]:
        """The end of the path."""
        return float(self.points[-1, 0]), float(self.points[-1, 1])

    @property
    def length_m(self) -> float:
        """Meters along the path."""
        return float(arc_lengths(self.points)[-1])


def arc_lengths(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the meters along a polyline (n, 2) up to each of its points."""
    steps = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.zeros(0)
    return np.concatenate(([0.0], np.cumsum(steps)))


def resample(points: NDArray[np.float64], spacing_m: float) -> NDArray[np.float64]:
    """Resample a polyline every `spacing_m`; the last step may be shorter, the ends stay."""
    along = arc_lengths(points)
    total = along[-1]
    if total < 1e-9:
        return points[[0, -1]].astype(np.float64)
    at = np.arange(0.0, total, spacing_m)
    if total - at[-1] < 1e-6:
        at = at[:-1]
    at = np.append(at, total)
    return np.column_stack((np.interp(at, along, points[:, 0]), np.interp(at, along, points[:, 1])))


def smooth(points: NDArray[np.float64], passes: int = 3) -> NDArray[np.float64]:
    """Smooth the kinks of a grid: each inner point moves towards its neighbors' midpoint."""
    out = points.copy()
    for _ in range(passes):
        out[1:-1] = 0.25 * out[:-2] + 0.5 * out[1:-1] + 0.25 * out[2:]
    return out


def headings(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the direction of travel at each point (rad); the last one is repeated."""
    if len(points) < 2:
        return np.zeros(len(points))
    steps = np.diff(points, axis=0)
    yaw = np.arctan2(steps[:, 1], steps[:, 0])
    return np.append(yaw, yaw[-1])
