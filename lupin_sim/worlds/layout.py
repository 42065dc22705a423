"""Builds simulated greenhouses from layout files, such as the packaged one of `mdp-greenhouse`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from lupin_runtime.apriltag import FAMILY_SIZE
from lupin_runtime.geometry import Pose2
from lupin_runtime.layout import Layout, LayoutError, LayoutText, Table, packaged_layout_path
from lupin_sim.world import TAG_PLATE_M, Box, Tag, World
from lupin_sim.worlds.flower_placement import place_all_flowers
from lupin_sim.worlds.tag_placement import nearest, project

# The packaged layout has aisles of 0.45 m, too narrow for a robot of 0.44 m. Stretched by 1.8, the narrowest is 1.0 m.
COURSE_STRETCH = 1.8
STRETCH_RANGE = (1.0, 5.0)
# From the outermost table to the wall, so that the robot can be half a meter in front of a tag that faces outwards.
WALL_MARGIN_M = 1.1
START_CLEARANCE_M = 0.40
MAX_COORDINATE_M = 100.0  # a larger coordinate is a mistake, usually of units


def parse_simulable_layout(text: LayoutText) -> Layout:
    """Parse a layout and check that a simulated greenhouse can be built from it. Raises LayoutError.

    The simulator has more requirements than the robot: at least one table, tables large enough for a tag's plate, tag ids of
    the family, and plausible coordinates.
    """
    layout = text.parse()
    if not layout.tables:
        raise text.error("tables", "at least one table is needed, found none")
    for name, table in layout.tables.items():
        _check_coordinates(text, f"tables.{name}", name, vars(table))
        if min(table.x1 - table.x0, table.y1 - table.y0) < TAG_PLATE_M:
            size = f"{table.x1 - table.x0:.3f} by {table.y1 - table.y0:.3f} m"
            raise text.error(
                name, f"table {name!r} is {size}; a tag's plate needs {TAG_PLATE_M} m in both directions (x1 > x0, y1 > y0)"
            )
    for tag_id, location in layout.tags.items():
        if not (tag_id.isascii() and tag_id.isdigit() and len(tag_id) < 9 and int(tag_id) < FAMILY_SIZE):
            raise text.error(tag_id, f"tag {tag_id!r} is not an id of family 36h11 (0 to {FAMILY_SIZE - 1})")
        _check_coordinates(text, f"tags.{tag_id}", tag_id, vars(location))
    return layout


def _check_coordinates(text: LayoutText, owner: str, key: str, coordinates: dict[str, float]) -> None:
    for name, value in coordinates.items():
        if abs(value) > MAX_COORDINATE_M:
            raise text.error(key, f"{owner}.{name} must be at most {MAX_COORDINATE_M:.0f} m from 0, found {value!r}")


def world_from_layout(layout: Layout, name: str, seed: int, stretch: float = 1.0) -> World:
    """Build a world from a layout.

    Tables become planters of the same size. Their distances from the layout's middle are multiplied by `stretch`, so that a
    robot fits between them. Each tag is placed on the nearest side of its nearest table and moves with it. Raises ValueError if
    there is no room for a tag or for the robot's start.
    """
    tables = dict(sorted(layout.tables.items()))
    cx = (min(t.x0 for t in tables.values()) + max(t.x1 for t in tables.values())) / 2
    cy = (min(t.y0 for t in tables.values()) + max(t.y1 for t in tables.values())) / 2
    original = {table_name: _planter(table_name, table, 0.0, 0.0) for table_name, table in tables.items()}
    shift = {box.name: ((stretch - 1.0) * (box.x - cx), (stretch - 1.0) * (box.y - cy)) for box in original.values()}
    boxes = tuple(_planter(table_name, table, *shift[table_name]) for table_name, table in tables.items())
    tags: list[Tag] = []
    unstretched: list[Tag] = []
    for tag_id, location in sorted(((int(i), at) for i, at in layout.tags.items()), key=lambda item: item[0]):
        box = nearest(original.values(), location.x, location.y)
        placed = project(box, location.x, location.y, tag_id, unstretched)
        unstretched.append(placed)
        dx, dy = shift[box.name]
        tags.append(Tag(placed.id, placed.x + dx, placed.y + dy, placed.yaw, box=box.name))
    corners = [corner for box in boxes for corner in box.corners()]
    bounds = (
        min(x for x, _ in corners) - WALL_MARGIN_M,
        min(y for _, y in corners) - WALL_MARGIN_M,
        max(x for x, _ in corners) + WALL_MARGIN_M,
        max(y for _, y in corners) + WALL_MARGIN_M,
    )
    rng = np.random.default_rng(np.random.SeedSequence((seed, 0x1A70)))
    world = World(
        name=name,
        seed=seed,
        bounds=bounds,
        boxes=boxes,
        tags=tuple(tags),
        flowers=place_all_flowers({box.name: box for box in boxes}, tuple(tags), rng),
        start=Pose2(bounds[0], bounds[1], 0.0),
    )
    return World(**{**world.__dict__, "start": _start(world)}).with_outer_walls()


def _planter(name: str, table: Table, dx: float, dy: float) -> Box:
    """Return a planter whose front faces south; its width is along x."""
    x, y = table.center[0] + dx, table.center[1] + dy
    return Box(name, x, y, -math.pi / 2, width=table.x1 - table.x0, depth=table.y1 - table.y0)


def _start(world: World) -> Pose2:
    """Return the free pose nearest to the south-west corner, heading east. Raises ValueError."""
    x0, y0, x1, y1 = world.bounds
    xs = np.arange(x0 + START_CLEARANCE_M, x1 - START_CLEARANCE_M, 0.1)
    ys = np.arange(y0 + START_CLEARANCE_M, y1 - START_CLEARANCE_M, 0.1)
    x, y = (part.ravel() for part in np.meshgrid(xs, ys))
    for index in np.lexsort((y, x, np.hypot(x - x0, y - y0))):
        if world.clearance(float(x[index]), float(y[index])) >= START_CLEARANCE_M:
            return Pose2(float(x[index]), float(y[index]), 0.0)
    raise ValueError(f"world {world.name!r} has no room for the robot's start")


def layout_file(path: str, seed: int) -> World:
    """Return the greenhouse of a user's layout file, not stretched. Raises LayoutError."""
    layout = parse_simulable_layout(LayoutText.read(Path(path)))
    try:
        return world_from_layout(layout, Path(path).stem, seed)
    except ValueError as error:
        raise LayoutError(f"{path}: {error}") from None


def course(stretch: str, seed: int) -> World:
    """Return the packaged layout of `mdp-greenhouse`, stretched by a factor ("" for the default). Raises LayoutError."""
    factor = COURSE_STRETCH
    if stretch:
        try:
            factor = float(stretch)
        except ValueError:
            factor = math.nan
        if not STRETCH_RANGE[0] <= factor <= STRETCH_RANGE[1]:
            raise LayoutError(f"course:{stretch}: the stretch must be a number from {STRETCH_RANGE[0]} to {STRETCH_RANGE[1]}")
    layout = parse_simulable_layout(LayoutText.read(packaged_layout_path()))
    return world_from_layout(layout, "course", seed, factor)
