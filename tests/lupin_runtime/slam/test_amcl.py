"""Localization on a saved map: accuracy, honest covariances, the number of particles."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.slam.amcl import Amcl, AmclSettings, Belief
from lupin_runtime.slam.likelihood_field import LikelihoodField
from lupin_runtime.slam.scan import Beams, ScanReader
from lupin_runtime.slam.se2 import relative_pose, wrap
from tests.support import slam_worlds
from tests.support.mapping_run import MappingRun, beams_of
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.support.slam_worlds import Log

SPREAD = np.diag([0.25, 0.25, 0.068])


def localize(
    grid: GridMap, log: Log, seed: int, start: np.ndarray | None = None, last: int | None = None, blind: range = range(0)
) -> tuple[np.ndarray, np.ndarray, list[Belief]]:
    """Run a filter along a log in the map's frame; returns errors (n, 3), covariances (n, 3, 3) and beliefs."""
    amcl, reader, beams = Amcl(grid, seed=seed), ScanReader(), beams_of(log)
    rng = np.random.default_rng(seed)
    origin = np.zeros(3) if start is None else start
    truth = np.array([relative_pose(origin, row) for row in log.truth]) if start is not None else log.truth
    amcl.start(truth[0] + rng.multivariate_normal(np.zeros(3), SPREAD / 4), SPREAD / 4)
    before, errors, covariances, beliefs = Pose2(*log.odom[0]), [], [], []
    for k in range(last or len(log.stamps)):
        odom = Pose2(*log.odom[k])
        step = before.inverse() @ odom
        motion = np.array([step.x, step.y, step.yaw])
        if k >= 3 and not amcl.is_due(motion):
            continue
        amcl.predict(motion)
        before = odom
        belief = amcl.belief() if k in blind else amcl.correct(reader.read(beams, log.ranges[k]).xy)
        error = belief.pose - truth[k]
        error[2] = float(wrap(np.asarray(error[2])))
        errors.append(error)
        covariances.append(belief.covariance)
        beliefs.append(belief)
        assert 500 <= len(amcl.particles) <= 2000
    return np.array(errors), np.array(covariances), beliefs


