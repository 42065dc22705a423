"""Publishes the robot's messages at their ticks; expensive ones only if they have subscribers.

Messages are created once and reused, because rclpy checks every field that is assigned, which is expensive for a dozen topics
at 50 Hz.
"""

from __future__ import annotations

import math
import time
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import mujoco
import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from mirte_msgs.msg import IntensityDigital, ServoPosition
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, CameraInfo, CompressedImage, Image, Imu, JointState, LaserScan
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from lupin_runtime import graph
from lupin_runtime.geometry import quaternion_from_yaw
from lupin_runtime.ros import LupinNode, TransformBroadcaster, stamp_from_ns, stamp_ns
from lupin_runtime.ros.tf import to_message
from lupin_runtime.transforms import Quaternion, Transform
from lupin_sim import lidar, mirte, robot_model, urdf
from lupin_sim.cameras import CameraRig, new_image
from lupin_sim.engine import Simulation
from lupin_sim.sensor_faults import SensorFaults
from lupin_sim.servos import NAMES

JPEG_QUALITY = 80
# From the datasheet, as the vendor's driver publishes them. The orientation is not estimated (REP-145: -1).
_GYRO_VARIANCE = math.radians(5.0) ** 2
_ACCELEROMETER_VARIANCE = (0.59**2, 0.59**2, 0.78**2)
# Typical configuration of such a controller: x, y; z, roll and pitch, which are unknown to a planar base; yaw.
_ODOMETRY_VARIANCE = (0.001, 0.001, 1e6, 1e6, 1e6, 0.01)

# (period in ticks of 10 ms, offset in ticks). Scans and images are at ticks that also publish their transform.
SCHEDULE_CLOCK = (1, 0)
SCHEDULE_STATE = (2, 0)
SCHEDULE_SCAN = (10, 2)
SCHEDULE_BODY_IMAGE = (10, 4)
SCHEDULE_GRIPPER_IMAGE = (10, 8)
SCHEDULE_LINKS = (10, 6)
SCHEDULE_BUTTON = (10, 0)
SCHEDULE_SERVO = (10, 0)
SCHEDULE_BATTERY = (100, 0)


def optical_quaternion(rotation: NDArray[np.float64]) -> Quaternion:
    """(x, y, z, w) of a rotation matrix of shape (3, 3)."""
    w, x, y, z = robot_model.quaternion(rotation)
    return x, y, z, w


def _camera_transform(simulation: Simulation, camera: str) -> Transform:
    position, rotation = simulation.camera_pose(camera)
    x, y, z = (float(v) for v in position)
    return Transform((x, y, z), optical_quaternion(rotation))


@dataclass(frozen=True)
class Stamps:
    """The time stamps of messages: simulated time, which the robot then also publishes on /clock, or this computer's clock, as
    on a robot."""

    simulation: Simulation
    faults: SensorFaults
    wall_clock: bool = False

    def true_s(self) -> float:
        """Return the time of this tick in seconds, on the clock of the stamps, without the faults of a sensor's clock."""
        return time.time() if self.wall_clock else self.simulation.time_s

    def now(self) -> Time:
        """Return the stamp of this tick."""
        now_ns = time.time_ns() if self.wall_clock else self.simulation.time_ns
        # A stamp cannot be before the epoch.
        return stamp_from_ns(max(1, now_ns + self.faults.clock_offset_ns))


