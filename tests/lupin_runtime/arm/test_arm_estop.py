"""The arm's nodes under the e-stop, on a real graph: everything is refused, and a release resumes nothing."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.arm import PRESETS, Refused
from tests.support.arm_vendor import Console, Vendor, arm_nodes, record
from tests.support.optional import present

if TYPE_CHECKING:
    from control_msgs.action import GripperCommand_Result

    from lupin_runtime.arm.motion import ArmMotion
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


class EStop:
    """Publishes the e-stop's state like the bridge."""

    def __init__(self, host: GraphHost, console: Any) -> None:
        self._host, self._publisher = host, console.node.publisher(graph.ESTOP_STATE)
        host.until(lambda: self._publisher.get_subscription_count() >= 2, what="the arm's subscriptions")

    def set(self, engaged: bool) -> None:
        from std_msgs.msg import Bool

        from lupin_runtime.arm.shared_arm import _SHARED_ARM

        def repeated() -> bool:
            self._publisher.publish(Bool(data=engaged))
            threading.Event().wait(0.05)
            return _refused(present(_SHARED_ARM.motion)) == engaged

        self._host.until(repeated, what="the arm's e-stop state")


def _refused(motion: ArmMotion) -> bool:
    try:
        motion.require_released()
    except Refused:
        return True
    return False


def test_estop_refuses_every_arm_command_with_its_reason(
    graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path
) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    graph_host.until(lambda: console.states, what="the library's state")
    record(graph_host, vendor, console, "nod", "teleop")
    assert console.ask(graph.ARM_LIBRARY_SAVE_POSE, name="here", from_current=True).success
    estop = EStop(graph_host, console)
    estop.set(True)
    graph_host.until(lambda: list(vendor.trajectories[-1].points[0].positions) == vendor.at, what="the hold")
    count, grips = len(vendor.trajectories), len(vendor.gripper_goals)
    for row, fields in (
        (graph.ARM_PRESET, {"name": "home"}),
        (graph.ARM_INIT, {}),
        (graph.ARM_LIBRARY_GOTO_POSE, {"name": "here"}),
        (graph.ARM_LIBRARY_PLAY, {"name": "nod", "speed": 1.0}),
        (graph.ARM_LIBRARY_RECORD, {"action": "start", "name": "led", "mode": "kinesthetic"}),
    ):
        answer = console.ask(row, **fields)
        assert not answer.success and answer.message.startswith("e-stop engaged"), row.name
    assert not console.ask(graph.arm_joint_angle("elbow_joint"), angle=30.0, rate=30.0, degrees=True).status
    assert not console.ask(graph.GRIPPER_ANGLE, angle=30.0, rate=0.0, degrees=True).status
    assert (len(vendor.trajectories), len(vendor.gripper_goals), vendor.calls) == (count, grips, [])
    estop.set(False)
    assert console.ask(graph.ARM_PRESET, name="home").success
    graph_host.until(lambda: vendor.last == PRESETS["home"], what="the trajectory")


