"""The growing pose graph of a mapper: keyframes, the edges between them, and distances along the graph."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from lupin_runtime.slam.local_map import ScanPool, grow
from lupin_runtime.slam.pose_graph import Edges
from lupin_runtime.slam.scan import ScanPoints

Array = NDArray[np.floating]
Index = NDArray[np.int64]

# Meters that a turn of one radian adds to the length of an edge: turning on the spot adds uncertainty, too.
TURN_AS_M = 0.3


@dataclass(frozen=True)
class Edge:
    """One relative pose, as in `pose_graph.Edges`; a closure may be wrong and is optimized under a robust kernel.

    `lost_m` is added to the edge's length where its motion was guessed, not measured.
    """

    tail: int
    head: int
    motion: Array
    information: Array
    closure: bool
    lost_m: float = 0.0


class KeyframeGraph:
    """Keyframes with their scans, stamps and poses (n, 3), and the edges between them."""

    def __init__(self) -> None:
        self.pool = ScanPool()
        self.stamps: list[float] = []
        self.edges: list[Edge] = []
        self._poses = np.zeros((64, 3))
        self._distances: csr_matrix | None = None
        # Ends and lengths of the first `_joined` edges, for distances along the graph.
        self._joined = 0
        self._low, self._high, self._length = np.zeros(64, np.int64), np.zeros(64, np.int64), np.zeros(64)

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def poses(self) -> Array:
        """Poses (n, 3) in the map, a view."""
        return self._poses[: len(self.stamps)]

    @poses.setter
    def poses(self, values: Array) -> None:
        self._poses[: len(self.stamps)] = values

    def add(self, scan: ScanPoints, stamp: float, pose: Array) -> int:
        """Add a keyframe; returns its number."""
        number = self.pool.add(scan)
        if number == len(self._poses):
            self._poses = grow(self._poses, 2 * number)
        self._poses[number] = pose
        self.stamps.append(stamp)
        self._distances = None
        return number

    def join(self, tail: int, head: int, motion: Array, information: Array, closure: bool = False, lost_m: float = 0.0) -> None:
        """Add an edge; `information` (3, 3) in the axes of the head."""
        self.edges.append(Edge(tail, head, motion, information, closure, lost_m))
        self._distances = None

    def replace_edges(self, edges: list[Edge]) -> None:
        """Replace all edges between the keyframes."""
        self.edges = edges
        self._distances, self._joined = None, 0

    def as_edges(self) -> tuple[Edges, NDArray[np.bool_]]:
        """The edges as arrays, and which of them are closures."""
        if not self.edges:
            empty = np.zeros(0, np.int64)
            return Edges(empty, empty, np.zeros((0, 3)), np.zeros((0, 3, 3))), np.zeros(0, bool)
        return (
            Edges(
                np.array([edge.tail for edge in self.edges], np.int64),
                np.array([edge.head for edge in self.edges], np.int64),
                np.stack([edge.motion for edge in self.edges]),
                np.stack([edge.information for edge in self.edges]),
            ),
            np.array([edge.closure for edge in self.edges]),
        )

    def _measure(self) -> None:
        """Compute the lengths of the edges added since the last call."""
        new = self.edges[self._joined :]
        if len(self.edges) > len(self._low):
            size = 2 * len(self.edges)
            self._low, self._high, self._length = (grow(block, size) for block in (self._low, self._high, self._length))
        for at, edge in enumerate(new, start=self._joined):
            x, y, yaw = edge.motion
            self._low[at], self._high[at] = min(edge.tail, edge.head), max(edge.tail, edge.head)
            self._length[at] = math.hypot(x, y) + TURN_AS_M * abs(yaw) + edge.lost_m + 1e-3
        self._joined = len(self.edges)

    def path_lengths(self, start: int, limit: float = np.inf) -> Array:
        """Compute the meters along the graph (n,) from a keyframe to all others; inf beyond `limit`."""
        n = len(self)
        if self._joined < len(self.edges):
            self._measure()
        if self._distances is None:
            low, high, length = (block[: self._joined] for block in (self._low, self._high, self._length))
            # csr sums duplicate entries, so of parallel edges only the shortest is kept
            order = np.argsort(length, kind="stable")
            _, first = np.unique((low * n + high)[order], return_index=True)
            kept = order[first]
            self._distances = csr_matrix((length[kept], (low[kept], high[kept])), shape=(n, n))
        return np.asarray(dijkstra(self._distances, directed=False, indices=start, limit=limit))
