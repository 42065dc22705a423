"""Greenhouses from layout files, the packaged one of `mdp-greenhouse` among them.

The format: `{"units": "m", "tables": {NAME: {"x0", "x1", "y0", "y1"}}, "tags": {ID: {"x", "y", "sensors": [...]}}}`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_sim.tag_family import FAMILY_SIZE
from lupin_sim.world import TAG_PLATE_M, Box, Tag, World
from lupin_sim.worlds.hanging import nearest, project
from lupin_sim.worlds.planting import plant_all

# The packaged aisles are 0.45 m: no robot of 0.44 m gets through. At 1.8 the narrowest is 1.0 m.
COURSE_STRETCH = 1.8
STRETCH_RANGE = (1.0, 5.0)
# From the outermost table to the wall: room to stand half a metre in front of a tag that looks outwards.
WALL_MARGIN_M = 1.1
START_CLEARANCE_M = 0.40
FARTHEST_M = 100.0  # a coordinate: more is no greenhouse but a slip, of units most often
_KEYS = ("x0", "x1", "y0", "y1")


class LayoutError(ValueError):
    """A layout file that makes no greenhouse: names the file, the line where that is known, and the problem."""


@dataclass(frozen=True)
class Table:
    """A rectangle of the layout, metres."""

    name: str
    x0: float
    x1: float
    y0: float
    y1: float


@dataclass(frozen=True)
class LayoutTag:
    """Where the layout has a tag, metres."""

    id: int
    x: float
    y: float


@dataclass(frozen=True)
class Layout:
    """A layout file's content, tables by name and tags by id."""

    tables: tuple[Table, ...]
    tags: tuple[LayoutTag, ...]


def parse_layout(text: str, source: str) -> Layout:
    """Read a layout; `source` stands in error messages. Raises LayoutError."""
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise LayoutError(f"{source}:{error.lineno}: not JSON: {error.msg}") from None
    except (ValueError, RecursionError) as error:  # numbers of thousands of digits, brackets of thousands of levels
        raise LayoutError(f"{source}: not JSON that can be read: {error}") from None
    reader = _Reader(text, source)
    root = reader.mapping(document, "the file", "")
    units = root.get("units", "m")
    if units != "m":
        raise reader.error("units", f'units must be "m", found {units!r}')
    tables = [reader.table(name, value) for name, value in reader.mapping(root.get("tables"), "tables", "tables").items()]
    tags = [reader.tag(name, value) for name, value in reader.mapping(root.get("tags"), "tags", "tags").items()]
    if not tables:
        raise reader.error("tables", "at least one table is needed, found none")
    return Layout(tuple(sorted(tables, key=lambda table: table.name)), tuple(sorted(tags, key=lambda tag: tag.id)))


class _Reader:
    """Checks values and says where a bad one stands."""

    def __init__(self, text: str, source: str) -> None:
        self._lines, self._source = text.splitlines(), source

    def error(self, key: str, problem: str) -> LayoutError:
        # json keeps no positions; the first line that holds the quoted key is where a person would look.
        for number, line in enumerate(self._lines, 1):
            if key and f'"{key}"' in line:
                return LayoutError(f"{self._source}:{number}: {problem}")
        return LayoutError(f"{self._source}: {problem}")

    def mapping(self, value: Any, what: str, key: str) -> Mapping[str, Any]:
        if not isinstance(value, dict):
            raise self.error(key, f"{what} must be an object, found {_found(value)}")
        return value

    def number(self, owner: str, holder: Mapping[str, Any], name: str) -> float:
        value = holder.get(name)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= FARTHEST_M:
            raise self.error(
                owner, f"{owner}.{name} must be a number, at most {FARTHEST_M:.0f} m from 0, found {_found(value)}"
            )
        return float(value)

    def table(self, name: str, value: Any) -> Table:
        holder = self.mapping(value, f"table {name!r}", name)
        x0, x1, y0, y1 = (self.number(name, holder, key) for key in _KEYS)
        if min(x1 - x0, y1 - y0) < TAG_PLATE_M:
            size = f"{x1 - x0:.3f} by {y1 - y0:.3f} m"
            raise self.error(
                name, f"table {name!r} is {size}; a tag's plate needs {TAG_PLATE_M} m both ways (x1 > x0, y1 > y0)"
            )
        return Table(name, x0, x1, y0, y1)

    def tag(self, name: str, value: Any) -> LayoutTag:
        if not (name.isascii() and name.isdigit() and int(name) < FAMILY_SIZE):
            raise self.error(name, f"tag {name!r} is not an id of family 36h11 (0 to {FAMILY_SIZE - 1})")
        holder = self.mapping(value, f"tag {name!r}", name)
        return LayoutTag(int(name), self.number(name, holder, "x"), self.number(name, holder, "y"))


