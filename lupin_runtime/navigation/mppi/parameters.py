"""The controller's parameters.

Their names follow Nav2's MPPI controller; `seed`, `robot_radius` and `least_radius` are Lupin's own.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class ConstraintCritic:
    """Penalizes planar speeds beyond the limits."""

    cost_weight: float = 4.0


@dataclass(frozen=True)
class ObstaclesCritic:
    """Penalizes collisions, poses near obstacles (the margin), and any lack of room (the repulsion).

    Distances are in meters from the circle of the collision radius around the robot's center. The margin's cost moreover
    applies only within `inflation_radius` of the center.
    """

    repulsion_weight: float = 1.5
    critical_weight: float = 20.0  # weight of the costs of collisions and of the margin
    collision_cost: float = 10000.0
    collision_margin_distance: float = 0.1  # an obstacle nearer than this costs the difference
    near_goal_distance: float = 0.5  # no repulsion once the rest of the path is this short, m
    inflation_radius: float = 0.25  # an obstacle nearer than this repels by the difference


@dataclass(frozen=True)
class GoalCritic:
    """Penalizes the mean distance to the goal, once the rest of the path is as short as the threshold (m)."""

    cost_weight: float = 5.0
    threshold_to_consider: float = 1.4


@dataclass(frozen=True)
class GoalAngleCritic:
    """Penalizes the mean angle to the goal's heading, once the rest of the path is as short as the threshold (m)."""

    cost_weight: float = 3.0
    threshold_to_consider: float = 0.5


@dataclass(frozen=True)
class PathAlignCritic:
    """Penalizes the distance to the path at equal arc lengths, while the rest of the path is longer than the threshold (m)."""

    cost_weight: float = 14.0
    max_path_occupancy_ratio: float = 0.05  # a path with a larger share of points in obstacles is not followed closely
    trajectory_point_step: int = 4  # compares every fourth point of a trajectory
    threshold_to_consider: float = 0.5
    offset_from_furthest: int = 20  # applies once a trajectory reaches this many points of the path


@dataclass(frozen=True)
class PathFollowCritic:
    """Penalizes the distance of a trajectory's end to a point a little beyond what any trajectory reaches.

    This drives the robot forward, while the rest of the path is longer than the threshold (m).
    """

    cost_weight: float = 5.0
    offset_from_furthest: int = 5  # points of the path
    threshold_to_consider: float = 1.4


@dataclass(frozen=True)
class PathAngleCritic:
    """Penalizes facing away from the path, while the robot does so by more than the maximum (rad).

    Applies while the rest of the path is longer than the threshold (m).
    """

    cost_weight: float = 2.0
    offset_from_furthest: int = 4  # points of the path
    threshold_to_consider: float = 0.5
    max_angle_to_furthest: float = 1.2


@dataclass(frozen=True)
class PreferForwardCritic:
    """Penalizes driving backwards, where no camera faces, while the rest of the path is longer than the threshold (m)."""

    cost_weight: float = 1.0
    threshold_to_consider: float = 0.5


@dataclass(frozen=True)
class MppiParameters:
    """Sampling, limits (m/s and rad/s for v and w; m/s^2 and rad/s^2 for a) and critics."""

    controller_frequency: float = 20.0  # Hz
    time_steps: int = 56
    model_dt: float = 0.05  # s
    batch_size: int = 2000
    vx_std: float = 0.2
    vy_std: float = 0.2
    wz_std: float = 0.4
    vx_max: float = 0.5
    vx_min: float = -0.35
    vy_max: float = 0.5
    wz_max: float = 1.9
    ax_max: float = 2.5
    ax_min: float = -2.5
    ay_max: float = 2.5
    az_max: float = 3.2
    iteration_count: int = 1
    temperature: float = 0.3
    gamma: float = 0.015
    prune_distance: float = 1.7  # length of the path that a cycle considers, m
    seed: int = 1  # of the noise
    robot_radius: float = 0.22  # m; a pose collides if its center is this near to an obstacle
    # The smallest collision radius (m), half the robot's width: a robot that is already nearer to an obstacle than its radius
    # must be able to leave, but must never touch the obstacle.
    least_radius: float = 0.17
    constraint: ConstraintCritic = field(default_factory=ConstraintCritic)
    obstacles: ObstaclesCritic = field(default_factory=ObstaclesCritic)
    goal: GoalCritic = field(default_factory=GoalCritic)
    goal_angle: GoalAngleCritic = field(default_factory=GoalAngleCritic)
    path_align: PathAlignCritic = field(default_factory=PathAlignCritic)
    path_follow: PathFollowCritic = field(default_factory=PathFollowCritic)
    path_angle: PathAngleCritic = field(default_factory=PathAngleCritic)
    prefer_forward: PreferForwardCritic = field(default_factory=PreferForwardCritic)
