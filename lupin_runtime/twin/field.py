"""Interpolates a sensor's values over a rectangle of the map by inverse distance weighting (Shepard 1968)."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

COINCIDENT_M = 0.001
CACHE_ENTRIES = 64
# 25 million cells would take 100 MB and half a minute; maps of a greenhouse have far fewer.
MAX_CELLS = 4_000_000


class FieldError(ValueError):
    """A request that cannot be answered; the message says why."""


@dataclass(frozen=True)
class FieldRequest:
    """A sensor and a rectangle of the map, meters, in cells of `resolution` meters."""

    sensor: str
    resolution: float
    min_x: float
    min_y: float
    max_x: float
    max_y: float

    def check(self) -> None:
        """Raise FieldError if the request is invalid."""
        bounds = (self.min_x, self.min_y, self.max_x, self.max_y)
        if not self.sensor:
            raise FieldError("sensor_type is empty; name a sensor, such as temperature")
        if not math.isfinite(self.resolution) or self.resolution <= 0.0:
            raise FieldError(f"resolution is {self.resolution:g} m; expected a positive number")
        if not all(map(math.isfinite, bounds)):
            raise FieldError("a bound of the rectangle is not a finite number")
        if self.max_x < self.min_x or self.max_y < self.min_y:
            raise FieldError(
                f"the rectangle's maximum ({self.max_x:g}, {self.max_y:g}) is below its minimum "
                f"({self.min_x:g}, {self.min_y:g})"
            )
        if self.width * self.height > MAX_CELLS:
            raise FieldError(
                f"{self.width} x {self.height} cells, at most {MAX_CELLS} are possible; request a coarser resolution"
            )

    @property
    def width(self) -> int:
        """Number of cells along x, at least 1."""
        return _cells(self.max_x - self.min_x, self.resolution)

    @property
    def height(self) -> int:
        """Number of cells along y, at least 1."""
        return _cells(self.max_y - self.min_y, self.resolution)


def _cells(length: float, resolution: float) -> int:
    # Bounds arrive as float32, which makes 1.0 / 0.1 slightly more than 10.
    return max(1, math.ceil(length / resolution - 1e-5))


@dataclass(frozen=True)
class IdwOptions:
    """Options of the interpolation.

    Samples within `falloff_radius_m` count in a cell's mean; a cell farther than `max_distance_m` from every sample is unknown.
    """

    power: float = 2.0
    falloff_radius_m: float = 1.5
    max_distance_m: float = 1.5


@dataclass(frozen=True, eq=False)
class Field:
    """`values` (height, width) float32, NaN in unknown cells; minimum and maximum of the known cells, 0 without any."""

    values: NDArray[np.float32]
    minimum: float
    maximum: float
    samples: int


def interpolate(request: FieldRequest, samples: Sequence[tuple[float, float, float]], options: IdwOptions) -> Field:
    """Interpolate (x, y, value) samples at the cells' centers. Raises FieldError for an invalid request.

    A cell farther than `max_distance_m` from the nearest sample is unknown. A cell within a millimeter of a sample has its
    value. Every other cell has the weighted mean of the samples within the falloff radius, or the nearest value if there are
    none.
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
    # One pass per sample: there are few samples and many cells, and an array of both would not fit in memory.
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
    # Rounding errors may move a weighted mean beyond its samples' extremes.
    mean = np.clip(mean, data[:, 2].min(), data[:, 2].max())
    values = np.where(nearest2 < COINCIDENT_M**2, nearest_value, mean).astype(np.float32)
    values[nearest2 > options.max_distance_m**2] = np.nan
    known = values[np.isfinite(values)]
    extremes = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    return Field(values, *extremes, len(samples))


class FieldCache:
    """The most recently used fields, by request and the store's observation count."""

    def __init__(self, entries: int = CACHE_ENTRIES) -> None:
        self._entries = entries
        self._fields: OrderedDict[tuple[FieldRequest, int], Field] = OrderedDict()

    def get(self, request: FieldRequest, count: int) -> Field | None:
        """Return a cached field, which becomes the most recently used; None if it is not cached."""
        key = (request, count)
        if key in self._fields:
            self._fields.move_to_end(key)
        return self._fields.get(key)

    def put(self, request: FieldRequest, count: int, field: Field) -> None:
        """Store a field, and drop the least recently used one if the cache is full."""
        self._fields[request, count] = field
        self._fields.move_to_end((request, count))
        while len(self._fields) > self._entries:
            self._fields.popitem(last=False)

    def __len__(self) -> int:
        return len(self._fields)
