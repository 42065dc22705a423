"""The MPPI controller: one optimization per cycle, warm-started from the last one."""

from __future__ import annotations

import math
from ctypes import byref, c_float
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import Costmap
from lupin_runtime.navigation.mppi import kernels
from lupin_runtime.navigation.mppi.parameters import MppiParameters

# Savitzky-Golay, window 9, order 2 (Savitzky & Golay 1964, table I).
_SMOOTHING = np.array([-21, 14, 39, 54, 59, 54, 39, 14, -21], np.float32) / 231.0
_HALF_WINDOW = len(_SMOOTHING) // 2

# The noise is drawn once. Each cycle reads a slice of this pool at a pseudo-random offset below this number of values, so that
# consecutive cycles rarely reuse the same noise.
_NOISE_OFFSET_RANGE = 1 << 16

_ALIGNMENT = 64


class NoValidControl(Exception):
    """No collision-free command was found: all samples collide, or mean and best sample both collide within a second."""


@dataclass(frozen=True)
class Command:
    """A body-frame velocity (m/s, m/s, rad/s) and statistics of the optimization.

    `collision_free_count` is the number of samples that do not collide, `furthest_path_index` the index of the
    furthest point of the local path next to which one of these ends.
    """

    vx: float
    vy: float
    wz: float
    collision_free_count: int = 0
    furthest_path_index: int = 0


