"""Map files by the rules of Nav2's map_server: a YAML that places an image, and the image.

Rules of reading: `loadMapYaml` and `loadMapFromFile` in nav2_map_server/src/map_io.cpp; yaml-cpp reads the numbers. Where Nav2
would let a wall or an erased part become floor, the safer value is taken: see docs/formats.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from lupin_runtime.atomic_file import MalformedFile, write_atomically
from lupin_runtime.bounded_file import expand_home, read_bounded_text
from lupin_runtime.cpp_number import parse_number
from lupin_runtime.gridmap import OCCUPIED, UNKNOWN, GridMap
from lupin_runtime.slam.map_image import WHITE, MapImage, read_map_image
from lupin_runtime.yaml_fields import YamlFields

MODES = ("trinary", "scale", "raw")
# Pixel 205 must read back as unknown: its shade, 0.19608, is above 0.196 but below the 0.25 that Nav2's map saver writes.
OCCUPIED_THRESHOLD, FREE_THRESHOLD = 0.65, 0.196
_PIXEL_OCCUPIED, _PIXEL_FREE, _PIXEL_UNKNOWN = 0, 254, 205
_MAX_ORIGIN_M = 1e6
_SHOWN_ITEMS, _SHOWN_CHARACTERS = 6, 80  # of a refused value
_NEGATE = {name: value for value in (0, 1) for name in (str(value), ("n", "y")[value], ("no", "yes")[value])}
_NEGATE |= {"false": 0, "true": 1, "off": 0, "on": 1}


@dataclass(frozen=True)
class _Header:
    """The YAML's fields, checked."""

    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied: float
    free: float
    mode: str


def load_map(path: Path, warn: Callable[[str], object] | None = None) -> GridMap:
    """Read a map from its YAML. A turned origin is resampled onto the axes of the map frame (nearest cell).

    `warn` receives what a user should know of a map that can be read. Raises MalformedFile naming file and line, OSError where
    a file cannot be opened.
    """
    path = expand_home(str(path))
    header = _read_header(path)
    image_path = path.parent / expand_home(header.image)
    try:
        image = read_map_image(image_path)
    except FileNotFoundError:
        raise MalformedFile(path, None, f"its image {image_path} does not exist") from None
    except OSError as error:
        raise MalformedFile(path, None, f"its image {image_path} cannot be read: {error.strerror or error}") from None
    cells = _cells(image, header)
    if warn is not None and header.mode == "trinary" and (text := _free_205(image, cells, header.free)):
        warn(f"{path}: {text}")
    grid = GridMap(cells[::-1], header.resolution, header.origin[0], header.origin[1])
    return grid if header.origin[2] == 0.0 else _upright(grid, header.origin[2])


def save_map(path: Path, grid: GridMap, mode: str = "trinary") -> None:
    """Write `path` (the YAML) and the PGM beside it, both atomically, the image first.

    `trinary` keeps occupied (>= 65), free (<= 19) and unknown; `scale` keeps the grades but has no pixel for unknown; `raw`
    keeps everything. Raises ValueError for a mode that cannot hold the grid, OSError.
    """
    if mode not in MODES:
        raise ValueError(f"expected a mode of {', '.join(MODES)}, found {mode!r}")
    image = path.with_suffix(".pgm")
    pixels = _pixels(grid.cells[::-1], mode)
    write_atomically(image, b"P5\n%d %d\n255\n" % (grid.width, grid.height) + pixels.tobytes(), sync=True)
    occupied, free = (1.0, 0.0) if mode == "scale" else (OCCUPIED_THRESHOLD, FREE_THRESHOLD)
    header = (
        f"image: {image.name}\nmode: {mode}\nresolution: {grid.resolution_m!r}\n"
        f"origin: [{grid.origin_x!r}, {grid.origin_y!r}, 0]\nnegate: 0\noccupied_thresh: {occupied}\nfree_thresh: {free}\n"
    )
    write_atomically(path, header, sync=True)


