"""`arm_guard` on a real graph: it holds the arm and cancels goals while the process `body` does not respond."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph

if TYPE_CHECKING:
    from lupin_runtime.arm.guard_node import ArmGuard
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

AT = [0.1, 0.2, 0.3, -0.4]


class Vendor:
    """Joint states, an arm controller, the cancel services of both controllers, and the e-stop's state."""

    def __init__(self, host: GraphHost) -> None:
        from action_msgs.srv import CancelGoal
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Bool

        from lupin_runtime.ros import LupinNode

        self.at = AT
        self.engaged = False
        self.trajectories: list[list[float]] = []
        self.cancels: list[str] = []
        self.node = LupinNode("vendor")
        joints, estop = self.node.publisher(graph.JOINT_STATES), self.node.publisher(graph.ESTOP_STATE)
        self.arm = self.node.publisher(graph.ARM_TRAJECTORY)

        def speak() -> None:
            joints.publish(JointState(name=list(graph.ARM_JOINTS), position=self.at))
            joints.publish(JointState(name=list(graph.WHEEL_JOINTS), position=[0.0] * 4))

        self.node.create_timer(0.02, speak)
        self.node.create_timer(0.2, lambda: estop.publish(Bool(data=self.engaged)))
        self.node.subscription(graph.ARM_TRAJECTORY, self._on_trajectory)
        for row in (graph.GRIPPER_COMMAND, graph.ARM_FOLLOW_TRAJECTORY):
            self.node.create_service(CancelGoal, f"{row.name}/_action/cancel_goal", self._canceler(row.name))
        host.add(self.node)

    def _on_trajectory(self, message: Any) -> None:
        self.trajectories.append(list(message.points[-1].positions))

    def _canceler(self, name: str) -> Any:
        def cancel(_: Any, response: Any) -> Any:
            self.cancels.append(name)
            return response

        return cancel

    def publish(self, positions: list[float]) -> None:
        from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

        point = JointTrajectoryPoint(positions=positions)
        self.arm.publish(JointTrajectory(joint_names=list(graph.ARM_JOINTS), points=[point]))


@pytest.fixture
def vendor(graph_host: GraphHost) -> Vendor:
    return Vendor(graph_host)


@pytest.fixture
def holds() -> Iterator[list[str]]:
    """Return a list whose last item is the supervisor's reason why nothing may move."""
    from lupin_runtime.ros import LupinNode

    reasons = [""]
    before = LupinNode.motion_hold
    LupinNode.motion_hold = staticmethod(lambda: reasons[-1])
    yield reasons
    LupinNode.motion_hold = staticmethod(before)


@pytest.fixture
def guard(graph_host: GraphHost, vendor: Vendor, holds: list[str]) -> ArmGuard:
    from lupin_runtime.arm.guard_node import ArmGuard

    assert holds == [""]
    guard: ArmGuard = graph_host.add(ArmGuard())
    graph_host.until(lambda: vendor.arm.get_subscription_count() == 2, what="the guard's subscription")
    clients = list(guard._canceler._pending)
    graph_host.until(lambda: all(client.service_is_ready() for client in clients), what="the cancel services")
    graph_host.until(lambda: vendor.node.count_subscribers(graph.ESTOP_STATE.name), what="the guard's e-stop")
    return guard


def wait(host: GraphHost, node: Any, seconds: float) -> None:
    ticks: list[int] = []
    timer = host.within(node, lambda: node.create_timer(0.1, lambda: ticks.append(1)))
    host.until(lambda: len(ticks) >= 10 * seconds, what=f"{seconds} s of ticks")
    host.within(node, lambda: node.destroy_timer(timer))


@pytest.mark.usefixtures("guard")
def test_hung_body_makes_the_guard_hold_the_arm_once(graph_host: GraphHost, vendor: Vendor, holds: list[str]) -> None:
    wait(graph_host, vendor.node, 0.5)
    assert vendor.trajectories == [] and vendor.cancels == []
    vendor.at = [0.5, 0.2, 0.3, -0.4]
    wait(graph_host, vendor.node, 0.1)
    holds.append("slam has exited, body does not respond")
    graph_host.until(lambda: vendor.trajectories, what="the hold")
    assert vendor.trajectories == [vendor.at], "the present pose, not one that waited in a queue"
    graph_host.until(lambda: len(vendor.cancels) == 2, what="the cancellations")
    vendor.at = AT
    wait(graph_host, vendor.node, 0.5)
    assert len(vendor.trajectories) == 1 and len(vendor.cancels) == 2


@pytest.mark.usefixtures("guard")
def test_hung_body_under_the_estop_keeps_the_arm_in_place(graph_host: GraphHost, vendor: Vendor, holds: list[str]) -> None:
    holds.append("body does not respond")
    vendor.engaged = True
    graph_host.until(lambda: len(vendor.cancels) >= 6, what="cancellations with every message")
    assert vendor.trajectories and {*map(tuple, vendor.trajectories)} == {tuple(AT)}
    count = len(vendor.trajectories)
    vendor.publish([0.9, 0.2, 0.3, -0.4])  # of another client
    graph_host.until(lambda: len(vendor.trajectories) > count + 1, what="the hold")
    assert vendor.trajectories[-1] == AT
    vendor.engaged = False
    count = len(vendor.trajectories)
    graph_host.until(lambda: len(vendor.trajectories) > count, what="the hold with the release")
    assert vendor.trajectories[-1] == AT
    holds.append("")
    vendor.publish([0.9, 0.2, 0.3, -0.4])
    wait(graph_host, vendor.node, 0.5)
    assert vendor.trajectories[-1][0] == 0.9


def test_guard_leaves_the_arm_to_a_body_that_answers(graph_host: GraphHost, vendor: Vendor, guard: ArmGuard) -> None:
    vendor.engaged = True
    graph_host.until(lambda: guard._hold._engaged_ns is not None, what="the e-stop")
    vendor.publish(AT)  # as `body` does
    wait(graph_host, vendor.node, 1.0)
    assert vendor.trajectories == [AT] and vendor.cancels == []


@pytest.mark.usefixtures("guard")
def test_guard_answers_an_estop_that_nobody_answers(graph_host: GraphHost, vendor: Vendor) -> None:
    vendor.engaged = True
    graph_host.until_expired(lambda: vendor.trajectories, what="the hold")
    assert vendor.trajectories == [AT]
    graph_host.until(lambda: len(vendor.cancels) >= 4, what="cancellations")


@pytest.mark.usefixtures("guard")
def test_malformed_trajectory_does_not_end_the_guard(graph_host: GraphHost, vendor: Vendor, holds: list[str]) -> None:
    vendor.publish([])
    holds.append("body has exited")
    graph_host.until(lambda: AT in vendor.trajectories, what="the hold")
