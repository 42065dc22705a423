"""The node on a real graph, with a kinematic robot in the test's process."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2

if TYPE_CHECKING:
    from nav2_msgs.action import NavigateThroughPoses_Goal, NavigateToPose_Goal

    from lupin_runtime.graph import Action

pytestmark = pytest.mark.graph

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


def test_goal_gives_feedback_and_ends_with_zero_velocity(pilot: Any) -> None:
    handle = pilot.send(pilot.goal(3.2, 2.0, math.pi / 2))
    assert handle.accepted
    answer = pilot.result(handle)
    assert (answer.status, answer.result.error_code) == (SUCCEEDED, 0)
    assert pilot.robot.base.truth.distance_to(Pose2(3.2, 2.0)) < 0.25
    assert abs(pilot.robot.base.truth.yaw - math.pi / 2) < 0.12
    pilot.host.until(pilot.ends_with_zero)
    distances = [message.distance_remaining for message in pilot.feedback if message.distance_remaining > 0.0]
    assert distances[0] > 3.0 > 0.7 > distances[-1]
    assert pilot.feedback[-1].navigation_time.sec >= 3


def test_cancelling_all_goals_stops_the_robot(pilot: Any) -> None:
    from action_msgs.srv import CancelGoal

    handle = pilot.send(pilot.goal(3.2, 2.0))
    pilot.host.until(pilot.driving, what="motion")
    cancel = pilot.node.create_client(CancelGoal, "/navigate_to_pose/_action/cancel_goal")
    pilot.host.until(cancel.service_is_ready)
    future = cancel.call_async(CancelGoal.Request())  # the all-zero UUID and stamp mean every goal
    pilot.host.until(future.done)
    assert len(future.result().goals_canceling) == 1
    assert pilot.result(handle).status == CANCELED
    pilot.host.until(pilot.at_rest, what="rest")
    assert pilot.ends_with_zero()


def test_new_goal_aborts_the_old_one(pilot: Any) -> None:
    first = pilot.send(pilot.goal(3.2, 2.0))
    pilot.host.until(pilot.driving, what="motion")
    # Not the start: it would be reached at once, while the robot coasts away from it for as long as its last pose is old.
    second = pilot.send(pilot.goal(0.7, 2.2))
    answer = pilot.result(first)
    assert answer.status == ABORTED
    assert "newer goal" in answer.result.error_msg
    assert pilot.result(second).status == SUCCEEDED
    assert pilot.robot.base.truth.distance_to(Pose2(0.7, 2.2)) < 0.25


def test_goal_in_a_bench_aborts_before_the_robot_moves(pilot: Any) -> None:
    from nav2_msgs.action import ComputePathToPose

    answer = pilot.result(pilot.send(pilot.goal(2.0, 2.2)))
    assert answer.status == ABORTED
    assert answer.result.error_code == ComputePathToPose.Result.GOAL_OCCUPIED
    assert "from an obstacle" in answer.result.error_msg
    assert all(command == (0.0, 0.0, 0.0) for command in pilot.robot.commands)


@pytest.mark.parametrize(("x", "yaw", "frame"), [(math.nan, 0.0, "map"), (1.0, math.inf, "map"), (1.0, 0.0, "nowhere")])
def test_goals_that_are_no_map_poses_are_aborted_with_reason(pilot: Any, x: float, yaw: float, frame: str) -> None:
    from nav2_msgs.action import ComputePathToPose

    driving = pilot.send(pilot.goal(3.2, 2.0))
    pilot.host.until(pilot.driving, what="motion")
    goal = pilot.goal(1.0, 1.0, 0.0, frame)
    goal.pose.pose.position.x = x
    if not math.isfinite(yaw):
        goal.pose.pose.orientation.z = yaw
    answer = pilot.result(pilot.send(goal))
    code, words = {
        "map": (ComputePathToPose.Result.UNKNOWN, "finite"),
        "nowhere": (ComputePathToPose.Result.TF_ERROR, "'nowhere'"),
    }[frame]
    assert (answer.status, answer.result.error_code) == (ABORTED, code)
    assert words in answer.result.error_msg
    assert pilot.result(driving).status == SUCCEEDED  # as with Nav2, the goal that was active goes on


def test_goal_in_the_robot_frame_is_transformed(pilot: Any) -> None:
    answer = pilot.result(pilot.send(pilot.goal(0.5, 0.0, 0.0, graph.BASE_FRAME)))
    assert answer.status == SUCCEEDED
    assert pilot.robot.base.truth.distance_to(Pose2(1.1, 0.6)) < 0.25


@pytest.mark.parametrize("mode", ["frozen", "nan", "zero", "silent"])
def test_blind_lidar_stops_the_robot_until_it_recovers(pilot: Any, mode: str) -> None:
    handle = pilot.send(pilot.goal(3.2, 2.0))
    pilot.host.until(pilot.driving, what="motion")
    pilot.robot.scan_mode = mode
    pilot.host.until(lambda: pilot.at_rest() and pilot.ends_with_zero(), what=f"a halt under a {mode} scan")
    assert pilot.robot.base.truth.distance_to(Pose2(3.2, 2.0)) > 0.5, "it halts on its way"
    pilot.robot.scan_mode = "good"
    assert pilot.result(handle).status == SUCCEEDED


def test_poses_older_than_the_scans_stop_the_robot(pilot: Any) -> None:
    handle = pilot.send(pilot.goal(3.2, 2.0))
    pilot.host.until(pilot.driving, what="motion")
    pilot.robot.late_steps = 25
    pilot.host.until(lambda: pilot.at_rest() and pilot.ends_with_zero(), what="a halt with old poses")
    assert pilot.robot.base.truth.distance_to(Pose2(3.2, 2.0)) > 0.5, "it halts on its way"
    pilot.host.until(lambda: "is known from" in (pilot.navigator._robot_state.lidar_fault() or ""), what="the cause")
    pilot.robot.late_steps = 0
    assert pilot.result(handle).status == SUCCEEDED


def test_lidar_that_hangs_upside_down_keeps_off_walls(pilot: Any) -> None:
    pilot.robot.mount_lidar(math.pi)
    assert pilot.result(pilot.send(pilot.goal(3.2, 2.0))).status == SUCCEEDED  # the fixture counts collisions


def test_tilted_lidar_stops_the_robot_and_is_named(pilot: Any) -> None:
    handle = pilot.send(pilot.goal(3.2, 2.0))
    pilot.host.until(pilot.driving, what="motion")
    pilot.robot.mount_lidar(math.radians(30.0))
    pilot.host.until(lambda: pilot.at_rest() and pilot.ends_with_zero(), what="a halt under a tilted lidar")
    assert pilot.robot.base.truth.distance_to(Pose2(3.2, 2.0)) > 0.5, "it halts on its way"
    assert "'laser' is tilted by 30 degrees" in pilot.navigator._robot_state.lidar_fault()
    pilot.robot.mount_lidar(0.0)
    assert pilot.result(handle).status == SUCCEEDED


@pytest.mark.parametrize("action", [graph.NAVIGATE_TO_POSE, graph.NAVIGATE_THROUGH_POSES], ids=lambda row: row.name)
def test_estop_aborts_goals_and_its_release_starts_nothing(pilot: Any, action: Action) -> None:
    from nav2_msgs.action import FollowPath, NavigateThroughPoses
    from std_msgs.msg import Bool

    stop = pilot.node.publisher(graph.ESTOP_STATE)
    click = pilot.node.publisher(graph.GOAL_POSE)
    client = pilot.node.action_client(action)

    def goal(x: float, y: float) -> NavigateThroughPoses_Goal | NavigateToPose_Goal:
        to_pose = pilot.goal(x, y)
        return to_pose if action is graph.NAVIGATE_TO_POSE else NavigateThroughPoses.Goal(poses=[to_pose.pose])

    driving = pilot.send(goal(3.2, 2.0), client)
    pilot.host.until(pilot.driving, what="motion")
    stop.publish(Bool(data=True))
    first = pilot.result(driving)
    pilot.host.until(lambda: max(map(abs, pilot.robot.base.velocity)) < 1e-6 and pilot.ends_with_zero(), what="rest")
    new = pilot.result(pilot.send(goal(0.6, 0.6), client))
    click.publish(pilot.goal(3.2, 2.0).pose)
    for answer in (first, new):
        assert (answer.status, answer.result.error_code) == (ABORTED, FollowPath.Result.UNKNOWN)
        assert answer.result.error_msg.startswith("e-stop engaged")
    at = pilot.robot.base.truth
    pilot.node.create_timer(0.1, lambda: stop.publish(Bool(data=False)))
    steps = pilot.robot.steps
    pilot.host.until_expired(lambda: pilot.robot.steps > steps + int(6.0 / pilot.robot.step_s), what="six seconds")
    assert pilot.robot.base.truth.distance_to(at) < 0.001
    assert pilot.result(pilot.send(goal(1.2, 0.6), client)).status == SUCCEEDED


@pytest.mark.parametrize("pilot", [{"wait_for_estop": True}], indirect=True)
@pytest.mark.parametrize("engaged_s_ago", [None, 5.0], ids=["never-pressed", "pressed-before-discovery"])
def test_goal_waits_until_the_estop_is_known(pilot: Any, engaged_s_ago: float | None) -> None:
    from std_msgs.msg import Bool, String

    state, status = pilot.node.publisher(graph.ESTOP_STATE), pilot.node.publisher(graph.ESTOP_STATUS)
    handle = pilot.send(pilot.goal(3.2, 2.0))
    pilot.node.create_timer(0.1, lambda: state.publish(Bool(data=False)))
    at, steps = pilot.robot.base.truth, pilot.robot.steps
    pilot.host.until(
        lambda: pilot.robot.steps > steps + int(3.0 / pilot.robot.step_s), what="three seconds without the e-stop's status"
    )
    assert pilot.robot.base.truth.distance_to(at) < 0.001
    report = {"engaged": False, "bridge": "a", "presses": 0 if engaged_s_ago is None else 1, "engaged_s_ago": engaged_s_ago}
    status.publish(String(data=json.dumps(report)))
    answer = pilot.result(handle)
    if engaged_s_ago is None:
        assert answer.status == SUCCEEDED
    else:
        assert answer.status == ABORTED and answer.result.error_msg.startswith("e-stop engaged")
        assert pilot.robot.base.truth.distance_to(at) < 0.001


@pytest.mark.parametrize("jump_s", [-5.0, 60.0])
def test_clock_jump_delays_the_goal_only_briefly(pilot: Any, jump_s: float) -> None:
    handle = pilot.send(pilot.goal(3.2, 2.0))
    pilot.host.until(pilot.driving, what="motion")
    pilot.robot.time_ns = max(1, pilot.robot.time_ns + int(jump_s * 1e9))
    assert pilot.result(handle).status == SUCCEEDED
    assert pilot.robot.base.truth.distance_to(Pose2(3.2, 2.0)) < 0.25


def test_goal_pose_topic_is_driven_and_can_be_cancelled(pilot: Any) -> None:
    from action_msgs.srv import CancelGoal

    click = pilot.node.publisher(graph.GOAL_POSE)
    pilot.host.until(lambda: click.get_subscription_count() > 0)
    click.publish(pilot.goal(3.2, 2.0).pose)
    pilot.host.until(pilot.driving, what="motion")
    cancel = pilot.node.create_client(CancelGoal, "/navigate_to_pose/_action/cancel_goal")
    pilot.host.until(cancel.service_is_ready)
    future = cancel.call_async(CancelGoal.Request())
    pilot.host.until(future.done)
    assert len(future.result().goals_canceling) == 1
    pilot.host.until(pilot.at_rest, what="rest")


def test_navigate_through_poses_passes_and_counts_them(pilot: Any) -> None:
    from nav2_msgs.action import NavigateThroughPoses

    client = pilot.node.action_client(graph.NAVIGATE_THROUGH_POSES)
    poses = [pilot.goal(x, y).pose for x, y in ((1.2, 0.5), (2.0, 0.45), (3.2, 0.6))]
    answer = pilot.result(pilot.send(NavigateThroughPoses.Goal(poses=poses), client))
    assert answer.status == SUCCEEDED
    remaining = [message.number_of_poses_remaining for message in pilot.feedback]
    assert max(remaining) >= 2
    assert remaining[-1] == 1


def test_compute_path_plans_without_driving(pilot: Any) -> None:
    from nav2_msgs.action import ComputePathToPose

    client = pilot.node.action_client(graph.COMPUTE_PATH_TO_POSE)
    request = ComputePathToPose.Goal(goal=pilot.goal(3.2, 2.0).pose)
    answer = pilot.result(pilot.send(request, client))
    assert answer.status == SUCCEEDED
    last = answer.result.path.poses[-1].pose.position
    assert (last.x, last.y) == pytest.approx((3.2, 2.0), abs=0.05)
    refused = pilot.result(pilot.send(ComputePathToPose.Goal(goal=pilot.goal(9.0, 2.0).pose), client))
    assert refused.status == ABORTED
    assert refused.result.error_code == ComputePathToPose.Result.GOAL_OUTSIDE_MAP
    assert pilot.robot.commands == []


def test_both_costmaps_are_published_and_can_be_cleared(pilot: Any) -> None:
    from nav2_msgs.srv import ClearEntireCostmap

    seen: dict[str, Any] = {}
    for topic in (graph.LOCAL_COSTMAP, graph.GLOBAL_COSTMAP):
        pilot.node.subscription(topic, lambda message, name=topic.name: seen.update({name: message}))
    local_name = graph.LOCAL_COSTMAP.name
    both = pilot.host.until(
        lambda: seen if len(seen) == 2 and max(seen[local_name].data) == 100 else None,
        what="a wall that is seen",
    )
    local, world = both[graph.LOCAL_COSTMAP.name], both[graph.GLOBAL_COSTMAP.name]
    assert (local.header.frame_id, local.info.width, local.info.height) == (graph.ODOM_FRAME, 60, 60)
    assert world.header.frame_id == graph.MAP_FRAME
    for row in (graph.CLEAR_LOCAL_COSTMAP, graph.CLEAR_GLOBAL_COSTMAP):
        client = pilot.node.create_client(ClearEntireCostmap, row.name)
        pilot.host.until(client.service_is_ready)
        pilot.host.until(client.call_async(ClearEntireCostmap.Request()).done)
