"""MPPI in plain numpy: the reference for the results of the kernels, and for their speed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import Costmap
from lupin_runtime.navigation.mppi import LocalPath, MppiParameters


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Return the angles wrapped to [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def rollouts(
    p: MppiParameters, controls: np.ndarray, noise: np.ndarray, velocity: Sequence[float], robot: Pose2
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return all samples' velocities (3, batch, steps), and x, y (m from the robot, axes of the frame), yaw (batch, steps)."""
    batch, steps, _ = noise.shape
    up = np.array([p.ax_max, p.ay_max, p.az_max]) * p.model_dt
    down = np.array([-p.ax_min, p.ay_max, p.az_max]) * p.model_dt
    std = np.array([p.vx_std, p.vy_std, p.wz_std])
    v = np.empty((3, batch, steps))
    v[:, :, 0] = np.array(velocity)[:, None]
    for t in range(1, steps):
        for k in range(3):
            last = v[k, :, t - 1]
            v[k, :, t] = np.clip(controls[k, t - 1] + std[k] * noise[:, t - 1, k], last - down[k], last + up[k])
    yaw = robot.yaw + np.cumsum(v[2] * p.model_dt, axis=1)
    before = np.concatenate((np.full((batch, 1), robot.yaw), yaw[:, :-1]), axis=1)
    x = np.cumsum((v[0] * np.cos(before) - v[1] * np.sin(before)) * p.model_dt, axis=1)
    y = np.cumsum((v[0] * np.sin(before) + v[1] * np.cos(before)) * p.model_dt, axis=1)
    return v, x, y, yaw


def iterate(
    p: MppiParameters,
    controls: np.ndarray,
    noise: np.ndarray,
    velocity: Sequence[float],
    robot: Pose2,
    path: LocalPath,
    goal: Pose2,
    costmap: Costmap,
) -> np.ndarray | None:
    """Run one iteration; return the new controls (3, steps) before limits and smoothing, or None if every sample collides.

    `noise` is (batch, steps, 3), unit normal; the other arguments are those of MppiController.compute.
    """
    v, x, y, yaw = rollouts(p, controls, noise, velocity, robot)
    steps = noise.shape[1]
    std = np.array([p.vx_std, p.vy_std, p.wz_std])
    cost = sum(p.gamma / std[k] * (noise[:, :-1, k] @ controls[k, :-1]) for k in range(3))

    speed = np.copysign(np.hypot(v[0], v[1]), v[0])
    fastest, slowest = math.hypot(p.vx_max, p.vy_max), -math.hypot(p.vx_min, p.vy_max)
    excess = np.maximum(speed - fastest, 0.0) + np.maximum(slowest - speed, 0.0)
    cost = cost + p.constraint.cost_weight * p.model_dt * excess.sum(axis=1)

    height, width = costmap.distance_m.shape
    columns = np.floor((x + robot.x - costmap.origin_x) / costmap.resolution_m).astype(int)
    rows = np.floor((y + robot.y - costmap.origin_y) / costmap.resolution_m).astype(int)
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    distance = np.full(x.shape, 1e3)
    distance[inside] = costmap.distance_m[rows[inside], columns[inside]]
    here = costmap.distance_at(robot.x, robot.y)
    radius = max(p.least_radius, min(p.robot_radius, here - 0.5 * costmap.resolution_m))
    clearance = distance - radius
    o = p.obstacles
    reach = o.inflation_radius - radius + 0.5 * costmap.resolution_m
    margin = np.where(clearance < reach, np.maximum(o.collision_margin_distance - clearance, 0.0), 0.0).sum(axis=1)
    collides = clearance.min(axis=1) <= 0.0
    if collides.all():
        return None
    cost += o.critical_weight * np.where(collides, o.collision_cost, margin)
    if path.remaining_m > o.near_goal_distance:
        repulsion = np.maximum(o.inflation_radius - clearance, 0.0).sum(axis=1)
        cost += o.repulsion_weight * np.maximum(repulsion - repulsion[~collides].min(), 0.0) / steps

    goal_x, goal_y = goal.x - robot.x, goal.y - robot.y
    if path.remaining_m <= p.goal.threshold_to_consider:
        cost += p.goal.cost_weight * np.hypot(x - goal_x, y - goal_y).mean(axis=1)
    if path.remaining_m <= p.goal_angle.threshold_to_consider:
        cost += p.goal_angle.cost_weight * np.abs(wrapped(yaw - goal.yaw)).mean(axis=1)
    if path.remaining_m > p.prefer_forward.threshold_to_consider:
        cost += p.prefer_forward.cost_weight * p.model_dt * np.maximum(-v[0], 0.0).sum(axis=1)

    path_x, path_y = path.x - robot.x, path.y - robot.y
    away = (x[:, -1, None] - path_x) ** 2 + (y[:, -1, None] - path_y) ** 2
    furthest = int(np.argmin(away, axis=1)[~collides].max())
    last = len(path_x) - 1
    a = p.path_align
    occupied = int((~path.free[: furthest + 1]).sum())
    crowded = occupied > 2 and occupied > a.max_path_occupancy_ratio * (furthest + 1)
    if path.remaining_m > a.threshold_to_consider and furthest >= a.offset_from_furthest and not crowded:
        sx, sy = x[:, :: a.trajectory_point_step], y[:, :: a.trajectory_point_step]
        along = np.cumsum(np.hypot(np.diff(sx, axis=1), np.diff(sy, axis=1)), axis=1)
        at = np.minimum((along / path.spacing_m + 0.5).astype(int), furthest)
        use = path.free[at]
        off = np.hypot(path_x[at] - sx[:, 1:], path_y[at] - sy[:, 1:]) * use
        cost += a.cost_weight * off.sum(axis=1) / np.maximum(use.sum(axis=1), 1)
    follow = min(furthest + p.path_follow.offset_from_furthest, last)
    while follow < last and not path.free[follow]:
        follow += 1
    if last > 0 and path.remaining_m > p.path_follow.threshold_to_consider:
        cost += p.path_follow.cost_weight * np.hypot(path_x[follow] - x[:, -1], path_y[follow] - y[:, -1])
    face = min(furthest + p.path_angle.offset_from_furthest, last)
    if last > 0 and path.remaining_m > p.path_angle.threshold_to_consider:
        off_heading = wrapped(np.array(math.atan2(path_y[face], path_x[face]) - robot.yaw))
        if abs(float(off_heading)) >= p.path_angle.max_angle_to_furthest:
            desired_yaw = np.arctan2(path_y[face] - y[:, -1], path_x[face] - x[:, -1])
            cost += p.path_angle.cost_weight * np.abs(wrapped(desired_yaw - yaw[:, -1]))

    weights = np.exp(-(cost - cost.min()) / p.temperature)
    weights /= weights.sum()
    return np.asarray(controls + np.stack([std[k] * (weights @ noise[:, :, k]) for k in range(3)]))