@dataclass(frozen=True)
class LocalPath:
    """The part of the path to follow now, in the odometry frame: evenly spaced points, and which of them are free of obstacles.

    `remaining_m` is the path length to the goal, also beyond this part: a goal behind a table is near, but its path is long.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    free: NDArray[np.bool_]
    spacing_m: float
    remaining_m: float


class MppiController:
    """A sampling controller, deterministic for a seed and a sequence of inputs. Not thread-safe."""

    def __init__(self, parameters: MppiParameters | None = None) -> None:
        p = self.parameters = parameters or MppiParameters()
        # The kernels simulate LANES trajectories side by side. Each such group is a tile; the last one may be partly unused.
        self._tiles = -(-p.batch_size // kernels.LANES)
        lanes = self._tiles * kernels.LANES
        self._kernel_parameters = _make_kernel_parameters(p, self._tiles)
        self._noise_pool = _aligned(lanes * p.time_steps * 3 + _NOISE_OFFSET_RANGE)
        self._noise_pool[:] = kernels.unit_normals(p.seed, len(self._noise_pool))
        points = -(-p.time_steps // p.path_align.trajectory_point_step)
        self._costs = _aligned(lanes)
        self._reached = _aligned(lanes)
        self._tracks = _aligned(lanes * 2 * points)
        self._tile_memory = _aligned(self._tiles * kernels.TILE_BYTES // 4)
        self._best = np.zeros((3, p.time_steps), np.float32)
        self._outcome = kernels.CycleResult()
        self._lower = np.array([p.vx_min, -p.vy_max, -p.wz_max], np.float32)[:, None]
        self._upper = np.array([p.vx_max, p.vy_max, p.wz_max], np.float32)[:, None]
        self._padded: tuple[Costmap, NDArray[np.float32]] | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the warm start and the command history, and restart the noise sequence: for a new goal, or after a pause."""
        self._controls = np.zeros((3, self.parameters.time_steps), np.float32)
        self._history = np.zeros((3, _HALF_WINDOW), np.float32)
        self._random = np.random.default_rng(self.parameters.seed)

    def compute(
        self, robot: Pose2, velocity: tuple[float, float, float], path: LocalPath, goal: Pose2, costmap: Costmap
    ) -> Command:
        """Compute the velocity to drive now.

        `robot` and `goal` are in the odometry frame, `velocity` is of the body. Raises NoValidControl, and ValueError for
        numbers that are not finite.
        """
        p = self.parameters
        if not all(map(math.isfinite, (robot.x, robot.y, robot.yaw, goal.x, goal.y, goal.yaw, *velocity))):
            raise ValueError(f"not finite: robot {robot}, goal {goal}, velocity {velocity}")
        grid = self._grid(costmap)
        inputs = self._make_cycle_inputs(robot, velocity, path, goal, costmap, grid.shape)
        path_x = (path.x - robot.x).astype(np.float32)
        path_y = (path.y - robot.y).astype(np.float32)
        free = path.free.astype(np.float32)
        for _ in range(p.iteration_count):
            offset = int(self._random.integers(0, _NOISE_OFFSET_RANGE // 16)) * 16
            failed = kernels.optimize(
                *(byref(self._kernel_parameters), byref(inputs), self._controls, self._noise_pool[offset:].ctypes.data, grid),
                *(path_x, path_y, free, self._costs, self._reached, self._tracks, self._tile_memory.ctypes.data),
                *(self._best, byref(self._outcome)),
            )
            if failed:
                self.reset()
                raise NoValidControl(f"all {p.batch_size} sampled trajectories collide with an obstacle")
            np.clip(self._controls, self._lower, self._upper, out=self._controls)
        self._smooth()
        self._fall_back_to_best_sample(inputs, grid)
        command = self._controls[:, 1].copy()
        self._shift_horizon(command)
        outcome = self._outcome
        vx, vy, wz = map(float, command)
        return Command(vx, vy, wz, int(outcome.collision_free_count), int(outcome.furthest_path_index))

    def _grid(self, costmap: Costmap) -> NDArray[np.float32]:
        if self._padded is None or self._padded[0] is not costmap:
            rim = np.float32(1e3)
            self._padded = costmap, np.pad(costmap.distance_m, 1, constant_values=rim)
        return self._padded[1]

    def _make_cycle_inputs(
        self,
        robot: Pose2,
        velocity: tuple[float, float, float],
        path: LocalPath,
        goal: Pose2,
        costmap: Costmap,
        shape: tuple[int, ...],
    ) -> kernels.CycleInputs:
        p = self.parameters
        remaining = path.remaining_m
        obstacle_distance_m = costmap.distance_at(robot.x, robot.y)
        # At most half a cell less than the present distance, so that a robot that is too near to an obstacle may stay or leave.
        collision_radius_m = max(p.least_radius, min(p.robot_radius, obstacle_distance_m - 0.5 * costmap.resolution_m))
        inputs = kernels.CycleInputs(
            velocity=(c_float * 3)(*velocity),
            yaw=robot.yaw,
            goal_x=goal.x - robot.x,
            goal_y=goal.y - robot.y,
            goal_yaw=goal.yaw,
            grid_x=costmap.origin_x - costmap.resolution_m - robot.x,
            grid_y=costmap.origin_y - costmap.resolution_m - robot.y,
            cells_per_meter=1.0 / costmap.resolution_m,
            grid_height=shape[0],
            grid_width=shape[1],
            collision_distance=collision_radius_m,
            # As in Nav2, the margin costs nothing outside the inflated cells. Otherwise, in a narrow aisle, the spread of the
            # samples alone would cost more than any progress saves.
            margin_reach=p.obstacles.inflation_radius - collision_radius_m + 0.5 * costmap.resolution_m,
            path_points_per_meter=1.0 / path.spacing_m,
            path_size=len(path.x),
        )
        inputs.use_repulsion = remaining > p.obstacles.near_goal_distance
        inputs.use_goal = remaining <= p.goal.threshold_to_consider
        inputs.use_goal_angle = remaining <= p.goal_angle.threshold_to_consider
        inputs.use_align = remaining > p.path_align.threshold_to_consider
        inputs.use_follow = remaining > p.path_follow.threshold_to_consider
        inputs.use_angle = remaining > p.path_angle.threshold_to_consider
        inputs.use_forward = remaining > p.prefer_forward.threshold_to_consider
        return inputs

    def _smooth(self) -> None:
        last = self._controls[:, -1:]
        padded = np.concatenate((self._history, self._controls, np.repeat(last, _HALF_WINDOW, axis=1)), axis=1)
        for row, out in zip(padded, self._controls):
            out[:] = np.convolve(row, _SMOOTHING, mode="valid")
        np.clip(self._controls, self._lower, self._upper, out=self._controls)

    def _fall_back_to_best_sample(self, inputs: kernels.CycleInputs, grid: NDArray[np.float32]) -> None:
        """Use the best sample if the mean collides within a second.

        Trajectories left and right of a post average to one through it.
        """
        p = self.parameters
        steps_per_second = round(1.0 / p.model_dt)
        checked_steps = min(p.time_steps, steps_per_second)
        if kernels.first_contact(byref(self._kernel_parameters), byref(inputs), self._controls, grid) >= checked_steps:
            return
        np.clip(self._best, self._lower, self._upper, out=self._controls)
        if kernels.first_contact(byref(self._kernel_parameters), byref(inputs), self._controls, grid) < checked_steps:
            self.reset()
            raise NoValidControl("both the mean and the best sampled trajectory collide within a second")

    def _shift_horizon(self, command: NDArray[np.float32]) -> None:
        self._history = np.concatenate((self._history[:, 1:], command[:, None]), axis=1)
        self._controls[:, :-1] = self._controls[:, 1:].copy()


def _aligned(count: int) -> NDArray[np.float32]:
    raw = np.zeros(count + _ALIGNMENT // 4, np.float32)
    start = (-raw.ctypes.data % _ALIGNMENT) // 4
    return raw[start : start + count]


def _make_kernel_parameters(p: MppiParameters, tiles: int) -> kernels.KernelParameters:
    return kernels.KernelParameters(
        tiles=tiles,
        batch=p.batch_size,
        steps=p.time_steps,
        align_step=p.path_align.trajectory_point_step,
        dt=p.model_dt,
        std=(c_float * 3)(p.vx_std, p.vy_std, p.wz_std),
        acceleration=(c_float * 3)(p.ax_max, p.ay_max, p.az_max),
        deceleration_x=-p.ax_min,
        gamma=p.gamma,
        temperature=p.temperature,
        max_speed=math.hypot(p.vx_max, p.vy_max),
        min_speed=-math.hypot(p.vx_min, p.vy_max),
        constraint_weight=p.constraint.cost_weight,
        collision_cost=p.obstacles.collision_cost,
        critical_weight=p.obstacles.critical_weight,
        repulsion_weight=p.obstacles.repulsion_weight,
        collision_margin=p.obstacles.collision_margin_distance,
        inflation_radius=p.obstacles.inflation_radius,
        goal_weight=p.goal.cost_weight,
        goal_angle_weight=p.goal_angle.cost_weight,
        align_weight=p.path_align.cost_weight,
        follow_weight=p.path_follow.cost_weight,
        angle_weight=p.path_angle.cost_weight,
        forward_weight=p.prefer_forward.cost_weight,
        align_offset=p.path_align.offset_from_furthest,
        follow_offset=p.path_follow.offset_from_furthest,
        angle_offset=p.path_angle.offset_from_furthest,
        align_occupancy=p.path_align.max_path_occupancy_ratio,
        angle_max=p.path_angle.max_angle_to_furthest,
    )