class StatePublishers:
    """Publishes all topics except the cameras'."""

    def __init__(self, node: LupinNode, stamps: Stamps) -> None:
        self._stamps, self._simulation, self._faults = stamps, stamps.simulation, stamps.faults
        simulation = stamps.simulation
        self._clock, self._clock_message = node.publisher(graph.CLOCK), Clock()
        self._odometry = (node.publisher(graph.ODOM), node.publisher(graph.ODOM_SIM))
        self._odometry_message = _odometry_message()
        self._broadcaster = TransformBroadcaster(node)
        self._tf_odom, self._tf_camera = TransformStamped(), TransformStamped()
        self._tf_odom.header.frame_id, self._tf_odom.child_frame_id = graph.ODOM_FRAME, graph.BASE_FRAME
        self._tf_camera.header.frame_id = graph.BASE_FRAME
        self._tf_camera.child_frame_id = graph.GRIPPER_CAMERA_FRAME
        self._tf = node.publisher(graph.TF)
        self._links = urdf.LinkPoses(simulation.model)
        self._description = node.publisher(graph.ROBOT_DESCRIPTION)
        self._joints, self._joints_message = node.publisher(graph.JOINT_STATES), JointState()
        self._joints_message.name = list(simulation.joints().names)
        self._imu, self._imu_message = node.publisher(graph.IMU), _imu_message()
        self._scan, self._scan_message = node.publisher(graph.SCAN), _scan_message()
        self._button, self._button_message = node.publisher(graph.ESTOP_BUTTON), IntensityDigital()
        self._battery, self._battery_message = node.publisher(graph.BATTERY), _battery_message()
        self._servos = [node.publisher(graph.servo_position(name)) for name in NAMES]
        self._schedule: tuple[tuple[tuple[int, int], Callable[[Time], None]], ...] = (
            *(() if stamps.wall_clock else ((SCHEDULE_CLOCK, self._publish_clock),)),
            (SCHEDULE_STATE, self._publish_odometry),
            (SCHEDULE_STATE, self._publish_joints),
            (SCHEDULE_STATE, self._publish_imu),
            (SCHEDULE_LINKS, self._publish_links),
            (SCHEDULE_SCAN, self._publish_scan),
            (SCHEDULE_BUTTON, self._publish_button),
            (SCHEDULE_SERVO, self._publish_servos),
            (SCHEDULE_BATTERY, self._publish_battery),
        )

    def announce(self) -> None:
        """Publish the static transforms and the URDF."""
        now_ns = self._simulation.time_ns
        sensors = {
            graph.LASER_FRAME: Transform(mirte.LIDAR_POSITION, quaternion_from_yaw(mirte.LIDAR_YAW_RAD)),
            graph.BODY_CAMERA_FRAME: _camera_transform(self._simulation, robot_model.BODY_CAMERA),
        }
        self._broadcaster.send_static(*(to_message(graph.BASE_FRAME, frame, now_ns, at) for frame, at in sensors.items()))
        self._description.publish(String(data=urdf.robot_description(self._simulation.model, sensors)))

    def publish_due(self) -> None:
        """Publish the messages that are due at this tick."""
        stamp = self._stamps.now()
        for (period, offset), publish in self._schedule:
            if self._simulation.tick % period == offset:
                publish(stamp)
        if self._button_message.value != self._simulation.estop_pressed:
            self._publish_button(stamp)  # an edge is published at once

    def _publish_clock(self, stamp: Time) -> None:
        self._clock_message.clock = stamp
        self._clock.publish(self._clock_message)

    def _publish_odometry(self, stamp: Time) -> None:
        transforms = []
        if self._simulation.controllers.is_active("mirte_base_controller") and not self._faults.is_silent("odometry"):
            pose, twist = self._simulation.odometry.pose, self._simulation.odometry.twist
            message = self._odometry_message
            message.header.stamp = stamp
            position, rotation = message.pose.pose.position, message.pose.pose.orientation
            position.x, position.y = pose.x, pose.y
            _, _, rotation.z, rotation.w = quaternion_from_yaw(pose.yaw)
            message.twist.twist.linear.x, message.twist.twist.linear.y, message.twist.twist.angular.z = twist
            for publisher in self._odometry:
                if publisher.get_subscription_count():
                    publisher.publish(message)
            self._tf_odom.header.stamp = stamp
            self._tf_odom.transform.translation.x, self._tf_odom.transform.translation.y = pose.x, pose.y
            self._tf_odom.transform.rotation = rotation
            transforms.append(self._tf_odom)
        if self._simulation.controllers.is_active("joint_state_broadcaster"):
            camera = _camera_transform(self._simulation, robot_model.GRIPPER_CAMERA)
            self._tf_camera.header.stamp = stamp
            t, q = self._tf_camera.transform.translation, self._tf_camera.transform.rotation
            t.x, t.y, t.z = camera.translation
            q.x, q.y, q.z, q.w = camera.rotation
            transforms.append(self._tf_camera)
        if transforms:
            self._tf.publish(TFMessage(transforms=transforms))

    def _publish_joints(self, stamp: Time) -> None:
        if not self._simulation.controllers.is_active("joint_state_broadcaster"):
            return
        joints = self._simulation.joints()
        self._joints_message.header.stamp = stamp
        self._joints_message.position = array("d", joints.positions)
        self._joints_message.velocity = array("d", joints.velocities)
        self._joints.publish(self._joints_message)

    def _publish_links(self, stamp: Time) -> None:
        """Publish the arm's links as robot_state_publisher does, at a lower rate: they are for viewers only."""
        if not self._simulation.controllers.is_active("joint_state_broadcaster"):
            return
        poses = self._links.read(self._simulation.data, self._simulation.servos.angles[-1])
        time_ns = stamp_ns(stamp)
        self._broadcaster.send(
            *(to_message(parent, child, time_ns, pose) for (parent, child), pose in zip(self._links.frames, poses))
        )

    def _publish_imu(self, stamp: Time) -> None:
        sample = self._simulation.imu()
        if not self._imu.get_subscription_count() or self._faults.is_silent("board"):
            return
        message = self._imu_message
        message.header.stamp = stamp
        rate, force = message.angular_velocity, message.linear_acceleration
        rate.x, rate.y, rate.z = sample.gyro
        force.x, force.y, force.z = sample.accelerometer
        self._imu.publish(message)

    def _publish_scan(self, stamp: Time) -> None:
        ranges = self._faults.distort_scan(self._simulation.scan())
        if ranges is None:
            return
        self._scan_message.header.stamp = stamp
        self._scan_message.ranges = array("f", ranges.tobytes())
        self._scan.publish(self._scan_message)

    def _publish_button(self, stamp: Time) -> None:
        if self._faults.is_silent("board"):
            return
        self._button_message.header.stamp = stamp
        self._button_message.value = self._simulation.estop_pressed
        self._button.publish(self._button_message)

    def _publish_servos(self, stamp: Time) -> None:
        for index, publisher in enumerate(self._servos):
            if publisher.get_subscription_count():
                message = ServoPosition()
                message.header.stamp = stamp
                message.angle = self._simulation.servos.angles[index]
                message.raw = self._simulation.servos.raw_counts(index)
                publisher.publish(message)

    def _publish_battery(self, stamp: Time) -> None:
        if self._faults.is_silent("board"):
            return
        message = self._battery_message
        message.header.stamp = stamp
        message.percentage = math.nan if self._faults.modes["battery"] == "nan" else self._simulation.battery
        message.voltage = mirte.battery_volts(self._simulation.battery)
        self._battery.publish(message)


