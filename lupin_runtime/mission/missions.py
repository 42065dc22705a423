"""Progress of a mission: what is done and what remains, without time, motion or ROS."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

OK, UNREACHABLE, SCAN_FAILED, SKIPPED = 0, 1, 2, 3
"""Status of a visit to a tag; the numbers are those of the Observation message."""

ALL_TAGS = 65535
"""The discovery goal (the largest uint16) that stands for all tags that can be found."""


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
        *(sum(status == counted for status in statuses) for counted in (OK, SCAN_FAILED, UNREACHABLE, SKIPPED)),
    )


def tag_order(tag_id: str) -> tuple[int, int, str]:
    """Return a sort key: numeric ids ascending, then the others alphabetically."""
    return (0, int(tag_id), tag_id) if tag_id.isascii() and tag_id.isdigit() else (1, 0, tag_id)


def nearest_neighbor_order(
    tag_ids: Iterable[str], positions: Mapping[str, tuple[float, float]], start: tuple[float, float] | None
) -> list[str]:
    """Order tags by greedy nearest neighbor from `start`; equal distances are ordered by id.

    Without a start, or if no tag has a position, the order is by id. Tags without a position come last.
    """
    remaining = sorted(set(tag_ids), key=tag_order)
    placed = [tag for tag in remaining if tag in positions]
    if start is None or not placed:
        return remaining
    order: list[str] = []
    current = start
    while placed:
        nearest = min(
            placed,  # `min` returns the first of equals, and the list is in id order
            key=lambda tag: (positions[tag][0] - current[0]) ** 2 + (positions[tag][1] - current[1]) ** 2,
        )
        placed.remove(nearest)
        order.append(nearest)
        current = positions[nearest]
    return order + [tag for tag in remaining if tag not in positions]


class VisitPlan(Protocol):
    """The tags that a mission visits one after the other."""

    source: str

    @property
    def current(self) -> str | None:
        """The tag to visit now, or None."""

    def record(self, status: int) -> None:
        """Record the status of the visit to the current tag, and move on to the next."""

    @property
    def is_complete(self) -> bool:
        """Whether no tag is left to visit."""

    @property
    def counters(self) -> Counters:
        """Progress so far."""


class InspectionMission:
    """Visits a list of tags once, in the given order."""

    source = "InspectionMission"

    def __init__(self, tag_ids: Sequence[str]) -> None:
        if not tag_ids:
            raise ValueError("an inspection needs at least one tag")
        self._tags = list(tag_ids)
        self._statuses: list[int] = []

    @property
    def current(self) -> str | None:
        return None if self.is_complete else self._tags[len(self._statuses)]

    def record(self, status: int) -> None:
        if not self.is_complete:
            self._statuses.append(status)

    def record_remaining(self, status: int) -> list[str]:
        """Record a status for every remaining tag, and return these tags."""
        remaining = self._tags[len(self._statuses) :]
        self._statuses += [status] * len(remaining)
        return remaining

    @property
    def is_complete(self) -> bool:
        return len(self._statuses) >= len(self._tags)

    @property
    def counters(self) -> Counters:
        return _counters(len(self._tags), self._statuses)


class ExplorationMission:
    """Searches until `goal` distinct tags are discovered."""

    source = "ExplorationMission"

    def __init__(self, goal: int) -> None:
        self.goal = max(1, goal)
        self.discovered = 0

    @property
    def seeks_all_tags(self) -> bool:
        """Whether the goal is all tags that can be found, so that no number of tags ends the search."""
        return self.goal >= ALL_TAGS

    @property
    def is_complete(self) -> bool:
        return self.discovered >= self.goal

    @property
    def counters(self) -> Counters:
        # The number of all tags is unknown: a total of 65535 would mislead a progress bar.
        return Counters(total=self.discovered if self.seeks_all_tags else self.goal, completed=self.discovered)


class MonitoringMission:
    """Visits the discovered tags in monitoring rounds, each in nearest-neighbor order.

    `rounds` 0 continues forever. A tag that is discovered during a round is added at the end of the order.
    """

    source = "MonitoringMission"

    def __init__(
        self, positions: Mapping[str, tuple[float, float]], start: tuple[float, float] | None, rounds: int = 0
    ) -> None:
        self._order = nearest_neighbor_order(positions, positions, start)
        self._cursor = 0
        self._rounds = rounds
        self._tallies = {OK: 0, SCAN_FAILED: 0, UNREACHABLE: 0}
        self.completed_rounds = 0

    @property
    def order(self) -> tuple[str, ...]:
        """The tags of a round, in their order."""
        return tuple(self._order)

    def add(self, tag_id: str) -> None:
        """Add a tag that was discovered after the round was planned; known tags are ignored."""
        if tag_id not in self._order:
            self._order.append(tag_id)

    @property
    def current(self) -> str | None:
        return self._order[self._cursor] if self._order else None

    def record(self, status: int) -> None:
        if not self._order:
            return
        if status in self._tallies:
            self._tallies[status] += 1
        self._cursor += 1
        if self._cursor >= len(self._order):
            self._cursor = 0
            self.completed_rounds += 1

    @property
    def is_complete(self) -> bool:
        return not self._order or 0 < self._rounds <= self.completed_rounds

    @property
    def counters(self) -> Counters:
        return Counters(len(self._order), self._tallies[OK], self._tallies[SCAN_FAILED], self._tallies[UNREACHABLE], skipped=0)
