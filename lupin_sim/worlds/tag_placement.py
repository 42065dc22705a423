"""Places tags on the sides of boxes."""

from __future__ import annotations

import math
from collections.abc import Iterable

from lupin_runtime.geometry import Pose2
from lupin_sim.world import TAG_PLATE_M, Box, Tag

# Minimum distance of the centers of two tags on one side, so that no plate covers another.
TAG_SPACING_M = TAG_PLATE_M + 0.02


def place_tag(box: Box, side: float, along_m: float, tag_id: int) -> Tag:
    """Return a tag on the side of a box whose outward normal has the heading `side`, `along_m` from the middle of that side.

    Positive `along_m` is to the left when facing outwards. Raises ValueError if the box has no such side, or if the plate would
    extend over its edge.
    """
    for face, width in box.faces():
        if math.cos(face.yaw - side) > 0.999:
            if abs(along_m) > (width - TAG_PLATE_M) / 2 + 1e-9:
                raise ValueError(f"tag {tag_id} extends over the edge of {box.name}, whose side is {width:.2f} m wide")
            at = face @ Pose2(y=along_m)
            return Tag(tag_id, at.x, at.y, at.yaw, box=box.name)
    raise ValueError(f"{box.name} has no side towards {math.degrees(side):.0f} degrees")


def nearest(boxes: Iterable[Box], x: float, y: float) -> Box:
    """Return the box whose footprint is nearest to a point; of equally near ones, the first by name."""
    return min(boxes, key=lambda box: (round(box.distance_to(x, y), 6), box.name))


def project(box: Box, x: float, y: float, tag_id: int, taken: Iterable[Tag] = ()) -> Tag:
    """Place a tag, located near a box in a layout, on the nearest side of the box that has room for its plate.

    It keeps its distance from the tags in `taken`. Raises ValueError if no side has room.
    """
    others = [tag for tag in taken if tag.box == box.name]
    candidates = []
    for order, (face, width) in enumerate(box.faces()):
        room = (width - TAG_PLATE_M) / 2
        if room < 0.0:
            continue
        outside, along = face.inverse().apply(x, y)
        wanted = min(max(along, -room), room)
        here = [face.inverse().apply(tag.x, tag.y)[1] for tag in others if math.cos(tag.yaw - face.yaw) > 0.999]
        place = _free_place(wanted, room, here)
        if place is not None:
            # Ranked by the distance between its place in the layout and its place on the side.
            candidates.append((round(math.hypot(outside, along - place), 6), order, face, place))
    if not candidates:
        raise ValueError(f"no side of {box.name} has room for tag {tag_id}")
    _, _, face, place = min(candidates, key=lambda c: c[:2])
    at = face @ Pose2(y=place)
    return Tag(tag_id, at.x, at.y, at.yaw, box=box.name)


def _free_place(wanted: float, room: float, taken: list[float]) -> float | None:
    """Return the place nearest to `wanted` within +-room that keeps TAG_SPACING_M from the taken ones, or None."""
    places = [wanted, *(t + side * TAG_SPACING_M for t in taken for side in (-1.0, 1.0))]
    free = [
        place for place in places if abs(place) <= room + 1e-9 and all(abs(place - t) >= TAG_SPACING_M - 1e-9 for t in taken)
    ]
    return min(free, key=lambda place: (abs(place - wanted), place)) if free else None
