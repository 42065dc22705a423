"""What one look at a pot found: detections gathered while a tag is in focus, placed in its box, and when to say so."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from lupin_runtime.perception import box_geometry as geometry
from lupin_runtime.perception.blooms import CLASS_NAMES
from lupin_runtime.perception.box_geometry import Box, Point2
from lupin_runtime.perception.messages import SeenBloom

CAPACITY = 512
EMIT_CONFIDENCE_STEP = 0.1


@dataclass(frozen=True)
class FlowerOptions:
    """How detections are read and placed; the names are those of the aggregator's parameters."""

    class_names: tuple[str, ...] = CLASS_NAMES
    anomaly_class_name: str = "bug"
    min_confidence: float = 0.35
    image_width: float = 640.0
    lateral_columns: int = 7
    base_depth_frac: float = 0.5
    depth_jitter_frac: float = 0.18
    pan_half_span_rad: float = 0.5
    camera_half_fov_rad: float = 0.5
    gate: bool = True
    gate_margin_m: float = 0.10

    def name_of(self, class_id: int) -> str:
        """A class's name, "" for one that nobody named."""
        return self.class_names[class_id] if 0 <= class_id < len(self.class_names) else ""


@dataclass(frozen=True)
class Detection:
    """One flower or bug in one picture. `fraction` lies along the front of whatever box is before the arm, unclamped."""

    species: str
    anomaly: bool
    confidence: float
    fraction: float
    track_id: int | None = None
    frame: int = 0


@dataclass(frozen=True)
class Bloom:
    """One placed bloom: a point of the map's plane, and what was seen there."""

    position: Point2
    species: str
    confidence: float
    anomaly: bool


@dataclass(frozen=True)
class Finding:
    """What the detections of one focus amount to."""

    species: str = ""
    confidence: float = 0.0
    anomaly: bool = False
    flower_count: int = 0
    bug_count: int = 0
    blooms: tuple[Bloom, ...] = ()

    def differs_from(self, other: Finding | None) -> bool:
        """Whether it is worth telling those who heard `other` last. Having seen nothing is no finding."""
        if not self.species and not self.anomaly:
            return False
        if other is None:
            return True
        told = (self.species, self.anomaly, self.flower_count, self.bug_count)
        before = (other.species, other.anomaly, other.flower_count, other.bug_count)
        return told != before or abs(self.confidence - other.confidence) > EMIT_CONFIDENCE_STEP


class Accumulator:
    """The newest detections of one focus target; another target starts with none, so no bug spreads to the next pot."""

    def __init__(self, options: FlowerOptions) -> None:
        self._options = options
        self._detections: deque[Detection] = deque(maxlen=CAPACITY)
        self._frame = 0
        self.target: str | None = None

    def focus(self, target: str | None) -> bool:
        """Look at another target, or at none; whether that is a change."""
        if target == self.target:
            return False
        self.target = target
        self._detections.clear()
        return True

    def add(self, seen: Iterable[SeenBloom], pan_rad: float, pan_centre_rad: float) -> None:
        """Take one picture's detections, if something is in focus. `pan_rad` counts to the right, as the picture's x does."""
        if self.target is None:
            return
        o = self._options
        self._frame += 1
        for bloom in seen:
            name = o.name_of(bloom.class_id)
            if not name or bloom.confidence < o.min_confidence:
                continue
            anomaly = name == o.anomaly_class_name
            x1, _, x2, _ = bloom.box_px
            fraction = geometry.lateral_fraction(
                pan_rad,
                pan_centre_rad,
                (x1 + x2) / 2.0,
                o.image_width,
                o.pan_half_span_rad,
                o.camera_half_fov_rad,
                raw=True,
            )
            species = "" if anomaly else name
            self._detections.append(Detection(species, anomaly, bloom.confidence, fraction, bloom.track_id, self._frame))

    def finding(self, box: Box | None, registered: bool, anchor: Point2) -> Finding:
        """What they amount to on `box`. The gate needs a `registered` box: one guessed from a tag has a guessed size."""
        detections: Sequence[Detection] = tuple(self._detections)
        if registered and box is not None:
            detections = gated(detections, box, self._options)
        return summarise(detections, box, anchor, self._options)


