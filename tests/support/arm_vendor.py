"""A fake vendor of the arm that records its calls, a console that calls the arm's services, and the arm's nodes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lupin_runtime import graph

if TYPE_CHECKING:
    from control_msgs.action import GripperCommand_Result
    from std_srvs.srv import SetBool_Response

    from tests.conftest import GraphHost


class Vendor:
    """The vendor's side: joint states, gate and torque, the gripper's action. Its arm follows every command at once."""

    def __init__(self, host: GraphHost, gate: bool = True) -> None:
        from control_msgs.action import GripperCommand
        from rclpy.action import ActionServer
        from rclpy.callback_groups import ReentrantCallbackGroup
        from rclpy.task import Future
        from sensor_msgs.msg import JointState

        from lupin_runtime.ros import LupinNode

        self.at = [0.1, 0.2, 0.3, -0.4]
        self.gripper_at = 0.0
        self.publishes = True
        self.calls: list[tuple[str, bool]] = []
        self.refuse: set[tuple[str, bool]] = set()
        self.silent: set[tuple[str, bool]] = set()  # calls that are executed, but not answered before `answer`
        self._answering = Future()
        self.trajectories: list[Any] = []
        self.gripper_goals: list[tuple[float, float]] = []
        self.node = LupinNode("vendor")
        publisher = self.node.publisher(graph.JOINT_STATES)

        def publish_joints() -> None:
            if self.publishes:
                names = [*graph.ARM_JOINTS, graph.GRIPPER_JOINT, *graph.WHEEL_JOINTS]
                publisher.publish(JointState(name=names, position=[*self.at, self.gripper_at, 0.0, 0.0, 0.0, 0.0]))
                publisher.publish(JointState(name=list(graph.WHEEL_JOINTS), position=[0.0] * 4))

        self.node.create_timer(0.02, publish_joints)
        self.node.subscription(graph.ARM_TRAJECTORY, self.trajectories.append)
        group = ReentrantCallbackGroup()  # a service that does not answer blocks nothing else
        self.node.service(graph.VENDOR_TORQUE, self._switch("torque"), group)
        if gate:
            self.node.service(graph.VENDOR_ARM_GATE, self._switch("gate"), group)

        def grip(goal: Any) -> GripperCommand_Result:
            command = goal.request.command
            self.gripper_goals.append((command.position, command.max_effort))
            goal.succeed()
            return GripperCommand.Result(position=command.position, reached_goal=True)

        self._server: Any = ActionServer(self.node, GripperCommand, graph.GRIPPER_COMMAND.name, grip)
        host.add(self.node)

    def _switch(self, name: str) -> Callable[..., Any]:
        async def serve(request: Any, response: SetBool_Response) -> SetBool_Response:
            self.calls.append((name, request.data))
            if (name, request.data) in self.silent:
                await self._answering
            response.success = (name, request.data) not in self.refuse
            response.message = "" if response.success else "out of order"
            return response

        return serve

    def answer(self) -> None:
        """Answer the calls that have not been answered; call it on the executor's thread."""
        self.silent.clear()
        self._answering.set_result(None)

    def deactivate_gripper(self) -> None:
        """Take the gripper's action away, as if its controller were not active."""
        server, self._server = self._server, None
        if server is not None:
            server.destroy()

    def close(self) -> None:
        self.deactivate_gripper()

    @property
    def last(self) -> tuple[float, ...]:
        return tuple(round(v, 6) for v in self.trajectories[-1].points[-1].positions)


class Console:
    """Calls services and waits for the responses."""

    def __init__(self, host: GraphHost) -> None:
        from lupin_runtime.ros import LupinNode

        self._host, self.node = host, LupinNode("console")
        self.states: list[dict[str, Any]] = []
        self.node.subscription(graph.ARM_LIBRARY_STATE, lambda message: self.states.append(json.loads(message.data)))
        self._clients: dict[str, Any] = {}
        host.add(self.node)

    def send(self, row: graph.Service, **fields: Any) -> Any:
        from lupin_runtime.ros.interfaces import interface

        client = self._clients.setdefault(row.name, None) or self.node.client(row)
        self._clients[row.name] = client
        self._host.until(client.service_is_ready, what=f"{row.name}")
        return client.call_async(interface(row.type).Request(**fields))

    def ask(self, row: graph.Service, **fields: Any) -> Any:
        future = self.send(row, **fields)
        self._host.until(future.done, what=f"the answer of {row.name}")
        return future.result()


def arm_nodes(host: GraphHost, tmp_path: Path | None = None, pinned_by: Any = None) -> Any:
    """Create the three arm nodes of one process, with a released e-stop; with a vendor, wait for the first hold command."""
    from lupin_runtime.arm.node import ArmLibraryServer, ArmPresetServer, GripperActionBridge

    library = {"library_path": str(tmp_path / "arm_library.json")} if tmp_path else {}
    nodes = [host.add(ArmPresetServer()), host.add(GripperActionBridge())]
    if tmp_path:
        nodes.append(host.add(ArmLibraryServer(library)))
    if pinned_by is not None:
        host.until(lambda: pinned_by.trajectories, what="the arm to be pinned")
    nodes[0].motion.set_estop(False)
    return nodes


def record(graph_host: GraphHost, vendor: Any, console: Any, name: str, mode: str) -> None:
    """Record a motion of the pan joint and the gripper."""
    with graph_host.clock.real():
        assert console.ask(graph.ARM_LIBRARY_RECORD, action="start", name=name, mode=mode, include_gripper=True).success
        for step in range(5):
            vendor.at = [0.1 + 0.1 * step, 0.2, 0.3, -0.4]
            vendor.gripper_at = 0.0 if step < 3 else 0.2
            graph_host.until(lambda n=step: console.states[-1]["n_waypoints"] > n, what="the next waypoint")  # type: ignore[misc]
        answer = console.ask(graph.ARM_LIBRARY_RECORD, action="save")
    assert answer.success and answer.n_waypoints >= 5 and answer.duration_s > 0.5
