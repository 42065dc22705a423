"""Trajectories as TUM text: `stamp x y z qx qy qz qw`, one pose a line."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.geometry import Pose2, quaternion_from_yaw


def format_tum(stamps: Iterable[str], poses: Iterable[Pose2]) -> str:
    """Format a trajectory; stamps are text, so that they keep the digits of the log."""
    lines = []
    for stamp, pose in zip(stamps, poses):
        _, _, qz, qw = quaternion_from_yaw(pose.yaw)
        lines.append(f"{stamp} {pose.x:.6f} {pose.y:.6f} 0.000000 0.000000 0.000000 {qz:.9f} {qw:.9f}\n")
    return "".join(lines)


def write_tum(path: Path, stamps: Iterable[str], poses: Iterable[Pose2]) -> None:
    """Write a trajectory atomically."""
    write_atomically(path, format_tum(stamps, poses), sync=True)
