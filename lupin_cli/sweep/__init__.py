"""What dead ROS processes leave behind, found and removed: ports that zombies hold, shared memory, an old `ros2` daemon."""

from lupin_cli.sweep.act import Result, look, sweep
from lupin_cli.sweep.rules import Culprit, Kept, Orphan, Plan

__all__ = ["Culprit", "Kept", "Orphan", "Plan", "Result", "look", "sweep"]