def test_estop_keeps_the_arm_stiff_but_lets_a_limp_one_stiffen(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    estop = EStop(graph_host, console)
    estop.set(True)
    refused = console.ask(graph.ARM_SET_TORQUE, data=False)
    assert not refused.success and refused.message.startswith("e-stop engaged") and vendor.calls == []
    estop.set(False)
    assert console.ask(graph.ARM_SET_TORQUE, data=False).success
    estop.set(True)
    assert console.ask(graph.ARM_SET_TORQUE, data=True).success
    assert vendor.calls == [("gate", False), ("torque", False), ("torque", True), ("gate", True)]
    assert list(vendor.trajectories[-1].points[-1].positions) == vendor.at


def test_estop_aborts_a_replay_and_a_release_does_not_resume_it(
    graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path
) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    graph_host.until(lambda: console.states, what="the library's state")
    record(graph_host, vendor, console, "nod", "teleop")
    assert console.ask(graph.ARM_LIBRARY_PLAY, name="nod", speed=0.25).success
    graph_host.until(lambda: console.states[-1]["playing"], what="the playing state")
    estop = EStop(graph_host, console)
    estop.set(True)
    graph_host.until(lambda: not console.states[-1]["playing"], what="the end of the replay")
    assert console.states[-1]["aborted"] == "e-stop engaged"
    count, grips = len(vendor.trajectories), len(vendor.gripper_goals)
    held = list(vendor.trajectories[-1].points[-1].positions)
    assert held == vendor.at, "held where it is"
    estop.set(False)
    states = len(console.states)
    graph_host.until(lambda: len(console.states) > states + 10, what="two seconds of states")
    assert [list(sent.points[-1].positions) for sent in vendor.trajectories[count:]] == [held], "held once more"
    assert len(vendor.gripper_goals) == grips
    assert console.ask(graph.ARM_LIBRARY_PLAY, name="nod", speed=2.0).success


def test_replay_waiting_for_torque_is_refused_after_an_estop(
    graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path
) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    graph_host.until(lambda: console.states, what="the library's state")
    record(graph_host, vendor, console, "nod", "teleop")
    count = len(vendor.trajectories)
    estop = EStop(graph_host, console)
    play = console.send(graph.ARM_LIBRARY_PLAY, name="nod", speed=1.0)
    graph_host.until(lambda: len(vendor.trajectories) > count, what="the hold before the torque")  # 0.35 s before its end
    estop.set(True)
    estop.set(False)
    graph_host.until(play.done, what="the replay's answer")
    assert not play.result().success and play.result().message.startswith("e-stop engaged")
    graph_host.until(lambda: not console.states[-1]["playing"], what="the end of the replay")


@pytest.mark.parametrize("after_estop", [False, True], ids=["running", "sent-while-engaged"])
def test_estop_cancels_gripper_goals_of_any_client(graph_host: GraphHost, console: Any, after_estop: bool) -> None:
    from control_msgs.action import GripperCommand
    from rclpy.action import ActionServer, CancelResponse
    from rclpy.callback_groups import ReentrantCallbackGroup

    from lupin_runtime.ros import LupinNode

    node, cancelled = LupinNode("vendor"), threading.Event()

    async def grip(goal: Any) -> GripperCommand_Result | None:
        from lupin_runtime.arm import async_wait

        while not goal.is_cancel_requested:
            await async_wait.sleep(node, 0.02)
        goal.canceled()
        cancelled.set()
        return GripperCommand.Result()

    server = ActionServer(
        node,
        GripperCommand,
        graph.GRIPPER_COMMAND.name,
        grip,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
        callback_group=ReentrantCallbackGroup(),
    )
    graph_host.add(node)
    arm_nodes(graph_host)
    estop = EStop(graph_host, console)
    other_client = console.node.action_client(graph.GRIPPER_COMMAND)
    graph_host.until(other_client.server_is_ready, what="the gripper's action")
    if after_estop:
        estop.set(True)
    sent = graph_host.within(console.node, lambda: other_client.send_goal_async(GripperCommand.Goal()))
    graph_host.until(lambda: sent.done() and sent.result().accepted, what="the goal")
    estop.set(True)
    graph_host.until(cancelled.is_set, what="the goal's cancellation")
    server.destroy()


def test_trajectory_of_another_publisher_is_replaced_under_estop(
    graph_host: GraphHost, vendor: Vendor, console: Console
) -> None:
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    arm_nodes(graph_host, pinned_by=vendor)
    other_publisher = console.node.publisher(graph.ARM_TRAJECTORY)
    graph_host.until(lambda: other_publisher.get_subscription_count() >= 2, what="the subscriptions")
    estop = EStop(graph_host, console)
    estop.set(True)
    graph_host.until(lambda: len(vendor.trajectories) >= 2, what="the hold")
    held = list(vendor.trajectories[-1].points[-1].positions)
    point = JointTrajectoryPoint(positions=[0.9, 0.0, 0.0, 0.0])
    point.time_from_start.sec = 3
    other_publisher.publish(JointTrajectory(joint_names=list(graph.ARM_JOINTS), points=[point]))
    graph_host.until(lambda: len(vendor.trajectories) >= 4, what="the second hold")
    assert list(vendor.trajectories[-1].points[-1].positions) == held
    estop.set(False)
    graph_host.until(lambda: len(vendor.trajectories) >= 5, what="the hold with the release")
    assert list(vendor.trajectories[-1].points[-1].positions) == held
    count = len(vendor.trajectories)
    other_publisher.publish(JointTrajectory(joint_names=list(graph.ARM_JOINTS), points=[point]))
    graph_host.until(lambda: len(vendor.trajectories) > count and console.ask(graph.ARM_PRESET, name="home").success)
    assert len(vendor.trajectories[count].points) == 1 and vendor.trajectories[count].points[0].positions[0] == 0.9