class CameraPublisher:
    """Publishes one camera: raw image, JPEG and calibration. Renders only if there are subscribers."""

    def __init__(
        self,
        node: LupinNode,
        stamps: Stamps,
        topic: graph.Topic,
        camera: str,
        frame: str,
        schedule: tuple[int, int],
    ) -> None:
        self._stamps, self._simulation, self._faults = stamps, stamps.simulation, stamps.faults
        self._camera, self._schedule = camera, schedule
        self._raw = node.publisher(topic)
        self._jpeg = node.publisher(graph.compressed(topic))
        self._info = node.publisher(graph.camera_info(topic))
        self._image = Image(height=mirte.IMAGE_HEIGHT, width=mirte.IMAGE_WIDTH, encoding="rgb8", step=3 * mirte.IMAGE_WIDTH)
        self._image.data = array("B", bytes(new_image().nbytes))
        # Render directly into the message's buffer (read back, since its setter may copy): assigning an array costs 50 ms per
        # frame.
        pixels = np.frombuffer(self._image.data, np.uint8)
        self._pixels = pixels.reshape(mirte.IMAGE_HEIGHT, mirte.IMAGE_WIDTH, 3)
        self._compressed = CompressedImage(format="rgb8; jpeg compressed bgr8")
        self._calibration = _camera_info_message()
        for message in (self._image, self._compressed, self._calibration):
            message.header.frame_id = frame

    def publish_due(self, rig: CameraRig) -> None:
        """Render and publish, if the camera is due at this tick and has subscribers."""
        period, offset = self._schedule
        if self._simulation.tick % period != offset or self._faults.is_silent("camera"):
            return
        stamp = self._stamps.now()
        raw, jpeg = self._raw.get_subscription_count(), self._jpeg.get_subscription_count()
        if raw or jpeg:
            rig.render(self._simulation.data, self._camera, self._pixels)
        # The calibration is first, so that subscribers that pair the two have it when the image arrives.
        if self._info.get_subscription_count():
            self._calibration.header.stamp = stamp
            self._info.publish(self._calibration)
        if raw:
            self._image.header.stamp = stamp
            self._raw.publish(self._image)
        if jpeg:
            ok, encoded = cv2.imencode(
                ".jpg", cv2.cvtColor(self._pixels, cv2.COLOR_RGB2BGR), (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY)
            )
            if not ok:
                raise RuntimeError(f"OpenCV could not encode a frame of {self._camera} as JPEG")
            self._compressed.header.stamp = stamp
            self._compressed.data = array("B", encoded.tobytes())
            self._jpeg.publish(self._compressed)


