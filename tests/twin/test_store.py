"""What the twin keeps, and what an observation changes."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.twin.store import Flowers, TagPose, TwinStore

HERE = TagPose((1.0, 2.0, 0.15), (0.5, 0.5, 0.5, 0.5))
THERE = TagPose((9.0, 9.0, 0.15), (0.0, 0.0, 0.0, 1.0))
NOWHERE = TagPose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))


def test_an_empty_tag_id_is_rejected_and_counts_nothing():
    store = TwinStore()
    assert not store.add_reading("", 1, [("co2", 4.0)])
    assert not store.add_failure("", 1, "")
    assert not store.add_flowers("", 1, Flowers("tulip_red"))
    store.add_discovered("", HERE)
    store.add_box("", SQUARE)
    assert (len(store), store.observation_count) == (0, 0)


def test_the_first_pose_wins_and_no_pose_is_none():
    store = TwinStore()
    store.add_reading("7", 1, [], NOWHERE)
    assert store.get("7").pose is None
    store.add_reading("7", 2, [], HERE)
    store.add_reading("7", 3, [], THERE)
    store.add_flowers("7", 4, Flowers("tulip_red"), THERE)
    store.add_discovered("7", THERE)
    assert store.get("7").pose == HERE


def test_poses_that_are_no_numbers_are_none():
    assert not TagPose((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)).known
    assert not TagPose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, math.inf)).known


def test_readings_keep_the_latest_value_in_the_order_of_first_appearance():
    store = TwinStore()
    store.add_reading("7", 1, [("co2", 400.0), ("light", 1.0)])
    store.add_reading("7", 2, [("humidity", 5.0), ("co2", 500.0)])
    assert list(store.get("7").readings.items()) == [("co2", 500.0), ("light", 1.0), ("humidity", 5.0)]
    assert store.observation_count == 2


def test_a_failed_scan_lists_the_tag_and_makes_nothing_fresher():
    store = TwinStore()
    store.add_reading("7", int(10e9), [("co2", 400.0)], HERE)
    assert store.add_failure("7", int(50e9), "scan_timeout")
    record = store.get("7")
    assert record.stale_s(int(60e9)) == 50.0
    assert (record.failures, record.last_failed_ns, record.last_detail) == (1, int(50e9), "scan_timeout")
    assert record.readings == {"co2": 400.0}
    store.add_failure("8", 1, "nav_timeout")
    assert store.get("8").pose is None and store.get("8").last_observed_ns is None and store.get("8").stale_s(99) == 0.0


def test_the_same_observation_twice_changes_nothing_but_the_count():
    one, two = TwinStore(), TwinStore()
    for store, times in ((one, 1), (two, 2)):
        for _ in range(times):
            store.add_reading("7", 5, [("co2", 400.0)], HERE)
    assert one.get("7").readings == two.get("7").readings and one.get("7").last_observed_ns == 5
    assert (one.observation_count, two.observation_count) == (1, 2)


def test_a_late_observation_does_not_turn_the_clock_back():
    store = TwinStore()
    store.add_reading("7", int(10e9), [])
    store.add_flowers("7", int(4e9), Flowers("tulip_red"))
    assert store.get("7").stale_s(int(12e9)) == 2.0
    assert store.get("7").stale_s(0) == 0.0


def test_flowers_are_latest_wins_and_may_pin_an_unpinned_tag():
    store = TwinStore()
    store.add_flowers("7", 1, Flowers("tulip_red", 0.9, True, 3, 1, footprint=SQUARE), HERE)
    store.add_flowers("7", 2, Flowers("tulip_white", 0.5))
    record = store.get("7")
    assert record.flowers == Flowers("tulip_white", 0.5) and record.pose == HERE
    assert record.footprint == SQUARE  # a look that gave no footprint takes none away


def test_a_registered_boxs_footprint_stays_and_touches_neither_age_nor_count():
    store = TwinStore()
    box = tuple((x + 5.0, y) for x, y in SQUARE)
    store.add_reading("7", int(1e9), [])
    store.add_box("7", box)
    assert store.observation_count == 1 and store.get("7").stale_s(int(3e9)) == 2.0
    store.add_flowers("7", 2, Flowers("tulip_red", footprint=SQUARE))
    assert store.get("7").footprint == box
    store.add_box("7", ())
    assert store.get("7").footprint == box
    store.add_box("7", SQUARE)
    assert store.get("7").footprint == SQUARE


def test_discovered_tags_give_a_place_only_and_a_zero_w_becomes_one():
    store = TwinStore()
    store.add_discovered("7", TagPose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 0.0)))
    record = store.get("7")
    assert record.pose.orientation == (0.0, 0.0, 0.0, 1.0)
    assert store.observation_count == 0 and record.last_observed_ns is None


def test_tags_stay_in_the_order_they_came():
    store = TwinStore()
    for tag_id in ("9", "1", "5", "1", "9"):
        store.add_reading(tag_id, 1, [])
    assert [r.tag_id for r in store.records] == ["9", "1", "5"]


def test_the_history_is_bounded():
    store = TwinStore(buffer_len=32)
    for k in range(100):
        store.add_reading("7", k, [("co2", float(k))])
    assert [h.time_ns for h in store.get("7").history] == list(range(68, 100))


def test_only_placed_tags_with_a_finite_latest_value_enter_a_field():
    store = TwinStore()
    store.add_reading("1", 1, [("co2", 400.0)], HERE)
    store.add_reading("2", 1, [("co2", 500.0)])
    store.add_reading("3", 1, [("light", 1.0)], HERE)
    store.add_reading("4", 1, [("co2", 7.0)], HERE)
    store.add_reading("4", 2, [("co2", math.nan)])
    assert store.samples("co2") == [(1.0, 2.0, 400.0)]


ids = st.sampled_from(["", "1", "2", "3"])


@given(st.lists(st.tuples(st.sampled_from(["read", "fail", "flower", "found", "box"]), ids, st.integers(0, 100)), max_size=40))
def test_the_count_is_that_of_accepted_observations_and_age_is_never_negative(events):
    store = TwinStore()
    accepted = 0
    for kind, tag_id, time in events:
        if kind == "found":
            store.add_discovered(tag_id, HERE)
        elif kind == "box":
            store.add_box(tag_id, SQUARE)
        elif kind == "read":
            accepted += store.add_reading(tag_id, time, [("co2", 1.0)])
        elif kind == "fail":
            accepted += store.add_failure(tag_id, time, "")
        else:
            accepted += store.add_flowers(tag_id, time, Flowers())
    assert store.observation_count == accepted
    assert all(r.tag_id and r.stale_s(50) >= 0.0 for r in store.records)
