"""The maps that were published during a run, in bounded memory."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from lupin_runtime.gridmap import GridMap

MAX_SNAPSHOTS = 64
_FIRST_PERIOD_S = 2.0


@dataclass(frozen=True)
class MapSnapshot:
    """The map at a time, compressed: a greenhouse of 20 m by 20 m takes a few kB."""

    t_s: float
    height: int
    width: int
    resolution_m: float
    origin_x: float
    origin_y: float
    packed: bytes

    @property
    def grid(self) -> GridMap:
        """The map's cells."""
        cells = np.frombuffer(zlib.decompress(self.packed), dtype=np.int8).reshape(self.height, self.width)
        return GridMap(cells, self.resolution_m, self.origin_x, self.origin_y)


class MapHistory:
    """Keeps maps spread evenly over the run, at most MAX_SNAPSHOTS: when there are more, every second one is dropped."""

    def __init__(self) -> None:
        self.snapshots: list[MapSnapshot] = []
        self._period_s = _FIRST_PERIOD_S

    def add(self, t_s: float, grid: GridMap) -> None:
        """Add the map that was published at `t_s`, unless the last one is too recent."""
        if self.snapshots and t_s - self.snapshots[-1].t_s < self._period_s:
            return
        packed = zlib.compress(np.ascontiguousarray(grid.cells).tobytes(), 6)
        self.snapshots.append(
            MapSnapshot(t_s, grid.height, grid.width, grid.resolution_m, grid.origin_x, grid.origin_y, packed)
        )
        if len(self.snapshots) > MAX_SNAPSHOTS:
            span_s = self.snapshots[-1].t_s - self.snapshots[0].t_s
            self.snapshots = self.snapshots[::2]
            self._period_s = max(2.0 * self._period_s, span_s / len(self.snapshots))
