"""Findings of a pot: species, counts, places, and when they are told."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.perception import messages
from lupin_runtime.perception.blooms import BlobLimits, find_blooms
from lupin_runtime.perception.box_geometry import Box, BoxSize
from lupin_runtime.perception.flowers import Accumulator, Finding, FlowerOptions, distinct, gated
from lupin_runtime.perception.messages import MalformedDetections, SeenBloom

OPTIONS = FlowerOptions()
BOX = Box((0.0, 0.0), (1.0, 0.0), BoxSize())
RED, WHITE, PINK, BUG = range(4)


def bloom(class_id: int, x: float = 320.0, confidence: float = 0.9, track: int | None = None) -> SeenBloom:
    return SeenBloom(class_id, confidence, (x - 10, 200.0, x + 10, 230.0), track)


def look(*frames: list[SeenBloom], box: Box | None = BOX, registered: bool = False, pan: float = 0.0) -> Finding:
    accumulator = Accumulator(OPTIONS)
    accumulator.focus("1")
    for frame in frames:
        accumulator.add(frame, pan, 0.0)
    return accumulator.finding(box, registered, (0.0, 0.0))


def test_the_most_confident_flower_names_the_pot_and_any_bug_marks_it():
    found = look([bloom(RED, confidence=0.6), bloom(PINK, 420, 0.8), bloom(BUG, 420, 0.99)])
    assert (found.species, found.confidence, found.anomaly) == ("tulip_pink", 0.8, True)
    assert (found.flower_count, found.bug_count) == (2, 1)


def test_detections_below_the_confidence_or_of_unknown_classes_count_for_nothing():
    assert look([bloom(RED, confidence=0.34), bloom(9), bloom(-1)]) == Finding()


def test_another_focus_starts_without_the_last_pots_bug():
    accumulator = Accumulator(OPTIONS)
    accumulator.focus("1")
    accumulator.add([bloom(BUG)], 0.0, 0.0)
    assert accumulator.finding(BOX, False, (0, 0)).anomaly
    assert accumulator.focus("2")
    accumulator.add([bloom(RED)], 0.0, 0.0)
    found = accumulator.finding(BOX, False, (0, 0))
    assert not found.anomaly and found.species == "tulip_red"


def test_nothing_is_gathered_without_a_focus():
    accumulator = Accumulator(OPTIONS)
    accumulator.add([bloom(RED)], 0.0, 0.0)
    accumulator.focus("1")
    assert accumulator.finding(BOX, False, (0, 0)) == Finding()


def test_blooms_stand_in_the_columns_they_were_seen_in():
    found = look([bloom(RED, 320), bloom(WHITE, 620), bloom(BUG, 620)])
    assert [b.species for b in found.blooms] == ["tulip_red", "tulip_white"]
    assert [b.anomaly for b in found.blooms] == [False, True]
    red, white = (BOX.coordinates(*b.position) for b in found.blooms)
    assert red == pytest.approx((0.0, 0.5 + (3 * 0.6180339887498949 % 1 - 0.5) * 0.36))
    assert white[0] == pytest.approx(4 / 7)  # fraction 0.47: the column from 3/7 to 5/7


def test_a_bloom_to_the_right_in_the_picture_stands_to_the_right_of_the_one_who_looks():
    """The box faces east, so one who looks at it looks west, and has north on the right."""
    (right,) = look([bloom(RED, 600)]).blooms
    assert right.position[1] > 0.1


def test_a_bug_alone_has_no_species():
    found = look([bloom(BUG)])
    assert (found.species, found.anomaly, found.flower_count, found.bug_count) == ("", True, 0, 1)
    assert found.blooms[0].species == ""


@pytest.mark.parametrize("box", [None, Box((0.0, 0.0), (1.0, 0.0), BoxSize(0.0, 0.0))])
def test_without_a_box_one_bloom_stands_at_the_anchor(box):
    accumulator = Accumulator(OPTIONS)
    accumulator.focus("1")
    accumulator.add([bloom(RED, 100), bloom(PINK, 600, 0.5)], 0.0, 0.0)
    found = accumulator.finding(box, False, (4.0, 5.0))
    assert [(b.position, b.species) for b in found.blooms] == [((4.0, 5.0), "tulip_red")]


def test_tracks_count_where_a_tracker_ran_columns_where_none_did():
    assert look([bloom(RED, 320, track=1), bloom(RED, 330, track=2)], [bloom(RED, 500, track=1)]).flower_count == 2
    assert look([bloom(RED, 320)], [bloom(RED, 325)]).flower_count == 1
    assert look([bloom(RED, 100)], [bloom(RED, 600)]).flower_count == 2


def test_neighbours_in_one_column_are_counted_where_one_picture_shows_both():
    assert look([bloom(RED, 300), bloom(RED, 340)]).flower_count == 2


def test_neighbours_in_one_column_share_its_width_and_the_bug_stays_with_its_own():
    found = look([bloom(RED, 320)], [bloom(RED, 345), bloom(PINK, 300), bloom(BUG, 344)])
    assert [(b.species, b.anomaly) for b in found.blooms] == [("tulip_pink", False), ("tulip_red", True)]
    fractions = [BOX.coordinates(*b.position)[0] for b in found.blooms]
    assert fractions == pytest.approx([-1 / 14, 1 / 14])


def test_a_bearing_beyond_a_registered_box_is_dropped_and_not_clamped_onto_it():
    outside = [bloom(BUG, 640), bloom(RED, 320)]
    narrow = Box((0.0, 0.0), (1.0, 0.0), BoxSize(0.5, 0.3))
    found = look(outside, box=narrow, registered=True, pan=1.0)
    assert (found.species, found.anomaly, found.bug_count) == ("tulip_red", False, 0)
    assert look(outside, box=narrow, registered=True, pan=1.5) == Finding()
    assert look(outside, box=narrow, registered=False, pan=1.0).anomaly
    assert len(look([bloom(RED, 640)], box=narrow, registered=True).blooms) == 1


def test_the_gate_can_be_off():
    detections = [*_detections(3.0)]
    assert gated(detections, BOX, OPTIONS) == []
    assert gated(detections, BOX, FlowerOptions(gate=False)) == detections


def _detections(fraction):
    from lupin_runtime.perception.flowers import Detection

    return [Detection("tulip_red", False, 0.9, fraction)]


def test_news_is_what_changed():
    told = Finding("tulip_red", 0.5, False, 1, 0)
    assert not Finding().differs_from(None) and not Finding().differs_from(told)
    assert told.differs_from(None)
    assert not told.differs_from(told)
    assert not Finding("tulip_red", 0.59, False, 1, 0).differs_from(told)
    assert Finding("tulip_red", 0.61, False, 1, 0).differs_from(told)
    for other in (
        Finding("tulip_pink", 0.5, False, 1, 0),
        Finding("tulip_red", 0.5, True, 1, 0),
        Finding("tulip_red", 0.5, False, 2, 0),
        Finding("tulip_red", 0.5, False, 1, 1),
    ):
        assert other.differs_from(told)


@given(st.lists(st.builds(bloom, st.integers(0, 3), st.floats(0, 640), st.floats(0, 1)), max_size=30))
def test_counts_and_blooms_are_bounded(seen):
    found = look(seen)
    assert len(found.blooms) <= len(seen)
    assert found.flower_count + found.bug_count <= len(seen)
    assert all(BOX.contains(*b.position, margin_m=1e-6) for b in found.blooms)
    assert found.anomaly == (found.bug_count > 0)


def test_the_accumulator_forgets_the_oldest():
    accumulator = Accumulator(OPTIONS)
    accumulator.focus("1")
    accumulator.add([bloom(BUG)], 0.0, 0.0)
    for _ in range(512):
        accumulator.add([bloom(RED)], 0.0, 0.0)
    assert not accumulator.finding(BOX, False, (0, 0)).anomaly
    assert distinct([], 7) == 0


# -- colours -----------------------------------------------------------------------------------------------------------

GREEN = (60, 140, 60)
HSV = {RED: (175, 220, 200), WHITE: (20, 15, 235), PINK: (170, 90, 230), BUG: (60, 40, 20)}


def greenhouse(*blobs: tuple[int, int, int, int, int]) -> np.ndarray:
    """A green picture with ellipses: class, x, y, half width, half height."""
    image = np.full((480, 640, 3), GREEN, np.uint8)
    for class_id, x, y, w, h in blobs:
        pixel = cv2.cvtColor(np.uint8([[HSV[class_id]]]), cv2.COLOR_HSV2BGR)[0, 0]
        cv2.ellipse(image, (x, y), (w, h), 0, 0, 360, tuple(int(v) for v in pixel), -1)
    return image


@pytest.mark.parametrize("class_id", [RED, WHITE, PINK, BUG])
def test_each_class_is_found_by_its_colour_where_it_is(class_id):
    (found,) = find_blooms(greenhouse((class_id, 300, 200, 20, 28)))
    assert found.class_id == class_id
    assert np.abs(np.array(found.box_px) - (280, 172, 321, 229)).max() <= 4
    assert found.confidence == pytest.approx(np.pi * 20 * 28 / 2000, rel=0.1)


def test_red_lies_on_both_sides_of_the_hue_circle():
    for hue in (2, 178):
        image = np.full((480, 640, 3), GREEN, np.uint8)
        pixel = cv2.cvtColor(np.uint8([[(hue, 220, 200)]]), cv2.COLOR_HSV2BGR)[0, 0]
        cv2.circle(image, (100, 100), 30, tuple(int(v) for v in pixel), -1)
        assert [b.class_id for b in find_blooms(image)] == [RED]


def test_all_blooms_of_a_class_are_found_the_largest_first():
    found = find_blooms(greenhouse((RED, 100, 200, 15, 20), (RED, 300, 200, 25, 30), (RED, 500, 200, 20, 25)))
    assert [round((b.box_px[0] + b.box_px[2]) / 2, -2) for b in found] == [300, 500, 100]


def test_blobs_below_the_area_are_left_out():
    assert find_blooms(greenhouse((RED, 300, 200, 5, 6))) == []
    assert len(find_blooms(greenhouse((RED, 300, 200, 5, 6)), BlobLimits(min_area_px=40, morph_kernel_px=1))) == 1


def test_white_floors_and_the_paper_of_a_tag_are_no_flowers():
    from lupin_runtime.perception.tag_family import picture

    floor = np.full((480, 640, 3), GREEN, np.uint8)
    floor[260:] = (225, 225, 225)
    assert find_blooms(floor) == []
    wall_line = np.full((480, 640, 3), GREEN, np.uint8)
    wall_line[100:130] = (225, 225, 225)
    assert find_blooms(wall_line) == []
    for tag_id in range(0, 580, 20):
        plate = np.full((480, 640, 3), GREEN, np.uint8)
        tag = cv2.cvtColor(picture(tag_id, 15), cv2.COLOR_GRAY2BGR)
        plate[100 : 100 + tag.shape[0], 200 : 200 + tag.shape[1]] = np.where(tag > 0, 230, 70)
        assert find_blooms(plate) == []


def test_a_bug_on_a_white_flower_leaves_the_flower():
    found = find_blooms(greenhouse((WHITE, 300, 200, 24, 32), (BUG, 306, 204, 14, 18)))
    assert [b.class_id for b in found] == [WHITE, BUG]


@pytest.mark.parametrize("width", [320, 640, 1280])
def test_the_size_of_the_picture_does_not_change_what_is_found(width):
    image = cv2.resize(greenhouse((PINK, 300, 200, 24, 30)), (width, width * 3 // 4), interpolation=cv2.INTER_AREA)
    (found,) = find_blooms(image)
    assert found.confidence == pytest.approx(1.0, abs=0.15)
    assert found.box_px[0] == pytest.approx(276 * width / 640, abs=0.02 * width)


# -- messages ----------------------------------------------------------------------------------------------------------


def test_flower_messages_survive_the_way_through_json():
    seen = [bloom(RED, track=4), bloom(BUG)]
    text = json.dumps([messages.bloom_entry(b, "x") for b in seen])
    assert messages.read_blooms(text) == seen


@pytest.mark.parametrize("text", ["", "{", "{}", "3", '"a"', "null"])
def test_text_that_is_no_array_is_refused(text):
    for read in (messages.read_blooms, messages.read_tags):
        with pytest.raises(MalformedDetections):
            read(text)


def test_entries_that_make_no_sense_are_left_out():
    tags = '[{"id": 3, "dist": 1.0}, {"id": true, "dist": 1}, {"dist": 1}, {"id": 4, "dist": NaN}, {"id": 5}, 7]'
    assert messages.read_tags(tags) == [messages.SeenTag("3", 1.0)]
    box = '"bbox_xyxy": [1, 2, 3, 4]'
    blooms = (
        f'[{{"class": 0, "confidence": 0.5, {box}}}, {{"class": 0, "confidence": 0.5, "bbox_xyxy": [1, 2, 3]}},'
        f' {{"class": "a", "confidence": 1, {box}}}, {{"class": 0, "confidence": NaN, {box}}},'
        ' {"class": 0, "confidence": 1, "bbox_xyxy": [1, 2, 3, null]}]'
    )
    assert messages.read_blooms(blooms) == [SeenBloom(0, 0.5, (1, 2, 3, 4))]


leaves = st.none() | st.floats() | st.text()
documents = st.recursive(leaves, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)).map(json.dumps)


@settings(max_examples=60)
@given(st.text() | documents)
def test_no_text_breaks_the_readers(text):
    for read in (messages.read_blooms, messages.read_tags):
        try:
            read(text)
        except MalformedDetections:
            continue
