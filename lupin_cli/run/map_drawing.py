"""Draws a run's map in the terminal: walls in braille dots, the way, the plan, tags by number, and the robot as an arrow."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rich.text import Text

DOT_COLUMNS, DOT_ROWS = 2, 4  # of one character
_DOT_BITS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
_BRAILLE = 0x2800
ARROWS = "▶▲◀▼"  # by quarter turns of the heading, from +x
WALL, WAY, ROBOT, READ, UNREAD = "default", "bright_black", "bold bright_green", "bright_green", "yellow"


@dataclass(frozen=True)
class _Canvas:
    """Dots and letters of `width` x `height` characters; a map meter is `dots_per_m` dots, and y points up."""

    width: int
    height: int
    x: float  # of the left edge, m
    y: float  # of the lower edge, m
    dots_per_m: float
    dots: dict[tuple[int, int], int]  # (row, column) of a character → bits
    styles: dict[tuple[int, int], str]
    letters: dict[tuple[int, int], tuple[str, str]]

    def dot(self, x: float, y: float, style: str) -> None:
        """Set the dot of a point."""
        across, up = math.floor((x - self.x) * self.dots_per_m), math.floor((y - self.y) * self.dots_per_m)
        down = self.height * DOT_ROWS - 1 - up
        if 0 <= across < self.width * DOT_COLUMNS and 0 <= down < self.height * DOT_ROWS:
            at = down // DOT_ROWS, across // DOT_COLUMNS
            self.dots[at] = self.dots.get(at, 0) | _DOT_BITS[down % DOT_ROWS][across % DOT_COLUMNS]
            self.styles[at] = style

    def write(self, x: float, y: float, text: str, style: str) -> None:
        """Write a text that begins at a point, as far as it fits."""
        column = math.floor((x - self.x) * self.dots_per_m) // DOT_COLUMNS
        row = (self.height * DOT_ROWS - 1 - math.floor((y - self.y) * self.dots_per_m)) // DOT_ROWS
        column = min(max(0, column), max(0, self.width - len(text)))
        if 0 <= row < self.height:
            self.letters.update({(row, column + at): (letter, style) for at, letter in enumerate(text)})

    def line(self, row: int) -> Text:
        """Return one row of characters."""
        line = Text(no_wrap=True)
        for column in range(self.width):
            letter, style = self.letters.get((row, column)) or (chr(_BRAILLE + self.dots.get((row, column), 0)), "")
            line.append(letter, style or self.styles.get((row, column), WALL))
        return line


def draw_map(robot: Mapping[str, Any], width: int, height: int) -> list[Text]:
    """Return at most `height` lines of `width` characters from what the run's state says of the robot; empty without a map."""
    try:
        return _draw(robot, width, height)
    except (KeyError, TypeError, ValueError, IndexError, ArithmeticError):
        return []  # of another version, or damaged


def _draw(robot: Mapping[str, Any], width: int, height: int) -> list[Text]:
    found = robot.get("map")
    if not found:
        return []
    rows, cell_m = found["rows"], float(found["cell_m"])
    across_m, up_m = len(rows[0]) * cell_m, len(rows) * cell_m
    dots_per_m = min(width * DOT_COLUMNS / across_m, height * DOT_ROWS / up_m)
    lines = min(height, math.ceil(up_m * dots_per_m / DOT_ROWS))
    canvas = _Canvas(width, lines, float(found["x"]), float(found["y"]), dots_per_m, {}, {}, {})
    dots_of_cell = max(1, math.ceil(cell_m * dots_per_m))
    for row, letters in enumerate(rows):
        for column, letter in enumerate(letters):
            if letter == "#":
                for sub in range(dots_of_cell * dots_of_cell):  # a cell may be larger than a dot
                    part_x, part_y = (sub % dots_of_cell + 0.5) / dots_of_cell, (sub // dots_of_cell + 0.5) / dots_of_cell
                    canvas.dot(canvas.x + (column + part_x) * cell_m, canvas.y + (row + part_y) * cell_m, WALL)
    for x, y in _between(robot.get("trail", ()), 1.0 / dots_per_m):
        canvas.dot(x, y, WAY)
    for x, y in _between(robot.get("plan", ()), 1.0 / dots_per_m):
        canvas.dot(x, y, READ)
    for tag in robot.get("tags", ()):
        if tag["x"] is not None:
            canvas.write(tag["x"], tag["y"], str(tag["id"]), READ if tag["read"] else UNREAD)
    if robot.get("plan"):
        goal_x, goal_y = robot["plan"][-1]
        canvas.write(goal_x, goal_y, "x", READ)
    if robot.get("pose"):
        x, y, yaw = robot["pose"]
        canvas.write(x, y, ARROWS[round(yaw / (math.pi / 2)) % 4], ROBOT)
    return [canvas.line(row) for row in range(lines)]


def _between(points: Iterable[Iterable[float]], step_m: float) -> Iterable[tuple[float, float]]:
    """Yield points along straight lines between the given ones, no further apart than `step_m`."""
    before: tuple[float, float] | None = None
    for x, y in points:
        pieces = 1 if before is None else max(1, min(200, math.ceil(math.dist(before, (x, y)) / step_m)))
        start_x, start_y = before or (x, y)
        for piece in range(1, pieces + 1):
            yield start_x + (x - start_x) * piece / pieces, start_y + (y - start_y) * piece / pieces
        before = x, y
