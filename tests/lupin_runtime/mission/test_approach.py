"""Approach poses: the geometry of tables and tags, overrides, and goals that fit into the map."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.gridmap import GridMap
from lupin_runtime.layout import Layout, Table, TagLocation
from lupin_runtime.mission.approach import clamp_standoff, compute_approach, compute_discovered_approach
from lupin_runtime.mission.approach_fitting import fit_approach
from lupin_runtime.mission.clearance import ClearanceMap
from lupin_runtime.mission.overrides import Override
from lupin_runtime.mission.records import MapPose
from tests.support.mission_rig import tag_orientation

BED = Layout({"Bed": Table(0.0, 1.0, 0.0, 0.4)}, {"41": TagLocation(0.5, 0.4), "42": TagLocation(0.5, 0.2)})


def test_goal_is_on_line_from_table_center_and_faces_tag() -> None:
    approach = compute_approach("41", BED, 0.5, fallback_yaw=9.0)
    assert (approach.goal_x, approach.goal_y) == pytest.approx((0.5, 0.9))
    assert approach.goal_yaw == pytest.approx(-math.pi / 2)
    assert (approach.standoff_m, approach.derived_from, approach.table_id) == (0.5, "geometry", "Bed")


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.0, 3.0))
def test_goal_faces_tag_at_standoff_and_off_tables(x: float, y: float, standoff: float) -> None:
    layout = Layout({"Bed": Table(-0.5, 0.5, -0.2, 0.2), "Far": Table(2.0, 3.0, 0.0, 0.4)}, {"1": TagLocation(x, y)})
    approach = compute_approach("1", layout, standoff, fallback_yaw=0.3)
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


@pytest.mark.parametrize(("requested", "expected"), [(0.1, 0.2), (0.7, 0.7), (9.0, 1.5), (math.nan, 0.2), (math.inf, 0.2)])
def test_standoff_is_clamped(requested: float, expected: float) -> None:
    assert clamp_standoff(requested) == expected


def test_standoff_is_shortened_until_goal_is_off_tables() -> None:
    layout = Layout({"Bed": Table(0.0, 1.0, 0.0, 0.4), "Next": Table(0.0, 1.0, 0.75, 1.2)}, BED.tags)
    approach = compute_approach("41", layout, 0.5, fallback_yaw=0.0)
    assert approach.standoff_m == pytest.approx(0.3)
    assert approach.derived_from == "geometry"


def test_goal_without_clear_standoff_falls_back_to_tag() -> None:
    layout = Layout({"Bed": Table(0.0, 1.0, 0.0, 0.4), "Next": Table(0.0, 1.0, 0.45, 1.2)}, BED.tags)
    approach = compute_approach("41", layout, 0.5, fallback_yaw=1.25)
    assert (approach.goal_x, approach.goal_y, approach.goal_yaw) == (0.5, 0.4, 1.25)
    assert (approach.standoff_m, approach.derived_from) == (0.0, "fallback")


@pytest.mark.parametrize("layout", [BED, Layout({}, BED.tags)], ids=["at the center", "no tables"])
def test_goal_for_tag_without_normal_is_at_the_tag(layout: Layout) -> None:
    assert compute_approach("42", layout, 0.5, fallback_yaw=0.7).derived_from == "fallback"


def test_unknown_tag_raises_key_error() -> None:
    with pytest.raises(KeyError):
        compute_approach("99", BED, 0.5, fallback_yaw=0.0)


def test_equally_near_tables_are_ordered_by_id() -> None:
    layout = Layout({"B": Table(0.0, 1.0, 1.0, 2.0), "A": Table(0.0, 1.0, -1.0, 0.0)}, {"1": TagLocation(0.5, 0.5)})
    assert compute_approach("1", layout, 0.3, fallback_yaw=0.0).table_id == "A"


def test_complete_override_replaces_geometry() -> None:
    override = Override(goal_x=1.0, goal_y=2.0, yaw=0.75, standoff=9.0)
    approach = compute_approach("41", BED, 0.5, fallback_yaw=0.0, override=override)
    assert (approach.goal_x, approach.goal_y, approach.goal_yaw) == (1.0, 2.0, 0.75)
    assert (approach.standoff_m, approach.derived_from) == (1.5, "override")
    assert compute_approach("41", BED, 0.5, fallback_yaw=0.0, override=Override(1.0, 2.0, 0.75)).standoff_m == 0.5


def test_partial_override_replaces_its_fields() -> None:
    plain = compute_approach("41", BED, 0.5, fallback_yaw=0.0)
    turned = compute_approach("41", BED, 0.5, fallback_yaw=0.0, override=Override(yaw=0.75))
    assert (turned.goal_x, turned.goal_y, turned.goal_yaw) == (plain.goal_x, plain.goal_y, 0.75)
    assert turned.derived_from == "override"
    further = compute_approach("41", BED, 0.5, fallback_yaw=0.0, override=Override(standoff=0.8))
    assert further.goal_y == pytest.approx(1.2)
    assert (further.standoff_m, further.derived_from) == (0.8, "override")


@given(st.floats(-math.pi, math.pi))
def test_discovered_tag_is_approached_along_its_normal(yaw: float) -> None:
    approach = compute_discovered_approach("7", MapPose(1.0, 2.0, 0.15, *tag_orientation(yaw)), None, 0.5, fallback_yaw=0.0)
    assert approach.derived_from == "discovered_normal"
    assert (approach.goal_x, approach.goal_y) == pytest.approx((1.0 + 0.5 * math.cos(yaw), 2.0 + 0.5 * math.sin(yaw)), abs=1e-9)


@pytest.mark.parametrize("flat", [(0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0)], ids=["lying flat", "no orientation"])
def test_discovered_tag_without_normal_uses_robot_side(flat: tuple[float, float, float, float]) -> None:
    tag = MapPose(1.0, 0.0, 0.15, *flat)
    from_robot = compute_discovered_approach("7", tag, (3.0, 0.0), 0.5, fallback_yaw=0.2)
    assert from_robot.derived_from == "discovered_robot"
    assert from_robot.goal_x == pytest.approx(1.5)
    for robot in (None, (1.0, 0.0)):
        at_tag = compute_discovered_approach("7", tag, robot, 0.5, fallback_yaw=0.2)
        assert (at_tag.derived_from, at_tag.goal_yaw, at_tag.standoff_m) == ("fallback", 0.2, 0.0)


# -- fitting into the map ----------------------------------------------------------------------------------------------

ROOM_M = 0.27  # free space that the robot needs around the goal


def _aisle(width_m: float) -> ClearanceMap:
    """Return an aisle along x between y = 0 (where tags hang) and y = width."""
    cells = np.full((80, 120), 100, np.int8)
    cells[20 : 20 + round(width_m / 0.05), :] = 0
    return ClearanceMap.from_grid(GridMap(cells, 0.05, -3.0, -1.0))


ON_WALL = MapPose(0.0, 0.0, 0.15, *tag_orientation(math.pi / 2))


def test_goal_with_room_is_unchanged() -> None:
    approach = compute_discovered_approach("7", ON_WALL, None, 0.5, fallback_yaw=0.0)
    assert fit_approach(approach, (0.0, 0.0), _aisle(1.2), ROOM_M) is approach


def test_goal_near_next_table_moves_and_faces_tag() -> None:
    approach = compute_discovered_approach("7", ON_WALL, None, 0.5, fallback_yaw=0.0)
    clearance = _aisle(0.7)
    fitted = fit_approach(approach, (0.0, 0.0), clearance, ROOM_M)
    assert (
        clearance.distance_at(approach.goal_x, approach.goal_y) < ROOM_M <= clearance.distance_at(fitted.goal_x, fitted.goal_y)
    )
    assert fitted.goal_yaw == pytest.approx(math.atan2(-fitted.goal_y, -fitted.goal_x))
    assert fitted.derived_from == "discovered_normal+0.45m+0deg"  # the standoff, and the turn around the tag


def test_unreachable_goal_is_not_chosen_again() -> None:
    approach = compute_discovered_approach("7", ON_WALL, None, 0.5, fallback_yaw=0.0)
    other = fit_approach(approach, (0.0, 0.0), _aisle(1.2), ROOM_M, ((approach.goal_x, approach.goal_y),))
    assert math.hypot(other.goal_x - approach.goal_x, other.goal_y - approach.goal_y) >= 0.1


def test_goal_keeps_line_of_sight_to_tag() -> None:
    cells = np.zeros((120, 120), np.int8)
    cells[59:61, 40:80] = 100  # the tag's table
    cells[70:72, 20:100] = 100  # a shelf in front of the tag, from y = 0.5 to 0.6
    approach = compute_discovered_approach(
        "7", MapPose(0.0, 0.05, 0.15, *tag_orientation(math.pi / 2)), None, 0.8, fallback_yaw=0.0
    )
    fitted = fit_approach(approach, (0.0, 0.05), ClearanceMap.from_grid(GridMap(cells, 0.05, -3.0, -3.0)), room_m=0.15)
    assert approach.goal_y > 0.6, "the unfitted goal is behind the shelf"
    assert fitted.goal_y < 0.5


def test_override_and_goal_without_room_are_unchanged() -> None:
    approach = compute_discovered_approach("7", ON_WALL, None, 0.5, fallback_yaw=0.0)
    assert fit_approach(approach, (0.0, 0.0), _aisle(0.3), ROOM_M) is approach
    pinned = compute_discovered_approach("7", ON_WALL, None, 0.5, fallback_yaw=0.0, override=Override(yaw=1.0))
    assert fit_approach(pinned, (0.0, 0.0), _aisle(0.7), ROOM_M) is pinned


def test_fallback_moves_to_free_side_of_tag() -> None:
    approach = compute_discovered_approach("7", MapPose(0.0, 0.0, 0.15, 0, 0, 0, 0), None, 0.5, fallback_yaw=0.0)
    clearance = _aisle(1.2)
    fitted = fit_approach(approach, (0.0, 0.0), clearance, ROOM_M)
    assert clearance.distance_at(fitted.goal_x, fitted.goal_y) >= ROOM_M
    assert fitted.derived_from == "fallback+0.55m-30deg"