def gated(detections: Sequence[Detection], box: Box, options: FlowerOptions) -> Sequence[Detection]:
    """Those whose bearing meets the box, with a margin; all of them where the gate is off or the box has no area."""
    if not options.gate or box.degenerate:
        return detections
    return [
        d for d in detections if box.contains(*box.place(d.fraction, options.base_depth_frac), margin_m=options.gate_margin_m)
    ]


def summarise(detections: Sequence[Detection], box: Box | None, anchor: Point2, options: FlowerOptions) -> Finding:
    """Species of the most confident flower, anomaly if any bug, counts, and one bloom for each occupied column.

    Without a box that has an area, one bloom stands at the anchor.
    """
    if not detections:
        return Finding()
    flowers = [d for d in detections if not d.anomaly]
    bugs = [d for d in detections if d.anomaly]
    best = max(flowers, key=lambda d: d.confidence, default=None)
    species, confidence = (best.species, best.confidence) if best else ("", 0.0)
    if box is None or box.degenerate:
        blooms: tuple[Bloom, ...] = (Bloom(anchor, species, confidence, bool(bugs)),)
    else:
        blooms = place_blooms(detections, box, options)
    columns = options.lateral_columns
    return Finding(species, confidence, bool(bugs), distinct(flowers, columns), distinct(bugs, columns), blooms)


def distinct(detections: Sequence[Detection], columns: int) -> int:
    """How many different things were seen: tracked ones by their tracks; others by the columns they occupy, and never
    fewer than one picture showed at once, since two neighbours may share a column."""
    tracks = {d.track_id for d in detections if d.track_id is not None}
    if tracks:
        return len(tracks)
    occupied = {geometry.column_of(min(1.0, max(-1.0, d.fraction)), columns) for d in detections}
    frames: dict[int, int] = {}
    for d in detections:
        frames[d.frame] = frames.get(d.frame, 0) + 1
    return max(len(occupied), max(frames.values(), default=0))


def place_blooms(detections: Sequence[Detection], box: Box, options: FlowerOptions) -> tuple[Bloom, ...]:
    """A bloom in the middle of each occupied column of the box: the most confident species there, and whether a bug was.

    Where one picture shows several flowers in a column, they share its width in the order in which they stand.
    """
    n = options.lateral_columns
    columns: dict[int, list[Detection]] = {}
    for d in detections:
        columns.setdefault(geometry.column_of(min(1.0, max(-1.0, d.fraction)), n), []).append(d)
    blooms = []
    for column, members in sorted(columns.items()):
        neighbours = _most_at_once([d for d in members if not d.anomaly])
        if len(neighbours) < 2:
            best = max((d for d in members if not d.anomaly), key=lambda d: d.confidence, default=None)
            neighbours = [best or Detection("", True, 0.0, geometry.column_centre(column, n))]
        infested = {
            min(range(len(neighbours)), key=lambda k: abs(neighbours[k].fraction - bug.fraction))
            for bug in members
            if bug.anomaly
        }
        depth = geometry.column_depth(column, options.base_depth_frac, options.depth_jitter_frac)
        for k, flower in enumerate(neighbours):
            fraction = geometry.column_centre(column, n) + (2.0 / n) * ((k + 0.5) / len(neighbours) - 0.5)
            blooms.append(Bloom(box.place(fraction, depth), flower.species, flower.confidence, k in infested))
    return tuple(blooms)


def _most_at_once(flowers: Sequence[Detection]) -> list[Detection]:
    """Those of the picture that shows the most, from left to right."""
    frames: dict[int, list[Detection]] = {}
    for d in flowers:
        frames.setdefault(d.frame, []).append(d)
    fullest = max(frames.values(), key=lambda group: len(group)) if frames else []
    return sorted(fullest, key=lambda d: d.fraction)
