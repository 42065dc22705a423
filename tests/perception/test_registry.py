"""Fusion of sightings: close to the truth with noise, outliers and mirrored poses; independent of order; honest on doubt."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.geometry import Pose2
from lupin_runtime.perception.map_motion import MapJump
from lupin_runtime.perception.registry import Sighting, TagRegistry, fuse
from lupin_runtime.transforms import Transform, multiply, rotate

TAG = np.array([3.0, 2.0, 0.15])
UPRIGHT = (0.5, 0.5, 0.5, 0.5)  # z along x, y up


def turned(yaw: float, rotation=UPRIGHT):
    return multiply((0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)), rotation)


def sighting(rng, angle, range_m, stamp, place_error=(0.0, 0.0), yaw_error=0.0, offset=(0.0, 0.0, 0.0)) -> Sighting:
    """A look at the tag from `angle` off its normal, from a robot that is off by `place_error`."""
    camera = TAG + range_m * np.array([math.cos(angle), math.sin(angle), 0.0])
    noise = rng.normal(0, [0.002 * range_m**2, 0.002 * range_m, 0.001])
    position = TAG + noise + np.array([*place_error, 0.0]) + np.array(offset)
    pose = Transform(tuple(position), turned(yaw_error + rng.normal(0, 0.01 * range_m)))
    return Sighting(stamp, pose, tuple(camera + np.array([*place_error, 0.0])))


def error_m(registry: TagRegistry) -> float:
    return math.dist(registry.get("7").pose.translation, TAG)


def normal_error_deg(pose: Transform) -> float:
    return math.degrees(math.acos(min(1.0, rotate(pose.rotation, (0.0, 0.0, 1.0))[0])))


def fill(registry, rng, places=6, frames=12, place_sigma=0.02):
    stamp = 0
    for k in range(places):
        place_error = rng.normal(0, place_sigma, 2)
        for _ in range(frames):
            stamp += 1
            registry.add("7", sighting(rng, -0.8 + 1.6 * k / places, rng.uniform(0.5, 2.3), stamp, place_error))


@pytest.mark.parametrize("seed", range(5))
def test_the_fused_pose_is_better_than_a_place_and_stands_outliers(seed):
    rng = np.random.default_rng(seed)
    registry = TagRegistry()
    fill(registry, rng)
    assert error_m(registry) < 0.02
    clean = error_m(registry)
    for k in range(10):  # a tenth of the looks: 40 cm off, some with the mirrored normal
        registry.add("7", sighting(rng, 0.3, 2.2, 1000 + k, offset=(0.4, -0.3, 0.1), yaw_error=0.6))
    assert error_m(registry) < clean + 0.01
    assert normal_error_deg(registry.get("7").pose) < 2.0


def test_a_long_look_from_one_place_does_not_outvote_the_other_places():
    rng = np.random.default_rng(3)
    registry = TagRegistry()
    fill(registry, rng, places=6, frames=5, place_sigma=0.005)
    for k in range(100):
        registry.add("7", sighting(rng, 0.9, 0.6, 500 + k, place_error=(0.08, 0.0)))
    assert error_m(registry) < 0.03


def test_mirrored_normals_lose_to_the_ones_that_agree():
    """A mirrored pose turns by twice the viewing angle: from each place another way."""
    rng = np.random.default_rng(5)
    registry = TagRegistry()
    for k, angle in enumerate((-0.7, -0.4, 0.2, 0.5, 0.8)):
        registry.add("7", sighting(rng, angle, 1.0, 2 * k))
        registry.add("7", sighting(rng, angle, 2.0, 2 * k + 1, yaw_error=2 * angle))
    assert normal_error_deg(registry.get("7").pose) < 2.0


seeds = st.integers(0, 2**31)


@settings(max_examples=25, deadline=None)
@given(seeds, seeds)
def test_the_order_of_sightings_does_not_matter(seed, shuffle):
    rng = np.random.default_rng(seed)
    looks = [sighting(rng, rng.uniform(-1, 1), rng.uniform(0.4, 2.5), k, rng.normal(0, 0.02, 2)) for k in range(25)]
    shuffled = list(looks)
    random.Random(shuffle).shuffle(shuffled)
    assert fuse(looks) == fuse(shuffled)


@settings(max_examples=25, deadline=None)
@given(seeds, st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3))
def test_moving_the_map_moves_the_fused_pose_along(seed, x, y, yaw):
    """Fusion has no favourite place: a rigid motion of all sightings is the same motion of the result."""
    rng = np.random.default_rng(seed)
    registry, moved = TagRegistry(), TagRegistry()
    motion = Pose2(x, y, yaw)
    for k in range(12):
        # One place for all, whatever cell of the map it falls into.
        look = sighting(rng, 0.3, 1.0 + 0.01 * k, k)
        registry.add("7", look)
        shifted = look.moved(motion)
        moved.add("7", Sighting(k, shifted.pose, shifted.camera))
    if len({s.place for s in moved._sightings["7"]}) > 1 or len({s.place for s in registry._sightings["7"]}) > 1:
        return
    expected = motion.apply(*registry.get("7").pose.translation[:2])
    assert moved.get("7").pose.translation[:2] == pytest.approx(expected, abs=2e-4)


def test_tags_are_discovered_after_three_sightings():
    rng = np.random.default_rng(0)
    registry = TagRegistry(min_sightings=3)
    for k in range(3):
        assert registry.discovered() == []
        registry.add("7", sighting(rng, 0.1, 1.0, k))
    (tag,) = registry.discovered()
    assert (tag.id, tag.sightings, tag.last_seen_ns) == ("7", 3, 2)
    registry.add("7", sighting(rng, 0.1, 1.0, 1))
    assert registry.get("7").last_seen_ns == 2


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_poses_that_are_no_numbers_are_not_counted(bad):
    registry = TagRegistry()
    assert not registry.add("7", Sighting(0, Transform((bad, 0.0, 0.0)), (0.0, 0.0, 0.0)))
    assert registry.sightings("7") == 0 and registry.get("7") is None and len(registry) == 0


def test_memory_is_bounded_and_the_count_goes_on():
    rng = np.random.default_rng(0)
    registry = TagRegistry()
    for k in range(400):
        registry.add("7", sighting(rng, 0.1 + 0.001 * k, 1.0, k))
    assert registry.sightings("7") == 400
    assert len(registry._sightings["7"]) <= 160
    assert error_m(registry) < 0.01


def _jump(shift_x: float) -> MapJump:
    """Everything from 5 m of path on moved by `shift_x`, nothing before."""
    stations = np.array([0.0, 5.0, 5.001, 10.0])
    zero = np.zeros(4)
    return MapJump(stations, zero, zero, np.array([0.0, 0.0, shift_x, shift_x]), zero, zero)


def test_sightings_follow_a_jump_of_the_map_and_newer_ones_then_count_more():
    rng = np.random.default_rng(1)
    registry = TagRegistry()
    for k in range(20):
        look = sighting(rng, 0.2, 1.0, k)
        registry.add("7", Sighting(look.stamp_ns, look.pose, look.camera, travelled=8.0))
    registry.follow(_jump(-0.3))
    assert registry.get("7").pose.translation[0] == pytest.approx(TAG[0] - 0.3, abs=0.01)
    assert registry.get("7").spread_m > 0.05
    for k in range(5):  # what is seen now says that the map moved by 25 cm here, not by 30
        look = sighting(rng, 0.5, 0.8, 100 + k, offset=(-0.25, 0.0, 0.0))
        registry.add("7", Sighting(look.stamp_ns, look.pose, look.camera, travelled=12.0))
    assert registry.get("7").pose.translation[0] == pytest.approx(TAG[0] - 0.25, abs=0.01)


def test_sightings_from_before_the_loop_stay():
    rng = np.random.default_rng(1)
    registry = TagRegistry()
    look = sighting(rng, 0.2, 1.0, 0)
    registry.add("7", Sighting(0, look.pose, look.camera, travelled=2.0))
    before = registry.get("7").pose
    registry.follow(_jump(-0.3))
    assert registry.get("7").pose == before


def test_a_doubt_moves_nothing_and_lets_newer_looks_count_more():
    rng = np.random.default_rng(1)
    registry = TagRegistry()
    for k in range(20):
        registry.add("7", sighting(rng, 0.2, 1.0, k))
    before = registry.get("7")
    zero = np.zeros(1)
    for _ in range(50):
        registry.follow(MapJump(zero, zero, zero, zero, zero, zero, doubt_m=0.2))
    after = registry.get("7")
    assert after.pose.translation == pytest.approx(before.pose.translation, abs=2e-3)
    assert before.spread_m < after.spread_m <= 0.11
    for k in range(5):
        registry.add("7", sighting(rng, 0.5, 0.8, 100 + k, offset=(0.15, 0.0, 0.0)))
    assert registry.get("7").pose.translation[0] == pytest.approx(TAG[0] + 0.15, abs=0.03)


def test_doubts_are_told_apart():
    rng = np.random.default_rng(1)
    registry = TagRegistry(min_sightings=3)
    assert "not discovered" in registry.doubt("7", 0, 5.0)
    registry.add("7", sighting(rng, 0.2, 1.0, 0))
    assert registry.doubt("7", 0, 5.0) == "tag 7 below threshold: 1 of 3 sightings"
    for k in (1, 2):
        registry.add("7", sighting(rng, 0.2, 1.0, k))
    assert registry.doubt("7", int(4.9e9), 5.0) is None
    assert "stale: last seen 9.0 s ago" in registry.doubt("7", int(9e9), 5.0)
