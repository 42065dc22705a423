"""The controller's parameters, under the names that Nav2's MPPI controller gives them."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class ConstraintCritic:
    """Punishes speeds beyond the limits."""

    cost_weight: float = 4.0


@dataclass(frozen=True)
class ObstaclesCritic:
    """Collisions, nearness, and a general liking for room. Clearances are from the robot's hull, in metres."""

    repulsion_weight: float = 1.5
    critical_weight: float = 20.0
    collision_cost: float = 10000.0
    collision_margin_distance: float = 0.1
    near_goal_distance: float = 0.5
    inflation_radius: float = 0.25


@dataclass(frozen=True)
class GoalCritic:
    """Mean distance to the goal, once the rest of the path is shorter than the threshold."""

    cost_weight: float = 5.0
    threshold_to_consider: float = 1.4


@dataclass(frozen=True)
class GoalAngleCritic:
    """Mean turn away from the goal's heading, near the goal."""

    cost_weight: float = 3.0
    threshold_to_consider: float = 0.5


@dataclass(frozen=True)
class PathAlignCritic:
    """Distance to the path at equal arc lengths."""

    cost_weight: float = 14.0
    max_path_occupancy_ratio: float = 0.05
    trajectory_point_step: int = 4
    threshold_to_consider: float = 0.5
    offset_from_furthest: int = 20


@dataclass(frozen=True)
class PathFollowCritic:
    """Distance of a trajectory's end to a point a little beyond what any trajectory reaches: what drives forward."""

    cost_weight: float = 5.0
    offset_from_furthest: int = 5
    threshold_to_consider: float = 1.4


@dataclass(frozen=True)
class PathAngleCritic:
    """Turns the robot towards the path when it looks away by more than the maximum."""

    cost_weight: float = 2.0
    offset_from_furthest: int = 4
    threshold_to_consider: float = 0.5
    max_angle_to_furthest: float = 1.2


@dataclass(frozen=True)
class PreferForwardCritic:
    """Punishes driving backwards, where no camera looks."""

    cost_weight: float = 1.0
    threshold_to_consider: float = 0.5


@dataclass(frozen=True)
class MppiParameters:
    """Sampling, limits (m/s, rad/s and their derivatives) and critics."""

    controller_frequency: float = 20.0
    time_steps: int = 56
    model_dt: float = 0.05
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
    prune_distance: float = 1.7
    seed: int = 1
    robot_radius: float = 0.22
    # A robot that already stands nearer to something than its radius must be able to leave, but never to touch: half its width.
    least_radius: float = 0.17
    constraint: ConstraintCritic = field(default_factory=ConstraintCritic)
    obstacles: ObstaclesCritic = field(default_factory=ObstaclesCritic)
    goal: GoalCritic = field(default_factory=GoalCritic)
    goal_angle: GoalAngleCritic = field(default_factory=GoalAngleCritic)
    path_align: PathAlignCritic = field(default_factory=PathAlignCritic)
    path_follow: PathFollowCritic = field(default_factory=PathFollowCritic)
    path_angle: PathAngleCritic = field(default_factory=PathAngleCritic)
    prefer_forward: PreferForwardCritic = field(default_factory=PreferForwardCritic)
