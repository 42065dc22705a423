"""Observations of a pot: species, counts, positions, and when they are published."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.perception import messages
from lupin_runtime.perception.box_geometry import Box, BoxSize
from lupin_runtime.perception.color_blobs import BlobLimits, find_flowers
from lupin_runtime.perception.flowers import (
    SAME_THING_OVERLAP,
    Accumulator,
    BoxDetection,
    FlowerOptions,
    PotObservation,
    count_distinct,
    gate,
    merge_overlapping,
    overlap,
)
from lupin_runtime.perception.messages import FlowerDetection, MalformedDetections

OPTIONS = FlowerOptions()
BOX = Box((0.0, 0.0), (1.0, 0.0), BoxSize())
RED, WHITE, PINK, BUG = range(4)


def detection(class_id: int, x: float = 320.0, confidence: float = 0.9, track: int | None = None) -> FlowerDetection:
    return FlowerDetection(class_id, confidence, (x - 10, 200.0, x + 10, 230.0), track)


def look(*frames: list[FlowerDetection], box: Box | None = BOX, registered: bool = False, pan: float = 0.0) -> PotObservation:
    accumulator = Accumulator(OPTIONS)
    accumulator.focus("1")
    for frame in frames:
        accumulator.add(frame, pan, 0.0)
    return accumulator.observation(box, registered, (0.0, 0.0))


def test_most_confident_flower_gives_the_species() -> None:
    found = look([detection(RED, confidence=0.6), detection(PINK, 420, 0.8), detection(BUG, 420, 0.99)])
    assert (found.species, found.confidence, found.anomaly) == ("tulip_pink", 0.8, True)
    assert (found.flower_count, found.bug_count) == (2, 1)


def test_weak_or_unknown_detections_are_ignored() -> None:
    assert look([detection(RED, confidence=0.34), detection(9), detection(-1)]) == PotObservation()


def test_new_focus_starts_without_the_last_pots_bug() -> None:
    accumulator = Accumulator(OPTIONS)
    accumulator.focus("1")
    accumulator.add([detection(BUG)], 0.0, 0.0)
    assert accumulator.observation(BOX, False, (0, 0)).anomaly
    assert accumulator.focus("2")
    accumulator.add([detection(RED)], 0.0, 0.0)
    found = accumulator.observation(BOX, False, (0, 0))
    assert not found.anomaly and found.species == "tulip_red"


def test_detections_without_a_focus_are_ignored() -> None:
    accumulator = Accumulator(OPTIONS)
    accumulator.add([detection(RED)], 0.0, 0.0)
    accumulator.focus("1")
    assert accumulator.observation(BOX, False, (0, 0)) == PotObservation()


def test_flowers_are_placed_in_the_columns_that_saw_them() -> None:
    found = look([detection(RED, 320), detection(WHITE, 620), detection(BUG, 620)])
    assert [b.species for b in found.flowers] == ["tulip_red", "tulip_white"]
    assert [b.anomaly for b in found.flowers] == [False, True]
    red, white = (BOX.coordinates(*b.position) for b in found.flowers)
    assert red == pytest.approx((0.0, 0.5 + (3 * 0.6180339887498949 % 1 - 0.5) * 0.36))
    assert white[0] == pytest.approx(4 / 7)  # fraction 0.47: the column from 3/7 to 5/7


def test_flower_on_the_image_right_is_placed_on_the_robots_right() -> None:
    """The box faces east, so an observer faces west and has north on the right."""
    (right,) = look([detection(RED, 600)]).flowers
    assert right.position[1] > 0.1


def test_bug_alone_has_no_species() -> None:
    found = look([detection(BUG)])
    assert (found.species, found.anomaly, found.flower_count, found.bug_count) == ("", True, 0, 1)
    assert found.flowers[0].species == ""


@pytest.mark.parametrize("box", [None, Box((0.0, 0.0), (1.0, 0.0), BoxSize(0.0, 0.0))])
def test_flower_without_a_box_is_placed_at_the_anchor(box: Box | None) -> None:
    accumulator = Accumulator(OPTIONS)
    accumulator.focus("1")
    accumulator.add([detection(RED, 100), detection(PINK, 600, 0.5)], 0.0, 0.0)
    found = accumulator.observation(box, False, (4.0, 5.0))
    assert [(b.position, b.species) for b in found.flowers] == [((4.0, 5.0), "tulip_red")]


def test_count_uses_tracks_or_columns_without_a_tracker() -> None:
    assert look([detection(RED, 320, track=1), detection(RED, 330, track=2)], [detection(RED, 500, track=1)]).flower_count == 2
    assert look([detection(RED, 320)], [detection(RED, 325)]).flower_count == 1
    assert look([detection(RED, 100)], [detection(RED, 600)]).flower_count == 2


def test_neighbors_in_one_column_count_if_one_image_shows_both() -> None:
    assert look([detection(RED, 300), detection(RED, 340)]).flower_count == 2


def test_neighbors_in_one_column_share_its_width() -> None:
    found = look([detection(RED, 320)], [detection(RED, 345), detection(PINK, 300), detection(BUG, 344)])
    assert [(b.species, b.anomaly) for b in found.flowers] == [("tulip_pink", False), ("tulip_red", True)]
    fractions = [BOX.coordinates(*b.position)[0] for b in found.flowers]
    assert fractions == pytest.approx([-1 / 14, 1 / 14])


def boxed(class_id: int, confidence: float, x1: float, width: float = 40.0, track: int | None = None) -> FlowerDetection:
    return FlowerDetection(class_id, confidence, (x1, 200.0, x1 + width, 260.0), track)


def test_two_classes_at_one_place_are_one_flower() -> None:
    """The columns' border at 320 px lies between the boxes' centers: each box alone would be a flower of its own."""
    found = look([boxed(WHITE, 0.6, 303), boxed(PINK, 0.8, 297), boxed(RED, 0.7, 500), boxed(BUG, 0.5, 314, 12)])
    assert [(b.species, b.confidence, b.anomaly) for b in found.flowers] == [
        ("tulip_pink", 0.8, True),
        ("tulip_red", 0.7, False),
    ]
    assert (found.flower_count, found.bug_count, found.species) == (2, 1, "tulip_pink")


def test_bug_is_on_the_neighbor_that_two_boxes_hid() -> None:
    """Three boxes on two neighbors in one column: with the second box as a flower, the bug would sit on that."""
    found = look([boxed(RED, 0.9, 300, 24), boxed(PINK, 0.5, 303, 26), boxed(WHITE, 0.8, 326, 24), boxed(BUG, 0.7, 313, 12)])
    assert [(b.species, b.anomaly) for b in found.flowers] == [("tulip_red", True), ("tulip_white", False)]


def test_close_neighbors_stay_two_flowers() -> None:
    """Their boxes overlap by up to three quarters of a width, in the direction in which flowers stand side by side."""
    for shift in (40.0, 20.0, 10.5):
        assert look([boxed(RED, 0.9, 300), boxed(PINK, 0.8, 300 + shift)]).flower_count == 2
    assert look([boxed(RED, 0.9, 300), boxed(PINK, 0.8, 309)]).flower_count == 1
    row = [boxed(RED, 0.9, 300), boxed(PINK, 0.8, 309), boxed(RED, 0.7, 318)]
    assert look(row).flower_count == 2, "the first and the third are apart, although each is close to the second"


def test_bug_as_large_as_its_flower_is_kept() -> None:
    found = look([boxed(RED, 0.9, 300), boxed(BUG, 0.95, 300)])
    assert (found.species, found.flower_count, found.bug_count) == ("tulip_red", 1, 1)
    assert look([boxed(BUG, 0.9, 300), boxed(BUG, 0.8, 302)]).bug_count == 1


def test_weak_box_does_not_hide_a_flower() -> None:
    assert look([boxed(9, 0.99, 300), boxed(RED, 0.4, 301), boxed(PINK, 0.2, 302)]).species == "tulip_red"


def test_two_tracks_of_one_flower_count_once() -> None:
    """The tracker follows both boxes, and now one of them is the better, now the other."""
    frames = [[boxed(RED, 0.5 + k % 2 / 10, 300, track=1), boxed(PINK, 0.55, 302, track=2)] for k in range(4)]
    assert look(*frames).flower_count == 1
    assert look(*frames, [boxed(RED, 0.9, 500, track=3)]).flower_count == 2


def test_two_tracks_that_part_again_are_two_flowers() -> None:
    passing = [boxed(RED, 0.9, 300, track=1), boxed(PINK, 0.8, 304, track=2)]
    apart = [boxed(RED, 0.9, 320, track=1), boxed(PINK, 0.8, 370, track=2)]
    assert look(passing, apart, passing).flower_count == 2


boxes = st.builds(
    boxed, st.integers(0, 2), st.floats(0.35, 1), st.floats(0, 600), st.floats(0, 80), st.none() | st.integers(0, 9)
)


@given(st.lists(boxes, max_size=12))
def test_merged_boxes_do_not_overlap(seen: list[FlowerDetection]) -> None:
    merged = merge_overlapping(seen)
    kept = [d for d, _ in merged]
    assert all(overlap(a, b) <= SAME_THING_OVERLAP for k, a in enumerate(kept) for b in kept[:k])
    assert all(any(overlap(d, k) > SAME_THING_OVERLAP or d is k for k in kept) for d in seen)
    assert {t for _, tracks in merged for t in tracks} == {d.track_id for d in seen} - {None}


def test_bearing_beyond_a_registered_box_is_dropped() -> None:
    outside = [detection(BUG, 640), detection(RED, 320)]
    narrow = Box((0.0, 0.0), (1.0, 0.0), BoxSize(0.5, 0.3))
    found = look(outside, box=narrow, registered=True, pan=1.0)
    assert (found.species, found.anomaly, found.bug_count) == ("tulip_red", False, 0)
    assert look(outside, box=narrow, registered=True, pan=1.5) == PotObservation()
    assert look(outside, box=narrow, registered=False, pan=1.0).anomaly
    assert len(look([detection(RED, 640)], box=narrow, registered=True).flowers) == 1


def test_bearing_gate_can_be_off() -> None:
    detections = [*_detections(3.0)]
    assert gate(detections, BOX, OPTIONS) == []
    assert gate(detections, BOX, FlowerOptions(gate=False)) == detections


def _detections(fraction: float) -> list[BoxDetection]:
    return [BoxDetection("tulip_red", False, 0.9, fraction)]


def test_observation_differs_only_if_its_content_changed() -> None:
    published = PotObservation("tulip_red", 0.5, False, 1, 0)
    assert not PotObservation().differs_from(None) and not PotObservation().differs_from(published)
    assert published.differs_from(None)
    assert not published.differs_from(published)
    assert not PotObservation("tulip_red", 0.59, False, 1, 0).differs_from(published)
    assert PotObservation("tulip_red", 0.61, False, 1, 0).differs_from(published)
    for other in (
        PotObservation("tulip_pink", 0.5, False, 1, 0),
        PotObservation("tulip_red", 0.5, True, 1, 0),
        PotObservation("tulip_red", 0.5, False, 2, 0),
        PotObservation("tulip_red", 0.5, False, 1, 1),
    ):
        assert other.differs_from(published)


@given(st.lists(st.builds(detection, st.integers(0, 3), st.floats(0, 640), st.floats(0, 1)), max_size=30))
def test_counts_and_flowers_are_bounded(seen: list[FlowerDetection]) -> None:
    found = look(seen)
    assert len(found.flowers) <= len(seen)
    assert found.flower_count + found.bug_count <= len(seen)
    assert all(BOX.contains(*b.position, margin_m=1e-6) for b in found.flowers)
    assert found.anomaly == (found.bug_count > 0)


def test_accumulator_forgets_the_oldest() -> None:
    accumulator = Accumulator(OPTIONS)
    accumulator.focus("1")
    accumulator.add([detection(BUG)], 0.0, 0.0)
    for _ in range(512):
        accumulator.add([detection(RED)], 0.0, 0.0)
    assert not accumulator.observation(BOX, False, (0, 0)).anomaly
    assert count_distinct([], 7) == 0


# -- colors -----------------------------------------------------------------------------------------------------------

GREEN = (60, 140, 60)
HSV = {RED: (175, 220, 200), WHITE: (20, 15, 235), PINK: (170, 90, 230), BUG: (60, 40, 20)}


def greenhouse(*blobs: tuple[int, int, int, int, int]) -> np.ndarray:
    """Return a green image with ellipses: class, x, y, half width, half height."""
    image = np.full((480, 640, 3), GREEN, np.uint8)
    for class_id, x, y, w, h in blobs:
        pixel = cv2.cvtColor(np.array([[HSV[class_id]]], np.uint8), cv2.COLOR_HSV2BGR)[0, 0]
        cv2.ellipse(image, (x, y), (w, h), 0, 0, 360, tuple(int(v) for v in pixel), -1)
    return image


@pytest.mark.parametrize("class_id", [RED, WHITE, PINK, BUG])
def test_each_class_is_found_by_its_color(class_id: int) -> None:
    (found,) = find_flowers(greenhouse((class_id, 300, 200, 20, 28)))
    assert found.class_id == class_id
    assert np.abs(np.array(found.box_px) - (280, 172, 321, 229)).max() <= 4
    assert found.confidence == pytest.approx(np.pi * 20 * 28 / 2000, rel=0.1)


def test_red_spans_both_ends_of_the_hue_circle() -> None:
    for hue in (2, 178):
        image = np.full((480, 640, 3), GREEN, np.uint8)
        pixel = cv2.cvtColor(np.array([[(hue, 220, 200)]], np.uint8), cv2.COLOR_HSV2BGR)[0, 0]
        cv2.circle(image, (100, 100), 30, tuple(int(v) for v in pixel), -1)
        assert [b.class_id for b in find_flowers(image)] == [RED]


def test_all_flowers_of_a_class_are_found_largest_first() -> None:
    found = find_flowers(greenhouse((RED, 100, 200, 15, 20), (RED, 300, 200, 25, 30), (RED, 500, 200, 20, 25)))
    assert [round((b.box_px[0] + b.box_px[2]) / 2, -2) for b in found] == [300, 500, 100]


def test_blobs_below_the_area_are_left_out() -> None:
    assert find_flowers(greenhouse((RED, 300, 200, 5, 6))) == []
    assert len(find_flowers(greenhouse((RED, 300, 200, 5, 6)), BlobLimits(min_area_px=40, morph_kernel_px=1))) == 1


def test_white_floors_and_tag_paper_are_no_flowers() -> None:
    from lupin_runtime.apriltag import tag_image

    floor = np.full((480, 640, 3), GREEN, np.uint8)
    floor[260:] = (225, 225, 225)
    assert find_flowers(floor) == []
    wall_line = np.full((480, 640, 3), GREEN, np.uint8)
    wall_line[100:130] = (225, 225, 225)
    assert find_flowers(wall_line) == []
    for tag_id in range(0, 580, 20):
        plate = np.full((480, 640, 3), GREEN, np.uint8)
        tag = cv2.cvtColor(tag_image(tag_id, 15), cv2.COLOR_GRAY2BGR)
        plate[100 : 100 + tag.shape[0], 200 : 200 + tag.shape[1]] = np.where(tag > 0, 230, 70)
        assert find_flowers(plate) == []


def test_bug_on_a_white_flower_leaves_the_flower() -> None:
    found = find_flowers(greenhouse((WHITE, 300, 200, 24, 32), (BUG, 306, 204, 14, 18)))
    assert [b.class_id for b in found] == [WHITE, BUG]


@pytest.mark.parametrize("width", [320, 640, 1280])
def test_image_size_does_not_change_the_detections(width: int) -> None:
    image = cv2.resize(greenhouse((PINK, 300, 200, 24, 30)), (width, width * 3 // 4), interpolation=cv2.INTER_AREA)
    (found,) = find_flowers(image)
    assert found.confidence == pytest.approx(1.0, abs=0.15)
    assert found.box_px[0] == pytest.approx(276 * width / 640, abs=0.02 * width)


# -- messages ----------------------------------------------------------------------------------------------------------


def test_flower_messages_round_trip_through_json() -> None:
    seen = [detection(RED, track=4), detection(BUG)]
    text = json.dumps([messages.flower_entry(b, "x") for b in seen])
    assert messages.read_flower_detections(text) == seen


@pytest.mark.parametrize("text", ["", "{", "{}", "3", '"a"', "null"])
def test_text_that_is_no_json_array_is_refused(text: str) -> None:
    for read in (messages.read_flower_detections, messages.read_tags):
        with pytest.raises(MalformedDetections):
            read(text)


def test_invalid_json_entries_are_left_out() -> None:
    tags = '[{"id": 3, "dist": 1.0}, {"id": true, "dist": 1}, {"dist": 1}, {"id": 4, "dist": NaN}, {"id": 5}, 7]'
    assert messages.read_tags(tags) == [messages.SeenTag("3", 1.0)]
    box = '"bbox_xyxy": [1, 2, 3, 4]'
    detections = (
        f'[{{"class": 0, "confidence": 0.5, {box}}}, {{"class": 0, "confidence": 0.5, "bbox_xyxy": [1, 2, 3]}},'
        f' {{"class": "a", "confidence": 1, {box}}}, {{"class": 0, "confidence": NaN, {box}}},'
        ' {"class": 0, "confidence": 1, "bbox_xyxy": [1, 2, 3, null]}]'
    )
    assert messages.read_flower_detections(detections) == [FlowerDetection(0, 0.5, (1, 2, 3, 4))]


leaves = st.none() | st.floats() | st.text()
documents = st.recursive(leaves, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)).map(json.dumps)


@settings(max_examples=60)
@given(st.text() | documents)
def test_no_text_crashes_the_json_readers(text: str) -> None:
    for read in (messages.read_flower_detections, messages.read_tags):
        try:
            read(text)
        except MalformedDetections:
            continue
