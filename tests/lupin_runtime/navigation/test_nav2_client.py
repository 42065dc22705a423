"""What a client of Nav2 calls, in the order in which nav2_simple_commander's BasicNavigator calls it."""

from __future__ import annotations

from typing import Any

import pytest

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2
from tests.support.lost_answers import lose_goal_answers

pytestmark = pytest.mark.graph

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
LETHAL, UNKNOWN_COST = 254, 255


def call(pilot: Any, row: graph.Service) -> Any:
    client = pilot.node.client(row)
    pilot.host.until(client.service_is_ready, what=f"{row.name}'s server")
    future = client.call_async(client.srv_type.Request())
    return pilot.host.until(lambda: future.done() and future.result(), what=f"{row.name}'s answer")


@pytest.fixture
def follower(pilot: Any, request: pytest.FixtureRequest) -> Any:
    from lupin_runtime.navigation.waypoint_follower import WaypointFollower

    return pilot.host.add(WaypointFollower(getattr(request, "param", {})))


def waypoints(pilot: Any, *points: tuple[float, float], **fields: int) -> Any:
    """Send a goal of follow_waypoints; the pilot keeps its feedback."""
    from nav2_msgs.action import FollowWaypoints

    client = pilot.node.action_client(graph.FOLLOW_WAYPOINTS)
    return pilot.send(FollowWaypoints.Goal(poses=[pilot.goal(x, y).pose for x, y in points], **fields), client)


def test_calls_of_a_whole_session_succeed_in_their_order(pilot: Any) -> None:
    state = pilot.host.until(lambda: (s := call(pilot, graph.BT_NAVIGATOR_STATE).current_state).label == "active" and s)
    assert state.id == state.PRIMARY_STATE_ACTIVE
    call(pilot, graph.CLEAR_LOCAL_COSTMAP)
    call(pilot, graph.CLEAR_GLOBAL_COSTMAP)
    world, local = call(pilot, graph.GET_GLOBAL_COSTMAP).map, call(pilot, graph.GET_LOCAL_COSTMAP).map
    assert (world.header.frame_id, local.header.frame_id) == (graph.MAP_FRAME, graph.ODOM_FRAME)
    assert (local.metadata.size_x, local.metadata.size_y, len(local.data)) == (60, 60, 3600)
    assert len(world.data) == world.metadata.size_x * world.metadata.size_y
    assert LETHAL in world.data and 0 in world.data

    markers: list[Any] = []
    pilot.node.subscription(graph.GOAL_MARKERS, markers.append)
    handle = pilot.send(pilot.goal(3.2, 2.0))
    assert handle.accepted
    pilot.host.until(pilot.driving, what="motion")
    shown = pilot.host.until(lambda: markers and markers[-1].markers, what="the goal's marker")
    assert [marker.pose.position.x for marker in shown[1:]] == [3.2]  # the first one deletes those of the goal before
    assert pilot.host.until(lambda: pilot.feedback and pilot.feedback[-1].distance_remaining > 0.0)
    future = pilot.host.within(pilot.node, handle.cancel_goal_async)
    pilot.host.until(future.done)
    answer = pilot.result(handle)
    assert (answer.status, answer.result.error_code) == (CANCELED, 0)
    assert pilot.result(pilot.send(pilot.goal(1.2, 0.6))).status == SUCCEEDED
    pilot.host.until(lambda: len(markers[-1].markers) == 1, what="no marker after the end")


def test_costmap_requests_do_not_stop_a_drive(pilot: Any) -> None:
    handle = pilot.send(pilot.goal(3.2, 2.0))
    pilot.host.until(pilot.driving, what="motion")
    client = pilot.node.client(graph.GET_GLOBAL_COSTMAP)
    pilot.host.until(client.service_is_ready)
    answers = [client.call_async(client.srv_type.Request()) for _ in range(5)]
    pilot.host.until(lambda: all(answer.done() for answer in answers), what="all answers")
    assert all(answer.result().map.data for answer in answers)
    assert pilot.result(handle).status == SUCCEEDED


def test_navigator_is_inactive_until_it_has_a_map_and_a_pose(graph_host: Any) -> None:
    from lupin_runtime.navigation.node import Navigator
    from lupin_runtime.ros import LupinNode

    navigator = graph_host.add(Navigator())
    node = graph_host.add(LupinNode("pilot"))
    client = node.client(graph.BT_NAVIGATOR_STATE)
    graph_host.until(client.service_is_ready)
    future = client.call_async(client.srv_type.Request())
    state = graph_host.until(lambda: future.done() and future.result()).current_state
    assert (state.id, state.label) == (state.PRIMARY_STATE_INACTIVE, "inactive")
    navigator.before_shutdown()


def test_goal_without_poses_is_aborted_with_nav2s_code(pilot: Any) -> None:
    from nav2_msgs.action import ComputePathThroughPoses, NavigateThroughPoses

    client = pilot.node.action_client(graph.NAVIGATE_THROUGH_POSES)
    answer = pilot.result(pilot.send(NavigateThroughPoses.Goal(), client))
    assert (answer.status, answer.result.error_code) == (ABORTED, ComputePathThroughPoses.Result.NO_VIAPOINTS_GIVEN)
    assert answer.result.error_msg == "the goal has no poses"


def test_path_to_a_pose_in_an_unknown_frame_says_why(pilot: Any) -> None:
    from nav2_msgs.action import ComputePathToPose

    client = pilot.node.action_client(graph.COMPUTE_PATH_TO_POSE)
    answer = pilot.result(pilot.send(ComputePathToPose.Goal(goal=pilot.goal(1.0, 1.0, frame="nowhere").pose), client))
    assert (answer.status, answer.result.error_code) == (ABORTED, ComputePathToPose.Result.TF_ERROR)
    assert "'nowhere'" in answer.result.error_msg


