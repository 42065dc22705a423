"""The twin's store."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.twin.store import PotFlowers, TagRecord, TwinPose, TwinStore

POSE = TwinPose((1.0, 2.0, 0.15), (0.5, 0.5, 0.5, 0.5))
OTHER_POSE = TwinPose((9.0, 9.0, 0.15), (0.0, 0.0, 0.0, 1.0))
UNKNOWN_POSE = TwinPose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))


def get(store: TwinStore, tag_id: str) -> TagRecord:
    record = store.get(tag_id)
    assert record is not None
    return record


def test_empty_tag_id_is_rejected() -> None:
    store = TwinStore()
    assert not store.add_reading("", 1, [("co2", 4.0)])
    assert not store.add_failure("", 1, "")
    assert not store.add_flowers("", 1, PotFlowers("tulip_red"))
    store.add_discovered("", POSE)
    store.add_box("", SQUARE)
    assert (len(store), store.observation_count) == (0, 0)


def test_first_known_pose_is_kept() -> None:
    store = TwinStore()
    store.add_reading("7", 1, [], UNKNOWN_POSE)
    assert get(store, "7").pose is None
    store.add_reading("7", 2, [], POSE)
    store.add_reading("7", 3, [], OTHER_POSE)
    store.add_flowers("7", 4, PotFlowers("tulip_red"), OTHER_POSE)
    store.add_discovered("7", OTHER_POSE)
    assert get(store, "7").pose == POSE


def test_poses_that_are_not_finite_are_unknown() -> None:
    assert not TwinPose((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)).known
    assert not TwinPose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, math.inf)).known


def test_readings_keep_latest_value_in_first_order() -> None:
    store = TwinStore()
    store.add_reading("7", 1, [("co2", 400.0), ("light", 1.0)])
    store.add_reading("7", 2, [("humidity", 5.0), ("co2", 500.0)])
    assert list(get(store, "7").readings.items()) == [("co2", 500.0), ("light", 1.0), ("humidity", 5.0)]
    assert store.observation_count == 2


def test_failed_scan_lists_tag_without_refreshing_it() -> None:
    store = TwinStore()
    store.add_reading("7", int(10e9), [("co2", 400.0)], POSE)
    assert store.add_failure("7", int(50e9), "scan_timeout")
    record = get(store, "7")
    assert record.stale_s(int(60e9)) == 50.0
    assert (record.failures, record.last_failed_ns, record.last_detail) == (1, int(50e9), "scan_timeout")
    assert record.readings == {"co2": 400.0}
    store.add_failure("8", 1, "nav_timeout")
    assert get(store, "8").pose is None and get(store, "8").last_observed_ns is None and get(store, "8").stale_s(99) == 0.0


def test_repeated_observation_changes_only_the_count() -> None:
    one, two = TwinStore(), TwinStore()
    for store, times in ((one, 1), (two, 2)):
        for _ in range(times):
            store.add_reading("7", 5, [("co2", 400.0)], POSE)
    assert get(one, "7").readings == get(two, "7").readings and get(one, "7").last_observed_ns == 5
    assert (one.observation_count, two.observation_count) == (1, 2)


def test_late_observation_keeps_newer_time() -> None:
    store = TwinStore()
    store.add_reading("7", int(10e9), [])
    store.add_flowers("7", int(4e9), PotFlowers("tulip_red"))
    assert get(store, "7").stale_s(int(12e9)) == 2.0
    assert get(store, "7").stale_s(0) == 0.0


def test_latest_flowers_are_kept_and_may_give_a_pose() -> None:
    store = TwinStore()
    store.add_flowers("7", 1, PotFlowers("tulip_red", 0.9, True, 3, 1, footprint=SQUARE), POSE)
    store.add_flowers("7", 2, PotFlowers("tulip_white", 0.5))
    record = get(store, "7")
    assert record.flowers == PotFlowers("tulip_white", 0.5) and record.pose == POSE
    assert record.footprint == SQUARE  # a look that gave no footprint takes none away


def test_registered_footprint_has_priority() -> None:
    store = TwinStore()
    box = tuple((x + 5.0, y) for x, y in SQUARE)
    store.add_reading("7", int(1e9), [])
    store.add_box("7", box)
    assert store.observation_count == 1 and get(store, "7").stale_s(int(3e9)) == 2.0
    store.add_flowers("7", 2, PotFlowers("tulip_red", footprint=SQUARE))
    assert get(store, "7").footprint == box
    store.add_box("7", ())
    assert get(store, "7").footprint == box
    store.add_box("7", SQUARE)
    assert get(store, "7").footprint == SQUARE


def test_discovered_tag_gives_a_pose_only() -> None:
    store = TwinStore()
    store.add_discovered("7", TwinPose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 0.0)))
    record = get(store, "7")
    assert record.pose is not None and record.pose.orientation == (0.0, 0.0, 0.0, 1.0)
    assert store.observation_count == 0 and record.last_observed_ns is None


def test_tags_keep_their_order() -> None:
    store = TwinStore()
    for tag_id in ("9", "1", "5", "1", "9"):
        store.add_reading(tag_id, 1, [])
    assert [r.tag_id for r in store.records] == ["9", "1", "5"]


def test_history_is_bounded() -> None:
    store = TwinStore(buffer_len=32)
    for k in range(100):
        store.add_reading("7", k, [("co2", float(k))])
    assert [h.time_ns for h in get(store, "7").history] == list(range(68, 100))


def test_samples_need_a_pose_and_a_finite_value() -> None:
    store = TwinStore()
    store.add_reading("1", 1, [("co2", 400.0)], POSE)
    store.add_reading("2", 1, [("co2", 500.0)])
    store.add_reading("3", 1, [("light", 1.0)], POSE)
    store.add_reading("4", 1, [("co2", 7.0)], POSE)
    store.add_reading("4", 2, [("co2", math.nan)])
    assert store.samples("co2") == [(1.0, 2.0, 400.0)]


ids = st.sampled_from(["", "1", "2", "3"])


@given(st.lists(st.tuples(st.sampled_from(["read", "fail", "flower", "found", "box"]), ids, st.integers(0, 100)), max_size=40))
def test_count_is_of_accepted_observations(events: list[tuple[str, str, int]]) -> None:
    store = TwinStore()
    accepted = 0
    for kind, tag_id, time in events:
        if kind == "found":
            store.add_discovered(tag_id, POSE)
        elif kind == "box":
            store.add_box(tag_id, SQUARE)
        elif kind == "read":
            accepted += store.add_reading(tag_id, time, [("co2", 1.0)])
        elif kind == "fail":
            accepted += store.add_failure(tag_id, time, "")
        else:
            accepted += store.add_flowers(tag_id, time, PotFlowers())
    assert store.observation_count == accepted
    assert all(r.tag_id and r.stale_s(50) >= 0.0 for r in store.records)
