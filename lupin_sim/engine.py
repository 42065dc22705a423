"""The simulation: takes commands, advances in steps of 10 ms, gives observations. It uses no wall clock, no ROS and no threads.

The same world, seed, and commands at the same ticks give bitwise equal observations, including scans and images.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_sim import mirte, robot_model
from lupin_sim.collisions import CollisionCounter
from lupin_sim.controllers import ACTIVE, ControllerManager
from lupin_sim.lidar import Lidar
from lupin_sim.odometry import WheelOdometry
from lupin_sim.scene import SENSOR_LOOK, TIMESTEP_S, Look, build
from lupin_sim.servos import ServoBus
from lupin_sim.trajectory import TrajectoryController
from lupin_sim.wheels import DRIVES, Drive, twist_from_wheels, wheels_from_twist
from lupin_sim.world import World

TICK_S = 0.01
TICK_NS = 10_000_000
_SUBSTEPS = round(TICK_S / TIMESTEP_S)
# Simulated time starts above 0: a stamp of 0 means "latest" to a transform buffer and "unset" to many programs.
START_NS = 1_000_000_000
GYRO_NOISE_RADPS = 0.002
ACCELEROMETER_NOISE_MPS2 = 0.03
DISCHARGE_PER_S = 0.9 / (2.5 * 3600.0)  # 90 % in two and a half hours
NO_TWIST = (0.0, 0.0, 0.0)
_LED_OFF, _LED_ON = 0.08, 0.66


@dataclass(frozen=True)
class Joints:
    """Joint names, positions (rad) and velocities (rad/s), as the joint state broadcaster publishes them."""

    names: tuple[str, ...]
    positions: tuple[float, ...]
    velocities: tuple[float, ...]


@dataclass(frozen=True)
class Imu:
    """Angular velocity (rad/s) and specific force (m/s^2) in base_link, with noise."""

    gyro: tuple[float, float, float]
    accelerometer: tuple[float, float, float]


class Simulation:
    """A robot in a world. Any thread may give commands; `step` and the observations must be called from one thread."""

    def __init__(
        self,
        world: World,
        seed: int = 0,
        fidelity: str = "ideal",
        controllers: str = ACTIVE,
        look: Look = SENSOR_LOOK,
        led_order: str = "RGB",
    ) -> None:
        if fidelity not in DRIVES:
            raise ValueError(f"fidelity {fidelity!r} is not one of {', '.join(DRIVES)}")
        if sorted(led_order) != sorted("RGB"):
            raise ValueError(f"LED order {led_order!r} is not a permutation of RGB")
        self.world = world
        self.model = build(world, look)
        self.data = mujoco.MjData(self.model)
        # One random stream per sensor, so that reading one sensor never changes the values of another.
        odometry_rng, lidar_rng, self._imu_rng = (
            np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3)
        )
        self.lock = threading.Lock()
        self.tick = 0
        self.controllers = ControllerManager(controllers)
        self.drive: Drive = DRIVES[fidelity]()
        self.odometry = WheelOdometry(odometry_rng)
        self.arm = TrajectoryController(mirte.ARM_START_RAD)
        self.gripper_command = 0.0
        self.servos = ServoBus([*mirte.ARM_START_RAD, self.gripper_command])
        self.collisions = CollisionCounter()
        self.battery = 0.9
        self.estop_pressed = False
        self.distance_m = 0.0
        self.wheel_angles: NDArray[np.float64] = np.zeros(4)
        self._lidar = Lidar(self.model, lidar_rng)
        self._led_order = led_order
        self.led_color = (0, 0, 0)  # red, green, blue of the LED strip, 0..255
        self._twist = NO_TWIST
        self._command_tick = -(10**9)
        self._index_model()
        self._reset()

    # -- commands, safe from any thread -------------------------------------------------------------------------------
    def command_twist(self, vx: float, vy: float, wz: float) -> None:
        """Drive (m/s, rad/s). A twist that is not finite stops the wheels."""
        with self.lock:
            finite = all(map(math.isfinite, (vx, vy, wz)))
            self._twist = (vx, vy, wz) if finite else NO_TWIST
            self._command_tick = self.tick

    def set_leds(self, first: int, second: int, third: int) -> None:
        """Set the three bytes of the LED strip, 0..255; their colors are in the strip's order."""
        color = dict(zip(self._led_order, (first, second, third)))
        self.led_color = color["R"], color["G"], color["B"]
        # An LED that is off looks like dark glass; one at full power leaves room for the light that falls on it.
        glow = [_LED_OFF + (_LED_ON - _LED_OFF) * min(max(value, 0), 255) / 255.0 for value in self.led_color]
        with self.lock:
            self.model.geom_rgba[self._leds] = [*glow, 1.0]

    def switch_controllers(self, activate: list[str], deactivate: list[str], strict: bool) -> tuple[bool, str]:
        """Switch controllers as the controller manager does. An arm controller that becomes active holds the present pose.

        Returns whether all changes were made, and what was refused.
        """
        with self.lock:
            was_active = self.controllers.is_active("mirte_master_arm_controller")
            reply = self.controllers.switch(activate, deactivate, strict)
            if self.controllers.is_active("mirte_master_arm_controller") and not was_active:
                self.arm.hold(self.servos.angles[:4])
                self.gripper_command = self.servos.angles[4]
            return reply.ok, reply.message

    def place(self, pose: Pose2, arm: Sequence[float] | None = None) -> None:
        """Teleport the robot to a pose, at rest: for pictures and experiments."""
        self.data.qpos[:3] = pose.x, pose.y, pose.yaw
        self.data.qvel[:] = 0.0
        if arm is not None:
            self.data.qpos[self._arm_positions[:4]] = arm
        mujoco.mj_forward(self.model, self.data)

    # -- time ---------------------------------------------------------------------------------------------------------
    @property
    def time_ns(self) -> int:
        """Simulated time, nanoseconds."""
        return START_NS + self.tick * TICK_NS

    @property
    def time_s(self) -> float:
        """Simulated time, seconds."""
        return self.time_ns / 1e9

    def step(self) -> None:
        """Advance by 10 ms."""
        with self.lock:
            wheel_speeds = self._step_wheels()
            self._step_arm()
            self._aim_base(wheel_speeds)
            self.battery = max(0.0, self.battery - DISCHARGE_PER_S * TICK_S)
        before = self.data.qpos[:2].copy()
        mujoco.mj_step(self.model, self.data, nstep=_SUBSTEPS)
        self.distance_m += float(np.hypot(*(self.data.qpos[:2] - before)))
        self.tick += 1
        self.odometry.step(wheel_speeds, TICK_S)
        with self.lock:
            self.servos.read(self._joint_angles())
        self.collisions.update(self._touched_object(), self.time_s)
        # mj_step leaves the body positions one step old, and the sensors read them.
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    # -- observations -------------------------------------------------------------------------------------------------
    @property
    def true_pose(self) -> Pose2:
        """The pose of base_link in the world frame."""
        x, y, yaw = (float(v) for v in self.data.qpos[:3])
        return Pose2(x, y, wrap_angle(yaw))

    @property
    def true_twist(self) -> tuple[float, float, float]:
        """The true velocity of base_link in its own frame: m/s, m/s, rad/s."""
        vx, vy, wz = (float(v) for v in self.data.qvel[:3])
        c, s = math.cos(self.true_pose.yaw), math.sin(self.true_pose.yaw)
        return c * vx + s * vy, -s * vx + c * vy, wz

    def scan(self) -> NDArray[np.float32]:
        """Ranges of shape (360,) in the frame `laser`, meters; inf for no return."""
        return self._lidar.scan(self.data)

    def true_ranges(self) -> NDArray[np.float64]:
        """Ranges like those of `scan`, without noise."""
        return self._lidar.true_ranges(self.data)

    def imu(self) -> Imu:
        """Return a sample of gyroscope and accelerometer."""
        gyro = self.data.sensordata[0:3] + self._imu_rng.normal(size=3) * GYRO_NOISE_RADPS
        force = self.data.sensordata[3:6] + self._imu_rng.normal(size=3) * ACCELEROMETER_NOISE_MPS2
        return Imu(tuple(map(float, gyro)), tuple(map(float, force)))  # type: ignore[arg-type]

    def joints(self) -> Joints:
        """Return the joint states of arm, gripper and wheels."""
        arm_speeds = [float(self.data.qvel[i]) for i in self._arm_dofs]
        return Joints(
            (*graph.ARM_JOINTS, graph.GRIPPER_JOINT, *graph.WHEEL_JOINTS),
            (*self.servos.angles, *map(float, self.wheel_angles)),
            (*arm_speeds, 0.0, *map(float, self.drive.speeds)),
        )

    def camera_pose(self, camera: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(position (3,), rotation (3, 3)) of a camera's optical frame (x right, y down, z forward) in base_link."""
        index = self.model.camera(camera).id
        base = self.data.xmat[self._base].reshape(3, 3)
        # A MuJoCo camera looks along -z with y up.
        optical = self.data.cam_xmat[index].reshape(3, 3) * np.array([1.0, -1.0, -1.0])
        return base.T @ (self.data.cam_xpos[index] - self.data.xpos[self._base]), base.T @ optical

    # -- implementation -------------------------------------------------------------------------------------------------------
    def _index_model(self) -> None:
        model = self.model
        self._base = model.body(graph.BASE_FRAME).id
        self._base_actuators = [model.actuator(name).id for name in robot_model.BASE_ACTUATORS]
        joints = [*graph.ARM_JOINTS, "finger_left"]
        self._arm_positions = [int(model.joint(name).qposadr[0]) for name in joints]
        self._arm_dofs = [int(model.joint(name).dofadr[0]) for name in graph.ARM_JOINTS]
        names = [*(servo.servo for servo in mirte.SERVOS), robot_model.GRIPPER_ACTUATOR]
        self._servo_actuators = [model.actuator(name).id for name in names]
        self._servo_activations = [int(model.actuator(name).actadr[0]) for name in names]
        self._leds = [model.geom(name).id for name in robot_model.LED_GEOMS]
        self._is_robot = np.asarray(model.geom_group) == robot_model.GROUP
        self._floor = model.geom("floor").id

    def _reset(self) -> None:
        mujoco.mj_resetData(self.model, self.data)
        start = self.world.start
        self.data.qpos[:3] = start.x, start.y, start.yaw
        physical = self._physical(self.servos.references)
        for address, value in zip(self._arm_positions, physical):
            self.data.qpos[address] = value
        self.data.qpos[int(self.model.joint("finger_right").qposadr[0])] = physical[-1]
        self._aim_servos(physical)
        # Start the position loops at the present angles; at zero the arm would swing at the first step.
        self.data.act[self._servo_activations] = physical
        mujoco.mj_forward(self.model, self.data)

    @staticmethod
    def _physical(angles: list[float]) -> list[float]:
        """MuJoCo's joint positions for servo angles; the gripper's is half the aperture, m."""
        return [*angles[:4], mirte.aperture_from_gripper(angles[4]) / 2]

    def _joint_angles(self) -> list[float]:
        *arm, finger = (float(self.data.qpos[address]) for address in self._arm_positions)
        return [*arm, mirte.gripper_from_aperture(2 * finger)]

    def _step_wheels(self) -> NDArray[np.float64]:
        is_recent = (self.tick - self._command_tick) * TICK_S < mirte.COMMAND_TIMEOUT_S
        drives = is_recent and self.controllers.is_active("mirte_base_controller")
        speeds = self.drive.step(wheels_from_twist(np.array(self._twist if drives else NO_TWIST)), TICK_S)
        self.wheel_angles = self.wheel_angles + speeds * TICK_S
        return speeds

    def _aim_base(self, wheel_speeds: NDArray[np.float64]) -> None:
        vx, vy, wz = twist_from_wheels(wheel_speeds)
        # The slide joints are aligned with the world's axes; use the heading in the middle of this tick.
        yaw = self.data.qpos[2] + wz * TICK_S / 2
        c, s = math.cos(yaw), math.sin(yaw)
        self.data.ctrl[self._base_actuators] = c * vx - s * vy, s * vx + c * vy, wz

    def _step_arm(self) -> None:
        arm: tuple[float | None, ...] = (None,) * 4
        if self.controllers.is_active("mirte_master_arm_controller"):
            arm = self.arm.step(self.time_s)
        gripper = self.gripper_command if self.controllers.is_active("mirte_master_gripper_controller") else None
        self.servos.write([*arm, gripper])
        was_limp = bool(self.model.opt.disableactuator)
        self.model.opt.disableactuator = 0 if self.servos.torque else 1 << robot_model.SERVO_ACTUATOR_GROUP
        targets = self._physical(self.servos.targets(TICK_S))
        if was_limp and self.servos.torque:
            self.data.act[self._servo_activations] = [self.data.qpos[i] for i in self._arm_positions]
        self._aim_servos(targets)

    def _aim_servos(self, physical: list[float]) -> None:
        self.data.ctrl[self._servo_actuators] = physical

    def _touched_object(self) -> str | None:
        """Return the name of an object that touches the robot, except the floor; None without contact."""
        for index in range(self.data.ncon):
            one, other = (int(v) for v in self.data.contact[index].geom)
            if self._is_robot[one] == self._is_robot[other]:
                continue
            touched = other if self._is_robot[one] else one
            if touched != self._floor:
                return str(self.model.geom(touched).name)
        return None
