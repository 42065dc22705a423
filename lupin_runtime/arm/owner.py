"""The process's one publisher of arm trajectories and one ear for `/joint_states`, shared by its arm nodes.

The nodes have threads of their own, so what they share is either locked (ArmMotion) or replaced whole (the last message).
"""

from __future__ import annotations

import threading
from typing import Any

from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from lupin_runtime import graph
from lupin_runtime.arm.motion import ArmMotion, ArmState
from lupin_runtime.arm.states import arm_state
from lupin_runtime.arm.trajectory import VELOCITY_HINT, Point
from lupin_runtime.ros import LupinNode

# Found in a serialised message that speaks of the arm; the wheels may come in messages of their own.
_MARK = graph.ARM_JOINTS[0].encode()


class _Owner:
    """What the arm nodes of a process share. It lives on the first of them that joined."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._members: list[LupinNode] = []
        self._publisher: Publisher | None = None
        self._subscription: Subscription | None = None
        self._heard: tuple[bytes, int] | None = None
        self._decoded: tuple[bytes, ArmState | None] | None = None
        self.motion: ArmMotion | None = None

    def join(self, node: LupinNode) -> ArmMotion:
        with self._lock:
            self._members.append(node)
            if self.motion is None:
                self.motion = ArmMotion(self._state, self._send, self._clock_ns, self._listeners)
                self._move_to(node)
            return self.motion

    def leave(self, node: LupinNode) -> None:
        with self._lock:
            if node not in self._members:
                return
            was_host = self._members[0] is node
            self._members.remove(node)
            if was_host:
                node.destroy_publisher(self._publisher)
                node.destroy_subscription(self._subscription)
                if self._members:
                    self._move_to(self._members[0])
                else:
                    self.motion = self._heard = self._decoded = None

    def _move_to(self, node: LupinNode) -> None:
        self._publisher = node.publisher(graph.ARM_TRAJECTORY)
        self._subscription = node.subscription(graph.JOINT_STATES, self._hear, raw=True)

    def _hear(self, data: Any) -> None:
        # 50 messages a second come and few are asked for, so they are decoded when they are.
        if _MARK in data:
            self._heard = (data, self._clock_ns())

    def _clock_ns(self) -> int:
        return self._members[0].elapsed_clock_ns()

    def _listeners(self) -> int:
        return 0 if self._publisher is None else int(self._publisher.get_subscription_count())

    def _state(self) -> ArmState | None:
        heard = self._heard
        if heard is None:
            return None
        data, heard_ns = heard
        decoded = self._decoded
        if decoded is None or decoded[0] is not data:
            message = deserialize_message(data, JointState)
            decoded = (data, arm_state(message.name, message.position, heard_ns))
            self._decoded = decoded
        return decoded[1]

    def _send(self, path: tuple[Point, ...]) -> None:
        message = JointTrajectory(joint_names=list(graph.ARM_JOINTS))
        for point in path:
            row = JointTrajectoryPoint(positions=list(point.arm), velocities=[VELOCITY_HINT] * len(point.arm))
            row.time_from_start.sec = int(point.t_s)
            row.time_from_start.nanosec = min(999_999_999, round((point.t_s - int(point.t_s)) * 1e9))
            message.points.append(row)
        if self._publisher is not None:
            self._publisher.publish(message)


_OWNER = _Owner()


class ArmNode(LupinNode):
    """A node with a share in the arm: `motion`."""

    def __init__(self, name: str, parameters: dict[str, Any] | None = None) -> None:
        super().__init__(name, parameters)
        self.motion = _OWNER.join(self)

    def destroy_node(self) -> None:
        """Give the share back and end the node."""
        _OWNER.leave(self)
        super().destroy_node()
