"""The true path of a simulated robot, which the simulator writes ten times a second."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple


class Sample(NamedTuple):
    """The robot's true place at a time: seconds of the simulator's clock, meters."""

    t_s: float
    x: float
    y: float


def parse_path(text: str) -> list[Sample]:
    """Return the samples of `truth_trajectory.tum`; a last line that is still being written is left out."""
    rows = (line.split() for line in text.splitlines() if not line.startswith("#"))
    return [Sample(float(row[0]), float(row[1]), float(row[2])) for row in rows if len(row) == 8]


def moved_m(path: Sequence[Sample]) -> float:
    """Return the length of a path."""
    return sum(math.hypot(b.x - a.x, b.y - a.y) for a, b in itertools.pairwise(path))
