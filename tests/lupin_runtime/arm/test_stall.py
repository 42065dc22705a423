"""Joints that do not follow are named in time, and those that follow late are not."""

from __future__ import annotations

import pytest

from lupin_runtime.arm import Point
from lupin_runtime.arm.stall import PATIENCE_S, StallWatch
from lupin_runtime.arm.trajectory import to_pose

S = 10**9
ZERO = (0.0, 0.0, 0.0, 0.0)
TARGET = (1.0, 0.0, 0.0, 0.0)


def watch_at(path: tuple[Point, ...]) -> StallWatch:
    watch = StallWatch()
    watch.expect(path, ZERO, 0)
    return watch


def named_after_s(watch: StallWatch, at: tuple[float, float, float, float] = ZERO, until_s: float = 10.0) -> float | None:
    """Return when the first joint of an arm that stays `at` is named."""
    for tick in range(int(until_s * 10)):
        if watch.check(at, tick * S // 10):
            return tick / 10
    return None


def test_blocked_joint_is_named_within_a_bound_of_being_due() -> None:
    named_s = named_after_s(watch_at(to_pose(TARGET, 1.0)))
    assert named_s is not None
    assert PATIENCE_S <= named_s <= PATIENCE_S + 0.3


def test_joint_is_named_with_where_it_is_and_should_be() -> None:
    watch = watch_at(to_pose(TARGET, 1.0))
    named_after_s(watch)
    (blocked,) = watch.check(ZERO, 3 * S)
    assert blocked[:3] == ("shoulder_pan_joint", 0.0, 1.0)
    assert "the arm's shoulder_pan does not follow" in blocked.sentence()
    assert blocked.places() == "0.00 rad instead of 1.00 rad"


def test_joint_that_follows_late_is_not_named() -> None:
    watch = watch_at(to_pose(TARGET, 1.0))
    for tick in range(60):
        assert watch.check((min(1.0, tick * 0.02), 0.0, 0.0, 0.0), tick * S // 10) == ()


def test_stuck_half_way_is_named_and_freed_is_not() -> None:
    watch = watch_at(to_pose(TARGET, 1.0))
    assert named_after_s(watch, (0.5, 0.0, 0.0, 0.0)) is not None
    assert watch.check((0.97, 0.0, 0.0, 0.0), 11 * S) == ()


@pytest.mark.parametrize("error_rad", [0.0, 0.07, -0.07])
def test_dead_band_of_the_servo_is_not_named(error_rad: float) -> None:
    assert named_after_s(watch_at(to_pose(TARGET, 0.1)), (1.0 + error_rad, 0.0, 0.0, 0.0)) is None


def test_stream_of_short_trajectories_is_one_motion() -> None:
    watch, target = StallWatch(), 0.0
    named: list[float] = []
    for tick in range(40):
        now_ns = tick * S // 20
        target = min(0.5, target + 0.075)
        watch.expect(to_pose((target, 0.0, 0.0, 0.0), 0.2), ZERO, now_ns)
        named += [now_ns / S] if watch.check(ZERO, now_ns) else []
    assert named
    assert named[0] <= PATIENCE_S + 0.5


def test_new_motion_begins_where_the_arm_is() -> None:
    watch = watch_at(to_pose(TARGET, 0.1))
    by_hand = (0.3, 0.0, 0.0, 0.0)
    watch.expect(to_pose(by_hand, 3.0), by_hand, 60 * S)
    assert all(watch.check(by_hand, 60 * S + tick * S // 10) == () for tick in range(40))


def test_limp_arm_and_empty_path_expect_nothing() -> None:
    watch = watch_at(to_pose(TARGET, 0.1))
    watch.expect((), ZERO, S)
    assert watch.is_moving(S // 20)
    watch.forget()
    assert named_after_s(watch) is None
    assert not watch.is_moving(0)