def camera_publishers(node: LupinNode, stamps: Stamps) -> tuple[CameraPublisher, ...]:
    """Return the publishers of both cameras; with a robot's clock, the body camera has its name on a robot, too."""
    body = graph.BODY_IMAGE_ROBOT if stamps.wall_clock else graph.BODY_IMAGE_SIM
    rows = (
        (body, robot_model.BODY_CAMERA, graph.BODY_CAMERA_FRAME, SCHEDULE_BODY_IMAGE),
        (graph.GRIPPER_IMAGE, robot_model.GRIPPER_CAMERA, graph.GRIPPER_CAMERA_FRAME, SCHEDULE_GRIPPER_IMAGE),
    )
    return tuple(CameraPublisher(node, stamps, *row) for row in rows)


def new_camera_rig(model: mujoco.MjModel) -> CameraRig:
    """Return a renderer for the calling thread; also limits OpenCV to one core."""
    cv2.setNumThreads(1)
    return CameraRig(model)


def _diagonal(variances: tuple[float, ...]) -> NDArray[np.float64]:
    return np.diag(variances).ravel().astype(np.float64)


def _odometry_message() -> Any:
    message = Odometry(child_frame_id=graph.BASE_FRAME)
    message.header.frame_id = graph.ODOM_FRAME
    message.pose.covariance = _diagonal(_ODOMETRY_VARIANCE)
    message.twist.covariance = _diagonal(_ODOMETRY_VARIANCE)
    return message


def _imu_message() -> Any:
    message = Imu()
    message.header.frame_id = graph.BASE_FRAME
    unknown = np.zeros(9)
    unknown[0] = -1.0
    message.orientation_covariance = unknown
    message.angular_velocity_covariance = _diagonal((_GYRO_VARIANCE,) * 3)
    message.linear_acceleration_covariance = _diagonal(_ACCELEROMETER_VARIANCE)
    return message


def _scan_message() -> Any:
    message = LaserScan(
        angle_min=lidar.ANGLE_MIN_RAD,
        angle_max=lidar.ANGLE_MIN_RAD + lidar.ANGLE_STEP_RAD * (mirte.LIDAR_RAYS - 1),
        angle_increment=lidar.ANGLE_STEP_RAD,
        scan_time=0.1,
        range_min=mirte.LIDAR_MIN_M,
        range_max=mirte.LIDAR_MAX_M,
    )
    message.header.frame_id = graph.LASER_FRAME
    return message


def _battery_message() -> Any:
    return BatteryState(
        present=True,
        power_supply_status=BatteryState.POWER_SUPPLY_STATUS_DISCHARGING,
        power_supply_health=BatteryState.POWER_SUPPLY_HEALTH_GOOD,
        power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_LION,
        temperature=math.nan,
        current=-1.5,
        charge=math.nan,
        capacity=math.nan,
        design_capacity=math.nan,
    )


def _camera_info_message() -> Any:
    f = mirte.FOCAL_PX
    cx, cy = mirte.PRINCIPAL_POINT_PX
    message = CameraInfo(height=mirte.IMAGE_HEIGHT, width=mirte.IMAGE_WIDTH, distortion_model="plumb_bob")
    message.d = array("d", [0.0] * 5)
    message.k = np.array([f, 0, cx, 0, f, cy, 0, 0, 1], float)
    message.r = np.eye(3).ravel()
    message.p = np.array([f, 0, cx, 0, 0, f, cy, 0, 0, 0, 1, 0], float)
    return message
