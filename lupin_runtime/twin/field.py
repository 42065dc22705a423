"""A sensor's field over a rectangle of the map, by inverse distance weighting (Shepard 1968)."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

COINCIDENT_M = 0.001
CACHE_ENTRIES = 64
# 25 million numbers are 100 MB and half a minute; no map of ours has as many cells.
MAX_CELLS = 4_000_000


class FieldError(ValueError):
    """A request that has no answer; the message says why."""


@dataclass(frozen=True)
class FieldRequest:
    """A sensor over a rectangle, in cells of `resolution` metres."""

    sensor: str
    resolution: float
    min_x: float
    min_y: float
    max_x: float
    max_y: float

    def check(self) -> None:
        """Raise FieldError where it makes no sense."""
        bounds = (self.min_x, self.min_y, self.max_x, self.max_y)
        if not self.sensor:
            raise FieldError("sensor_type is empty; name a sensor, such as temperature")
        if not math.isfinite(self.resolution) or self.resolution <= 0.0:
            raise FieldError(f"resolution is {self.resolution:g} m; it must be positive")
        if not all(map(math.isfinite, bounds)):
            raise FieldError("the rectangle has a bound that is no number")
        if self.max_x < self.min_x or self.max_y < self.min_y:
            raise FieldError(
                f"the rectangle's maximum ({self.max_x:g}, {self.max_y:g}) lies below its minimum "
                f"({self.min_x:g}, {self.min_y:g})"
            )
        if self.width * self.height > MAX_CELLS:
            raise FieldError(f"{self.width} x {self.height} cells are more than {MAX_CELLS}; ask for a coarser resolution")

    @property
    def width(self) -> int:
        """Cells along x, at least one."""
        return _cells(self.max_x - self.min_x, self.resolution)

    @property
    def height(self) -> int:
        """Cells along y, at least one."""
        return _cells(self.max_y - self.min_y, self.resolution)


def _cells(length: float, resolution: float) -> int:
    # The sides come as float32: 1.0 / 0.1 is then a hair more than 10.
    return max(1, math.ceil(length / resolution - 1e-5))


@dataclass(frozen=True)
class IdwOptions:
    """Power of the distance, and the radii: of what counts in a weighted mean, and beyond which nothing is known."""

    power: float = 2.0
    falloff_radius_m: float = 1.5
    max_distance_m: float = 1.5


@dataclass(frozen=True, eq=False)
class Field:
    """values (height, width) float32, NaN where nothing is known; extremes over the known cells, 0 without any."""

    values: NDArray[np.float32]
    minimum: float
    maximum: float
    samples: int


def interpolate(request: FieldRequest, samples: Sequence[tuple[float, float, float]], options: IdwOptions) -> Field:
    """The field of (x, y, value) samples at the cells' centres. Raises FieldError.

    A cell further than max_distance from the nearest sample is unknown; one within a millimetre of a sample has its value;
    the others the weighted mean of the samples within the falloff radius, or the nearest value if there is none.
    """
    request.check()
    width, height = request.width, request.height
    if not samples:
        return Field(np.full((height, width), np.nan, np.float32), 0.0, 0.0, 0)
    data = np.array(samples, np.float64)
    x = request.min_x + (np.arange(width) + 0.5) * request.resolution
    y = request.min_y + (np.arange(height) + 0.5) * request.resolution
    nearest2 = np.full((height, width), np.inf)
    nearest_value = np.zeros((height, width))
    total, weights = np.zeros((height, width)), np.zeros((height, width))
    # One pass a sample: a few dozen of them over many cells, and never a cube of both in memory.
    for sx, sy, value in data:
        distance2 = ((y - sy) ** 2)[:, None] + ((x - sx) ** 2)[None, :]
        closer = distance2 < nearest2
        nearest2 = np.where(closer, distance2, nearest2)
        nearest_value = np.where(closer, value, nearest_value)
        weight = np.maximum(distance2, COINCIDENT_M**2) ** (-options.power / 2.0)
        weight *= distance2 <= options.falloff_radius_m**2
        total += weight * value
        weights += weight
    mean = np.divide(total, weights, out=nearest_value.copy(), where=weights > 0.0)
    # Rounding may carry a weighted mean past its own extremes.
    mean = np.clip(mean, data[:, 2].min(), data[:, 2].max())
    values = np.where(nearest2 < COINCIDENT_M**2, nearest_value, mean).astype(np.float32)
    values[nearest2 > options.max_distance_m**2] = np.nan
    known = values[np.isfinite(values)]
    extremes = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    return Field(values, *extremes, len(samples))


class FieldCache:
    """The fields asked for last, by request and the store's observation count."""

    def __init__(self, entries: int = CACHE_ENTRIES) -> None:
        self._entries = entries
        self._fields: OrderedDict[tuple[FieldRequest, int], Field] = OrderedDict()

    def get(self, request: FieldRequest, count: int) -> Field | None:
        """The field of a request at that count, if kept; it becomes the most recent."""
        key = (request, count)
        if key in self._fields:
            self._fields.move_to_end(key)
        return self._fields.get(key)

    def put(self, request: FieldRequest, count: int, field: Field) -> None:
        """Keep a field, dropping the one longest unused."""
        self._fields[request, count] = field
        self._fields.move_to_end((request, count))
        while len(self._fields) > self._entries:
            self._fields.popitem(last=False)

    def __len__(self) -> int:
        return len(self._fields)
