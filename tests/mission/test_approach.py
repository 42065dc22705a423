"""Approach poses: the geometry of tables and tags, overrides, and goals that fit into the map."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.approach import (
    Clearance,
    TagPose,
    clamp_standoff,
    compute_approach,
    compute_discovered_approach,
    fit_approach,
)
from lupin_runtime.mission.layout import (
    Layout,
    LayoutError,
    Override,
    Table,
    TagLocation,
    load_layout,
    load_overrides,
    packaged_layout_path,
)

BED = Layout({"Bed": Table(0.0, 1.0, 0.0, 0.4)}, {"41": TagLocation(0.5, 0.4), "42": TagLocation(0.5, 0.2)})


def test_the_goal_stands_off_along_the_line_from_the_table_s_centre_and_faces_the_tag():
    approach = compute_approach("41", BED, 0.5, 9.0)
    assert (approach.goal_x, approach.goal_y) == pytest.approx((0.5, 0.9))
    assert approach.goal_yaw == pytest.approx(-math.pi / 2)
    assert (approach.standoff_m, approach.derived_from, approach.table_id) == (0.5, "geometry", "Bed")


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.0, 3.0))
def test_every_geometric_goal_faces_its_tag_at_its_standoff_and_off_the_tables(x, y, standoff):
    layout = Layout({"Bed": Table(-0.5, 0.5, -0.2, 0.2), "Far": Table(2.0, 3.0, 0.0, 0.4)}, {"1": TagLocation(x, y)})
    approach = compute_approach("1", layout, standoff, 0.3)
    assert not any(table.contains(approach.goal_x, approach.goal_y) for table in layout.tables.values()) or (
        approach.derived_from == "fallback"
    )
    if approach.derived_from == "fallback":
        assert (approach.goal_x, approach.goal_y, approach.goal_yaw, approach.standoff_m) == (x, y, 0.3, 0.0)
    else:
        assert 0.2 - 1e-9 <= approach.standoff_m <= 1.5
        assert math.hypot(approach.goal_x - x, approach.goal_y - y) == pytest.approx(approach.standoff_m)
        ahead = (
            approach.goal_x + approach.standoff_m * math.cos(approach.goal_yaw),
            approach.goal_y + approach.standoff_m * math.sin(approach.goal_yaw),
        )
        assert ahead == pytest.approx((x, y), abs=1e-6)


@pytest.mark.parametrize(("asked", "got"), [(0.1, 0.2), (0.7, 0.7), (9.0, 1.5), (math.nan, 0.2), (math.inf, 0.2)])
def test_the_standoff_is_clamped(asked, got):
    assert clamp_standoff(asked) == got


def test_a_goal_inside_the_next_table_comes_closer_until_it_is_clear():
    layout = Layout({"Bed": Table(0.0, 1.0, 0.0, 0.4), "Next": Table(0.0, 1.0, 0.75, 1.2)}, BED.tags)
    approach = compute_approach("41", layout, 0.5, 0.0)
    assert approach.standoff_m == pytest.approx(0.3)
    assert approach.derived_from == "geometry"


def test_a_goal_that_no_standoff_clears_falls_back_to_the_tag():
    layout = Layout({"Bed": Table(0.0, 1.0, 0.0, 0.4), "Next": Table(0.0, 1.0, 0.45, 1.2)}, BED.tags)
    approach = compute_approach("41", layout, 0.5, 1.25)
    assert (approach.goal_x, approach.goal_y, approach.goal_yaw) == (0.5, 0.4, 1.25)
    assert (approach.standoff_m, approach.derived_from) == (0.0, "fallback")


@pytest.mark.parametrize("layout", [BED, Layout({}, BED.tags)], ids=["at the centre", "no tables"])
def test_a_tag_without_a_normal_falls_back(layout):
    assert compute_approach("42", layout, 0.5, 0.7).derived_from == "fallback"


def test_an_unknown_tag_is_a_key_error():
    with pytest.raises(KeyError):
        compute_approach("99", BED, 0.5, 0.0)


def test_equally_near_tables_are_taken_in_id_order():
    layout = Layout({"B": Table(0.0, 1.0, 1.0, 2.0), "A": Table(0.0, 1.0, -1.0, 0.0)}, {"1": TagLocation(0.5, 0.5)})
    assert compute_approach("1", layout, 0.3, 0.0).table_id == "A"


def test_a_whole_override_skips_the_geometry():
    override = Override(goal_x=1.0, goal_y=2.0, yaw=0.75, standoff=9.0)
    approach = compute_approach("41", BED, 0.5, 0.0, override)
    assert (approach.goal_x, approach.goal_y, approach.goal_yaw) == (1.0, 2.0, 0.75)
    assert (approach.standoff_m, approach.derived_from) == (1.5, "override")
    assert compute_approach("41", BED, 0.5, 0.0, Override(1.0, 2.0, 0.75)).standoff_m == 0.5


def test_part_of_an_override_replaces_that_field():
    plain = compute_approach("41", BED, 0.5, 0.0)
    turned = compute_approach("41", BED, 0.5, 0.0, Override(yaw=0.75))
    assert (turned.goal_x, turned.goal_y, turned.goal_yaw) == (plain.goal_x, plain.goal_y, 0.75)
    assert turned.derived_from == "override"
    further = compute_approach("41", BED, 0.5, 0.0, Override(standoff=0.8))
    assert (further.goal_y, further.standoff_m, further.derived_from) == (pytest.approx(1.2), 0.8, "override")


def _facing(yaw: float) -> tuple[float, float, float, float]:
    half, s = yaw / 2.0, math.sqrt(0.5)
    return -math.sin(half) * s, math.cos(half) * s, math.sin(half) * s, math.cos(half) * s


@given(st.floats(-math.pi, math.pi))
def test_a_discovered_tag_is_approached_along_its_own_normal(yaw):
    approach = compute_discovered_approach("7", TagPose(1.0, 2.0, 0.15, *_facing(yaw)), None, 0.5, 0.0)
    assert approach.derived_from == "discovered_normal"
    assert (approach.goal_x, approach.goal_y) == pytest.approx((1.0 + 0.5 * math.cos(yaw), 2.0 + 0.5 * math.sin(yaw)), abs=1e-9)


@pytest.mark.parametrize("flat", [(0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0)], ids=["lying flat", "no orientation"])
def test_without_a_normal_the_robot_s_side_is_taken_and_without_a_robot_the_tag(flat):
    tag = TagPose(1.0, 0.0, 0.15, *flat)
    from_robot = compute_discovered_approach("7", tag, (3.0, 0.0), 0.5, 0.2)
    assert (from_robot.derived_from, from_robot.goal_x) == ("discovered_robot", pytest.approx(1.5))
    for robot in (None, (1.0, 0.0)):
        at_tag = compute_discovered_approach("7", tag, robot, 0.5, 0.2)
        assert (at_tag.derived_from, at_tag.goal_yaw, at_tag.standoff_m) == ("fallback", 0.2, 0.0)


# -- fitting into the map ----------------------------------------------------------------------------------------------


def _aisle(width_m: float) -> Clearance:
    """An aisle along x between y = 0 (where tags hang) and y = width."""
    cells = np.full((80, 120), 100, np.int8)
    cells[20 : 20 + round(width_m / 0.05), :] = 0
    return Clearance.of(GridMap(cells, 0.05, -3.0, -1.0))


ON_WALL = TagPose(0.0, 0.0, 0.15, *_facing(math.pi / 2))


def test_a_goal_with_room_around_it_stays():
    approach = compute_discovered_approach("7", ON_WALL, None, 0.5, 0.0)
    assert fit_approach(approach, (0.0, 0.0), _aisle(1.2), 0.27) is approach


def test_a_goal_too_near_the_next_table_moves_and_still_faces_the_tag():
    approach = compute_discovered_approach("7", ON_WALL, None, 0.5, 0.0)
    clearance = _aisle(0.7)
    fitted = fit_approach(approach, (0.0, 0.0), clearance, 0.27)
    assert clearance.at(approach.goal_x, approach.goal_y) < 0.27 <= clearance.at(fitted.goal_x, fitted.goal_y)
    assert fitted.goal_yaw == pytest.approx(math.atan2(-fitted.goal_y, -fitted.goal_x))
    assert fitted.derived_from.startswith("discovered_normal+")


def test_a_goal_that_was_tried_is_not_tried_again():
    approach = compute_discovered_approach("7", ON_WALL, None, 0.5, 0.0)
    other = fit_approach(approach, (0.0, 0.0), _aisle(1.2), 0.27, ((approach.goal_x, approach.goal_y),))
    assert math.hypot(other.goal_x - approach.goal_x, other.goal_y - approach.goal_y) >= 0.1


def test_a_goal_is_not_put_behind_an_obstacle():
    cells = np.zeros((120, 120), np.int8)
    cells[59:61, 40:80] = 100  # the tag's table
    cells[70:72, 20:100] = 100  # a shelf 0.45 m in front of it
    approach = compute_discovered_approach("7", TagPose(0.0, 0.05, 0.15, *_facing(math.pi / 2)), None, 0.8, 0.0)
    fitted = fit_approach(approach, (0.0, 0.05), Clearance.of(GridMap(cells, 0.05, -3.0, -3.0)), 0.15)
    assert approach.goal_y > 0.6 > 0.5 > fitted.goal_y


def test_where_nothing_fits_and_for_an_override_the_goal_comes_back_as_it_is():
    approach = compute_discovered_approach("7", ON_WALL, None, 0.5, 0.0)
    assert fit_approach(approach, (0.0, 0.0), _aisle(0.3), 0.27) is approach
    pinned = compute_discovered_approach("7", ON_WALL, None, 0.5, 0.0, Override(yaw=1.0))
    assert fit_approach(pinned, (0.0, 0.0), _aisle(0.7), 0.27) is pinned


def test_a_fallback_at_the_tag_is_moved_to_whichever_side_is_free():
    approach = compute_discovered_approach("7", TagPose(0.0, 0.0, 0.15, 0, 0, 0, 0), None, 0.5, 0.0)
    clearance = _aisle(1.2)
    fitted = fit_approach(approach, (0.0, 0.0), clearance, 0.27)
    assert clearance.at(fitted.goal_x, fitted.goal_y) >= 0.27
    assert fitted.derived_from.startswith("fallback+")


# -- files -------------------------------------------------------------------------------------------------------------


def test_the_packaged_layout_has_its_tables_and_tags():
    layout = load_layout()
    assert packaged_layout_path().name == "tag_locations.json"
    assert (len(layout.tables), len(layout.tags)) == (10, 29)
    assert layout.tags["12"] == TagLocation(1.6, 3.2)
    assert layout.tables["Table6"] == Table(1.3, 1.55, 2.6, 3.7)


def test_units_are_converted(tmp_path: Path):
    path = tmp_path / "layout.json"
    path.write_text(json.dumps({"units": "cm", "tables": {}, "tags": {"1": {"x": 150, "y": -20}}}))
    assert load_layout(path).tags["1"] == TagLocation(1.5, pytest.approx(-0.2))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ('{"tags": {\n "1": {"x": 1, }}}', ":2: not JSON"),
        ("[]", "expected an object"),
        ('{"units": "ft"}', "units are 'ft'"),
        ('{"tags": {"1": {"x": 1}}}', "tags.1.y is None"),
        ('{"tags": {"1": {"x": "a", "y": 1}}}', "tags.1.x is 'a'"),
        ('{"tags": [1]}', "tags is list"),
        ('{"tables": {"A": {"x0": 0, "x1": NaN, "y0": 0, "y1": 1}}}', "tables.A.x1 is nan"),
    ],
)
def test_a_corrupt_layout_is_named_with_its_place(tmp_path: Path, text: str, wanted: str):
    path = tmp_path / "layout.json"
    path.write_text(text)
    with pytest.raises(LayoutError, match=r"layout\.json") as caught:
        load_layout(path)
    assert wanted in str(caught.value)


def test_overrides_are_read_and_unknown_keys_dropped(tmp_path: Path):
    path = tmp_path / "overrides.yaml"
    path.write_text('overrides:\n  "41":\n    yaw: 0.75\n    standoff: 0.6\n    note: by hand\n  12: {goal_x: 1}\n')
    assert load_overrides(path) == {"41": Override(yaw=0.75, standoff=0.6), "12": Override(goal_x=1.0)}


@pytest.mark.parametrize("text", ["", "other: 1\n", "# nothing\n"])
def test_a_file_without_overrides_pins_nothing(tmp_path: Path, text: str):
    path = tmp_path / "overrides.yaml"
    path.write_text(text)
    assert load_overrides(path) == {}


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("overrides:\n  - 1\n", ":2: overrides is not a mapping"),
        ("overrides: 3\n", ":1: overrides is not a mapping"),
        ('overrides:\n  "41":\n    yaw: east\n', ":3: overrides.41.yaw is 'east'"),
        ('overrides:\n  "41":\n    yaw: .nan\n', ":3: overrides.41.yaw is '.nan'"),
        ('overrides:\n  "41": [1]\n', ":2: overrides.41 is not a mapping"),
        ("overrides:\n  41: {yaw: 1\n", "not YAML"),
        ("- 1\n", ":1: the file is not a mapping"),
    ],
)
def test_corrupt_overrides_are_named_with_file_and_line(tmp_path: Path, text: str, wanted: str):
    path = tmp_path / "overrides.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"overrides\.yaml") as caught:
        load_overrides(path)
    assert wanted in str(caught.value)


def test_a_missing_override_file_is_an_error(tmp_path: Path):
    with pytest.raises(LayoutError, match="cannot read"):
        load_overrides(tmp_path / "nowhere.yaml")
