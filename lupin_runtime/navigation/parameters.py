"""The navigation node's parameters, under Nav2's names where Nav2 has them, with defaults tuned for this robot."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from lupin_runtime.navigation.checkers import GoalTolerance
from lupin_runtime.navigation.costmap import Inflation, ScanLimits
from lupin_runtime.navigation.executive import ExecutiveParameters
from lupin_runtime.navigation.mppi import MppiParameters
from lupin_runtime.navigation.planning import PlannerParameters
from lupin_runtime.navigation.recoveries import BehaviorLimits

T = TypeVar("T")


class ParameterNode(Protocol):
    """The part of LupinNode that declares parameters."""

    def parameter(self, name: str, default: Any) -> Any:
        """Declare a parameter and return its value."""
        ...


@dataclass(frozen=True)
class CostmapParameters:
    """Parameters of one costmap (m, Hz). It is published only while it has subscribers."""

    resolution: float = 0.05
    update_frequency: float = 5.0
    publish_frequency: float = 2.0
    obstacle_max_range: float = 2.5
    obstacle_min_range: float = 0.25
    raytrace_max_range: float = 3.0
    width: float = 3.0  # 0: the size of the map

    def limits(self) -> ScanLimits:
        """Return the ranges at which beams mark and clear."""
        return ScanLimits(self.obstacle_max_range, self.raytrace_max_range, self.obstacle_min_range)


LOCAL_DEFAULTS = CostmapParameters()
GLOBAL_DEFAULTS = CostmapParameters(
    update_frequency=1.0, publish_frequency=1.0, obstacle_max_range=5.0, raytrace_max_range=12.0, width=0.0
)


@dataclass(frozen=True)
class NavigationParameters:
    """The values of the navigation node's parameters."""

    mppi: MppiParameters
    planner: PlannerParameters
    executive: ExecutiveParameters
    inflation: Inflation
    local_costmap: CostmapParameters
    global_costmap: CostmapParameters
    feedback_hz: float
    transform_timeout_s: float
    scan_timeout_s: float
    velocity_threshold: float


def declare_parameters(node: ParameterNode) -> NavigationParameters:
    """Declare all parameters on a node and read them."""
    radius = node.parameter("robot_radius", MppiParameters().robot_radius)
    inflation = Inflation(
        robot_radius_m=radius,
        radius_m=node.parameter("inflation_layer.inflation_radius", Inflation().radius_m),
        scaling=node.parameter("inflation_layer.cost_scaling_factor", Inflation().scaling),
    )
    tolerance_defaults, executive_defaults = GoalTolerance(), ExecutiveParameters()
    scan_timeout_s = node.parameter("scan_patience", executive_defaults.scan_timeout_s)
    return NavigationParameters(
        mppi=dataclasses.replace(
            declare_all(node, "FollowPath.", MppiParameters(), skip=("robot_radius",)), robot_radius=radius
        ),
        planner=dataclasses.replace(
            declare_all(node, "GridBased.", PlannerParameters(), skip=("robot_radius_m",)), robot_radius_m=radius
        ),
        executive=dataclasses.replace(
            executive_defaults,
            failure_tolerance=node.parameter("failure_tolerance", executive_defaults.failure_tolerance),
            required_movement_radius=node.parameter(
                "progress_checker.required_movement_radius", executive_defaults.required_movement_radius
            ),
            required_movement_angle=node.parameter(
                "progress_checker.required_movement_angle", executive_defaults.required_movement_angle
            ),
            movement_time_allowance=node.parameter(
                "progress_checker.movement_time_allowance", executive_defaults.movement_time_allowance
            ),
            planner_period_s=1.0 / node.parameter("replanning_frequency", 1.0 / executive_defaults.planner_period_s),
            max_recoveries=node.parameter("number_of_retries", executive_defaults.max_recoveries),
            scan_timeout_s=scan_timeout_s,
            tolerance=GoalTolerance(
                xy=node.parameter("goal_checker.xy_goal_tolerance", tolerance_defaults.xy),
                yaw=node.parameter("goal_checker.yaw_goal_tolerance", tolerance_defaults.yaw),
                fine_xy=node.parameter("goal_checker.fine_xy_tolerance", tolerance_defaults.fine_xy),
                fine_yaw=node.parameter("goal_checker.fine_yaw_tolerance", tolerance_defaults.fine_yaw),
                settle_s=node.parameter("goal_checker.settle_s", tolerance_defaults.settle_s),
            ),
            behaviors=declare_all(node, "behavior_server.", BehaviorLimits()),
        ),
        inflation=inflation,
        local_costmap=declare_all(node, "local_costmap.", LOCAL_DEFAULTS),
        global_costmap=declare_all(node, "global_costmap.", GLOBAL_DEFAULTS, skip=("width", "resolution")),
        feedback_hz=node.parameter("feedback_frequency", 5.0),
        transform_timeout_s=node.parameter("transform_patience", 1.0),
        scan_timeout_s=scan_timeout_s,
        velocity_threshold=node.parameter("min_velocity_threshold", 0.001),
    )


def declare_all(node: ParameterNode, prefix: str, defaults: T, skip: tuple[str, ...] = ()) -> T:
    """Declare a dataclass's fields as parameters and return it with their values; nested ones are prefixed by class name."""
    values: dict[str, Any] = {}
    for item in dataclasses.fields(defaults):  # type: ignore[arg-type]
        default = getattr(defaults, item.name)
        if item.name in skip:
            continue
        if dataclasses.is_dataclass(default):
            values[item.name] = declare_all(node, f"{prefix}{type(default).__name__}.", default)
        else:
            values[item.name] = node.parameter(prefix + item.name, default)
    return dataclasses.replace(defaults, **values)  # type: ignore[type-var]
