"""The simulated robot as a process, seen by a client on its ROS graph."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install ./interfaces")

from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory, GripperCommand
from controller_manager_msgs.srv import (
    ListControllers,
    SwitchController,
)
from geometry_msgs.msg import Twist
from mirte_msgs.srv import GetServoRange, SetNeopixel
from std_msgs.msg import Float32, String
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from lupin_runtime import graph
from lupin_runtime.ros import TransformListener, stamp_ns
from lupin_sim import mirte
from lupin_sim.flythrough import HOME, INSPECT

if TYPE_CHECKING:
    from nav_msgs.msg import Odometry

    from lupin_runtime.graph import Topic
    from tests.lupin_sim.conftest import GraphClient, RobotProcess

pytestmark = [pytest.mark.graph, pytest.mark.sim]


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("run")


@pytest.fixture(scope="module")
def robot(start_robot: type[RobotProcess], run_dir: Path) -> Iterator[RobotProcess]:
    robot = start_robot("--world", "demo", "--run-dir", str(run_dir))
    yield robot
    status, stderr = robot.stop()
    assert status == 0, stderr


@pytest.fixture(scope="module")
def client(robot: RobotProcess, join_graph: type[GraphClient]) -> Iterator[GraphClient]:  # noqa: ARG001 -- the fixture must have run
    client = join_graph()
    client.next_message(graph.CLOCK)
    yield client
    client.close()


def speed(odometry: Odometry) -> float:
    twist = odometry.twist.twist
    result: float = math.hypot(twist.linear.x, twist.linear.y) + abs(twist.angular.z)
    return result


def publish_twist(client: GraphClient, row: graph.Topic, twist: tuple[float, float, float], seconds: float) -> None:
    """Publish a twist for `seconds` of simulated time, once per odometry message."""
    publisher = client.node.publisher(row)
    client.spin_until(publisher.get_subscription_count, f"a subscription to {row.name}")
    start_ns = stamp_ns(client.next_message(graph.ODOM).header.stamp)
    message = Twist()
    message.linear.x, message.linear.y, message.angular.z = twist
    while stamp_ns(client.newest[graph.ODOM.name].header.stamp) - start_ns < seconds * 1e9:
        publisher.publish(message)
        client.next_message(graph.ODOM)
    client.node.destroy_publisher(publisher)


# -- published topics -----------------------------------------------------------------------------------------------------
def test_clock_advances_and_starts_above_zero(client: GraphClient) -> None:
    first = stamp_ns(client.next_message(graph.CLOCK).clock)
    assert first > 0
    assert stamp_ns(client.next_message(graph.CLOCK).clock) > first


def test_scans_have_the_vendors_format(client: GraphClient) -> None:
    scan = client.next_message(graph.SCAN)
    assert scan.header.frame_id == "laser"
    assert len(scan.ranges) == 360
    assert scan.angle_max == pytest.approx(scan.angle_min + 359 * scan.angle_increment, abs=1e-4)
    assert (scan.range_min, scan.range_max) == pytest.approx((0.05, 12.0))
    ranges = np.array(scan.ranges)
    assert np.isfinite(ranges).mean() > 0.9
    # The start of `demo` is 1.0 m from the west wall and 0.9 m from the south one. Beam 0 points to the right,
    # beam 90 forward, beam 270 backward: the vendor mounts the sensor a quarter turn to the left.
    assert ranges[268:273].mean() == pytest.approx(1.0, abs=0.05)
    assert ranges[np.r_[358:360, 0:3]].mean() == pytest.approx(0.9, abs=0.05)


def test_transforms_connect_all_frames(client: GraphClient) -> None:
    tree = TransformListener(client.node).tree

    def all_connected() -> bool:
        try:
            for frame in (graph.LASER_FRAME, graph.BODY_CAMERA_FRAME, graph.GRIPPER_CAMERA_FRAME):
                tree.lookup(graph.ODOM_FRAME, frame)
        except LookupError:
            return False
        return True

    client.spin_until(all_connected, "a transform from odom to every sensor")
    laser = tree.lookup(graph.BASE_FRAME, graph.LASER_FRAME)
    assert laser.translation == pytest.approx(mirte.LIDAR_POSITION)
    assert laser.rotation == pytest.approx((0, 0, math.sqrt(0.5), math.sqrt(0.5)), abs=1e-6)
    body = tree.lookup(graph.BASE_FRAME, graph.BODY_CAMERA_FRAME)
    assert body.translation == pytest.approx(mirte.BODY_CAMERA_POSITION, abs=1e-6)
    # The camera looks forward: optical z is base x, optical x is base -y.
    assert np.abs(body.rotation) == pytest.approx((0.5, 0.5, 0.5, 0.5), abs=1e-6)
    gripper = tree.lookup(graph.BASE_FRAME, graph.GRIPPER_CAMERA_FRAME)
    assert gripper.translation[2] == pytest.approx(0.536, abs=0.01)


def test_links_of_the_description_are_frames(client: GraphClient) -> None:
    tree = TransformListener(client.node).tree
    description = client.next_message(graph.ROBOT_DESCRIPTION).data
    links = [link.attrib["name"] for link in ElementTree.fromstring(description).iter("link")]
    assert {graph.BASE_FRAME, graph.LASER_FRAME, "shoulder_pan", "wrist", "gripper"} <= set(links)

    def all_connected() -> bool:
        try:
            for link in links:
                tree.lookup(graph.BASE_FRAME, link)
        except LookupError:
            return False
        return True

    client.spin_until(all_connected, "a transform from base_link to every link")


@pytest.mark.usefixtures("graphics")
@pytest.mark.parametrize("row", [graph.BODY_IMAGE_SIM, graph.GRIPPER_IMAGE], ids=lambda row: row.name)
def test_images_are_published_raw_as_jpeg_and_with_calibration(client: GraphClient, row: Topic) -> None:
    raw = client.next_message(row)
    assert (raw.width, raw.height, raw.encoding, raw.step) == (640, 480, "rgb8", 1920)
    picture = np.frombuffer(raw.data, np.uint8).reshape(480, 640, 3)
    assert picture.std() > 10
    jpeg = client.next_message(graph.compressed(row))
    decoded = cv2.cvtColor(cv2.imdecode(np.frombuffer(jpeg.data, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    assert np.abs(decoded.astype(int) - picture).mean() < 5
    info = client.next_message(graph.camera_info(row))
    assert info.header.frame_id == raw.header.frame_id
    assert info.k == pytest.approx([554.256, 0, 319.5, 0, 554.256, 239.5, 0, 0, 1], abs=1e-2)
    assert list(info.d) == [0.0] * 5


def test_imu_and_joint_states_have_the_vendors_format(client: GraphClient) -> None:
    imu = client.next_message(graph.IMU)
    assert imu.linear_acceleration.z == pytest.approx(9.81, abs=0.3)
    assert imu.orientation_covariance[0] == -1.0
    joints = client.next_message(graph.JOINT_STATES)
    assert set(joints.name) == {*graph.ARM_JOINTS, graph.GRIPPER_JOINT, *graph.WHEEL_JOINTS}


def test_ground_truth_is_in_files_and_not_on_the_graph(client: GraphClient, run_dir: Path) -> None:
    truth = json.loads((run_dir / "truth.json").read_text())
    assert truth["world"] == "demo"
    state_file = run_dir / "sim_state.json"
    client.spin_until(state_file.exists, "the first state")
    state = json.loads(state_file.read_text())
    assert state["collisions"] == 0
    names = [name for name, _ in client.node.get_topic_names_and_types()]
    assert not [name for name in names if "truth" in name]


# -- driving ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("row", [graph.CMD_VEL_SINK_SIM, graph.CMD_VEL_SINK_ROBOT], ids=lambda row: row.name)
def test_both_twist_topics_drive_and_silence_stops_the_wheels(client: GraphClient, row: Topic) -> None:
    publish_twist(client, row, (0.1, 0.0, 0.0), 0.8)
    moving = client.next_message(graph.ODOM)
    assert moving.twist.twist.linear.x == pytest.approx(0.1, abs=0.02)
    silent_ns = stamp_ns(moving.header.stamp)
    still = client.spin_until(
        lambda: client.newest[graph.ODOM.name] if speed(client.newest[graph.ODOM.name]) < 0.01 else None, "a stop"
    )
    # 0.25 s until the command times out, and 0.25 s of braking.
    assert stamp_ns(still.header.stamp) - silent_ns < 0.5e9  # type: ignore[union-attr]


def test_twist_with_nan_stops_the_wheels(client: GraphClient) -> None:
    publish_twist(client, graph.CMD_VEL_SINK_SIM, (0.0, 0.1, 0.0), 0.5)
    publish_twist(client, graph.CMD_VEL_SINK_SIM, (math.nan, 0.0, 0.0), 0.5)
    assert speed(client.next_message(graph.ODOM)) < 0.01


# -- controllers ------------------------------------------------------------------------------------------------------
def test_base_without_its_controller_publishes_no_odometry(client: GraphClient) -> None:
    listed = client.call(graph.LIST_CONTROLLERS, ListControllers.Request()).controller
    assert {c.name: c.state for c in listed} == dict.fromkeys(graph.CONTROLLERS, "active")
    client.next_message(graph.ODOM)
    request = SwitchController.Request(deactivate_controllers=["mirte_base_controller"], strictness=2)
    assert client.call(graph.SWITCH_CONTROLLER, request).ok
    client.next_message(graph.SCAN)  # may have been sent before the switch
    switched = client.next_message(graph.SCAN).header.stamp
    client.next_message(graph.SCAN)
    client.next_message(graph.SCAN)
    assert stamp_ns(client.newest[graph.ODOM.name].header.stamp) <= stamp_ns(switched)
    request = SwitchController.Request(activate_controllers=["mirte_base_controller"], strictness=2)
    assert client.call(graph.SWITCH_CONTROLLER, request).ok
    client.next_message(graph.ODOM)


# -- arm and gripper --------------------------------------------------------------------------------------------------
def trajectory(point: tuple[Any, ...], seconds: float = 1.0, joints: tuple[Any, ...] = graph.ARM_JOINTS) -> JointTrajectory:
    moment = Duration(sec=int(seconds), nanosec=round(seconds % 1 * 1e9))
    return JointTrajectory(
        joint_names=list(joints),
        points=[JointTrajectoryPoint(positions=[float(v) for v in point], time_from_start=moment)],
    )


def arm(client: GraphClient) -> list[float]:
    message = client.next_message(graph.JOINT_STATES)
    return [message.position[message.name.index(joint)] for joint in graph.ARM_JOINTS]


def test_arm_topic_accepts_complete_trajectories_only(client: GraphClient) -> None:
    publisher = client.node.publisher(graph.ARM_TRAJECTORY)
    client.spin_until(publisher.get_subscription_count, "the arm controller")
    publisher.publish(trajectory(INSPECT))
    publisher.publish(trajectory((1.0,), joints=graph.ARM_JOINTS[:1]))
    publisher.publish(trajectory((math.nan, 0, 0, 0)))
    client.spin_until(lambda: np.allclose(arm(client), INSPECT, atol=0.04), "the arm at its goal")
    client.node.destroy_publisher(publisher)


def test_arm_action_succeeds_and_can_be_cancelled(client: GraphClient) -> None:
    action = client.node.action_client(graph.ARM_FOLLOW_TRAJECTORY)
    client.spin_until(action.server_is_ready, "the arm's action")
    goal = client.result(action.send_goal_async(FollowJointTrajectory.Goal(trajectory=trajectory(HOME, 0.6))))
    assert goal.accepted
    result = client.result(goal.get_result_async())
    assert (result.status, result.result.error_code) == (4, FollowJointTrajectory.Result.SUCCESSFUL)
    goal = client.result(action.send_goal_async(FollowJointTrajectory.Goal(trajectory=trajectory(INSPECT, 8.0))))
    client.result(goal.cancel_goal_async())
    assert client.result(goal.get_result_async()).status == 5
    # The arm holds the position that it had at the cancel.
    held = arm(client)
    assert np.abs(np.array(held) - HOME).max() < 0.4
    refused = FollowJointTrajectory.Goal(trajectory=trajectory((0, 0), joints=graph.ARM_JOINTS[:2]))
    assert not client.result(action.send_goal_async(refused)).accepted
    action.destroy()


def test_gripper_action_closes_the_gripper(client: GraphClient) -> None:
    action = client.node.action_client(graph.GRIPPER_COMMAND)
    client.spin_until(action.server_is_ready, "the gripper's action")
    goal = GripperCommand.Goal()
    goal.command.position, goal.command.max_effort = 0.2, 2.0
    result = client.result(client.result(action.send_goal_async(goal)).get_result_async())
    assert result.status == 4
    assert result.result.reached_goal
    assert result.result.position == pytest.approx(0.2, abs=0.05)
    goal.command.position = math.nan
    assert not client.result(action.send_goal_async(goal)).accepted
    action.destroy()


def test_servo_services_reply(client: GraphClient) -> None:
    limits = client.call(graph.servo_range("elbow"), GetServoRange.Request())
    assert (limits.min, limits.max) == pytest.approx((math.radians(-116.3), math.radians(92.5)), abs=1e-5)
    assert client.call(graph.VENDOR_TORQUE, SetBool.Request(data=True)).success
    assert client.call(graph.VENDOR_ARM_GATE, SetBool.Request(data=True)).success
    request = SetNeopixel.Request()
    request.color.r = 255
    assert client.call(graph.VENDOR_LEDS, request).status


# -- button and battery -----------------------------------------------------------------------------------------------
def test_estop_button_is_published_and_does_not_stop_the_wheels(client: GraphClient) -> None:
    assert not client.next_message(graph.ESTOP_BUTTON).value
    assert client.call(graph.SIM_PRESS_ESTOP, SetBool.Request(data=True)).success
    client.spin_until(lambda: client.next_message(graph.ESTOP_BUTTON).value, "the button pressed")
    publish_twist(client, graph.CMD_VEL_SINK_SIM, (0.0, 0.0, 0.3), 0.4)
    assert speed(client.next_message(graph.ODOM)) > 0.2
    assert client.call(graph.SIM_PRESS_ESTOP, SetBool.Request(data=False)).success
    client.spin_until(lambda: not client.next_message(graph.ESTOP_BUTTON).value, "the button released")


def test_battery_fraction_can_be_set(client: GraphClient) -> None:
    assert 0.8 < client.next_message(graph.BATTERY).percentage <= 0.9
    publisher = client.node.publisher(graph.SIM_BATTERY)
    client.spin_until(publisher.get_subscription_count, "a subscription")
    for value in (math.nan, 7.0, 0.15):
        publisher.publish(Float32(data=value))
    client.spin_until(lambda: client.next_message(graph.BATTERY).percentage < 0.2, "a low battery")
    assert client.newest[graph.BATTERY.name].voltage < 11.3
    client.node.destroy_publisher(publisher)


def is_silent_for(client: GraphClient, row: graph.Topic, scans: int) -> bool:
    """Return whether no message of a topic arrives during this number of scans."""
    last = client.newest.get(row.name)
    for _ in range(scans):
        client.next_message(graph.SCAN)
    return client.newest.get(row.name) is last


# -- faults -----------------------------------------------------------------------------------------------------------
def test_sensor_faults_and_clock_jumps_are_visible_on_the_graph(client: GraphClient) -> None:
    publisher = client.node.publisher(graph.SIM_FAULT)
    client.spin_until(publisher.get_subscription_count, "a subscription")

    def set_fault(text: str) -> None:
        publisher.publish(String(data=text))

    set_fault("scan nan")
    client.spin_until(lambda: np.isnan(client.next_message(graph.SCAN).ranges).all(), "a scan of NaN")
    set_fault("scan none")
    client.spin_until(lambda: np.isfinite(client.next_message(graph.SCAN).ranges).any(), "a normal scan")
    set_fault("battery nan")
    client.spin_until(lambda: math.isnan(client.next_message(graph.BATTERY).percentage), "a charge of NaN")
    set_fault("battery none")
    client.spin_until(lambda: math.isfinite(client.next_message(graph.BATTERY).percentage), "a charge")
    client.next_message(graph.ESTOP_BUTTON)
    set_fault("board silent")
    client.spin_until(lambda: is_silent_for(client, graph.ESTOP_BUTTON, scans=5), "silence of the button")
    set_fault("board none")
    client.next_message(graph.ESTOP_BUTTON)
    before = client.next_message(graph.CLOCK).clock.sec
    set_fault("clock 100")
    client.spin_until(lambda: client.next_message(graph.CLOCK).clock.sec > before + 50, "a jump forward")
    set_fault("clock -100")
    client.spin_until(lambda: client.next_message(graph.CLOCK).clock.sec < before + 50, "a jump back")
    client.node.destroy_publisher(publisher)
