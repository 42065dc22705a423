"""The JSON of detectors: writes it, and validates what it reads."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from lupin_runtime.json_text import parse_json


class MalformedDetections(ValueError):
    """A detections message that violates its contract; the message says what was found."""


@dataclass(frozen=True)
class SeenTag:
    """One tag of a `/camera/tag_detections_json` message: its id, and its depth along the optical axis."""

    id: str
    dist_m: float


@dataclass(frozen=True)
class FlowerDetection:
    """One object of a `/yolo/detections` message. `box_px`: x1, y1, x2, y2."""

    class_id: int
    confidence: float
    box_px: tuple[float, float, float, float]
    track_id: int | None = None


def tag_entry(tag_id: int, corners: NDArray[Any], dist_m: float, time_ns: int) -> dict[str, Any]:
    """One element of the tag detections array.

    `stamp` is when the image was taken, in s of ROS time: on a robot that turns, the corners fit no other image.
    """
    return {
        "id": tag_id,
        "corners": [[round(float(x), 2), round(float(y), 2)] for x, y in corners],
        "dist": round(dist_m, 4),
        "stamp": round(time_ns / 1e9, 6),
    }


def flower_entry(detection: FlowerDetection, class_name: str) -> dict[str, Any]:
    """One element of the flower detections array."""
    entry: dict[str, Any] = {
        "class": detection.class_id,
        "confidence": round(detection.confidence, 4),
        "bbox_xyxy": [round(value, 1) for value in detection.box_px],
        "class_name": class_name,
    }
    return entry if detection.track_id is None else {**entry, "track_id": detection.track_id}


def read_tags(text: str) -> list[SeenTag]:
    """The tags of a message; entries without a usable id or distance are left out. Raises MalformedDetections."""
    seen = []
    for entry in _entries(text):
        dist = _number(entry.get("dist"))
        tag_id = entry.get("id")
        if dist is not None and dist >= 0.0 and isinstance(tag_id, (int, str)) and not isinstance(tag_id, bool):
            seen.append(SeenTag(str(tag_id), dist))
    return seen


def read_flower_detections(text: str) -> list[FlowerDetection]:
    """The flowers and bugs of a message; entries without a usable class, confidence or box are left out.

    Raises MalformedDetections.
    """
    seen = []
    for entry in _entries(text):
        class_id, confidence = _number(entry.get("class")), _number(entry.get("confidence"))
        box = entry.get("bbox_xyxy")
        if class_id is None or confidence is None or not isinstance(box, list) or len(box) != 4:
            continue
        x1, y1, x2, y2 = (_number(value) for value in box)
        if x1 is None or y1 is None or x2 is None or y2 is None:
            continue
        track = entry.get("track_id")
        usable_track = int(track) if isinstance(track, int) and not isinstance(track, bool) else None
        seen.append(FlowerDetection(int(class_id), min(1.0, max(0.0, confidence)), (x1, y1, x2, y2), usable_track))
    return seen


def _entries(text: str) -> list[dict[str, Any]]:
    try:
        document = parse_json(text)
    except ValueError as error:
        raise MalformedDetections(f"not JSON: {error}") from error
    if not isinstance(document, list):
        raise MalformedDetections(f"a JSON array was expected, not {type(document).__name__}")
    return [entry for entry in document if isinstance(entry, dict)]


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return None
    return float(value)
