"""The simulated robot as a process: what a stranger on the graph sees of it."""

from __future__ import annotations

import json
import math

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
from lupin_sim.tour import HOME, INSPECT

pytestmark = [pytest.mark.graph, pytest.mark.sim]


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory):
    return tmp_path_factory.mktemp("run")


@pytest.fixture(scope="module")
def robot(start_robot, run_dir):
    robot = start_robot("--world", "demo", "--run-dir", str(run_dir))
    yield robot
    status, complaints = robot.stop()
    assert status == 0, complaints


@pytest.fixture(scope="module")
def stranger(robot, start_stranger):
    stranger = start_stranger()
    stranger.fresh(graph.CLOCK)
    yield stranger
    stranger.close()


def speed(odometry) -> float:
    twist = odometry.twist.twist
    return math.hypot(twist.linear.x, twist.linear.y) + abs(twist.angular.z)


def push(stranger, row: graph.Topic, twist: tuple[float, float, float], seconds: float) -> None:
    """Publish a command at 20 Hz of simulated time for a while."""
    publisher = stranger.node.publisher(row)
    stranger.until(publisher.get_subscription_count, f"a listener on {row.name}")
    start_ns = stamp_ns(stranger.fresh(graph.ODOM).header.stamp)
    message = Twist()
    message.linear.x, message.linear.y, message.angular.z = twist
    while stamp_ns(stranger.newest[graph.ODOM.name].header.stamp) - start_ns < seconds * 1e9:
        publisher.publish(message)
        stranger.fresh(graph.ODOM)
    stranger.node.destroy_publisher(publisher)


# -- what it says -----------------------------------------------------------------------------------------------------
def test_the_clock_runs_and_begins_after_zero(stranger):
    first = stamp_ns(stranger.fresh(graph.CLOCK).clock)
    assert first > 0
    assert stamp_ns(stranger.fresh(graph.CLOCK).clock) > first


def test_scans_look_like_the_vendors(stranger):
    scan = stranger.fresh(graph.SCAN)
    assert scan.header.frame_id == "laser"
    assert len(scan.ranges) == 360
    assert scan.angle_max == pytest.approx(scan.angle_min + 359 * scan.angle_increment, abs=1e-4)
    assert (scan.range_min, scan.range_max) == pytest.approx((0.05, 12.0))
    ranges = np.array(scan.ranges)
    assert np.isfinite(ranges).mean() > 0.9
    # The start of `demo` is 1.0 m from the west wall and 0.9 m from the south one. Beam 0 looks to the right,
    # beam 90 ahead, beam 270 astern: the vendor mounts the sensor a quarter turn to the left.
    assert ranges[268:273].mean() == pytest.approx(1.0, abs=0.05)
    assert ranges[np.r_[358:360, 0:3]].mean() == pytest.approx(0.9, abs=0.05)


def test_transforms_join_all_the_robots_frames(stranger):
    tree = TransformListener(stranger.node).tree

    def joined() -> bool:
        try:
            for frame in (graph.LASER_FRAME, graph.BODY_CAMERA_FRAME, graph.GRIPPER_CAMERA_FRAME):
                tree.lookup(graph.ODOM_FRAME, frame)
        except LookupError:
            return False
        return True

    stranger.until(joined, "a transform from odom to every sensor")
    laser = tree.lookup(graph.BASE_FRAME, graph.LASER_FRAME)
    assert laser.translation == pytest.approx(mirte.LIDAR_POSITION)
    assert laser.rotation == pytest.approx((0, 0, math.sqrt(0.5), math.sqrt(0.5)), abs=1e-6)
    body = tree.lookup(graph.BASE_FRAME, graph.BODY_CAMERA_FRAME)
    assert body.translation == pytest.approx(mirte.BODY_CAMERA_POSITION, abs=1e-6)
    # Looking ahead: optical z is base x, optical x is base -y.
    assert np.abs(body.rotation) == pytest.approx((0.5, 0.5, 0.5, 0.5), abs=1e-6)
    gripper = tree.lookup(graph.BASE_FRAME, graph.GRIPPER_CAMERA_FRAME)
    assert gripper.translation[2] == pytest.approx(0.536, abs=0.01)