def _found(value: Any) -> str:
    return "nothing" if value is None else f"{value!r:.40}"


def world_from_layout(layout: Layout, name: str, seed: int, stretch: float = 1.0) -> World:
    """Stand a layout up: tables become planters of their own size, spread about the layout's middle by `stretch` so that a
    robot fits between; each tag goes to the nearest side of its nearest table and moves along with it. Raises ValueError
    where a tag finds no room or the robot no place to start."""
    cx = (min(t.x0 for t in layout.tables) + max(t.x1 for t in layout.tables)) / 2
    cy = (min(t.y0 for t in layout.tables) + max(t.y1 for t in layout.tables)) / 2
    original = {table.name: _planter(table, 0.0, 0.0) for table in layout.tables}
    shift = {name: ((stretch - 1.0) * (box.x - cx), (stretch - 1.0) * (box.y - cy)) for name, box in original.items()}
    boxes = tuple(_planter(table, *shift[table.name]) for table in layout.tables)
    tags: list[Tag] = []
    hung: list[Tag] = []
    for tag in layout.tags:
        box = nearest(original.values(), tag.x, tag.y)
        placed = project(box, tag.x, tag.y, tag.id, hung)
        hung.append(placed)
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
        flowers=plant_all({box.name: box for box in boxes}, tuple(tags), rng),
        start=Pose2(bounds[0], bounds[1], 0.0),
    )
    return World(**{**world.__dict__, "start": _start(world)}).with_outer_walls()


def _planter(table: Table, dx: float, dy: float) -> Box:
    """The front looks south; width runs along x."""
    x, y = (table.x0 + table.x1) / 2 + dx, (table.y0 + table.y1) / 2 + dy
    return Box(table.name, x, y, -math.pi / 2, width=table.x1 - table.x0, depth=table.y1 - table.y0)


def _start(world: World) -> Pose2:
    """The free place nearest to the south-west corner, heading east."""
    x0, y0, x1, y1 = world.bounds
    xs = np.arange(x0 + START_CLEARANCE_M, x1 - START_CLEARANCE_M, 0.1)
    ys = np.arange(y0 + START_CLEARANCE_M, y1 - START_CLEARANCE_M, 0.1)
    x, y = (part.ravel() for part in np.meshgrid(xs, ys))
    for index in np.lexsort((y, x, np.hypot(x - x0, y - y0))):
        if world.clearance(float(x[index]), float(y[index])) >= START_CLEARANCE_M:
            return Pose2(float(x[index]), float(y[index]), 0.0)
    raise ValueError(f"world {world.name!r} has no place where the robot could start")


def layout_file(path: str, seed: int) -> World:
    """The greenhouse of a user's layout file, as it stands there. Raises LayoutError."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise LayoutError(f"{path}: cannot be read: {error}") from None
    try:
        return world_from_layout(parse_layout(text, path), Path(path).stem, seed)
    except LayoutError:
        raise
    except ValueError as error:
        raise LayoutError(f"{path}: {error}") from None


def course(stretch: str, seed: int) -> World:
    """The packaged layout of `mdp-greenhouse`, spread by a factor ("" for the default). Raises LayoutError."""
    factor = COURSE_STRETCH
    if stretch:
        try:
            factor = float(stretch)
        except ValueError:
            factor = math.nan
        if not STRETCH_RANGE[0] <= factor <= STRETCH_RANGE[1]:
            raise LayoutError(f"course:{stretch}: the stretch must be a number from {STRETCH_RANGE[0]} to {STRETCH_RANGE[1]}")
    try:
        packaged = resources.files("greenhouse_sim").joinpath("configs", "tag_locations.json")
        text = packaged.read_text(encoding="utf-8")
    except (ModuleNotFoundError, FileNotFoundError) as error:
        raise LayoutError(f"the packaged layout is missing ({error}); install it with: pip install mdp-greenhouse") from None
    return world_from_layout(parse_layout(text, str(packaged)), "course", seed, factor)
