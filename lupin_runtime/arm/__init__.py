"""The arm: limits, presets, trajectories, the library of poses and sequences, and the object that sends all motion.

This package exports the cores. The nodes are in `lupin_runtime.arm.node`; `python -m lupin_runtime.arm.auto_home` activates the
controllers and moves the arm home.
"""

from lupin_runtime.arm.library import Library, LibraryError, StoredPose, StoredSequence, Waypoint
from lupin_runtime.arm.limits import LIMITS, Arm, clamp, clamp_arm, gripper_deg, gripper_rad, window
from lupin_runtime.arm.motion import ArmMotion, ArmState, Refused
from lupin_runtime.arm.presets import PRESETS, UnknownPreset, preset
from lupin_runtime.arm.recorder import ArmRecorder, gripper_events
from lupin_runtime.arm.store import LibraryStore
from lupin_runtime.arm.trajectory import Point, retime, to_pose

__all__ = [
    "LIMITS",
    "PRESETS",
    "Arm",
    "ArmMotion",
    "ArmRecorder",
    "ArmState",
    "Library",
    "LibraryError",
    "LibraryStore",
    "Point",
    "Refused",
    "StoredPose",
    "StoredSequence",
    "UnknownPreset",
    "Waypoint",
    "clamp",
    "clamp_arm",
    "gripper_deg",
    "gripper_events",
    "gripper_rad",
    "preset",
    "retime",
    "to_pose",
    "window",
]
