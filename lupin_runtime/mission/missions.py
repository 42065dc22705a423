"""What a mission still has to do, and what it has done: plain bookkeeping without time, motion or ROS."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

OK, UNREACHABLE, SCAN_FAILED, SKIPPED = 0, 1, 2, 3
"""How a visit to a tag ended; the numbers are Observation's."""

ALL_TAGS = 65535
"""The discovery goal (the largest uint16) that means: all that can be found."""


@dataclass(frozen=True)
class Counters:
    """Progress as MissionState shows it."""

    total: int = 0
    completed: int = 0
    failed: int = 0
    unreachable: int = 0
    skipped: int = 0


def _counters(total: int, statuses: Sequence[int]) -> Counters:
    return Counters(
        total,
        *(sum(status == wanted for status in statuses) for wanted in (OK, SCAN_FAILED, UNREACHABLE, SKIPPED)),
    )


def tag_order(tag_id: str) -> tuple[int, int, str]:
    """Sort key: numeric ids ascending, then the others alphabetically."""
    return (0, int(tag_id), tag_id) if tag_id.isascii() and tag_id.isdigit() else (1, 0, tag_id)


def nearest_neighbour_order(
    tag_ids: Iterable[str], positions: Mapping[str, tuple[float, float]], start: tuple[float, float] | None
) -> list[str]:
    """Greedy nearest neighbour from `start` on squared distance, ties by numeric id.

    Without a start, or while no tag has a position, the order is that of the ids; tags without a position come last.
    """
    left = sorted(set(tag_ids), key=tag_order)
    placed = [tag for tag in left if tag in positions]
    if start is None or not placed:
        return left
    order: list[str] = []
    here = start
    while placed:
        nearest = min(
            placed,  # `min` keeps the first of equals, and the list is in id order
            key=lambda tag: (positions[tag][0] - here[0]) ** 2 + (positions[tag][1] - here[1]) ** 2,
        )
        placed.remove(nearest)
        order.append(nearest)
        here = positions[nearest]
    return order + [tag for tag in left if tag not in positions]


class TagWalk(Protocol):
    """A mission that visits tags one after the other."""

    source: str

    @property
    def current(self) -> str | None:
        """The tag to visit now; None when there is none."""

    def close(self, status: int) -> None:
        """The visit to the current tag ended so: move on."""

    @property
    def is_complete(self) -> bool:
        """Whether nothing is left to visit."""

    @property
    def counters(self) -> Counters:
        """Progress so far."""


class InspectionMission:
    """Walks a list of tags once, in the order given."""

    source = "InspectionMission"

    def __init__(self, tag_ids: Sequence[str]) -> None:
        if not tag_ids:
            raise ValueError("an inspection needs at least one tag")
        self._tags = list(tag_ids)
        self._statuses: list[int] = []

    @property
    def current(self) -> str | None:
        return None if self.is_complete else self._tags[len(self._statuses)]

    def close(self, status: int) -> None:
        if not self.is_complete:
            self._statuses.append(status)

    def close_remaining(self, status: int) -> list[str]:
        """Close every tag that is left, and return them."""
        left = self._tags[len(self._statuses) :]
        self._statuses += [status] * len(left)
        return left

    @property
    def is_complete(self) -> bool:
        return len(self._statuses) >= len(self._tags)

    @property
    def counters(self) -> Counters:
        return _counters(len(self._tags), self._statuses)


class ExplorationMission:
    """Looks for tags until `goal` distinct ones are discovered."""

    source = "ExplorationMission"

    def __init__(self, goal: int) -> None:
        self.goal = max(1, goal)
        self.discovered = 0

    @property
    def wants_all(self) -> bool:
        """Whether the goal is all tags that can be found, so that no count ends the search."""
        return self.goal >= ALL_TAGS

    @property
    def is_complete(self) -> bool:
        return self.discovered >= self.goal

    @property
    def counters(self) -> Counters:
        # Nobody knows how many "all" are: a total of 65535 would only mislead a progress bar.
        return Counters(total=self.discovered if self.wants_all else self.goal, completed=self.discovered)


class MonitoringMission:
    """Visits the discovered tags sweep after sweep, nearest neighbour first.

    `sweeps` 0 goes on for ever. A tag that is discovered during a sweep joins at the end of the order.
    """

    source = "MonitoringMission"

    def __init__(
        self, positions: Mapping[str, tuple[float, float]], start: tuple[float, float] | None, sweeps: int = 0
    ) -> None:
        self._order = nearest_neighbour_order(positions, positions, start)
        self._cursor = 0
        self._sweeps = sweeps
        self._tallies = {OK: 0, SCAN_FAILED: 0, UNREACHABLE: 0}
        self.cycles = 0

    @property
    def order(self) -> tuple[str, ...]:
        """The tags of a sweep, in their order."""
        return tuple(self._order)

    def add(self, tag_id: str) -> None:
        """A tag that was not known when the sweep was planned."""
        if tag_id not in self._order:
            self._order.append(tag_id)

    @property
    def current(self) -> str | None:
        return self._order[self._cursor] if self._order else None

    def close(self, status: int) -> None:
        if not self._order:
            return
        if status in self._tallies:
            self._tallies[status] += 1
        self._cursor += 1
        if self._cursor >= len(self._order):
            self._cursor = 0
            self.cycles += 1

    @property
    def is_complete(self) -> bool:
        return not self._order or 0 < self._sweeps <= self.cycles

    @property
    def counters(self) -> Counters:
        return Counters(len(self._order), self._tallies[OK], self._tallies[SCAN_FAILED], self._tallies[UNREACHABLE], skipped=0)