@pytest.mark.parametrize("row", [graph.BODY_IMAGE_SIM, graph.GRIPPER_IMAGE], ids=lambda row: row.name)
def test_pictures_come_raw_as_jpeg_and_with_their_calibration(graphics, stranger, row):
    raw = stranger.fresh(row)
    assert (raw.width, raw.height, raw.encoding, raw.step) == (640, 480, "rgb8", 1920)
    picture = np.frombuffer(raw.data, np.uint8).reshape(480, 640, 3)
    assert picture.std() > 10
    jpeg = stranger.fresh(graph.compressed(row))
    decoded = cv2.cvtColor(cv2.imdecode(np.frombuffer(jpeg.data, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    assert np.abs(decoded.astype(int) - picture).mean() < 5
    info = stranger.fresh(graph.camera_info(row))
    assert info.header.frame_id == raw.header.frame_id
    assert info.k == pytest.approx([554.256, 0, 319.5, 0, 554.256, 239.5, 0, 0, 1], abs=1e-2)
    assert list(info.d) == [0.0] * 5


def test_imu_and_joint_states_have_their_names(stranger):
    imu = stranger.fresh(graph.IMU)
    assert imu.linear_acceleration.z == pytest.approx(9.81, abs=0.3)
    assert imu.orientation_covariance[0] == -1.0
    joints = stranger.fresh(graph.JOINT_STATES)
    assert set(joints.name) == {*graph.ARM_JOINTS, graph.GRIPPER_JOINT, *graph.WHEEL_JOINTS}


def test_the_truth_is_in_files_and_not_on_the_graph(stranger, run_dir):
    truth = json.loads((run_dir / "truth.json").read_text())
    assert truth["world"] == "demo"
    state_file = run_dir / "sim_state.json"
    stranger.until(state_file.exists, "the first state")
    state = json.loads(state_file.read_text())
    assert state["collisions"] == 0
    names = [name for name, _ in stranger.node.get_topic_names_and_types()]
    assert not [name for name in names if "truth" in name]


# -- driving ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("row", [graph.CMD_VEL_SINK_SIM, graph.CMD_VEL_SINK_ROBOT], ids=lambda row: row.name)
def test_both_sinks_drive_and_silence_stops_the_wheels(stranger, row):
    push(stranger, row, (0.1, 0.0, 0.0), 0.8)
    moving = stranger.fresh(graph.ODOM)
    assert moving.twist.twist.linear.x == pytest.approx(0.1, abs=0.02)
    silent_ns = stamp_ns(moving.header.stamp)
    still = stranger.until(
        lambda: stranger.newest[graph.ODOM.name] if speed(stranger.newest[graph.ODOM.name]) < 0.01 else None, "a stop"
    )
    # A quarter second of patience, a quarter second of braking.
    assert stamp_ns(still.header.stamp) - silent_ns < 0.5e9


def test_a_command_of_nan_stops_the_wheels(stranger):
    push(stranger, graph.CMD_VEL_SINK_SIM, (0.0, 0.1, 0.0), 0.5)
    push(stranger, graph.CMD_VEL_SINK_SIM, (math.nan, 0.0, 0.0), 0.5)
    assert speed(stranger.fresh(graph.ODOM)) < 0.01


# -- controllers ------------------------------------------------------------------------------------------------------
def test_five_controllers_are_active_and_a_base_without_its_own_is_silent(stranger):
    listed = stranger.call(graph.LIST_CONTROLLERS, ListControllers.Request()).controller
    assert {c.name: c.state for c in listed} == dict.fromkeys(graph.CONTROLLERS, "active")
    stranger.fresh(graph.ODOM)
    request = SwitchController.Request(deactivate_controllers=["mirte_base_controller"], strictness=2)
    assert stranger.call(graph.SWITCH_CONTROLLER, request).ok
    stranger.fresh(graph.SCAN)  # what was on its way has arrived by then
    before = stranger.count[graph.ODOM.name]
    stranger.fresh(graph.SCAN)
    stranger.fresh(graph.SCAN)
    assert stranger.count[graph.ODOM.name] <= before + 1
    request = SwitchController.Request(activate_controllers=["mirte_base_controller"], strictness=2)
    assert stranger.call(graph.SWITCH_CONTROLLER, request).ok
    stranger.fresh(graph.ODOM)


# -- arm and gripper --------------------------------------------------------------------------------------------------
def trajectory(point, seconds=1.0, joints=graph.ARM_JOINTS) -> JointTrajectory:
    moment = Duration(sec=int(seconds), nanosec=round(seconds % 1 * 1e9))
    return JointTrajectory(
        joint_names=list(joints),
        points=[JointTrajectoryPoint(positions=[float(v) for v in point], time_from_start=moment)],
    )


def arm(stranger) -> list[float]:
    message = stranger.fresh(graph.JOINT_STATES)
    return [message.position[message.name.index(joint)] for joint in graph.ARM_JOINTS]


def test_the_arm_takes_whole_goals_from_the_topic_and_no_partial_ones(stranger):
    publisher = stranger.node.publisher(graph.ARM_TRAJECTORY)
    stranger.until(publisher.get_subscription_count, "the arm controller")
    publisher.publish(trajectory(INSPECT))
    publisher.publish(trajectory((1.0,), joints=graph.ARM_JOINTS[:1]))
    publisher.publish(trajectory((math.nan, 0, 0, 0)))
    stranger.until(lambda: np.allclose(arm(stranger), INSPECT, atol=0.04), "the arm at its goal")
    stranger.node.destroy_publisher(publisher)


def test_the_arms_action_succeeds_and_can_be_cancelled(stranger):
    client = stranger.node.action_client(graph.ARM_FOLLOW_TRAJECTORY)
    stranger.until(client.server_is_ready, "the arm's action")
    goal = stranger.wait(client.send_goal_async(FollowJointTrajectory.Goal(trajectory=trajectory(HOME, 0.6))))
    assert goal.accepted
    result = stranger.wait(goal.get_result_async())
    assert (result.status, result.result.error_code) == (4, FollowJointTrajectory.Result.SUCCESSFUL)
    goal = stranger.wait(client.send_goal_async(FollowJointTrajectory.Goal(trajectory=trajectory(INSPECT, 8.0))))
    stranger.wait(goal.cancel_goal_async())
    assert stranger.wait(goal.get_result_async()).status == 5
    # It stays where the cancel caught it.
    held = arm(stranger)
    assert np.abs(np.array(held) - HOME).max() < 0.4
    refused = FollowJointTrajectory.Goal(trajectory=trajectory((0, 0), joints=graph.ARM_JOINTS[:2]))
    assert not stranger.wait(client.send_goal_async(refused)).accepted
    client.destroy()


def test_the_gripper_closes_on_request(stranger):
    client = stranger.node.action_client(graph.GRIPPER_COMMAND)
    stranger.until(client.server_is_ready, "the gripper's action")
    goal = GripperCommand.Goal()
    goal.command.position, goal.command.max_effort = 0.2, 2.0
    result = stranger.wait(stranger.wait(client.send_goal_async(goal)).get_result_async())
    assert result.status == 4
    assert result.result.reached_goal
    assert result.result.position == pytest.approx(0.2, abs=0.05)
    goal.command.position = math.nan
    assert not stranger.wait(client.send_goal_async(goal)).accepted
    client.destroy()


def test_servo_services_answer(stranger):
    limits = stranger.call(graph.servo_range("elbow"), GetServoRange.Request())
    assert (limits.min, limits.max) == pytest.approx((math.radians(-116.3), math.radians(92.5)), abs=1e-5)
    assert stranger.call(graph.VENDOR_TORQUE, SetBool.Request(data=True)).success
    assert stranger.call(graph.VENDOR_ARM_GATE, SetBool.Request(data=True)).success
    request = SetNeopixel.Request()
    request.color.r = 255
    assert stranger.call(graph.VENDOR_LEDS, request).status


# -- button and battery -----------------------------------------------------------------------------------------------
def test_the_red_button_reports_and_does_not_cut_the_power(stranger):
    assert not stranger.fresh(graph.ESTOP_BUTTON).value
    assert stranger.call(graph.SIM_PRESS_ESTOP, SetBool.Request(data=True)).success
    stranger.until(lambda: stranger.fresh(graph.ESTOP_BUTTON).value, "the button pressed")
    push(stranger, graph.CMD_VEL_SINK_SIM, (0.0, 0.0, 0.3), 0.4)
    assert speed(stranger.fresh(graph.ODOM)) > 0.2
    assert stranger.call(graph.SIM_PRESS_ESTOP, SetBool.Request(data=False)).success
    stranger.until(lambda: not stranger.fresh(graph.ESTOP_BUTTON).value, "the button released")


def test_the_battery_can_be_emptied_by_hand(stranger):
    assert 0.8 < stranger.fresh(graph.BATTERY).percentage <= 0.9
    publisher = stranger.node.publisher(graph.SIM_BATTERY)
    stranger.until(publisher.get_subscription_count, "a listener")
    for value in (math.nan, 7.0, 0.15):
        publisher.publish(Float32(data=value))
    stranger.until(lambda: stranger.fresh(graph.BATTERY).percentage < 0.2, "a low battery")
    assert stranger.newest[graph.BATTERY.name].voltage < 11.3
    stranger.node.destroy_publisher(publisher)


def said_nothing_for(stranger, row: graph.Topic, scans: int) -> bool:
    """Whether as many scans came without a message of that topic between them."""
    last = stranger.newest.get(row.name)
    for _ in range(scans):
        stranger.fresh(graph.SCAN)
    return stranger.newest.get(row.name) is last


# -- faults -----------------------------------------------------------------------------------------------------------
def test_a_broken_lidar_and_a_jumping_clock_show_on_the_graph(stranger):
    publisher = stranger.node.publisher(graph.SIM_FAULT)
    stranger.until(publisher.get_subscription_count, "a listener")

    def order(text: str) -> None:
        publisher.publish(String(data=text))

    order("scan nan")
    stranger.until(lambda: np.isnan(stranger.fresh(graph.SCAN).ranges).all(), "a scan of NaN")
    order("scan none")
    stranger.until(lambda: np.isfinite(stranger.fresh(graph.SCAN).ranges).any(), "a sound scan")
    order("battery nan")
    stranger.until(lambda: math.isnan(stranger.fresh(graph.BATTERY).percentage), "a charge that is no number")
    order("battery none")
    stranger.until(lambda: math.isfinite(stranger.fresh(graph.BATTERY).percentage), "a charge")
    stranger.fresh(graph.ESTOP_BUTTON)
    order("board silent")
    stranger.until(lambda: said_nothing_for(stranger, graph.ESTOP_BUTTON, scans=5), "a silent button")
    order("board none")
    stranger.fresh(graph.ESTOP_BUTTON)
    before = stranger.fresh(graph.CLOCK).clock.sec
    order("clock 100")
    stranger.until(lambda: stranger.fresh(graph.CLOCK).clock.sec > before + 50, "a jump ahead")
    order("clock -100")
    stranger.until(lambda: stranger.fresh(graph.CLOCK).clock.sec < before + 50, "a jump back")
    stranger.node.destroy_publisher(publisher)
