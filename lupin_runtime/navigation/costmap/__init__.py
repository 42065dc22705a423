"""Layered costmaps: what the map says, what the lidar says, and the inflation around both."""

from lupin_runtime.navigation.costmap.costmaps import Costmap, GlobalCostmap, LocalCostmap
from lupin_runtime.navigation.costmap.costs import FREE, INSCRIBED, LETHAL, UNKNOWN, Inflation
from lupin_runtime.navigation.costmap.scans import BeamPoses, RangeScan, ScanLimits

__all__ = [
    "FREE",
    "INSCRIBED",
    "LETHAL",
    "UNKNOWN",
    "BeamPoses",
    "Costmap",
    "GlobalCostmap",
    "Inflation",
    "LocalCostmap",
    "RangeScan",
    "ScanLimits",
]
