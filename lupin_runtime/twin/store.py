"""The twin's store: pose, latest readings, flowers and time of the last observation of each tag.

Times are ROS time in nanoseconds. Poses and flowers are stored as they were sent.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from lupin_runtime.transforms import Quaternion, Vector

Point2 = tuple[float, float]


@dataclass(frozen=True)
class TwinPose:
    """The pose of a tag in the map frame, meters and quaternion."""

    position: Vector
    orientation: Quaternion

    @property
    def known(self) -> bool:
        """Whether the pose is finite and known; on this graph a quaternion with w = 0 means an unknown pose."""
        return self.orientation[3] != 0.0 and all(map(math.isfinite, (*self.position, *self.orientation)))


@dataclass(frozen=True)
class TwinFlower:
    """One flower; `position` is in the map frame."""

    position: Vector
    height_m: float
    species: str
    confidence: float
    anomaly: bool


@dataclass(frozen=True)
class PotFlowers:
    """The latest observation of the flowers in a tag's pot."""

    species: str = ""
    confidence: float = 0.0
    anomaly: bool = False
    flower_count: int = 0
    bug_count: int = 0
    flowers: tuple[TwinFlower, ...] = ()
    footprint: tuple[Point2, ...] = ()


@dataclass(frozen=True)
class HistoryEntry:
    """One observation in a tag's history."""

    time_ns: int
    ok: bool
    readings: tuple[tuple[str, float], ...] = ()
    detail: str = ""


@dataclass
class TagRecord:
    """The data of one tag.

    `last_observed_ns` is the time of the last successful observation. A failed scan only changes `failures`,
    `last_failed_ns` and `last_detail`, so that old readings do not look fresh. `footprint_registered` says that `footprint`
    belongs to a registered box.
    """

    tag_id: str
    pose: TwinPose | None = None
    readings: dict[str, float] = field(default_factory=dict)
    flowers: PotFlowers = field(default_factory=PotFlowers)
    footprint: tuple[Point2, ...] = ()
    footprint_registered: bool = False
    last_observed_ns: int | None = None
    last_failed_ns: int | None = None
    failures: int = 0
    last_detail: str = ""
    history: deque[HistoryEntry] = field(default_factory=deque)

    def stale_s(self, now_ns: int) -> float:
        """Return the age of the last observation in seconds; 0 if there is none, and never negative."""
        return 0.0 if self.last_observed_ns is None else max(0.0, (now_ns - self.last_observed_ns) / 1e9)


class TwinStore:
    """Stores a record per tag, in the order of their first appearance."""

    def __init__(self, buffer_len: int = 32) -> None:
        self._buffer_len = max(1, buffer_len)
        self._records: dict[str, TagRecord] = {}
        self.observation_count = 0

    @property
    def records(self) -> Iterable[TagRecord]:
        """All records, in the order of their first appearance."""
        return self._records.values()

    def __len__(self) -> int:
        return len(self._records)

    def get(self, tag_id: str) -> TagRecord | None:
        """Return a tag's record; None if it is unknown."""
        return self._records.get(tag_id)

    def add_reading(
        self, tag_id: str, time_ns: int, readings: Sequence[tuple[str, float]], pose: TwinPose | None = None
    ) -> bool:
        """Add a successful scan; return False, without counting it, for an empty tag id.

        The latest value of each sensor is kept, in the order of first appearance. NaN is stored, but not used in fields.
        """
        record = self._record_observed(tag_id, time_ns, pose)
        if record is None:
            return False
        for name, value in readings:
            record.readings[name] = value
        self._append(record, HistoryEntry(time_ns, True, tuple(readings)))
        return True

    def add_failure(self, tag_id: str, time_ns: int, detail: str) -> bool:
        """Add a failed scan: the tag is listed, but its pose and the time of its last observation do not change."""
        record = self._record(tag_id)
        if record is None:
            return False
        self.observation_count += 1
        record.failures += 1
        record.last_failed_ns, record.last_detail = time_ns, detail
        self._append(record, HistoryEntry(time_ns, False, detail=detail))
        return True

    def add_flowers(self, tag_id: str, time_ns: int, flowers: PotFlowers, pose: TwinPose | None = None) -> bool:
        """Add an observation of a pot, which replaces the last one and may give a pose to a tag without one."""
        record = self._record_observed(tag_id, time_ns, pose)
        if record is None:
            return False
        record.flowers = flowers
        if flowers.footprint and not record.footprint_registered:
            record.footprint = flowers.footprint
        self._append(record, HistoryEntry(time_ns, True))
        return True

    def add_discovered(self, tag_id: str, pose: TwinPose) -> None:
        """Add a tag that perception discovered: it gives a pose to a tag without one, and does not count as an observation."""
        if not tag_id:
            return
        x, y, z, w = pose.orientation
        pose = TwinPose(pose.position, (x, y, z, w if w != 0.0 else 1.0))
        record = self._record(tag_id)
        if record is not None and record.pose is None and pose.known:
            record.pose = pose

    def add_box(self, tag_id: str, footprint: tuple[Point2, ...]) -> None:
        """Add a registered box: its footprint has priority over footprints that were estimated from a tag."""
        record = self._record(tag_id)
        if record is not None and footprint:
            record.footprint, record.footprint_registered = footprint, True

    def samples(self, sensor: str) -> list[tuple[float, float, float]]:
        """Return (x, y, value) of the tags with a pose and a finite latest value of a sensor."""
        return [
            (r.pose.position[0], r.pose.position[1], value)
            for r in self._records.values()
            if r.pose is not None and math.isfinite(value := r.readings.get(sensor, math.nan))
        ]

    def _record_observed(self, tag_id: str, time_ns: int, pose: TwinPose | None) -> TagRecord | None:
        record = self._record(tag_id)
        if record is None:
            return None
        self.observation_count += 1
        # A late or replayed observation must not replace a newer time.
        record.last_observed_ns = max(time_ns, record.last_observed_ns or 0)
        if pose is not None and pose.known and record.pose is None:
            record.pose = pose
        return record

    def _record(self, tag_id: str) -> TagRecord | None:
        if not tag_id:
            return None
        return self._records.setdefault(tag_id, TagRecord(tag_id, history=deque(maxlen=self._buffer_len)))

    @staticmethod
    def _append(record: TagRecord, entry: HistoryEntry) -> None:
        record.history.append(entry)
