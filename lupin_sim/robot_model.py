"""The robot as a MuJoCo specification: a planar base with velocity actuators, an arm of 4 joints, a gripper, cameras, LEDs.

The base slides in the plane instead of rolling on 32 rollers: this is five times cheaper, has no tilt, and stops at a table
with 0.01 mm of penetration. `wheels.py` models the wheels. All geoms of the robot are in group 2, which the lidar ignores.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from lupin_runtime import graph
from lupin_sim import mirte

GROUP = 2
# Contact bits: the robot (2) collides with the world (1), arm and gripper also with the floor (4), never with itself.
_CONTACT = {"contype": 2, "conaffinity": 1}
_ARM_CONTACT = {"contype": 2, "conaffinity": 5}
_VISUAL = {"contype": 0, "conaffinity": 0}

BASE_JOINTS = ("base_x", "base_y", "base_yaw")
BASE_ACTUATORS = ("base_vx", "base_vy", "base_wz")
GRIPPER_ACTUATOR = "gripper"
# Actuators of this group are disabled together when the servos have no torque.
SERVO_ACTUATOR_GROUP = 1
BODY_CAMERA, GRIPPER_CAMERA = "body_camera", "gripper_camera"
LIDAR_SITE, IMU_SITE = "lidar", "imu"
LED_GEOMS = tuple(f"led{i}" for i in range(mirte.LED_COUNT))

# No color is near black, white or pink, because the gripper camera sees the robot's own fingers.
_CHARCOAL = (0.26, 0.29, 0.33, 1.0)
_SLATE = (0.33, 0.38, 0.44, 1.0)
_RUBBER = (0.22, 0.23, 0.26, 1.0)
_HUB = (0.80, 0.55, 0.10, 1.0)
_ARM = (0.86, 0.60, 0.10, 1.0)
_SERVO = (0.24, 0.27, 0.32, 1.0)
_FINGER = (0.30, 0.42, 0.55, 1.0)

_GEOM = mujoco.mjtGeom
_JOINT = mujoco.mjtJoint


def quaternion(matrix: NDArray[np.float64]) -> list[float]:
    """Return the quaternion (w, x, y, z), in MuJoCo's order, of a rotation matrix of shape (3, 3)."""
    out = np.zeros(4)
    mujoco.mju_mat2Quat(out, np.asarray(matrix, float).ravel())
    return [float(v) for v in out]


def yaw_quaternion(yaw_rad: float) -> list[float]:
    """Return the quaternion (w, x, y, z) of a rotation about z."""
    return [math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)]


# A MuJoCo camera looks along -z with y up; the columns are its axes in the frame of its body.
_LOOK_FORWARD = np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]], float)
_LOOK_ALONG_GRIPPER = np.stack([[0, -1, 0], [-1, 0, 0], [0, 0, -1]], 1).astype(float)


