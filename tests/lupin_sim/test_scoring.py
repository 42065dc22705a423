"""Scores of a run against the truth: alignment, trajectory, tags and flowers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.geometry import Pose2
from lupin_sim.scoring import EstimatedTag, align, positions_at, read_tum, score
from lupin_sim.truth import truth
from lupin_sim.worlds import load_world
from tests.support.optional import present

coordinate = st.floats(-20, 20)
poses = st.builds(Pose2, coordinate, coordinate, st.floats(-math.pi, math.pi))
clouds = st.lists(st.tuples(coordinate, coordinate), min_size=2, max_size=30).map(np.array)


def moved(pose: Pose2, points: np.ndarray) -> np.ndarray:
    return np.array([pose.apply(*point) for point in points])


@given(poses, clouds)
def test_alignment_recovers_any_rigid_motion(pose: Pose2, points: np.ndarray) -> None:
    if np.ptp(points, axis=0).max() < 1e-3:
        return
    found = align(points, moved(pose, points))
    assert moved(found, points) == pytest.approx(moved(pose, points), abs=1e-5)


def test_too_few_or_coinciding_points_are_refused() -> None:
    with pytest.raises(ValueError, match="coincide"):
        align(np.zeros((5, 2)), np.ones((5, 2)))
    with pytest.raises(ValueError, match="1 estimated"):
        align(np.zeros((1, 2)), np.zeros((1, 2)))


def drive(pose: Pose2, noise: float = 0.0) -> np.ndarray:
    """Return a circle of 19 m in another frame, as rows of a TUM trajectory."""
    rng = np.random.default_rng(1)
    t = np.linspace(1.0, 61.0, 601)
    a = (t - 1.0) / 60.0 * 2 * math.pi
    points = moved(pose, np.stack([3 * np.sin(a), 3 - 3 * np.cos(a)], 1)) + rng.normal(size=(601, 2)) * noise
    return np.column_stack([t, points, np.zeros((601, 4)), np.ones(601)])


WORLD = load_world("demo")
TRUTH = truth(WORLD)
TRUE = drive(WORLD.start)


def tags(map_from_world: Pose2, **changes: Any) -> list[EstimatedTag]:
    return [EstimatedTag(tag.id, *map_from_world.apply(tag.x, tag.y), read=True, **changes) for tag in WORLD.tags]


def test_perfect_run_has_zero_error_in_any_map_frame() -> None:
    map_from_world = Pose2(3.0, -7.0, 2.0)
    estimated = TRUE.copy()
    estimated[:, 1:3] = moved(map_from_world, TRUE[:, 1:3])
    result = score(TRUTH, TRUE, estimated, tags(map_from_world))
    assert result.trajectory_rmse_m == pytest.approx(0.0, abs=1e-9)
    assert result.tag_error_median_m == pytest.approx(0.0, abs=1e-9)
    assert (result.tags_total, result.tags_reachable, result.tags_found, result.tags_read) == (12, 12, 12, 12)
    assert result.tags_missed == result.tags_unknown == ()
    assert Pose2(*result.world_from_map).distance_to(map_from_world.inverse()) < 1e-9


def test_trajectory_noise_is_measured() -> None:
    result = score(TRUTH, TRUE, drive(Pose2(), 0.03), tags(WORLD.start.inverse()))
    assert result.trajectory_rmse_m == pytest.approx(0.03 * math.sqrt(2), rel=0.1)
    assert present(result.trajectory_max_m) > present(result.trajectory_rmse_m)


def test_misplaced_missing_and_unknown_tags_are_distinguished() -> None:
    found = tags(WORLD.start.inverse())
    off = [EstimatedTag(found[0].id, found[0].x + 0.2, found[0].y, read=True)]
    invented = [EstimatedTag(99, 0.0, 0.0, read=True)]
    unread = [EstimatedTag(found[1].id, found[1].x, found[1].y)]
    result = score(TRUTH, TRUE, drive(Pose2()), off + unread + found[3:] + invented)
    assert result.tag_errors_m[found[0].id] == pytest.approx(0.2, abs=1e-6)
    assert result.tags_unknown == (99,)
    assert result.tags_missed == (found[1].id, found[2].id)
    assert (result.tags_found, result.tags_read) == (11, 10)


def test_flowers_and_bugs_are_counted_per_tag() -> None:
    kinds = {tag["id"]: tag["flowers"] for tag in TRUTH["tags"]}
    estimated = [EstimatedTag(i, 0.0, 0.0, True, kinds[i][0]["species"], any(f["bug"] for f in kinds[i])) for i in kinds]
    result = score(TRUTH, TRUE, drive(Pose2()), estimated)
    assert (result.flowers_total, result.flowers_right) == (12, 12)
    assert (result.bugs_total, result.bugs_found, result.bugs_imagined) == (3, 3, 0)
    wrong = [EstimatedTag(i, 0.0, 0.0, True, "tulip_blue", True) for i in kinds]
    result = score(TRUTH, TRUE, drive(Pose2()), wrong)
    assert (result.flowers_right, result.bugs_imagined) == (0, 9)


def test_run_without_motion_is_aligned_by_the_start_pose() -> None:
    still = TRUE.copy()
    still[:, 1:3] = WORLD.start.x, WORLD.start.y
    estimated = still.copy()
    estimated[:, 1:3] = 0.01, 0.0
    result = score(TRUTH, still, estimated, tags(WORLD.start.inverse()))
    assert result.trajectory_rmse_m == pytest.approx(0.01)
    assert result.tag_error_median_m == pytest.approx(0.0, abs=1e-9)


def test_score_without_data_is_none() -> None:
    result = score(TRUTH, TRUE, np.zeros((0, 8)), [])
    assert result.trajectory_rmse_m is None
    assert result.tag_error_median_m is None
    assert result.as_json()["tags_found"] == 0


def test_positions_are_interpolated_within_the_trajectory_only() -> None:
    found, within = positions_at(TRUE, np.array([0.0, 1.05, 100.0]))
    assert within.tolist() == [False, True, False]
    assert found[1] == pytest.approx((TRUE[0, 1:3] + TRUE[1, 1:3]) / 2)


def test_tum_files_are_read_and_bad_lines_named(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    path.write_text("# stamp x y z qx qy qz qw\n1 2 3 0 0 0 0 1\n\n2 2 3 0 0 0 0 1\n")
    assert read_tum(path).shape == (2, 8)
    path.write_text("")
    assert read_tum(path).shape == (0, 8)
    for bad in ("1 2 3", "1 2 3 0 0 0 0 one", "nan 2 3 0 0 0 0 1"):
        path.write_text("1 2 3 0 0 0 0 1\n" + bad + "\n")
        with pytest.raises(ValueError, match=r"a\.tum:2: expected 8 numbers"):
            read_tum(path)
