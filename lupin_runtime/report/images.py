"""Raster images of a report: occupancy map, heat maps and thumbnails."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import GridMap
from lupin_runtime.report.health import SENSORS
from lupin_runtime.report.palette import HEAT_ALPHA, heat_rgb
from lupin_runtime.report.tags import TagResult
from lupin_runtime.twin.field import FieldRequest, IdwOptions, interpolate

# Nearest-neighbor upscaling keeps the cells' edges sharp in browsers that smooth images.
MAP_SCALE = 3
HEAT_CELL_M = 0.05
_MAX_CELLS = 200_000

# (free, occupied) as RGB, for the light and the dark page; unknown cells are transparent.
_MAP_COLORS = {"light": ((255, 255, 253), (48, 52, 58)), "dark": ((36, 41, 49), (196, 204, 214))}


@dataclass(frozen=True)
class Extent:
    """A rectangle in the map frame, meters."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def width(self) -> float:
        """Size along x in meters."""
        return self.x1 - self.x0

    @property
    def height(self) -> float:
        """Size along y in meters."""
        return self.y1 - self.y0

    def grown_to(self, x: float, y: float, margin: float = 0.0) -> Extent:
        """Return the smallest extent that contains this one and a point."""
        return Extent(min(self.x0, x - margin), min(self.y0, y - margin), max(self.x1, x + margin), max(self.y1, y + margin))


@dataclass(frozen=True)
class HeatMap:
    """A sensor's values interpolated between the tags where it was read, as an image that covers `extent`."""

    sensor: str
    png: bytes
    extent: Extent
    low: float
    high: float
    samples: int


def known_extent(grid: GridMap) -> Extent | None:
    """Return the bounding rectangle of the known cells; None if there are none."""
    known = grid.cells >= 0
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not rows.size:
        return None
    r = grid.resolution_m
    return Extent(
        grid.origin_x + float(columns[0]) * r,
        grid.origin_y + float(rows[0]) * r,
        grid.origin_x + float(columns[-1] + 1) * r,
        grid.origin_y + float(rows[-1] + 1) * r,
    )


def map_png(grid: GridMap, extent: Extent, theme: str, scale: int = MAP_SCALE) -> bytes:
    """Return the cells in `extent` as a PNG with +y up, `scale` pixels per cell, in the theme's colors (`light` or `dark`)."""
    cells = _crop(grid, extent)
    free, occupied = (np.array(color, np.float32) for color in _MAP_COLORS[theme])
    fraction = (np.clip(cells, 0, 100).astype(np.float32) / 100.0)[..., None]
    image = np.empty((*cells.shape, 4), np.uint8)
    image[..., :3] = (free + (occupied - free) * fraction)[..., ::-1]
    image[..., 3] = np.where(cells < 0, 0, 255)
    size = (cells.shape[1] * scale, cells.shape[0] * scale)
    return _png(cv2.resize(image[::-1], size, interpolation=cv2.INTER_NEAREST))


def _crop(grid: GridMap, extent: Extent) -> NDArray[np.int8]:
    top, left = grid.cell_of(extent.x0 + 1e-6, extent.y0 + 1e-6)
    rows, columns = round(extent.height / grid.resolution_m), round(extent.width / grid.resolution_m)
    return grid.cells[top : top + rows, left : left + columns]


def heat_maps(tags: Sequence[TagResult], grid: GridMap | None) -> list[HeatMap]:
    """One per sensor that any placed tag measured. Where the map is unknown there is no color."""
    found = []
    for sensor in SENSORS:
        samples = np.array(
            [
                (tag.pose.x, tag.pose.y, reading.value)
                for tag in tags
                if tag.pose is not None
                for reading in tag.readings
                if reading.sensor == sensor and math.isfinite(reading.value)
            ]
        )
        if samples.size:
            found.append(_heat_map(sensor, samples, grid))
    return found


def _heat_map(sensor: str, samples: NDArray[np.float64], grid: GridMap | None) -> HeatMap:
    options = IdwOptions()
    margin_m = options.max_distance_m
    (x0, y0), (x1, y1) = samples[:, :2].min(axis=0) - margin_m, samples[:, :2].max(axis=0) + margin_m
    # Large greenhouses get larger cells.
    cell = max(HEAT_CELL_M, math.sqrt((x1 - x0) * (y1 - y0) / _MAX_CELLS))
    request = FieldRequest(sensor, cell, float(x0), float(y0), float(x1), float(y1))
    field = interpolate(request, [(float(x), float(y), float(v)) for x, y, v in samples], options).values
    rows, columns = field.shape
    xs, ys = x0 + (np.arange(columns) + 0.5) * cell, y0 + (np.arange(rows) + 0.5) * cell
    if grid is not None:
        column = np.floor((xs - grid.origin_x) / grid.resolution_m).astype(int)
        row = np.floor((ys - grid.origin_y) / grid.resolution_m).astype(int)
        inside = ((row >= 0) & (row < grid.height))[:, None] & ((column >= 0) & (column < grid.width))[None, :]
        known = grid.cells[np.ix_(row.clip(0, grid.height - 1), column.clip(0, grid.width - 1))] >= 0
        field[~(inside & known)] = np.nan
    low, high = float(samples[:, 2].min()), float(samples[:, 2].max())
    fraction = np.ones_like(field) if high - low < 1e-9 else ((field - low) / (high - low)).clip(0.0, 1.0)
    fraction[np.isnan(field)] = 0.0
    colors = np.array([heat_rgb(sensor, i / 255.0) for i in range(256)], np.uint8)
    image = np.empty((*field.shape, 4), np.uint8)
    image[..., :3] = colors[np.round(fraction * 255).astype(int)][..., ::-1]
    image[..., 3] = np.round(fraction * HEAT_ALPHA * 255)
    smooth = cv2.resize(image[::-1], (2 * columns, 2 * rows), interpolation=cv2.INTER_LINEAR)
    extent = Extent(float(x0), float(y0), float(x0 + columns * cell), float(y0 + rows * cell))
    return HeatMap(sensor, _png(smooth), extent, low, high, len(samples))


def thumbnail(jpeg: bytes, width_px: int, quality: int = 72) -> bytes | None:
    """Return a JPEG scaled to a width in pixels; None if it cannot be decoded."""
    if not jpeg:
        return None
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        return None
    height_px = max(1, round(image.shape[0] * width_px / image.shape[1]))
    small = cv2.resize(image, (width_px, height_px), interpolation=cv2.INTER_AREA)
    _, encoded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return encoded.tobytes()


def data_uri(content: bytes, kind: str) -> str:
    """Return an image as a data URI; `kind` is png or jpeg."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _png(image: NDArray[np.uint8]) -> bytes:
    _, encoded = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return encoded.tobytes()