def add_robot(spec: mujoco.MjSpec) -> None:
    """Add the robot to a specification whose angles are radians.

    Set its start pose in qpos, not on the body, because slide joints move along the axes of the body's frame.
    """
    base = spec.worldbody.add_body(name=graph.BASE_FRAME)
    base.add_joint(name="base_x", type=_JOINT.mjJNT_SLIDE, axis=[1, 0, 0])
    base.add_joint(name="base_y", type=_JOINT.mjJNT_SLIDE, axis=[0, 1, 0])
    base.add_joint(name="base_yaw", type=_JOINT.mjJNT_HINGE, axis=[0, 0, 1])
    # These force limits stop 6.5 kg from 0.5 m/s in an eighth of a second, which is the grip of the tires.
    for name, joint, gain, force in zip(BASE_ACTUATORS, BASE_JOINTS, (300.0, 300.0, 8.0), (32.0, 32.0, 4.0)):
        actuator = spec.add_actuator(name=name, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_velocity(kv=gain)
        actuator.forcelimited = True
        actuator.forcerange = [-force, force]
    _add_hull(base)
    _add_sensors(spec, base)
    _add_leds(spec, base)
    _add_arm(spec, base)


def _add_hull(base: mujoco.MjsBody) -> None:
    def box(name: str, half: list[float], at: list[float], rgba: tuple[float, ...], mass: float = 0.0) -> None:
        base.add_geom(name=name, type=_GEOM.mjGEOM_BOX, size=half, pos=at, rgba=list(rgba), mass=mass, group=GROUP, **_CONTACT)

    box("chassis", [0.14, 0.095, 0.03], [0, 0, 0.07], _CHARCOAL, mirte.BASE_MASS_KG - 2.0)
    box("deck", [0.08, 0.09, 0.025], [-0.05, 0, 0.145], _SLATE, 0.6)
    box("arm_stand", [0.030, 0.045, 0.025], [0.0793, 0, 0.125], _CHARCOAL)
    box("camera_bar", [0.0120, 0.0825, 0.0175], [0.1334, -0.0025, 0.1442], _SLATE, 0.3)
    for index, y in enumerate((-0.0622, 0.0648)):
        box(f"pillar{index}", [0.0065, 0.017, 0.0125], [0, y, 0.1125], _CHARCOAL)
    base.add_geom(
        name="lidar_puck",
        type=_GEOM.mjGEOM_CYLINDER,
        size=[0.0278, 0.012, 0],
        pos=[0.0005, 0, 0.108],
        rgba=[0.30, 0.30, 0.36, 1],
        mass=0.1,
        group=GROUP,
        **_CONTACT,
    )
    base.add_geom(
        name="lens",
        type=_GEOM.mjGEOM_CYLINDER,
        size=[0.008, 0.002, 0],
        pos=[0.1450, 0.010, 0.1427],
        quat=[math.sqrt(0.5), 0, math.sqrt(0.5), 0],
        rgba=[0.20, 0.22, 0.40, 1],
        mass=0,
        group=GROUP,
        **_VISUAL,
    )
    on_edge = [math.sqrt(0.5), math.sqrt(0.5), 0, 0]
    for joint, (x, y) in zip(graph.WHEEL_JOINTS, mirte.WHEEL_CENTERS):
        name = joint.removesuffix("_joint")
        base.add_geom(
            name=name,
            type=_GEOM.mjGEOM_CYLINDER,
            size=[mirte.WHEEL_RADIUS_M, mirte.WHEEL_WIDTH_M / 2, 0],
            pos=[x, y, mirte.WHEEL_CENTER_HEIGHT_M],
            quat=on_edge,
            rgba=list(_RUBBER),
            mass=0.3,
            group=GROUP,
            **_CONTACT,
        )
        base.add_geom(
            name=f"{name}_hub",
            type=_GEOM.mjGEOM_CYLINDER,
            size=[0.030, mirte.WHEEL_WIDTH_M / 2 + 0.002, 0],
            pos=[x, y, mirte.WHEEL_CENTER_HEIGHT_M],
            quat=on_edge,
            rgba=list(_HUB),
            mass=0,
            group=GROUP,
            **_VISUAL,
        )


def _add_sensors(spec: mujoco.MjSpec, base: mujoco.MjsBody) -> None:
    base.add_site(name=LIDAR_SITE, pos=list(mirte.LIDAR_POSITION), quat=yaw_quaternion(mirte.LIDAR_YAW_RAD), group=5)
    base.add_site(name=IMU_SITE, pos=[0, 0, mirte.IMU_HEIGHT_M], group=5)
    base.add_camera(
        name=BODY_CAMERA,
        pos=list(mirte.BODY_CAMERA_POSITION),
        quat=quaternion(_LOOK_FORWARD),
        fovy=math.degrees(mirte.CAMERA_VFOV_RAD),
        resolution=[mirte.IMAGE_WIDTH, mirte.IMAGE_HEIGHT],
    )
    for name, kind in (
        ("gyro", mujoco.mjtSensor.mjSENS_GYRO),
        ("accelerometer", mujoco.mjtSensor.mjSENS_ACCELEROMETER),
    ):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=IMU_SITE)


