"""The LED strip, which shows the robot's state to the people around it.

This package exports the cores; the node is in `lupin_runtime.lights.node`.
"""

from lupin_runtime.lights.motion import MotionDetector
from lupin_runtime.lights.palette import COLORS_BY_NAME, LIFECYCLE_COLORS, PHASE_COLORS, Rgb, byte_order
from lupin_runtime.lights.precedence import BEFORE_MANUAL, MANUAL, RULES, Light, Mission, View, choose, shown

__all__ = [
    "BEFORE_MANUAL",
    "COLORS_BY_NAME",
    "LIFECYCLE_COLORS",
    "MANUAL",
    "PHASE_COLORS",
    "RULES",
    "Light",
    "Mission",
    "MotionDetector",
    "Rgb",
    "View",
    "byte_order",
    "choose",
    "shown",
]
