"""The geometry of the box behind a tag, and its messages."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lupin_runtime.geometry import Pose2
from lupin_runtime.perception import box_geometry as g
from tests.support.optional import present

if TYPE_CHECKING:
    from lupin_runtime.perception.box_geometry import Box, BoxSize

meters = st.floats(-20.0, 20.0)
angles = st.floats(-math.pi, math.pi)
sizes = st.builds(g.BoxSize, st.floats(0.1, 3.0), st.floats(0.1, 3.0), st.floats(0.0, 2.0))
boxes = st.builds(lambda x, y, yaw, size: g.box_from_map(Pose2(x, y, yaw), size), meters, meters, angles, sizes)


@given(boxes, st.floats(-1.5, 1.5), st.floats(-0.5, 1.5))
def test_coordinates_invert_place(box: Box, fraction: float, depth: float) -> None:
    assert box.coordinates(*box.place(fraction, depth)) == pytest.approx((fraction, depth), abs=1e-9)


@given(boxes, st.floats(-1.0, 1.0), st.floats(0.0, 1.0), st.floats(1.05, 3.0))
def test_box_contains_exactly_what_is_placed_in_it(box: Box, fraction: float, depth: float, beyond: float) -> None:
    assert box.contains(*box.place(fraction, depth), margin_m=1e-9)
    assert not box.contains(*box.place(math.copysign(beyond, fraction), depth))
    assert not box.contains(*box.place(fraction, beyond))


@given(boxes, st.floats(0.01, 1.0))
def test_margin_applies_in_meters_on_every_side(box: Box, margin: float) -> None:
    inside, outside = 0.99 * margin, 1.01 * margin
    for sign in (-1.0, 1.0):
        assert box.contains(*box.place(sign * (1.0 + inside / (box.size.width / 2)), 0.5), margin_m=margin)
        assert not box.contains(*box.place(sign * (1.0 + outside / (box.size.width / 2)), 0.5), margin_m=margin)
    assert box.contains(*box.place(0.0, -inside / box.size.depth), margin_m=margin)
    assert not box.contains(*box.place(0.0, 1.0 + outside / box.size.depth), margin_m=margin)


@given(boxes)
def test_footprint_corners_are_in_the_documented_order(box: Box) -> None:
    corners = box.footprint()
    assert [box.coordinates(*c) for c in corners] == [pytest.approx(p, abs=1e-9) for p in ((1, 0), (-1, 0), (-1, 1), (1, 1))]
    assert math.dist(corners[0], corners[1]) == pytest.approx(box.size.width)
    assert math.dist(corners[1], corners[2]) == pytest.approx(box.size.depth)


@given(meters, meters, angles, sizes)
def test_box_from_the_map_keeps_its_center(x: float, y: float, yaw: float, size: BoxSize) -> None:
    center = g.box_from_map(Pose2(x, y, yaw), size).center()
    assert (center.x, center.y) == pytest.approx((x, y), abs=1e-9)
    assert math.cos(center.yaw - yaw) == pytest.approx(1.0)


@pytest.mark.parametrize("size", [g.BoxSize(0.0, 0.4), g.BoxSize(0.8, 0.0), g.BoxSize(-1.0, 0.4)])
def test_degenerate_box_has_no_footprint_and_contains_nothing(size: BoxSize) -> None:
    box = g.Box((0.0, 0.0), (1.0, 0.0), size)
    assert box.footprint() == ()
    assert not box.contains(0.0, 0.0, margin_m=1.0)


def facing(yaw_rad: float) -> tuple[float, float, float, float]:
    """Return the quaternion of an upright tag whose z axis points along yaw: x to the reader's right, y up."""
    from lupin_runtime.transforms import multiply

    return multiply((0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)), (0.5, 0.5, 0.5, 0.5))


@given(angles)
def test_normal_of_an_upright_tag_is_its_z_axis(yaw: float) -> None:
    assert g.tag_normal(facing(yaw)) == pytest.approx((math.cos(yaw), math.sin(yaw)), abs=1e-9)


def test_box_from_a_tag_is_behind_it_and_shifts_sideways() -> None:
    box = g.box_from_tag((2.0, 1.0, 0.1), facing(0.0), g.BoxSize(0.8, 0.4), lateral_offset_m=0.1)
    assert box is not None
    assert box.origin == pytest.approx((2.0, 1.1))
    assert box.place(0.0, 1.0) == pytest.approx((1.6, 1.1))


