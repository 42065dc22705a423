"""Cleanup of what dead ROS processes leave behind: stale processes on DDS ports, stale shared memory, an old `ros2` daemon."""

from lupin_cli.cleanup.execute import CleanupResult, clean_up, find_stale
from lupin_cli.cleanup.plan import CleanupPlan, Kept, StaleProcess, StaleSegment

__all__ = ["CleanupPlan", "CleanupResult", "Kept", "StaleProcess", "StaleSegment", "clean_up", "find_stale"]
