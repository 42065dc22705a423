"""Global planning: a path through a costmap with room to both sides, and the shortest path through a map."""

from lupin_runtime.navigation.planning.paths import Plan
from lupin_runtime.navigation.planning.planner import NoPath, PlanFailure, PlannerParameters, plan

__all__ = ["NoPath", "Plan", "PlanFailure", "PlannerParameters", "plan"]
