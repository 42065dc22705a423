"""Recorded arm motions keep their shape, their pauses and the gripper's events."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.arm import ArmRecorder, Point, StoredSequence, Waypoint, gripper_events
from lupin_runtime.arm.player import ArmPlayer
from lupin_runtime.arm.recorder import MAX_WAYPOINTS, MIN_GAP_S, MIN_MOVE_RAD
from tests.support.optional import present

STILL = (0.0, 0.0, 0.0, 0.0)
SAMPLES = st.lists(st.tuples(st.floats(0.005, 0.3), st.floats(-0.05, 0.05), st.floats(-0.2, 0.25)), min_size=1, max_size=80)


@given(SAMPLES, st.booleans())
def test_recorded_points_are_apart_and_end_with_the_motion(
    samples: list[tuple[float, float, float]], include_gripper: bool
) -> None:
    recorder, t, x = ArmRecorder("teleop", include_gripper), 100.0, 0.0
    for dt, dx, gripper in samples:
        t, x = t + dt, x + dx
        recorder.offer(t, (x, 0.0, 0.0, 0.0), gripper)
    sequence = recorder.finish()
    assert sequence is not None
    kept = sequence.waypoints
    assert kept[0].t == 0.0
    assert all(b.t - a.t >= MIN_GAP_S - 1e-5 for a, b in pairwise(kept))
    if not include_gripper:
        assert all(w.gripper is None for w in kept)
        assert all(abs(b.arm[0] - a.arm[0]) >= MIN_MOVE_RAD for a, b in pairwise(kept[:-1]))
    assert abs(kept[-1].arm[0] - x) < MIN_MOVE_RAD or t - 100.0 - samples[0][0] - kept[-1].t < MIN_GAP_S + 1e-5
    assert sequence.duration_s == pytest.approx(kept[-1].t, abs=1e-3)


def test_pause_at_the_end_is_recorded_as_a_hold() -> None:
    recorder = ArmRecorder("teleop", False)
    for k in range(200):
        recorder.offer(k * 0.05, (min(k, 20) * 0.02, 0.0, 0.0, 0.0), None)
    sequence = recorder.finish()
    assert sequence is not None
    assert sequence.waypoints[-1].t == pytest.approx(9.95) and len(sequence.waypoints) == 22


def test_recording_is_truncated_at_its_limits() -> None:
    many = ArmRecorder("teleop", False)
    for k in range(1100):
        many.offer(k * 0.05, (k * 0.02, 0.0, 0.0, 0.0), None)
    assert many.truncated and len(present(many.finish()).waypoints) == MAX_WAYPOINTS
    long = ArmRecorder("kinesthetic", False)
    for k in range(80):
        long.offer(float(k), (k * 0.02, 0.0, 0.0, 0.0), None)
    assert long.truncated and present(long.finish()).duration_s == 60.0


def test_empty_recording_gives_none() -> None:
    assert ArmRecorder("teleop", True).finish() is None


def sequence(*grippers: float | None, include: bool = True) -> StoredSequence:
    return StoredSequence(
        "teleop", include, len(grippers) - 1.0, tuple(Waypoint(float(i), STILL, g) for i, g in enumerate(grippers))
    )


def test_gripper_events_are_first_sample_and_changes() -> None:
    assert gripper_events(sequence(0.0, 0.04, 0.06, 0.06, -0.1)) == ((0.0, 0.0), (2.0, 0.06), (4.0, -0.1))
    assert gripper_events(sequence(0.0, 0.2, include=False)) == ()
    assert gripper_events(sequence(None, None)) == ()


def test_player_sends_events_after_the_lead_in() -> None:
    player = ArmPlayer(sequence(0.0, 0.2), [Point(1.0, STILL), Point(1.5, STILL)], speed=2.0)
    assert [player.due(t) for t in (0.0, 0.99, 1.0, 1.2, 1.5, 1.6)] == [None, None, 0.0, None, 0.2, None]
    assert player.duration_s == 1.5
    assert not player.over(1.49) and player.over(1.5)
    assert [player.progress(t) for t in (-1.0, 0.75, 9.0)] == [0.0, 0.5, 1.0]


def test_last_of_simultaneous_events_is_sent() -> None:
    player = ArmPlayer(sequence(0.0, 0.2, -0.1), [Point(0.1, STILL), Point(2.1, STILL)], speed=1.0)
    assert player.due(math.inf) == -0.1
