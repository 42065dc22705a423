"""The flowers of one pot: detections gathered while its tag is in focus, placed in the box behind the tag."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

from lupin_runtime.perception import box_geometry as geometry
from lupin_runtime.perception.box_geometry import Box, Point2
from lupin_runtime.perception.color_blobs import CLASS_NAMES
from lupin_runtime.perception.messages import FlowerDetection

CAPACITY = 512
EMIT_CONFIDENCE_STEP = 0.1
# Detectors suppress overlapping boxes within a class only, so one flower may get a box of each of two classes. Those overlap by
# more than this share of their union; boxes as wide as a flower whose neighbor stands a quarter of that width beside it do not.
SAME_THING_OVERLAP = 0.6


@dataclass(frozen=True)
class FlowerOptions:
    """How detections are read and placed; the fields are parameters of the aggregator."""

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
        """Return the name of a class, "" if it has none."""
        return self.class_names[class_id] if 0 <= class_id < len(self.class_names) else ""


@dataclass(frozen=True)
class BoxDetection:
    """One flower or bug in one image. `fraction` is its place along the front of the box before the arm: -1 to 1, or beyond.

    `track_ids` are the tracks of its boxes: two if the detector gave it two classes.
    """

    species: str
    anomaly: bool
    confidence: float
    fraction: float
    track_ids: frozenset[int] = frozenset()
    frame: int = 0


@dataclass(frozen=True)
class PlacedFlower:
    """One flower, placed at a point (x, y) of the map."""

    position: Point2
    species: str
    confidence: float
    anomaly: bool


@dataclass(frozen=True)
class PotObservation:
    """The summary of all detections of one pot."""

    species: str = ""
    confidence: float = 0.0
    anomaly: bool = False
    flower_count: int = 0
    bug_count: int = 0
    flowers: tuple[PlacedFlower, ...] = ()

    def differs_from(self, other: PotObservation | None) -> bool:
        """Whether this observation is worth publishing after `other`; one without any flower or bug never is."""
        if not self.species and not self.anomaly:
            return False
        if other is None:
            return True
        content = (self.species, self.anomaly, self.flower_count, self.bug_count)
        other_content = (other.species, other.anomaly, other.flower_count, other.bug_count)
        return content != other_content or abs(self.confidence - other.confidence) > EMIT_CONFIDENCE_STEP


class Accumulator:
    """The newest detections of the pot in focus; a new target starts with none, so that no bug spreads to the next pot."""

    def __init__(self, options: FlowerOptions) -> None:
        self._options = options
        self._detections: deque[BoxDetection] = deque(maxlen=CAPACITY)
        self._frame = 0
        self.target: str | None = None

    def focus(self, target: str | None) -> bool:
        """Change the target (None: nothing is in focus); returns whether it differs from the last one."""
        if target == self.target:
            return False
        self.target = target
        self._detections.clear()
        return True

    def add(self, seen: Iterable[FlowerDetection], pan_rad: float, pan_center_rad: float) -> None:
        """Add one image's detections, if something is in focus. `pan_rad` is positive to the right, as the image's x is."""
        if self.target is None:
            return
        o = self._options
        self._frame += 1
        usable = [d for d in seen if o.name_of(d.class_id) and d.confidence >= o.min_confidence]
        bugs = [d for d in usable if o.name_of(d.class_id) == o.anomaly_class_name]
        flowers = [d for d in usable if o.name_of(d.class_id) != o.anomaly_class_name]
        # A bug sits on its flower, so boxes are compared among flowers and among bugs.
        for detection, track_ids in (*merge_overlapping(flowers), *merge_overlapping(bugs)):
            name = o.name_of(detection.class_id)
            anomaly = name == o.anomaly_class_name
            x1, _, x2, _ = detection.box_px
            fraction = geometry.lateral_fraction(
                pan_rad,
                pan_center_rad,
                (x1 + x2) / 2.0,
                o.image_width,
                o.pan_half_span_rad,
                o.camera_half_fov_rad,
                raw=True,
            )
            species = "" if anomaly else name
            self._detections.append(BoxDetection(species, anomaly, detection.confidence, fraction, track_ids, self._frame))

    def observation(self, box: Box | None, registered: bool, anchor: Point2) -> PotObservation:
        """Summarise the detections on `box`. Only a `registered` box gates them: one guessed from a tag has a guessed size."""
        detections: Sequence[BoxDetection] = tuple(self._detections)
        if registered and box is not None:
            detections = gate(detections, box, self._options)
        return summarise(detections, box, anchor, self._options)


def merge_overlapping(detections: Iterable[FlowerDetection]) -> list[tuple[FlowerDetection, frozenset[int]]]:
    """Merge the boxes of one image that show the same thing: the most confident of each, and the track ids of all its boxes.

    Boxes are compared with the kept ones only, so that a row of neighbors is not merged from one to the next.
    """
    kept: list[tuple[FlowerDetection, set[int]]] = []
    for detection in sorted(detections, key=lambda d: -d.confidence):
        tracks = set() if detection.track_id is None else {detection.track_id}
        overlaps = [overlap(detection, other) for other, _ in kept]
        if max(overlaps, default=0.0) > SAME_THING_OVERLAP:
            kept[overlaps.index(max(overlaps))][1].update(tracks)
        else:
            kept.append((detection, tracks))
    return [(detection, frozenset(tracks)) for detection, tracks in kept]


def overlap(a: FlowerDetection, b: FlowerDetection) -> float:
    """The share of the union of two boxes that both cover, 0 to 1; 0 for boxes without an area."""
    (ax1, ay1, ax2, ay2), (bx1, by1, bx2, by2) = a.box_px, b.box_px
    common = max(0.0, min(ax2, bx2) - max(ax1, bx1)) * max(0.0, min(ay2, by2) - max(ay1, by1))
    union = (ax2 - ax1) * (ay2 - ay1) + (bx2 - bx1) * (by2 - by1) - common
    return common / union if common > 0.0 else 0.0


def gate(detections: Sequence[BoxDetection], box: Box, options: FlowerOptions) -> Sequence[BoxDetection]:
    """Keep the detections whose bearing meets the box, with a margin; all if the gate is off or the box has no area."""
    if not options.gate or box.degenerate:
        return detections
    return [
        d for d in detections if box.contains(*box.place(d.fraction, options.base_depth_frac), margin_m=options.gate_margin_m)
    ]


def summarise(detections: Sequence[BoxDetection], box: Box | None, anchor: Point2, options: FlowerOptions) -> PotObservation:
    """Summarise detections: species of the most confident flower, anomaly if any bug, counts, and the placed flowers.

    Without a box that has an area, one flower is placed at the anchor.
    """
    if not detections:
        return PotObservation()
    flowers = [d for d in detections if not d.anomaly]
    bugs = [d for d in detections if d.anomaly]
    best = max(flowers, key=lambda d: d.confidence, default=None)
    species, confidence = (best.species, best.confidence) if best else ("", 0.0)
    if box is None or box.degenerate:
        placed: tuple[PlacedFlower, ...] = (PlacedFlower(anchor, species, confidence, bool(bugs)),)
    else:
        placed = place_flowers(detections, box, options)
    columns = options.lateral_columns
    return PotObservation(
        species, confidence, bool(bugs), count_distinct(flowers, columns), count_distinct(bugs, columns), placed
    )


def count_distinct(detections: Sequence[BoxDetection], columns: int) -> int:
    """Count the different things that were detected: by their tracks if there are any, else by the columns they occupy.

    Two neighbors may share a column, so the count is never lower than what one image shows at once.
    """
    frames: dict[int, list[BoxDetection]] = {}
    for d in detections:
        frames.setdefault(d.frame, []).append(d)
    most_at_once = max(map(len, frames.values()), default=0)
    tracks = frozenset[int]().union(*(d.track_ids for d in detections))
    if tracks:
        return max(most_at_once, len(tracks) - _duplicate_tracks(frames.values()))
    occupied = {geometry.column_of(min(1.0, max(-1.0, d.fraction)), columns) for d in detections}
    return max(most_at_once, len(occupied))


def _duplicate_tracks(frames: Iterable[Sequence[BoxDetection]]) -> int:
    """Count the tracks that follow a thing which another track follows, too: they share it in one image, and no image shows
    them apart, as it would two flowers of which one passed behind the other."""
    images = list(frames)
    shared = {pair for image in images for d in image for pair in combinations(sorted(d.track_ids), 2)}
    apart = {
        (min(a, b), max(a, b))
        for image in images
        for one, other in combinations(image, 2)
        for a in one.track_ids
        for b in other.track_ids
    }
    first: dict[int, int] = {}
    for a, b in sorted(shared - apart):
        first.setdefault(b, first.get(a, a))
    return len(first)


def place_flowers(detections: Sequence[BoxDetection], box: Box, options: FlowerOptions) -> tuple[PlacedFlower, ...]:
    """Place a flower in the middle of each occupied column of the box: its most confident species, and whether it has a bug.

    If one image shows several flowers in a column, they share its width in their order from left to right.
    """
    n = options.lateral_columns
    columns: dict[int, list[BoxDetection]] = {}
    for d in detections:
        columns.setdefault(geometry.column_of(min(1.0, max(-1.0, d.fraction)), n), []).append(d)
    placed = []
    for column, members in sorted(columns.items()):
        neighbors = _fullest_image([d for d in members if not d.anomaly])
        if len(neighbors) < 2:
            best = max((d for d in members if not d.anomaly), key=lambda d: d.confidence, default=None)
            neighbors = [best or BoxDetection("", True, 0.0, geometry.column_center(column, n))]
        infested = {
            min(range(len(neighbors)), key=lambda k: abs(neighbors[k].fraction - bug.fraction))
            for bug in members
            if bug.anomaly
        }
        depth = geometry.column_depth(column, options.base_depth_frac, options.depth_jitter_frac)
        for k, flower in enumerate(neighbors):
            fraction = geometry.column_center(column, n) + (2.0 / n) * ((k + 0.5) / len(neighbors) - 0.5)
            placed.append(PlacedFlower(box.place(fraction, depth), flower.species, flower.confidence, k in infested))
    return tuple(placed)


def _fullest_image(flowers: Sequence[BoxDetection]) -> list[BoxDetection]:
    """The flowers of the image that shows the most, from left to right."""
    frames: dict[int, list[BoxDetection]] = {}
    for d in flowers:
        frames.setdefault(d.frame, []).append(d)
    fullest = max(frames.values(), key=lambda group: len(group)) if frames else []
    return sorted(fullest, key=lambda d: d.fraction)