def test_tag_facing_up_takes_its_normal_from_the_robot() -> None:
    flat = (0.0, 0.0, 0.0, 1.0)
    assert present(g.box_from_tag((0.0, 0.0, 0.0), flat, g.BoxSize(), robot=(0.0, 2.0))).normal == pytest.approx((0.0, 1.0))
    assert g.box_from_tag((0.0, 0.0, 0.0), flat, g.BoxSize()) is None
    assert g.box_from_tag((0.0, 0.0, 0.0), flat, g.BoxSize(), robot=(0.0, 0.0)) is None


@pytest.mark.parametrize(
    ("pan", "image_x", "expected"), [(0.0, 320, 0.0), (0.0, 640, 0.5), (0.0, 0, -0.5), (0.5, 640, 1.0), (0.2, 320, 0.2)]
)
def test_lateral_fraction_adds_pan_and_column(pan: float, image_x: int, expected: float) -> None:
    assert g.lateral_fraction(pan, 0.0, image_x) == pytest.approx(expected)


def test_only_the_raw_fraction_exceeds_the_ends() -> None:
    assert g.lateral_fraction(1.5, 0.0, 640) == 1.0
    assert g.lateral_fraction(1.5, 0.0, 640, raw=True) == pytest.approx(2.0)
    assert g.lateral_fraction(0.0, 0.0, 99999, raw=True) == pytest.approx(0.5)  # the column itself is always clamped


@given(st.floats(-1.0, 1.0), st.integers(1, 30))
def test_column_contains_its_fractions(fraction: float, columns: int) -> None:
    column = g.column_of(fraction, columns)
    assert 0 <= column < columns
    assert abs(g.column_center(column, columns) - fraction) <= 1.0 / columns + 1e-9


def test_column_centers_and_depths_follow_the_formula() -> None:
    assert [g.column_center(k, 7) for k in (0, 3, 6)] == pytest.approx([-6 / 7, 0.0, 6 / 7])
    assert g.column_depth(3, 0.5, 0.18) == pytest.approx(0.5 + (3 * 0.6180339887498949 % 1.0 - 0.5) * 0.36)
    assert all(0.0 <= g.column_depth(k, base, 0.9) <= 1.0 for k in range(20) for base in (0.0, 0.5, 1.0))


points = st.lists(st.tuples(meters, meters), min_size=3, max_size=8)


@given(points, meters, meters, angles)
def test_rigid_fit_recovers_the_motion(source: list[tuple[float, float]], x: float, y: float, yaw: float) -> None:
    spread = max(math.dist(a, b) for a in source for b in source)
    assume(spread > 0.1)
    motion = Pose2(x, y, yaw)
    found = g.rigid_fit(source, [motion.apply(*p) for p in source])
    assert math.cos(found.yaw - yaw) == pytest.approx(1.0, abs=1e-9)
    assert (found.x, found.y) == pytest.approx((x, y), abs=1e-5)


def test_underdetermined_rigid_fit_does_not_turn() -> None:
    assert g.rigid_fit([], []) == Pose2()
    assert g.rigid_fit([(0, 0)], [(1, 1), (2, 2)]) == Pose2()
    assert g.rigid_fit([(0, 0)], [(1, 2)]) == Pose2(1, 2, 0)
    assert g.rigid_fit([(1, 1), (1, 1)], [(4, 4), (4, 4)]) == Pose2(3, 3, 0)


def test_boxes_are_read_from_a_list_or_an_object() -> None:
    entry = {"id": "41", "x": 3.1, "y": 0.9, "yaw": 1.57, "width": 1.1, "depth": 0.25, "height": 0.3}
    other = {**{k: v for k, v in entry.items() if k != "id"}, "box_id": 7}
    boxes = g.read_boxes(json.dumps({"boxes": [entry, other]}))
    assert list(boxes) == ["41", "7"] and boxes["41"].size == g.BoxSize(1.1, 0.25, 0.3)
    assert g.read_boxes(json.dumps([entry]))["41"] == boxes["41"]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{", "not JSON"),
        ("{}", "a list of boxes"),
        ("3", "a list of boxes"),
        ("[3]", "box 0 is int"),
        ('[{"x": 1}]', "box 0 has the id None"),
        ('[{"id": "4", "x": "a"}]', "box 4 has x = 'a'"),
        ('[{"id": "4", "x": NaN}]', "box 4 has x = nan"),
    ],
)
def test_malformed_boxes_are_refused_by_name(text: str, problem: str) -> None:
    with pytest.raises(g.MalformedBoxes, match=problem):
        g.read_boxes(text)
