"""The twin's memory: per tag its place, its latest readings and flowers, and when it was last observed.

Times are ROS time in nanoseconds. Poses and blooms are kept as their owners sent them: the store decides which to keep.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from lupin_runtime.transforms import Quaternion, Vector

Point2 = tuple[float, float]


@dataclass(frozen=True)
class TagPose:
    """Where a tag hangs in the map."""

    position: Vector
    orientation: Quaternion

    @property
    def known(self) -> bool:
        """A quaternion with w = 0 says "no pose" on this graph."""
        return self.orientation[3] != 0.0 and all(map(math.isfinite, (*self.position, *self.orientation)))


@dataclass(frozen=True)
class Bloom:
    """One flower, placed in the map."""

    position: Vector
    height_m: float
    species: str
    confidence: float
    anomaly: bool


@dataclass(frozen=True)
class Flowers:
    """The latest look at the pot of a tag."""

    species: str = ""
    confidence: float = 0.0
    anomaly: bool = False
    flower_count: int = 0
    bug_count: int = 0
    blooms: tuple[Bloom, ...] = ()
    footprint: tuple[Point2, ...] = ()


@dataclass(frozen=True)
class Observed:
    """One entry of a tag's history."""

    time_ns: int
    ok: bool
    readings: tuple[tuple[str, float], ...] = ()
    detail: str = ""


@dataclass
class TagRecord:
    """What the twin knows of one tag.

    `last_observed_ns` is the last time anything was learnt of it. A scan that failed taught nothing: it is counted in
    `failures` and `last_failed_ns`, and makes no old reading look fresh.
    """

    tag_id: str
    pose: TagPose | None = None
    readings: dict[str, float] = field(default_factory=dict)
    flowers: Flowers = field(default_factory=Flowers)
    footprint: tuple[Point2, ...] = ()
    box_footprint: bool = False
    last_observed_ns: int | None = None
    last_failed_ns: int | None = None
    failures: int = 0
    last_detail: str = ""
    history: deque[Observed] = field(default_factory=deque)

    def stale_s(self, now_ns: int) -> float:
        """Age of the last observation in seconds; 0 where there is none, and never negative."""
        return 0.0 if self.last_observed_ns is None else max(0.0, (now_ns - self.last_observed_ns) / 1e9)


class TwinStore:
    """Records in the order in which tags were first heard of."""

    def __init__(self, buffer_len: int = 32) -> None:
        self._buffer_len = max(1, buffer_len)
        self._records: dict[str, TagRecord] = {}
        self.observation_count = 0

    @property
    def records(self) -> Iterable[TagRecord]:
        """All tags, in insertion order."""
        return self._records.values()

    def __len__(self) -> int:
        return len(self._records)

    def get(self, tag_id: str) -> TagRecord | None:
        """One tag's record."""
        return self._records.get(tag_id)

    def add_reading(
        self, tag_id: str, time_ns: int, readings: Sequence[tuple[str, float]], pose: TagPose | None = None
    ) -> bool:
        """A successful scan. False, and nothing counted, for an empty tag id.

        Latest value per name, names in order of first appearance; a NaN is kept as "the sensor answered nonsense" and
        enters no field.
        """
        record = self._observed(tag_id, time_ns, pose)
        if record is None:
            return False
        for name, value in readings:
            record.readings[name] = value
        self._remember(record, Observed(time_ns, True, tuple(readings)))
        return True

    def add_failure(self, tag_id: str, time_ns: int, detail: str) -> bool:
        """A scan that gave nothing: the tag is listed, without a pose, and what is known of it grows no younger."""
        record = self._record(tag_id)
        if record is None:
            return False
        self.observation_count += 1
        record.failures += 1
        record.last_failed_ns, record.last_detail = time_ns, detail
        self._remember(record, Observed(time_ns, False, detail=detail))
        return True

    def add_flowers(self, tag_id: str, time_ns: int, flowers: Flowers, pose: TagPose | None = None) -> bool:
        """A look at a pot; it replaces the last one, and may give a place to a tag that has none."""
        record = self._observed(tag_id, time_ns, pose)
        if record is None:
            return False
        record.flowers = flowers
        if flowers.footprint and not record.box_footprint:
            record.footprint = flowers.footprint
        self._remember(record, Observed(time_ns, True))
        return True

    def add_discovered(self, tag_id: str, pose: TagPose) -> None:
        """A tag that perception believes in: its place, if none is known; no observation."""
        if not tag_id:
            return
        x, y, z, w = pose.orientation
        placed = TagPose(pose.position, (x, y, z, w if w != 0.0 else 1.0))
        record = self._record(tag_id)
        if record is not None and record.pose is None and placed.known:
            record.pose = placed

    def add_box(self, tag_id: str, footprint: tuple[Point2, ...]) -> None:
        """A registered box: its footprint counts for more than one guessed from a tag, and says nothing of age."""
        record = self._record(tag_id)
        if record is not None and footprint:
            record.footprint, record.box_footprint = footprint, True

    def samples(self, sensor: str) -> list[tuple[float, float, float]]:
        """(x, y, value) of the tags that have a place and a finite latest value of a sensor."""
        return [
            (r.pose.position[0], r.pose.position[1], value)
            for r in self._records.values()
            if r.pose is not None and math.isfinite(value := r.readings.get(sensor, math.nan))
        ]

    def _observed(self, tag_id: str, time_ns: int, pose: TagPose | None) -> TagRecord | None:
        record = self._record(tag_id)
        if record is None:
            return None
        self.observation_count += 1
        # A replayed or late observation must not turn the clock back.
        record.last_observed_ns = max(time_ns, record.last_observed_ns or 0)
        if pose is not None and pose.known and record.pose is None:
            record.pose = pose
        return record

    def _record(self, tag_id: str) -> TagRecord | None:
        if not tag_id:
            return None
        return self._records.setdefault(tag_id, TagRecord(tag_id, history=deque(maxlen=self._buffer_len)))

    @staticmethod
    def _remember(record: TagRecord, observed: Observed) -> None:
        record.history.append(observed)
