"""What the executive knows at one tick, what it decides, and why a navigation fails."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import Costmap
from lupin_runtime.navigation.recoveries import Velocity


class Failure(Enum):
    """Why a navigation ended without success.

    Values are names of the error constants of FollowPath and ComputePathToPose in nav2_msgs, which Nav2's navigators pass on.
    The numbers of these constants differ between releases.
    """

    TF_ERROR = "FollowPath.TF_ERROR"
    FAILED_TO_MAKE_PROGRESS = "FollowPath.FAILED_TO_MAKE_PROGRESS"
    NO_VALID_CONTROL = "FollowPath.NO_VALID_CONTROL"
    # Nav2's controller reports this if its costmap stays out of date.
    SENSOR_LOST = "FollowPath.CONTROLLER_TIMED_OUT"
    START_OUTSIDE_MAP = "ComputePathToPose.START_OUTSIDE_MAP"
    GOAL_OUTSIDE_MAP = "ComputePathToPose.GOAL_OUTSIDE_MAP"
    START_OCCUPIED = "ComputePathToPose.START_OCCUPIED"
    GOAL_OCCUPIED = "ComputePathToPose.GOAL_OCCUPIED"
    NO_POSE = "ComputePathToPose.TF_ERROR"
    PLANNING_TIMED_OUT = "ComputePathToPose.TIMEOUT"
    NO_VALID_PATH = "ComputePathToPose.NO_VALID_PATH"
    # What a goal asks for is no pose, or nothing.
    INVALID_POSE = "ComputePathToPose.UNKNOWN"
    NO_POSES = "ComputePathThroughPoses.NO_VIAPOINTS_GIVEN"
    # nav2_msgs has no code for the e-stop; the result's message names it.
    ESTOP_ENGAGED = "FollowPath.UNKNOWN"


@dataclass(frozen=True)
class View:
    """What the robot knows at one tick. A pose is None if its transform is missing or too old."""

    now_s: float
    odom_from_base: Pose2 | None
    map_from_odom: Pose2 | None
    velocity: Velocity
    local: Costmap | None
    # Why the lidar cannot be trusted, or None.
    lidar_fault: str | None = None
    # The age of the scan in the local costmap.
    scan_age_s: float = 0.0
    # False until it is known whether the e-stop was engaged while the goal was sent.
    estop_known: bool = True


@dataclass(frozen=True)
class Decision:
    """What to do now: the `velocity` to drive; `finished` once the navigation has ended, with a `failure` or without.

    `new_path` (n, 2) is set when a plan was accepted.
    """

    velocity: Velocity
    finished: bool = False
    failure: Failure | None = None
    reason: str = ""
    new_path: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Progress:
    """The content of an action's feedback."""

    distance_remaining_m: float = math.inf
    navigation_time_s: float = 0.0
    estimated_time_remaining_s: float = 0.0
    recoveries: int = 0
    poses_remaining: int = 0