def _add_leds(spec: mujoco.MjSpec, base: mujoco.MjsBody) -> None:
    """Add the LED strip around the deck: four LEDs on the left, four at the rear, four on the right."""
    spec.add_material(name="led", emission=0.3, specular=0.0, shininess=0.0, reflectance=0.0)
    left = [(0.015 - 0.04 * i, 0.084) for i in range(4)]
    rear = [(-0.124, 0.054 - 0.036 * i) for i in range(4)]
    right = [(x, -y) for x, y in reversed(left)]
    for name, (x, y) in zip(LED_GEOMS, [*left, *rear, *right]):
        across = [0.006, 0.012, 0.004] if y not in (0.084, -0.084) else [0.014, 0.006, 0.004]
        base.add_geom(
            name=name,
            type=_GEOM.mjGEOM_BOX,
            size=across,
            pos=[x, y, 0.174],
            material="led",
            rgba=[0.1, 0.1, 0.12, 1],
            mass=0,
            group=GROUP,
            **_VISUAL,
        )


def _add_link(
    parent: mujoco.MjsBody,
    name: str,
    at: list[float],
    servo: mirte.Servo,
    axis: list[float],
    mass: float,
    center: list[float],
    inertia: list[float],
) -> mujoco.MjsBody:
    link = parent.add_body(name=name, pos=at)
    link.add_joint(
        name=servo.joint,
        type=_JOINT.mjJNT_HINGE,
        axis=axis,
        limited=True,
        range=[servo.lower_rad, servo.upper_rad],
        damping=[0.05, 0, 0],
        armature=0.002,
        frictionloss=0.03,
    )
    link.mass = mass
    link.ipos = center
    link.inertia = inertia
    link.explicitinertial = True
    return link


def _add_arm(spec: mujoco.MjSpec, base: mujoco.MjsBody) -> None:
    pan_servo, lift_servo, elbow_servo, wrist_servo = mirte.SERVOS
    pan = _add_link(base, "shoulder_pan", list(mirte.PAN_AXIS), pan_servo, [0, 0, 1], 0.069, [0, 0, 0.02], [2.2e-5] * 3)
    # The lifting joints rotate about -y, so that a positive angle leans the arm backwards.
    lift = _add_link(
        pan,
        "shoulder_lift",
        list(mirte.LIFT_PIVOT),
        lift_servo,
        [0, -1, 0],
        0.105,
        [0, 0, 0.0765],
        [5.5e-5, 5.5e-5, 2.5e-5],
    )
    elbow = _add_link(
        lift,
        "elbow",
        [0, 0, mirte.LIFT_TO_ELBOW_M],
        elbow_servo,
        [0, -1, 0],
        0.071,
        [0, 0, 0.064],
        [3.8e-5, 3.8e-5, 2e-5],
    )
    wrist = _add_link(
        elbow,
        "wrist",
        [0, 0, mirte.ELBOW_TO_WRIST_M],
        wrist_servo,
        [0, -1, 0],
        0.076,
        [0, 0, 0.0225],
        [1.8e-5] * 3,
    )

    def shape(body: mujoco.MjsBody, kind: mujoco.mjtGeom, size: list[float], at: list[float], rgba: tuple[float, ...]) -> None:
        body.add_geom(type=kind, size=size, pos=at, rgba=list(rgba), mass=0, group=GROUP, **_ARM_CONTACT)

    across = {"quat": [math.sqrt(0.5), math.sqrt(0.5), 0, 0]}
    shape(pan, _GEOM.mjGEOM_CYLINDER, [0.032, 0.012, 0], [0, 0, 0.0], _SERVO)
    for body, length in ((lift, mirte.LIFT_TO_ELBOW_M), (elbow, mirte.ELBOW_TO_WRIST_M)):
        for side in (-1, 1):
            shape(body, _GEOM.mjGEOM_BOX, [0.010, 0.004, length / 2 - 0.006], [0, side * 0.024, length / 2], _ARM)
        shape(body, _GEOM.mjGEOM_BOX, [0.012, 0.018, 0.022], [0, 0, length - 0.026], _SERVO)
        body.add_geom(
            type=_GEOM.mjGEOM_CYLINDER,
            size=[0.016, 0.030, 0],
            rgba=list(_SERVO),
            mass=0,
            group=GROUP,
            **across,
            **_VISUAL,
        )
    wrist.add_geom(
        type=_GEOM.mjGEOM_CYLINDER, size=[0.014, 0.029, 0], rgba=list(_SERVO), mass=0, group=GROUP, **across, **_VISUAL
    )
    shape(wrist, _GEOM.mjGEOM_BOX, [0.014, 0.0275, 0.024], [0, 0, 0.034], _ARM)
    # The camera's housing and bracket; visual only, since the camera is inside the housing.
    wrist.add_geom(
        type=_GEOM.mjGEOM_BOX,
        size=[0.010, 0.016, 0.009],
        pos=[-mirte.GRIPPER_CAMERA_ABOVE_M, 0, mirte.GRIPPER_CAMERA_ALONG_M - 0.012],
        rgba=list(_SERVO),
        mass=0,
        group=GROUP,
        **_VISUAL,
    )
    wrist.add_geom(
        type=_GEOM.mjGEOM_BOX,
        size=[0.026, 0.006, 0.004],
        pos=[-0.038, 0, 0.016],
        rgba=list(_SLATE),
        mass=0,
        group=GROUP,
        **_VISUAL,
    )
    wrist.add_camera(
        name=GRIPPER_CAMERA,
        pos=[-mirte.GRIPPER_CAMERA_ABOVE_M, 0, mirte.GRIPPER_CAMERA_ALONG_M],
        quat=quaternion(_LOOK_ALONG_GRIPPER),
        fovy=math.degrees(mirte.CAMERA_VFOV_RAD),
        resolution=[mirte.IMAGE_WIDTH, mirte.IMAGE_HEIGHT],
    )
    for servo in mirte.SERVOS:
        actuator = spec.add_actuator(
            name=servo.servo, target=servo.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, group=SERVO_ACTUATOR_GROUP
        )
        actuator.set_to_pid(kp=servo.stiffness, dampratio=1.0, slewmax=mirte.SERVO_SPEED_RADPS, ctrlspec=1)
        actuator.forcelimited = True
        actuator.forcerange = [-mirte.SERVO_EFFORT_NM, mirte.SERVO_EFFORT_NM]
        actuator.ctrllimited = True
        actuator.ctrlrange = [servo.lower_rad, servo.upper_rad]
    _add_gripper(spec, wrist)


