"""The rows of the page's tag table: pictures, outcome, readings, flowers and position of each tag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lupin_runtime.report.findings import clock
from lupin_runtime.report.health import SENSORS, grade
from lupin_runtime.report.images import data_uri, thumbnail
from lupin_runtime.report.page.map_drawing import OUTCOME_LABELS, anchor
from lupin_runtime.report.palette import SPECIES, SPECIES_OTHER, flower_label
from lupin_runtime.report.report_json import ReportInput
from lupin_runtime.report.run_log import CameraImage
from lupin_runtime.report.tags import READ, LatestReading, TagResult
from lupin_runtime.twin.health import shown_state

_PHOTO_PX = 224
_PHOTO_WITHIN_S = 4.0  # an image farther from the time of the reading may show another place
OUTCOME_MARKS = {"read": "✔", "unreachable": "✖", "scan_failed": "▲", "skipped": "↷", "seen": "○"}


@dataclass(frozen=True)
class Photo:
    """A thumbnail as a data URI."""

    uri: str
    alt: str


@dataclass(frozen=True)
class ReadingRow:
    """A sensor's value; `note` says how it is outside its ideal range."""

    name: str
    value: str
    unit: str
    note: str
    health: str


@dataclass(frozen=True)
class FlowerCount:
    """The number of flowers of one species, with its color."""

    label: str
    color: str


@dataclass(frozen=True)
class TagRow:
    """The texts of one tag's row; empty ones are shown as a dash."""

    tag_id: str
    anchor: str
    photos: tuple[Photo, ...]
    outcome: str
    outcome_label: str
    reason: str
    times: str
    readings: tuple[ReadingRow, ...]
    flowers: tuple[FlowerCount, ...]
    bugs: str
    confidence: str
    position: str
    height: str
    error: str


def tag_rows(report: ReportInput) -> list[TagRow]:
    """Return a row for every tag."""
    return [_row(tag, report) for tag in report.tags]


def _row(tag: TagResult, report: ReportInput) -> TagRow:
    flower, pose = tag.flower, tag.pose
    truth = report.tag_truth.get(tag.tag_id)
    error_m = truth.error_m if truth is not None else None
    return TagRow(
        tag_id=tag.tag_id,
        anchor=anchor(tag.tag_id),
        photos=_photos(tag, report),
        outcome=tag.outcome,
        outcome_label=_outcome_label(tag),
        reason=tag.reason,
        times=_times(tag),
        readings=tuple(map(reading_row, tag.readings)),
        flowers=_flowers(tag),
        bugs=f"✱ {flower.bug_count or 1} bug{'s' if flower.bug_count > 1 else ''}" if flower and flower.anomaly else "",
        confidence=f"{flower.confidence:.0%} confidence" if flower and flower.species and flower.confidence else "",
        position=f"{pose.x:.2f}, {pose.y:.2f} m" if pose is not None else "",
        height=f"height {pose.z:.2f} m" if pose is not None else "",
        error=f"{error_m * 100:.1f} cm" if error_m is not None else "",
    )


def _photos(tag: TagResult, report: ReportInput) -> tuple[Photo, ...]:
    if tag.read_s is None or not tag.visited:
        return ()
    photos = []
    for images, camera in ((report.log.body_images, "Front camera"), (report.log.gripper_images, "Gripper camera")):
        image = nearest_image(images, tag.read_s)
        jpeg = thumbnail(image.jpeg, _PHOTO_PX) if image is not None else None
        if jpeg is not None:
            photos.append(Photo(data_uri(jpeg, "jpeg"), f"{camera} at tag {tag.tag_id}"))
    return tuple(photos)


def nearest_image(images: Sequence[CameraImage], t_s: float) -> CameraImage | None:
    """Return the image closest to a time, within _PHOTO_WITHIN_S; images before it are preferred to images after it."""
    close = [image for image in images if abs(image.t_s - t_s) <= _PHOTO_WITHIN_S]
    return min(close, key=lambda i: t_s - i.t_s if i.t_s <= t_s else (i.t_s - t_s) * 2.0, default=None)


def _outcome_label(tag: TagResult) -> str:
    label = "read from a distance" if tag.outcome == READ and not tag.visited else OUTCOME_LABELS[tag.outcome]
    return f"{OUTCOME_MARKS[tag.outcome]} {label}"


def _times(tag: TagResult) -> str:
    times = []
    if tag.discovered_s is not None:
        times.append(f"seen {clock(tag.discovered_s)}")
    if tag.read_s is not None:
        times.append(f"read {clock(tag.read_s)}")
    if tag.sightings:
        times.append(f"{tag.sightings} sightings")
    return " · ".join(times)


def reading_row(reading: LatestReading) -> ReadingRow:
    """Return how a reading is shown: with a note and a mark that agree."""
    sensor = SENSORS.get(reading.sensor)
    value = f"{reading.value:.4g}"
    if sensor is None:
        return ReadingRow(reading.sensor, value, "", "", "no_data")
    health = grade(reading.deviation)
    if reading.deviation <= 0.0:
        return ReadingRow(sensor.label, value, sensor.unit, "" if health == "healthy" else health, health)
    degree = "a little" if health == "healthy" else health
    side = "low" if reading.value < sensor.low else "high"
    return ReadingRow(sensor.label, value, sensor.unit, f"{degree} {side}", shown_state(health, reading.deviation))


def _flowers(tag: TagResult) -> tuple[FlowerCount, ...]:
    flower = tag.flower
    if flower is None:
        return ()
    counts: dict[str, int] = {}
    for placed in flower.placed:
        counts[placed.species] = counts.get(placed.species, 0) + 1
    if not counts and (flower.species or flower.flower_count):
        counts = {flower.species: flower.flower_count or 1}
    return tuple(FlowerCount(flower_label(s, n), SPECIES.get(s, SPECIES_OTHER)) for s, n in counts.items())
