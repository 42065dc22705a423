"""Small symbols of the map: bugs, diamonds, crosses and tags. Sizes are units of the canvas."""

from __future__ import annotations

import math

from markupsafe import Markup

from lupin_runtime.report.page.markup import element, path_data


def bug_path(x: float, y: float, size: float) -> str:
    """Return path data of a body with three pairs of legs."""
    legs = "".join(
        f"M{x - size:.1f} {y + k * size * 0.6:.1f}L{x + size:.1f} {y + k * size * 0.6:.1f}" for k in (-0.7, 0.0, 0.7)
    )
    return f"{legs}M{x:.1f} {y - size:.1f}L{x:.1f} {y + size:.1f}"


def diamond_path(x: float, y: float, size: float) -> str:
    """Return path data of a diamond around (x, y)."""
    return f"M{x:.1f} {y - size:.1f}L{x + size:.1f} {y:.1f}L{x:.1f} {y + size:.1f}L{x - size:.1f} {y:.1f}Z"


def cross_path(x: float, y: float, size: float) -> str:
    """Return path data of a cross around (x, y)."""
    return f"M{x - size:.1f} {y - size:.1f}l{2 * size:.1f} {2 * size:.1f}m0 {-2 * size:.1f}l{-2 * size:.1f} {2 * size:.1f}"


def tag_plate(x: float, y: float, facing_rad: float | None, size: float) -> Markup:
    """Return a tag seen from above: a triangle that points where its face looks, a circle for a tag that faces up."""
    if facing_rad is None:
        return element("circle", cx=x, cy=y, r=size * 0.4, class_="plate")
    nx, ny = math.cos(facing_rad), -math.sin(facing_rad)
    lx, ly = -ny * size * 0.75, nx * size * 0.75
    points = [(x - lx, y - ly), (x + nx * size * 0.8, y + ny * size * 0.8), (x + lx, y + ly)]
    return element("path", d=path_data(points) + "Z", class_="plate")