def _pixels(cells: NDArray[np.int8], mode: str) -> NDArray[np.uint8]:
    if mode == "raw":
        return np.where(cells == UNKNOWN, 255, cells).astype(np.uint8)
    if mode == "scale":
        if (cells == UNKNOWN).any():
            raise ValueError("mode scale has no pixel for unknown cells; use trinary or raw")
        return np.asarray(np.rint(255.0 - cells * 2.55), np.uint8)
    pixels = np.full(cells.shape, _PIXEL_UNKNOWN, np.uint8)
    pixels[cells >= 100 * OCCUPIED_THRESHOLD] = _PIXEL_OCCUPIED
    pixels[(cells >= 0) & (cells <= 100 * FREE_THRESHOLD)] = _PIXEL_FREE
    return pixels


def _cells(image: MapImage, header: _Header) -> NDArray[np.int8]:
    """Return the cells of an image (height, width), top row first."""
    cells: NDArray[np.int8] = _cell_values(image.channels, header)[image.total]
    alpha = image.alpha
    if alpha is None:
        return cells
    if header.mode == "scale":
        cells[alpha < WHITE] = UNKNOWN
    if header.mode == "trinary":
        # Nav2 averages alpha into the color, as if it were a fourth one. Where both readings differ, the safer one is taken.
        color = image.total.astype(np.int32) * (3 // image.channels)
        averaged = _cell_values(4, header)[color + alpha]
        cells = np.where(cells == averaged, cells, np.where(np.maximum(cells, averaged) == OCCUPIED, OCCUPIED, UNKNOWN))
        cells[(alpha < WHITE) & (cells == 0)] = UNKNOWN
    cells[alpha == 0] = UNKNOWN
    return np.asarray(cells, np.int8)


def _cell_values(channels: int, header: _Header) -> NDArray[np.int8]:
    """Return the cell of each possible sum of a pixel's channels, computed in the order of Nav2: the last bit decides at a
    threshold."""
    shade = np.arange(channels * WHITE + 1) / channels / WHITE
    if header.mode == "raw":
        values = np.floor(shade * 255.0 + 0.5)
        return np.where(values <= OCCUPIED, values, UNKNOWN).astype(np.int8)
    occupancy = shade if header.negate else 1.0 - shade
    cells = np.full(shade.shape, UNKNOWN, np.int8)
    if header.mode == "scale":
        ratio = (occupancy - header.free) / (header.occupied - header.free)
        cells = np.rint(100.0 * np.clip(ratio, 0.0, 1.0)).astype(np.int8)
    cells[occupancy < header.free] = 0
    # With occupied_thresh 1, Nav2 finds no pixel occupied: black would be unknown, which paths may cross.
    cells[(occupancy > header.occupied) | (occupancy >= 1.0)] = OCCUPIED
    return cells


def _free_205(image: MapImage, cells: NDArray[np.int8], free: float) -> str:
    """Return a warning if the pixels that map savers write for unknown cells are free."""
    count = np.count_nonzero((image.total == 257 * _PIXEL_UNKNOWN * image.channels) & (cells == 0))
    if not count:
        return ""
    rest = "" if (cells == UNKNOWN).any() else ": the map has no unknown cells"
    return (
        f"{count} pixels of the gray 205, which map savers write for unknown, are free under free_thresh {free:g}{rest}; "
        f"to keep them unknown, set free_thresh: {FREE_THRESHOLD}"
    )


def _upright(grid: GridMap, yaw: float) -> GridMap:
    """Resample a grid that is turned by `yaw` about its corner onto the frame's axes."""
    c, s = math.cos(yaw), math.sin(yaw)
    width, height = grid.width * grid.resolution_m, grid.height * grid.resolution_m
    xs = [0.0, c * width, c * width - s * height, -s * height]
    ys = [0.0, s * width, s * width + c * height, c * height]
    columns = math.ceil((max(xs) - min(xs)) / grid.resolution_m - 1e-9)
    rows = math.ceil((max(ys) - min(ys)) / grid.resolution_m - 1e-9)
    x = min(xs) + (np.arange(columns) + 0.5) * grid.resolution_m
    y = min(ys) + (np.arange(rows) + 0.5) * grid.resolution_m
    along = np.floor((c * x[None, :] + s * y[:, None]) / grid.resolution_m).astype(np.int64)
    across = np.floor((-s * x[None, :] + c * y[:, None]) / grid.resolution_m).astype(np.int64)
    inside = (along >= 0) & (along < grid.width) & (across >= 0) & (across < grid.height)
    cells = np.full((rows, columns), UNKNOWN, np.int8)
    cells[inside] = grid.cells[across[inside], along[inside]]
    # The square of a turned cell may hold no center of the new ones: an obstacle of one cell would be lost.
    row, column = np.nonzero(grid.cells == OCCUPIED)
    u, v = (column + 0.5) * grid.resolution_m, (row + 0.5) * grid.resolution_m
    new_column = np.floor((c * u - s * v - min(xs)) / grid.resolution_m + 1e-9).astype(np.int64)
    new_row = np.floor((s * u + c * v - min(ys)) / grid.resolution_m + 1e-9).astype(np.int64)
    cells[np.clip(new_row, 0, rows - 1), np.clip(new_column, 0, columns - 1)] = OCCUPIED
    return GridMap(cells, grid.resolution_m, grid.origin_x + min(xs), grid.origin_y + min(ys))


def _read_header(path: Path) -> _Header:
    fields = _Fields(path, read_bounded_text(path, errors="replace"), "keys such as image, resolution, origin")
    origin = fields.numbers("origin", ("x", "y", "yaw"))
    header = _Header(
        image=fields.text("image"),
        resolution=fields.number("resolution", 1e-6, 1e3),
        origin=(origin[0], origin[1], origin[2]),
        negate=fields.negate(),
        occupied=fields.number("occupied_thresh", 0.0, 1.0),
        free=fields.number("free_thresh", 0.0, 1.0),
        mode=fields.mode(),
    )
    if header.free > header.occupied or (header.free == header.occupied and header.mode == "scale"):
        problem = f"free_thresh {header.free} must be below occupied_thresh {header.occupied}"
        raise MalformedFile(path, fields.line("free_thresh"), problem)
    return header


class _Fields(YamlFields):
    """The checked values of a map's YAML."""

    def text(self, key: str) -> str:
        node = self.node(key)
        if not isinstance(node, yaml.ScalarNode) or not node.value:
            raise self.refuse(key, f"expected a file name, found {_shown(node)}")
        return str(node.value)

    def mode(self) -> str:
        if "mode" not in self.nodes:
            return MODES[0]
        mode = self.text("mode").lower()
        if mode not in MODES:
            raise self.refuse("mode", f"expected one of {', '.join(MODES)}, found {mode!r}")
        return mode

    def negate(self) -> bool:
        if "negate" not in self.nodes:
            return False
        text = self.text("negate")
        value = _NEGATE.get(text.lower()) if text in (text.lower(), text.upper(), text.capitalize()) else None
        if value is None:
            raise self.refuse("negate", f"expected 0, 1 or a truth value, found {text!r}")
        return value == 1

    def number(self, key: str, low: float, high: float) -> float:
        value = self._number(key, key, self.node(key))
        if value is None or not low <= value <= high:
            raise self.refuse(key, f"expected a number from {low:g} to {high:g}, found {_shown(self.node(key))}")
        return value

    def numbers(self, key: str, names: tuple[str, ...]) -> list[float]:
        node = self.node(key)
        items = node.value if isinstance(node, yaml.SequenceNode) else []
        values = [self._number(key, name, item) for name, item in zip(names, items)]
        good = [value for value in values if value is not None and abs(value) <= _MAX_ORIGIN_M]
        if len(items) != len(names) or len(good) != len(names):
            raise self.refuse(key, f"expected {len(names)} numbers ({', '.join(names)}), found {_shown(node)}")
        return good

    def _number(self, key: str, name: str, node: yaml.Node) -> float | None:
        """Return the number of a node, None if it is none. Raises MalformedFile for NaN."""
        value = parse_number(str(node.value)) if isinstance(node, yaml.ScalarNode) else None
        if value is not None and math.isnan(value):
            raise self.refuse(key, f"the {name} is NaN: whatever wrote this file had no value for it; write a number")
        return value


def _shown(node: yaml.Node) -> str:
    """Return a value as text, one level deep: an alias may make a list a part of itself."""
    if isinstance(node, yaml.SequenceNode):
        return f"[{', '.join(_scalar(item) for item in node.value[:_SHOWN_ITEMS])}{', ...' * (len(node.value) > _SHOWN_ITEMS)}]"
    return _scalar(node)


def _scalar(node: yaml.Node) -> str:
    return repr(node.value[:_SHOWN_CHARACTERS]) if isinstance(node, yaml.ScalarNode) else "a list or mapping"