def _add_gripper(spec: mujoco.MjSpec, wrist: mujoco.MjsBody) -> None:
    """Add two coupled fingers, each sliding by half the aperture, so that one servo closes both."""
    opening = mirte.aperture_from_gripper(mirte.GRIPPER_LOWER_RAD) / 2
    for side, name in ((1, "finger_left"), (-1, "finger_right")):
        finger = wrist.add_body(name=name, pos=[0, 0, 0.075])
        finger.add_joint(
            name=name,
            type=_JOINT.mjJNT_SLIDE,
            axis=[0, side, 0],
            limited=True,
            range=[0.0, opening],
            damping=[1.0, 0, 0],
            armature=0.02,
        )
        finger.mass = 0.015
        finger.inertia = [2e-6] * 3
        finger.ipos = [0, 0, 0.03]
        finger.explicitinertial = True
        # Stiffer than the soft default, or strong fingers would pass through a stem.
        finger.add_geom(
            name=name,
            type=_GEOM.mjGEOM_BOX,
            size=[0.008, 0.004, 0.030],
            pos=[0, side * 0.004, 0.030],
            rgba=list(_FINGER),
            mass=0,
            friction=[1.5, 0.05, 0.001],
            solref=[0.004, 1.0],
            priority=2,
            group=GROUP,
            **_ARM_CONTACT,
        )
    equality = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT, name1="finger_right", name2="finger_left", objtype=mujoco.mjtObj.mjOBJ_JOINT
    )
    equality.data[:5] = [0, 1, 0, 0, 0]
    actuator = spec.add_actuator(
        name=GRIPPER_ACTUATOR, target="finger_left", trntype=mujoco.mjtTrn.mjTRN_JOINT, group=SERVO_ACTUATOR_GROUP
    )
    actuator.set_to_pid(kp=1500, dampratio=1.0, slewmax=0.06, ctrlspec=1)
    actuator.forcelimited = True
    actuator.forcerange = [-8, 8]
    actuator.ctrllimited = True
    actuator.ctrlrange = [0, opening]
