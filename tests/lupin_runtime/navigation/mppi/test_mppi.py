"""The controller: its kernels against plain numpy, its limits, and blocked paths."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.mppi import LocalPath, MppiController, MppiParameters, NoValidControl
from lupin_runtime.navigation.mppi import controller as controller_module
from lupin_runtime.navigation.mppi.kernels import LANES, unit_normals
from tests.support.numpy_mppi import iterate, rollouts
from tests.support.obstacles import costmap_with_obstacles as costmap_with
from tests.support.optional import present

if TYPE_CHECKING:
    from lupin_runtime.navigation.costmap.costmaps import Costmap

HERE = Pose2()


def walls(half_m: float) -> Costmap:
    """Return an aisle along x."""
    return costmap_with(*((x, side * half_m) for x in np.arange(-1.45, 1.5, 0.05) for side in (-1, 1)))


def straight(length_m: float = 3.0, heading: float = 0.0, free: bool = True) -> LocalPath:
    along = np.arange(0.0, min(length_m, 1.7), 0.05)
    return LocalPath(along * math.cos(heading), along * math.sin(heading), np.full(len(along), free), 0.05, length_m)


CASES = {
    "open": (costmap_with(), HERE, straight(), Pose2(3.0, 0.0, 0.0), (0.3, 0.0, 0.0)),
    "aisle": (walls(0.45), HERE, straight(), Pose2(3.0, 0.0, 0.0), (0.4, 0.05, -0.1)),
    "behind": (costmap_with((0.6, 0.5)), HERE, straight(3.0, math.pi), Pose2(-3.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "post": (costmap_with((0.7, 0.05)), HERE, straight(), Pose2(3.0, 0.0, 0.0), (0.3, 0.0, 0.0)),
    "near goal": (walls(0.5), Pose2(0.05, -0.02, 0.4), straight(0.4), Pose2(0.4, 0.0, -1.0), (0.1, 0.0, 0.2)),
    "blocked path": (
        costmap_with((0.8, 0.0)),
        HERE,
        straight(2.0, free=False),
        Pose2(2.0, 0.0, 0.0),
        (0.2, 0.0, 0.0),
    ),
    "one point": (costmap_with(), HERE, straight(0.04), Pose2(0.04, 0.0, 1.0), (0.0, 0.0, 0.0)),
}


@pytest.mark.parametrize("case", CASES)
def test_kernels_equal_the_numpy_reference(case: str) -> None:
    costmap, robot, path, goal, velocity = CASES[case]
    p = MppiParameters(batch_size=400)
    controller = MppiController(p)
    generator = np.random.default_rng(3)
    controls = (generator.normal(size=(3, p.time_steps)) * 0.1).astype(np.float32)
    controller._controls = controls.copy()
    offset = int(np.random.default_rng(p.seed).integers(0, controller_module._NOISE_OFFSET_RANGE // 16)) * 16
    tiles = -(-p.batch_size // LANES)
    drawn = controller._noise_pool[offset : offset + tiles * p.time_steps * 3 * LANES]
    noise = drawn.reshape(tiles, p.time_steps, 3, LANES).transpose(0, 3, 1, 2).reshape(-1, p.time_steps, 3)
    expected = iterate(p, controls.astype(float), noise[: p.batch_size].astype(float), velocity, robot, path, goal, costmap)
    taken: dict[str, Any] = {}
    controller._smooth = lambda: taken.update(mean=controller._controls.copy())  # type: ignore[method-assign]
    controller.compute(robot, velocity, path, goal, costmap)
    limits = np.array([p.vx_max, p.vy_max, p.wz_max])[:, None]
    low = np.array([p.vx_min, -p.vy_max, -p.wz_max])[:, None]
    assert taken["mean"] == pytest.approx(np.clip(present(expected), low, limits), abs=2e-3)


def test_rollouts_obey_the_acceleration_limits() -> None:
    p = MppiParameters(batch_size=50)
    noise = np.random.default_rng(1).normal(size=(50, p.time_steps, 3)) * 10
    v, *_ = rollouts(p, np.zeros((3, p.time_steps)), noise, (0.0, 0.0, 0.0), HERE)
    assert np.abs(np.diff(v[0])).max() <= 2.5 * 0.05 + 1e-9
    assert np.abs(np.diff(v[2])).max() <= 3.2 * 0.05 + 1e-9


def test_noise_is_unit_normal_and_reproducible_by_its_seed() -> None:
    draws = unit_normals(7, 200_000)
    assert np.array_equal(draws, unit_normals(7, 200_000))
    assert not np.array_equal(draws, unit_normals(8, 200_000))
    assert abs(draws.mean()) < 0.01
    assert draws.std() == pytest.approx(1.0, abs=0.01)
    assert abs(np.corrcoef(draws[:-1], draws[1:])[0, 1]) < 0.01
    assert (np.abs(draws) > 3.0).mean() == pytest.approx(0.0027, abs=0.0008)


def drive(
    controller: MppiController, path: LocalPath, goal: Pose2, costmap: Costmap, cycles: int
) -> list[tuple[float, float, float]]:
    velocity = (0.0, 0.0, 0.0)
    commands = []
    for _ in range(cycles):
        command = controller.compute(HERE, velocity, path, goal, costmap)
        velocity = (command.vx, command.vy, command.wz)
        commands.append(velocity)
    return commands


def test_commands_are_reproducible_by_the_seed() -> None:
    case = straight(), Pose2(3.0, 0.0, 0.0), walls(0.45), 12
    assert drive(MppiController(), *case) == drive(MppiController(), *case)
    assert drive(MppiController(), *case) != drive(MppiController(MppiParameters(seed=2)), *case)


def test_reset_controller_equals_a_new_one() -> None:
    case = straight(), Pose2(3.0, 0.0, 0.0), walls(0.45), 8
    used = MppiController()
    drive(used, *case)
    used.reset()
    assert drive(used, *case) == drive(MppiController(), *case)


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -2.0])
def test_commands_stay_within_the_limits_and_reach_speed(heading: float) -> None:
    commands = np.array(drive(MppiController(), straight(heading=heading), Pose2(9, 9, 0), costmap_with(), 80))
    assert commands[:, 0].max() <= 0.5
    assert commands[:, 0].min() >= -0.35
    assert np.abs(commands[:, 1]).max() <= 0.5
    assert np.abs(commands[:, 2]).max() <= 1.9
    assert np.hypot(*commands[:, :2].T).max() > 0.3


def test_boxed_in_robot_has_no_valid_control() -> None:
    ring = [(0.28 * math.cos(a), 0.28 * math.sin(a)) for a in np.linspace(-math.pi, math.pi, 60)]
    near = [(x * 0.93, y * 0.93) for x, y in ring]
    controller = MppiController(MppiParameters(least_radius=0.25))
    with pytest.raises(NoValidControl):
        drive(controller, straight(), Pose2(3.0, 0.0, 0.0), costmap_with(*ring, *near), 30)


def test_robot_too_near_to_a_wall_drives_away_from_it() -> None:
    costmap = costmap_with(*((0.26, y) for y in np.arange(-0.6, 0.6, 0.05)))
    away = straight(3.0, math.pi)
    near = Pose2(0.06, 0.0, 0.0)
    controller = MppiController()
    velocity = (0.0, 0.0, 0.0)
    for _ in range(15):
        command = controller.compute(near, velocity, away, Pose2(-3.0, 0.0, math.pi), costmap)
        velocity = (command.vx, command.vy, command.wz)
    assert velocity[0] < -0.05


def test_robot_does_not_drive_into_a_wall_ahead() -> None:
    wall = costmap_with(*((0.35, y) for y in np.arange(-1.4, 1.45, 0.05)))
    controller = MppiController()
    velocity = (0.0, 0.0, 0.0)
    for _ in range(40):
        try:
            command = controller.compute(HERE, velocity, straight(), Pose2(3.0, 0.0, 0.0), wall)
            velocity = (command.vx, command.vy, command.wz)
        except NoValidControl:
            velocity = (0.0, 0.0, 0.0)
    # The wall is 0.13 m from the hull: driving for a second must not reach it.
    assert velocity[0] < 0.13


@pytest.mark.parametrize(
    ("robot", "velocity", "goal"),
    [
        (Pose2(math.nan, 0, 0), (0.0, 0.0, 0.0), HERE),
        (HERE, (math.inf, 0.0, 0.0), HERE),
        (HERE, (0.0, 0.0, 0.0), Pose2(0, 0, math.nan)),
    ],
)
def test_non_finite_inputs_are_refused(robot: Pose2, velocity: tuple[float, float, float], goal: Pose2) -> None:
    with pytest.raises(ValueError, match="not finite"):
        MppiController().compute(robot, velocity, straight(), goal, costmap_with())


def test_default_parameters_are_the_robots_tuning() -> None:
    p = MppiParameters()
    assert (p.time_steps, p.model_dt, p.batch_size, p.iteration_count) == (56, 0.05, 2000, 1)
    assert (p.vx_std, p.vy_std, p.wz_std, p.temperature, p.gamma) == (0.2, 0.2, 0.4, 0.3, 0.015)
    assert (p.vx_max, p.vx_min, p.vy_max, p.wz_max, p.prune_distance) == (0.5, -0.35, 0.5, 1.9, 1.7)
    assert (p.ax_max, p.ax_min, p.ay_max, p.az_max) == (2.5, -2.5, 2.5, 3.2)
    weights = [c.cost_weight for c in (p.constraint, p.goal, p.goal_angle, p.path_align, p.path_follow, p.path_angle)]
    assert weights == [4.0, 5.0, 3.0, 14.0, 5.0, 2.0]
    assert p.prefer_forward.cost_weight == 1.0
