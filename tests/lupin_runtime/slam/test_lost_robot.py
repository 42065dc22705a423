"""A lost robot is noticed before its pose is wrong, and found only where nothing else fits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import UNKNOWN, GridMap
from lupin_runtime.localization import LOST_YAW_VARIANCE, says_lost
from lupin_runtime.slam.amcl import Amcl, Belief
from lupin_runtime.slam.likelihood_field import LikelihoodField
from lupin_runtime.slam.lost_robot import LOST_AFTER, LOST_BELOW, LostRobot, lost_belief
from lupin_runtime.slam.relocation import Expected, has_open_border, is_possible, relocate
from lupin_runtime.slam.scan import Beams, ScanReader
from lupin_runtime.slam.se2 import relative_pose
from tests.support import slam_worlds
from tests.support.mapping_run import MappingRun, beams_of
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.support.slam_worlds import Log

ORIGIN = np.zeros(3)
ANGLES = np.linspace(-math.pi, math.pi, 360, endpoint=False)
BEAMS = Beams(-math.pi, float(ANGLES[1] - ANGLES[0]), 360)


@pytest.fixture(scope="session")
def partial_maps(greenhouse_log: Log) -> dict[int, GridMap]:
    """Maps of the greenhouse after its first 5, 60 and 200 scans."""
    return {scans: present(MappingRun(greenhouse_log).process(0, scans).mapper.grid()) for scans in (5, 60, 200)}


def drive(grid: GridMap, log: Log, origin: np.ndarray, hide: float = 0.0) -> Iterator[tuple[float, bool, Belief]]:
    """Drive along a log on a map that begins at `origin`; yield error (m), whether the robot is lost, and the belief.

    `hide` is the share of beams that somebody beside the robot holds off.
    """
    amcl, reader, beams, lost_robot = Amcl(grid, seed=0), ScanReader(), beams_of(log), LostRobot()
    rng = np.random.default_rng(0)
    truth = np.array([relative_pose(origin, row) for row in log.truth])
    amcl.start(truth[0], np.diag([0.01, 0.01, 0.003]))
    before = Pose2(*log.odom[0])
    for k in range(len(log.stamps)):
        odom = Pose2(*log.odom[k])
        step = before.inverse() @ odom
        motion = np.array([step.x, step.y, step.yaw])
        if k >= 3 and not amcl.is_due(motion):
            continue
        before = odom
        amcl.predict(motion)
        ranges = log.ranges[k].copy()
        first = rng.integers(len(ranges))
        ranges[np.arange(first, first + int(hide * len(ranges))) % len(ranges)] = rng.uniform(0.6, 0.8)
        belief = amcl.correct(reader.read(beams, ranges).xy)
        lost = lost_robot.judge(belief, motion)
        yield math.hypot(*(belief.pose - truth[k])[:2]), lost, belief


@pytest.mark.parametrize("scans", [5, 60, 200])
def test_leaving_the_map_is_noticed_while_the_pose_is_right(
    greenhouse_log: Log, partial_maps: dict[int, GridMap], scans: int
) -> None:
    errors = []
    for error_m, lost, belief in drive(partial_maps[scans], greenhouse_log, greenhouse_log.truth[0]):
        errors.append(error_m)
        if lost:
            assert present(belief.explained) < LOST_BELOW
            break
    else:
        pytest.fail("the robot was never lost")
    assert len(errors) > 2 * LOST_AFTER and max(errors) < 0.15


@pytest.mark.parametrize(("hide", "limit_m"), [(0.0, 0.06), (0.3, 0.4)])
def test_robot_on_a_complete_map_is_never_lost(mapped: MappingRun, greenhouse_log: Log, hide: float, limit_m: float) -> None:
    log = slam_worlds.greenhouse_log(1.5, seed=31)
    seen = list(drive(present(mapped.mapper.grid()), log, greenhouse_log.truth[0], hide))
    assert len(seen) > 60 and not any(lost for _, lost, _ in seen)
    assert max(error_m for error_m, _, _ in seen[5:]) < limit_m


@pytest.mark.parametrize("scans", [5, 60, 200, 0])
def test_found_place_is_the_right_one(
    mapped: MappingRun, greenhouse_log: Log, partial_maps: dict[int, GridMap], scans: int
) -> None:
    grid = partial_maps.get(scans) or present(mapped.mapper.grid())
    field, reader, rng, found = LikelihoodField(grid), ScanReader(), np.random.default_rng(2), 0
    assert has_open_border(grid) == (scans > 0)
    for k in range(0, len(greenhouse_log.stamps), 60):
        truth = relative_pose(greenhouse_log.truth[0], greenhouse_log.truth[k])
        points = reader.read(beams_of(greenhouse_log), greenhouse_log.ranges[k]).xy
        result = relocate(field, points, Expected.after(truth + rng.normal(size=3) * [0.15, 0.15, 0.1], 0.75, 0.5))
        if not result.refusal:
            found += 1
            assert math.hypot(*(result.pose - truth)[:2]) < 0.1
    assert found >= (1 if scans else len(greenhouse_log.stamps) // 60)


def test_places_that_look_the_same_are_ambiguous(mapped: MappingRun, greenhouse_log: Log) -> None:
    points = ScanReader().read(beams_of(greenhouse_log), greenhouse_log.ranges[300]).xy
    result = relocate(LikelihoodField(present(mapped.mapper.grid())), points, None)
    assert "about equally well" in result.refusal


def test_carried_robot_is_found_on_a_map_without_open_border() -> None:
    world, _ = slam_worlds.office(1, 0.5)
    grid = slam_worlds.rasterized(world)
    rows, columns = np.nonzero(grid.cells)
    inside = np.zeros(grid.cells.shape, bool)
    inside[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
    grid.cells[~inside] = UNKNOWN
    rng, found = np.random.default_rng(3), 0
    field = LikelihoodField(grid)
    free = np.argwhere(inside & (field.distance_m > 0.4))
    places = free[rng.choice(len(free), 12, replace=False)]
    for row, column in places:
        pose = np.array([*grid.center_of(row, column), rng.uniform(-math.pi, math.pi)])
        points = ScanReader().read(BEAMS, world.cast(pose, ANGLES, 12.0)).xy
        if len(points) < 100:
            continue
        result = relocate(field, points, Expected.after(ORIGIN, 0.0, 0.0))
        if not result.refusal:
            found += 1
            assert math.hypot(*(result.pose - pose)[:2]) < 0.1
    assert found >= 6


def test_beams_through_walls_are_impossible() -> None:
    world = slam_worlds.World(np.concatenate((slam_worlds.box(0, 0, 6, 6), slam_worlds.box(0, 0, 1, 1))))
    field = LikelihoodField(slam_worlds.rasterized(world))
    outer = slam_worlds.World(slam_worlds.box(0, 0, 6, 6))
    points = ScanReader().read(BEAMS, outer.cast(ORIGIN, ANGLES, 12.0)).xy
    assert not is_possible(field, points, ORIGIN)
    assert is_possible(LikelihoodField(slam_worlds.rasterized(outer)), points, ORIGIN)


def test_field_outside_the_map_is_far_from_every_obstacle() -> None:
    cells = np.zeros((40, 40), np.int8)
    cells[:, -1] = 100  # at the map's edge
    field = LikelihoodField(GridMap(cells, 0.05, 0.0, 0.0))
    distance, gx, gy = field.sample(np.array([1.99, 2.5, -3.0]), np.array([1.0, 1.0, 9.0]))
    np.testing.assert_allclose(distance[0], 0.0, atol=0.03)
    np.testing.assert_allclose(distance[1:], 2.0)
    assert not gx[1:].any() and not gy[1:].any()


def test_only_a_lost_robot_has_any_heading() -> None:
    grid = GridMap(np.zeros((40, 80), np.int8), 0.05, 0.0, 0.0)
    belief = lost_belief(Belief(ORIGIN, np.eye(3) * 0.01, False, 0.2), grid)
    assert np.diag(belief.covariance) == pytest.approx([4.0**2 / 12.0, 2.0**2 / 12.0, LOST_YAW_VARIANCE], rel=0.01)
    assert says_lost([float(variance) for variance in np.diag(belief.covariance)])
    for variances in ((0.25, 0.25, 0.068), (9.0, 9.0, 3.0), (9.0, 9.0, 9.0), (0.1, 0.1, math.nan), (), (5.0,)):
        assert not says_lost(variances)


def test_updates_without_a_scan_change_nothing() -> None:
    lost_robot, still = LostRobot(), np.zeros(3)
    for explained in (0.9, 0.1, None, 0.1, None):
        assert not lost_robot.judge(Belief(ORIGIN, np.eye(3), False, explained), still)
    assert lost_robot.judge(Belief(ORIGIN, np.eye(3), False, 0.1), still)
    assert lost_robot.judge(Belief(ORIGIN, np.eye(3), True, 0.9), still)  # until it is found
