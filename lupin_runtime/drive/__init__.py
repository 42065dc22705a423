"""The drive bus, which selects the command source that moves the base, and the velocity smoother of navigation.

This package exports the cores; the nodes are in `lupin_runtime.drive.node` and `lupin_runtime.drive.smoother_node`.
"""

from lupin_runtime.drive.arbiter import INPUTS, Arbiter, Decision, Input
from lupin_runtime.drive.bus import Bus
from lupin_runtime.drive.smoother import AxisLimits, Smoother
from lupin_runtime.drive.twist import ZERO, HardLimits, Twist, decode, encode

__all__ = [
    "INPUTS",
    "ZERO",
    "Arbiter",
    "AxisLimits",
    "Bus",
    "Decision",
    "HardLimits",
    "Input",
    "Smoother",
    "Twist",
    "decode",
    "encode",
]