def nees(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Normalized estimation error squared (n,): three on average if the covariances are right."""
    result: np.ndarray = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
    return result


@pytest.mark.parametrize("seed", range(3))
def test_covariance_on_a_true_map_matches_the_error(seed: int) -> None:
    log = slam_worlds.greenhouse_log(1.5, seed=20 + seed)
    errors, covariances, beliefs = localize(slam_worlds.rasterized(slam_worlds.greenhouse()), log, seed)
    settled = slice(5, None)
    assert np.sqrt((errors[settled, :2] ** 2).sum(axis=1).mean()) < 0.04
    assert np.sqrt((errors[settled, 2] ** 2).mean()) < math.radians(0.5)
    consistency = nees(errors[settled], covariances[settled])
    assert 0.5 < consistency.mean() < 5.0
    assert np.quantile(consistency, 0.95) < 11.3  # 99 % of chi-squared with three degrees of freedom
    assert np.mean([belief.refined for belief in beliefs[5:]]) > 0.9


@pytest.mark.parametrize("wrong_m", [0.0, 0.8])
def test_vague_initial_pose_converges_at_rest_and_stays_honest(wrong_m: float) -> None:
    log = slam_worlds.greenhouse_log(0.2, seed=3)
    grid, scan = slam_worlds.rasterized(slam_worlds.greenhouse()), ScanReader().read(beams_of(log), log.ranges[0]).xy
    errors, covariances = [], []
    for seed in range(12):
        amcl = Amcl(grid, seed=seed)
        amcl.start(log.truth[0] + [wrong_m, -wrong_m / 2.0, 0.0], SPREAD)
        for _ in range(4):
            amcl.predict(np.zeros(3))
            belief = amcl.correct(scan)
        errors.append(belief.pose - log.truth[0])
        covariances.append(belief.covariance)
    assert nees(np.array(errors), np.array(covariances)).max() < 16.3  # 99.9 % of chi-squared with three degrees of freedom
    assert np.median(np.hypot(*np.array(errors)[:, :2].T)) < 0.05


def test_covariance_on_a_built_map_covers_the_error(mapped: MappingRun, greenhouse_log: Log) -> None:
    log = slam_worlds.greenhouse_log(1.0, seed=31)
    errors, covariances, beliefs = localize(present(mapped.mapper.grid()), log, 1, start=greenhouse_log.truth[0])
    assert 0.1 < nees(errors[5:], covariances[5:]).mean() < 5.0
    refined = np.array([belief.refined for belief in beliefs])
    assert refined.mean() > 0.9
    assert np.hypot(*errors[refined, :2].T).max() < 0.06


def test_covariance_without_scans_grows_and_covers_the_error() -> None:
    log = slam_worlds.greenhouse_log(0.6, seed=4)
    blind = range(150, 360)
    errors, covariances, beliefs = localize(slam_worlds.rasterized(slam_worlds.greenhouse()), log, 0, blind=blind)
    traces = covariances[:, 0, 0] + covariances[:, 1, 1]
    assert traces[-1] > 20 * np.median(traces[5:25])
    assert not beliefs[-1].refined
    assert nees(errors[-5:], covariances[-5:]).max() < 11.3


def test_corridor_leaves_the_particles_spread_along_it() -> None:
    world = slam_worlds.World(np.array([[-30.0, -1.0, 30.0, -1.0], [-30.0, 1.0, 30.0, 1.0]]))
    amcl = Amcl(slam_worlds.rasterized(world), seed=0)
    amcl.start(np.array([0.3, 0.1, 0.05]), np.diag([0.04, 0.04, 0.02]))
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    beams = Beams(-math.pi, float(angles[1] - angles[0]), 360)
    for k in range(4):
        truth = np.array([0.3 * k, 0.0, 0.0])
        amcl.predict(np.array([0.3, 0.0, 0.0]) if k else np.zeros(3))
        belief = amcl.correct(ScanReader().read(beams, world.cast(truth, angles, 12.0)).xy)
    sigma = np.sqrt(np.diag(belief.covariance))
    assert abs(belief.pose[1]) < 0.03 and abs(belief.pose[2]) < 0.02
    assert sigma[0] > 4 * sigma[1]
    assert abs(belief.pose[0] - truth[0]) < 3 * sigma[0]


def test_two_equal_rooms_give_a_covariance_that_spans_both() -> None:
    rooms = np.concatenate((slam_worlds.box(0, 0, 3, 3), slam_worlds.box(6, 0, 3, 3)))
    amcl = Amcl(slam_worlds.rasterized(slam_worlds.World(rooms)), seed=0)
    amcl.start(np.array([3.0, 0.0, 0.0]), np.diag([9.0, 0.05, 0.01]))
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    ranges = slam_worlds.World(rooms).cast(np.zeros(3), angles, 12.0)
    belief = amcl.correct(ScanReader().read(Beams(-math.pi, float(angles[1] - angles[0]), 360), ranges).xy)
    assert not belief.refined
    assert math.sqrt(belief.covariance[0, 0]) > 2.0


def test_particle_count_follows_the_spread() -> None:
    cells = np.zeros((400, 400), np.int8)
    cells[0, :] = 100
    amcl = Amcl(GridMap(cells, 0.05, 0.0, 0.0), AmclSettings(), seed=0)
    points = np.array([[0.5, 0.0], [0.0, 0.5]])
    amcl.start(np.array([10.0, 15.0, 0.0]), np.diag([25.0, 25.0, 3.0]))
    amcl.correct(points)
    assert len(amcl.particles) == 2000
    amcl.start(np.array([10.0, 15.0, 0.0]), np.diag([1e-4, 1e-4, 1e-4]))
    amcl.correct(points)
    assert len(amcl.particles) == 500


def test_omni_model_spreads_sideways_as_well() -> None:
    amcl = Amcl(GridMap(np.zeros((10, 10), np.int8), 0.05, 0.0, 0.0), seed=0)
    amcl.start(np.zeros(3), np.zeros((3, 3)))
    amcl.predict(np.array([0.0, 0.5, 0.0]))  # a mecanum base drives to its left
    x, y, yaw = amcl.particles.T
    assert y.mean() == pytest.approx(0.5, abs=0.03) and abs(x.mean()) < 0.03
    expected = math.sqrt(0.2 * 0.25)  # alpha 0.2, half a meter
    for spread in (x.std(), y.std(), yaw.std()):
        assert spread == pytest.approx(expected, rel=0.1)


def test_field_rises_linearly_from_a_wall_and_is_cut_off() -> None:
    cells = np.zeros((60, 200), np.int8)
    cells[:, 0] = 100
    field = LikelihoodField(GridMap(cells, 0.05, 0.0, 0.0))
    distance, gx, gy = field.sample(np.array([0.525, 1.025, 9.0]), np.array([1.5, 1.5, 1.5]))
    np.testing.assert_allclose(distance, [0.5, 1.0, 2.0], atol=1e-9)
    np.testing.assert_allclose(gx, [1.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(gy, 0.0, atol=1e-9)
    near, far = field.log_likelihood(np.array([[0.525, 1.5, 0.0], [5.0, 1.5, 0.0]]), np.array([[-0.5, 0.0]]))
    assert near > far


@pytest.mark.parametrize(
    ("pose", "covariance"), [([np.nan, 0, 0], np.eye(3)), ([0, 0, 0], np.full((3, 3), np.inf)), ([0, 0, 0], -np.eye(3))]
)
def test_invalid_initial_pose_is_refused(pose: list[float], covariance: np.ndarray) -> None:
    amcl = Amcl(GridMap(np.zeros((10, 10), np.int8), 0.05, 0.0, 0.0))
    with pytest.raises(ValueError, match="initial"):
        amcl.start(np.array(pose, float), covariance)
    assert not amcl.started
