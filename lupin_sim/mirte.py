"""The dimensions of a MIRTE Master: meters, kilograms, radians, in `base_link` (floor level, x forward, y left, z up).

They come from the vendor's public URDF and controller configuration. Where the two disagree, this module has the controller's
value, because the robot's odometry and limits follow it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

Vector = tuple[float, float, float]

# -- mecanum base -----------------------------------------------------------------------------------------------------
WHEEL_RADIUS_M = 0.051
# Half wheelbase plus half track, from the controller; the mesh gives 0.2105.
WHEEL_LEVER_M = 0.225
WHEEL_MAX_RADPS = 18.84
WHEEL_DEAD_ZONE = 0.10  # fraction of full speed below which the motor driver outputs 0
COMMAND_TIMEOUT_S = 0.25
# Front left, rear left, rear right, front right: the order of the vendor's drivers. (x, y) of the wheel centers.
WHEEL_CENTERS = ((0.085, 0.128), (-0.085, 0.128), (-0.085, -0.123), (0.085, -0.123))
WHEEL_WIDTH_M = 0.055
WHEEL_CENTER_HEIGHT_M = 0.0525
BASE_MASS_KG = 6.5
OUTER_RADIUS_M = 0.22  # of the circle about base_link that contains the base

# -- sensors ----------------------------------------------------------------------------------------------------------
LIDAR_POSITION: Vector = (0.0005, 0.0, 0.1072)
LIDAR_YAW_RAD = math.pi / 2  # as the vendor mounts it: angle 0 of a scan points to the robot's left
LIDAR_RAYS = 360
LIDAR_MIN_M, LIDAR_MAX_M = 0.05, 12.0
BODY_CAMERA_POSITION: Vector = (0.1467, 0.010, 0.1427)
IMU_HEIGHT_M = 0.10
IMAGE_WIDTH, IMAGE_HEIGHT = 640, 480
CAMERA_HFOV_RAD = math.radians(60.0)
FOCAL_PX = IMAGE_WIDTH / 2 / math.tan(CAMERA_HFOV_RAD / 2)
CAMERA_VFOV_RAD = 2 * math.atan(IMAGE_HEIGHT / 2 / FOCAL_PX)
# The renderer's optical axis meets the image midway between the middle pixels' centers.
PRINCIPAL_POINT_PX = ((IMAGE_WIDTH - 1) / 2, (IMAGE_HEIGHT - 1) / 2)

LED_COUNT = 12


@dataclass(frozen=True)
class Servo:
    """One bus servo of the arm, with its own limits; `home_counts` is the raw position at angle 0 (100 counts per degree)."""

    joint: str
    servo: str
    lower_rad: float
    upper_rad: float
    home_counts: int
    stiffness: float  # N m per rad of the position loop


SERVOS = (
    Servo("shoulder_pan_joint", "shoulder_pan", math.radians(-86.0), math.radians(90.0), 12000, 20.0),
    Servo("shoulder_lift_joint", "shoulder_lift", math.radians(-86.2), math.radians(85.5), 11450, 40.0),
    Servo("elbow_joint", "elbow", math.radians(-116.3), math.radians(92.5), 11750, 30.0),
    Servo("wrist_joint", "wrist", math.radians(-110.7), math.radians(88.0), 12200, 15.0),
)
GRIPPER_HOME_COUNTS = 10524
SERVO_EFFORT_NM = 2.0
SERVO_SPEED_RADPS = 2.0
# The vendor's rule for a stalled servo.
STALL_ERROR_RAD = 0.10
STALL_AFTER_S = 1.0
# The setpoint is sent again to a servo that is farther than this from it.
SERVO_REASSERT_RAD = 0.05

# -- arm: zero is straight up, positive leans backwards -----------------------------------------------------------------
PAN_AXIS: Vector = (0.0793, 0.0, 0.160)
LIFT_PIVOT: Vector = (0.00625, 0.0, 0.0281)  # in the pan body
LIFT_TO_ELBOW_M = 0.1378
ELBOW_TO_WRIST_M = 0.14265
WRIST_TO_JAW_M = 0.0435
WRIST_TO_TIP_M = 0.136
GRIPPER_CAMERA_ALONG_M = 0.027
GRIPPER_CAMERA_ABOVE_M = 0.067
# The pose of the arm after boot, before the first command.
ARM_START_RAD = (0.0, 0.0, 0.0, -1.57)

# -- gripper: joint angle and opening between the fingers --------------------------------------------------------
GRIPPER_LOWER_RAD, GRIPPER_UPPER_RAD = -0.20, 0.25
GRIPPER_SPEED_RADPS = 0.8
_GRIPPER_RAD = (-0.20, 0.0, 0.10, 0.20, 0.2102, 0.25)
_APERTURE_M = (0.0656, 0.0462, 0.0310, 0.0108, 0.0087, 0.0008)


def aperture_from_gripper(angle_rad: float) -> float:
    """Opening between the fingers, meters; angles outside the joint's range are clamped."""
    return _interpolate(angle_rad, _GRIPPER_RAD, _APERTURE_M)


def gripper_from_aperture(aperture_m: float) -> float:
    """Joint angle of an opening, radians: the inverse of `aperture_from_gripper`."""
    return _interpolate(aperture_m, _APERTURE_M[::-1], _GRIPPER_RAD[::-1])


def _interpolate(value: float, xs: tuple[float, ...], ys: tuple[float, ...]) -> float:
    if value <= xs[0]:
        return ys[0]
    for x0, x1, y0, y1 in zip(xs, xs[1:], ys, ys[1:]):
        if value <= x1:
            return y0 + (y1 - y0) * (value - x0) / (x1 - x0)
    return ys[-1]


# -- battery: three cells in series; open-circuit volts of one cell against state of charge ------------------------------
CELLS = 3
CELL_VOLTS = ((0.0, 3.27), (0.20, 3.73), (0.50, 3.84), (0.70, 3.95), (1.0, 4.20))


def battery_volts(fraction: float) -> float:
    """Pack voltage at a state of charge in 0..1."""
    return CELLS * _interpolate(fraction, tuple(f for f, _ in CELL_VOLTS), tuple(v for _, v in CELL_VOLTS))
