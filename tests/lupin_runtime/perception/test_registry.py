"""Fusion of sightings: noise, outliers, mirrored poses, order of arrival, and jumps of the map."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.geometry import Pose2
from lupin_runtime.perception.map_jumps import MapJump
from lupin_runtime.perception.registry import Sighting, TagRegistry, fuse
from lupin_runtime.transforms import Quaternion, Transform, multiply, rotate
from tests.support.optional import present

TAG = np.array([3.0, 2.0, 0.15])
UPRIGHT = (0.5, 0.5, 0.5, 0.5)  # z along x, y up


def turned(yaw: float, rotation: Quaternion = UPRIGHT) -> Quaternion:
    return multiply((0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)), rotation)


def sighting(
    rng: np.random.Generator,
    angle: float,
    range_m: float,
    stamp: int,
    place_error: np.ndarray | tuple[float, float] = (0.0, 0.0),
    yaw_error: float = 0.0,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Sighting:
    """Return a sighting of the tag from `angle` off its normal, from a robot whose pose is wrong by `place_error`."""
    camera = TAG + range_m * np.array([math.cos(angle), math.sin(angle), 0.0])
    noise = rng.normal(0, [0.002 * range_m**2, 0.002 * range_m, 0.001])
    position = TAG + noise + np.array([*place_error, 0.0]) + np.array(offset)
    pose = Transform((position[0], position[1], position[2]), turned(yaw_error + rng.normal(0, 0.01 * range_m)))
    return Sighting(stamp, pose, tuple(camera + np.array([*place_error, 0.0])))


def error_m(registry: TagRegistry) -> float:
    return math.dist(present(registry.get("7")).pose.translation, TAG)


def normal_error_deg(pose: Transform) -> float:
    return math.degrees(math.acos(min(1.0, rotate(pose.rotation, (0.0, 0.0, 1.0))[0])))


def fill(registry: TagRegistry, rng: np.random.Generator, places: int = 6, frames: int = 12, place_sigma: float = 0.02) -> None:
    stamp = 0
    for k in range(places):
        place_error = rng.normal(0, place_sigma, 2)
        for _ in range(frames):
            stamp += 1
            registry.add("7", sighting(rng, -0.8 + 1.6 * k / places, rng.uniform(0.5, 2.3), stamp, place_error))


@pytest.mark.parametrize("seed", range(5))
def test_fused_pose_beats_one_place_and_resists_outliers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    registry = TagRegistry()
    fill(registry, rng)
    assert error_m(registry) < 0.02
    clean = error_m(registry)
    for k in range(10):  # a tenth of the sightings: 40 cm off, some with the mirrored normal
        registry.add("7", sighting(rng, 0.3, 2.2, 1000 + k, offset=(0.4, -0.3, 0.1), yaw_error=0.6))
    assert error_m(registry) < clean + 0.01
    assert normal_error_deg(present(registry.get("7")).pose) < 2.0


def test_long_look_from_one_place_does_not_outvote_others() -> None:
    rng = np.random.default_rng(3)
    registry = TagRegistry()
    fill(registry, rng, places=6, frames=5, place_sigma=0.005)
    for k in range(100):
        registry.add("7", sighting(rng, 0.9, 0.6, 500 + k, place_error=(0.08, 0.0)))
    assert error_m(registry) < 0.03


def test_mirrored_normals_lose_to_consistent_ones() -> None:
    """A mirrored pose turns by twice the viewing angle, differently from each place."""
    rng = np.random.default_rng(5)
    registry = TagRegistry()
    for k, angle in enumerate((-0.7, -0.4, 0.2, 0.5, 0.8)):
        registry.add("7", sighting(rng, angle, 1.0, 2 * k))
        registry.add("7", sighting(rng, angle, 2.0, 2 * k + 1, yaw_error=2 * angle))
    assert normal_error_deg(present(registry.get("7")).pose) < 2.0


seeds = st.integers(0, 2**31)


@settings(max_examples=25)
@given(seeds, seeds)
def test_order_of_sightings_does_not_matter(seed: int, shuffle: int) -> None:
    rng = np.random.default_rng(seed)
    looks = [sighting(rng, rng.uniform(-1, 1), rng.uniform(0.4, 2.5), k, rng.normal(0, 0.02, 2)) for k in range(25)]
    shuffled = list(looks)
    random.Random(shuffle).shuffle(shuffled)
    assert fuse(looks) == fuse(shuffled)


@settings(max_examples=25)
@given(seeds, st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3))
def test_fused_pose_moves_with_the_map(seed: int, x: float, y: float, yaw: float) -> None:
    """A rigid motion of all sightings moves the result by the same motion."""
    rng = np.random.default_rng(seed)
    registry, moved = TagRegistry(), TagRegistry()
    motion = Pose2(x, y, yaw)
    for k in range(12):
        # One place for all sightings.
        look = sighting(rng, 0.3, 1.0 + 0.01 * k, k)
        registry.add("7", look)
        shifted = look.moved(motion)
        moved.add("7", Sighting(k, shifted.pose, shifted.camera))
    if len({s.place for s in moved._sightings["7"]}) > 1 or len({s.place for s in registry._sightings["7"]}) > 1:
        return
    expected = motion.apply(*present(registry.get("7")).pose.translation[:2])
    assert present(moved.get("7")).pose.translation[:2] == pytest.approx(expected, abs=2e-4)


def test_tag_is_discovered_after_three_sightings() -> None:
    rng = np.random.default_rng(0)
    registry = TagRegistry(min_sightings=3)
    for k in range(3):
        assert registry.discovered() == []
        registry.add("7", sighting(rng, 0.1, 1.0, k))
    (tag,) = registry.discovered()
    assert (tag.id, tag.sightings, tag.last_seen_ns) == ("7", 3, 2)
    registry.add("7", sighting(rng, 0.1, 1.0, 1))
    assert present(registry.get("7")).last_seen_ns == 2


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_non_finite_poses_are_not_counted(bad: float) -> None:
    registry = TagRegistry()
    assert not registry.add("7", Sighting(0, Transform((bad, 0.0, 0.0)), (0.0, 0.0, 0.0)))
    assert registry.sightings("7") == 0 and registry.get("7") is None and len(registry) == 0


def test_memory_is_bounded_while_the_count_continues() -> None:
    rng = np.random.default_rng(0)
    registry = TagRegistry()
    for k in range(400):
        registry.add("7", sighting(rng, 0.1 + 0.001 * k, 1.0, k))
    assert registry.sightings("7") == 400
    assert len(registry._sightings["7"]) <= 160
    assert error_m(registry) < 0.01


def _jump(shift_x: float) -> MapJump:
    """Return a jump that moves everything after 5 m of path by `shift_x`."""
    stations = np.array([0.0, 5.0, 5.001, 10.0])
    zero = np.zeros(4)
    return MapJump(stations, zero, zero, np.array([0.0, 0.0, shift_x, shift_x]), zero, zero)


def test_newer_sightings_weigh_more_after_a_map_jump() -> None:
    rng = np.random.default_rng(1)
    registry = TagRegistry()
    for k in range(20):
        look = sighting(rng, 0.2, 1.0, k)
        registry.add("7", Sighting(look.stamp_ns, look.pose, look.camera, traveled=8.0))
    registry.follow(_jump(-0.3))
    assert present(registry.get("7")).pose.translation[0] == pytest.approx(TAG[0] - 0.3, abs=0.01)
    assert present(registry.get("7")).spread_m > 0.05
    for k in range(5):  # new sightings show that the map moved by 25 cm here, not by 30
        look = sighting(rng, 0.5, 0.8, 100 + k, offset=(-0.25, 0.0, 0.0))
        registry.add("7", Sighting(look.stamp_ns, look.pose, look.camera, traveled=12.0))
    assert present(registry.get("7")).pose.translation[0] == pytest.approx(TAG[0] - 0.25, abs=0.01)


def test_sightings_from_before_the_loop_stay() -> None:
    rng = np.random.default_rng(1)
    registry = TagRegistry()
    look = sighting(rng, 0.2, 1.0, 0)
    registry.add("7", Sighting(0, look.pose, look.camera, traveled=2.0))
    before = present(registry.get("7")).pose
    registry.follow(_jump(-0.3))
    assert present(registry.get("7")).pose == before


def test_doubt_moves_nothing_and_favors_newer_sightings() -> None:
    rng = np.random.default_rng(1)
    registry = TagRegistry()
    for k in range(20):
        registry.add("7", sighting(rng, 0.2, 1.0, k))
    before = registry.get("7")
    zero = np.zeros(1)
    for _ in range(50):
        registry.follow(MapJump(zero, zero, zero, zero, zero, zero, doubt_m=0.2))
    after = registry.get("7")
    assert present(after).pose.translation == pytest.approx(present(before).pose.translation, abs=2e-3)
    assert present(before).spread_m < present(after).spread_m <= 0.11
    for k in range(5):
        registry.add("7", sighting(rng, 0.5, 0.8, 100 + k, offset=(0.15, 0.0, 0.0)))
    assert present(registry.get("7")).pose.translation[0] == pytest.approx(TAG[0] + 0.15, abs=0.03)


def test_separate_doubts_have_separate_epochs() -> None:
    rng = np.random.default_rng(1)
    registry = TagRegistry(min_sightings=3)
    assert "not discovered" in present(registry.doubt("7", 0, 5.0))
    registry.add("7", sighting(rng, 0.2, 1.0, 0))
    assert registry.doubt("7", 0, 5.0) == "tag 7 below threshold: 1 of 3 sightings"
    for k in (1, 2):
        registry.add("7", sighting(rng, 0.2, 1.0, k))
    assert registry.doubt("7", int(4.9e9), 5.0) is None
    assert "stale: last seen 9.0 s ago" in present(registry.doubt("7", int(9e9), 5.0))