@pytest.mark.usefixtures("follower")
def test_waypoints_are_reached_in_order_and_counted(pilot: Any) -> None:
    answer = pilot.result(waypoints(pilot, (1.2, 0.5), (0.6, 1.2), number_of_loops=1))
    assert (answer.status, answer.result.error_code, list(answer.result.missed_waypoints)) == (SUCCEEDED, 0, [])
    assert [message.current_waypoint for message in pilot.feedback] == [0, 1, 0, 1]
    assert pilot.robot.base.truth.distance_to(Pose2(0.6, 1.2)) < 0.25


@pytest.mark.usefixtures("follower")
def test_waypoint_in_a_bench_ends_the_goal_and_is_named(pilot: Any) -> None:
    from nav2_msgs.action import ComputePathToPose, FollowWaypoints

    answer = pilot.result(waypoints(pilot, (1.0, 0.5), (2.0, 2.2), (0.6, 0.6)))
    assert (answer.status, answer.result.error_code) == (ABORTED, FollowWaypoints.Result.UNKNOWN)
    assert answer.result.error_msg.startswith("waypoint 1 was not reached")
    (missed,) = answer.result.missed_waypoints
    assert (missed.index, missed.error_code) == (1, ComputePathToPose.Result.GOAL_OCCUPIED)


@pytest.mark.usefixtures("follower")
def test_cancelled_waypoints_stop_the_robot(pilot: Any) -> None:
    handle = waypoints(pilot, (3.2, 2.0), (0.6, 0.6))
    pilot.host.until(pilot.driving, what="motion")
    future = pilot.host.within(pilot.node, handle.cancel_goal_async)
    pilot.host.until(future.done)
    assert pilot.result(handle).status == CANCELED
    pilot.host.until(pilot.at_rest, what="rest")
    assert pilot.ends_with_zero()


def test_goal_cancelled_at_once_stops_the_goal_it_replaced(pilot: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from lupin_runtime.navigation import waypoint_follower

    monkeypatch.setattr(waypoint_follower, "_PERIOD_S", 0.5)  # so that the cancellation comes before the first waypoint
    pilot.host.add(waypoint_follower.WaypointFollower())
    waypoints(pilot, (3.2, 2.0), (0.6, 0.6))
    pilot.host.until(pilot.driving, what="motion")
    handle = waypoints(pilot, (1.2, 0.6))
    future = pilot.host.within(pilot.node, handle.cancel_goal_async)
    pilot.host.until(future.done)
    assert pilot.result(handle).status == CANCELED
    pilot.host.until(pilot.at_rest, what="rest")
    assert pilot.ends_with_zero()


def test_waypoints_are_cancelled_if_an_acceptance_was_lost(pilot: Any, follower: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    lose_goal_answers(monkeypatch, follower._client)
    handle = waypoints(pilot, (3.2, 2.0))
    pilot.host.until(pilot.driving, what="motion")
    future = pilot.host.within(pilot.node, handle.cancel_goal_async)
    pilot.host.until(future.done)
    assert pilot.result(handle).status == CANCELED
    pilot.host.until(pilot.at_rest, what="rest")
    assert pilot.ends_with_zero()


@pytest.mark.parametrize("follower", [{"waypoint_pause_duration": 4_000}], indirect=True)
@pytest.mark.usefixtures("follower")
def test_estop_between_waypoints_ends_them_for_good(pilot: Any) -> None:
    from std_msgs.msg import Bool

    stop = pilot.node.publisher(graph.ESTOP_STATE)
    arrivals: list[Any] = []
    pilot.node.subscription(graph.GOAL_MARKERS, arrivals.append)
    handle = waypoints(pilot, (1.0, 0.6), (3.2, 2.0))
    pilot.host.until(lambda: arrivals and len(arrivals[-1].markers) == 2, what="the first waypoint as goal")
    pilot.host.until(lambda: len(arrivals[-1].markers) == 1, what="the pause after the first waypoint")
    stop.publish(Bool(data=True))
    answer = pilot.result(handle)
    assert answer.status == ABORTED and answer.result.error_msg.startswith("e-stop engaged")
    at, steps = pilot.robot.base.truth, pilot.robot.steps
    pilot.node.create_timer(0.1, lambda: stop.publish(Bool(data=False)))
    pilot.host.until(lambda: pilot.robot.steps > steps + int(8.0 / pilot.robot.step_s), what="twice the pause")
    assert pilot.robot.base.truth.distance_to(at) < 0.01


@pytest.mark.usefixtures("follower")
def test_another_clients_goal_ends_the_waypoints(pilot: Any) -> None:
    handle = waypoints(pilot, (3.2, 2.0), (0.6, 0.6))
    pilot.host.until(pilot.driving, what="motion")
    other = pilot.send(pilot.goal(1.2, 0.6))
    answer = pilot.result(handle)
    assert answer.status == ABORTED and "newer goal" in answer.result.error_msg
    assert pilot.result(other).status == SUCCEEDED
    assert pilot.robot.base.truth.distance_to(Pose2(1.2, 0.6)) < 0.25


@pytest.mark.usefixtures("follower")
@pytest.mark.parametrize(("points", "index", "words"), [((), 0, "no poses"), (((1.0, 0.5),), 1, "1 of 1")])
def test_waypoints_that_name_no_pose_are_aborted(pilot: Any, points: Any, index: int, words: str) -> None:
    answer = pilot.result(waypoints(pilot, *points, goal_index=index))
    assert answer.status == ABORTED and words in answer.result.error_msg
    assert pilot.robot.commands == []
