"""Path data of the map's lines and small symbols: bugs, diamonds, crosses and tags. Sizes are units of the canvas."""

from __future__ import annotations

import math
from collections.abc import Iterable

Point = tuple[float, float]


def path_data(points: Iterable[Point]) -> str:
    """Return SVG path data, `M x y L x y …`, of a sequence of (x, y)."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def polygon_points(points: Iterable[Point]) -> str:
    """Return the points of an SVG polygon, `x,y x,y …`."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def bug_path(at: Point, size: float) -> str:
    """Return path data of a body with three pairs of legs."""
    x, y = at
    legs = "".join(
        f"M{x - size:.1f} {y + k * size * 0.6:.1f}L{x + size:.1f} {y + k * size * 0.6:.1f}" for k in (-0.7, 0.0, 0.7)
    )
    return f"{legs}M{x:.1f} {y - size:.1f}L{x:.1f} {y + size:.1f}"


def diamond_path(at: Point, size: float) -> str:
    """Return path data of a diamond around a point."""
    x, y = at
    return f"M{x:.1f} {y - size:.1f}L{x + size:.1f} {y:.1f}L{x:.1f} {y + size:.1f}L{x - size:.1f} {y:.1f}Z"


def cross_path(at: Point, size: float) -> str:
    """Return path data of a cross around a point."""
    x, y = at
    return f"M{x - size:.1f} {y - size:.1f}l{2 * size:.1f} {2 * size:.1f}m0 {-2 * size:.1f}l{-2 * size:.1f} {2 * size:.1f}"


def plate_path(at: Point, facing_rad: float, size: float) -> str:
    """Return path data of a tag seen from above: a triangle that points where its face looks."""
    x, y = at
    nx, ny = math.cos(facing_rad), -math.sin(facing_rad)
    lx, ly = -ny * size * 0.75, nx * size * 0.75
    return path_data([(x - lx, y - ly), (x + nx * size * 0.8, y + ny * size * 0.8), (x + lx, y + ly)]) + "Z"
