"""The publisher of arm trajectories, and the subscriptions to `/joint_states` and the e-stop, that the arm nodes of a process
share.

Each node has its own thread, so shared data is either locked (ArmMotion, the last pose) or replaced as a whole.
"""

from __future__ import annotations

import threading
import time
from typing import Any

from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from lupin_runtime import graph
from lupin_runtime.arm.joint_state import arm_state
from lupin_runtime.arm.messages import poses_of, trajectory_message
from lupin_runtime.arm.motion import ArmMotion, ArmState
from lupin_runtime.arm.trajectory import Point
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.polled_subscription import take_newest_with
from lupin_runtime.safety.estop_subscription import subscribe_estop

LAST_COMMAND_S = 0.05  # a publisher that is destroyed earlier may drop its last message
# Nodes that subscribe to arm trajectories but move nothing.
OBSERVERS = ("arm_guard", "arm_monitor", "lupin_recorder", "lupin_console", "lupin_foxglove")
# Every serialized message with the arm's joints contains this; the wheels may be published in separate messages.
_MARK = graph.ARM_JOINTS[0].encode()


class _SharedArm:
    """What the arm nodes of a process share. Its publisher and subscription belong to the first node that joined."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._members: list[LupinNode] = []
        self._publisher: Publisher | None = None
        self._subscriptions: tuple[Subscription, ...] = ()
        self._joints: Subscription | None = None
        self._joints_lock = threading.Lock()  # a node that holds the arm's lock may read the joints
        self._read_ns: int | None = None
        self._last: ArmState | None = None
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
                with self._joints_lock:
                    node.destroy_publisher(self._publisher)
                    for subscription in self._subscriptions:
                        node.destroy_subscription(subscription)
                    self._joints = None
                if self._members:
                    self._move_to(self._members[0])
                else:
                    self.motion = self._joints = self._last = self._read_ns = None

    def _move_to(self, node: LupinNode) -> None:
        self._publisher = node.publisher(graph.ARM_TRAJECTORY)
        # 50 messages arrive per second and few are read: waking a node for each would be the highest load of the process.
        self._joints = node.polled_subscription(graph.JOINT_STATES, graph.BEST5)
        self._subscriptions = (
            *subscribe_estop(node, self._on_estop),
            self._joints,
            node.subscription(graph.ARM_TRAJECTORY, self._on_trajectory),
        )

    def _on_estop(self, engaged: bool) -> None:
        motion = self.motion
        if motion is not None:
            motion.set_estop(engaged)

    def _on_trajectory(self, message: Any) -> None:
        motion = self.motion
        if motion is not None:
            motion.counter(poses_of(message))

    def _clock_ns(self) -> int:
        return self._members[0].elapsed_clock_ns()

    def _listeners(self) -> int:
        """Return the number of matched subscriptions without this process's own and those of observers."""
        if self._publisher is None:
            return 0
        host = self._members[0]
        names = [info.node_name for info in host.get_subscriptions_info_by_topic(graph.ARM_TRAJECTORY.name)]
        observers = sum(name in (host.get_name(), *OBSERVERS) for name in names)
        return max(0, int(self._publisher.get_subscription_count()) - observers)

    def _state(self) -> ArmState | None:
        with self._joints_lock:
            joints, now_ns = self._joints, self._clock_ns()
            taken = None if joints is None else take_newest_with(joints, _MARK)
            since_ns, self._read_ns = self._read_ns, now_ns
            if taken is not None:
                # It has arrived since the last reading, whatever a wall clock says that was set meanwhile.
                age_ns = int(taken.age_s * 1e9) if since_ns is None else max(0, min(int(taken.age_s * 1e9), now_ns - since_ns))
                message = deserialize_message(taken.data, JointState)
                self._last = arm_state(message.name, message.position, now_ns - age_ns)
            return self._last

    def _send(self, path: tuple[Point, ...]) -> None:
        if self._publisher is not None:
            self._publisher.publish(trajectory_message(path))


_SHARED_ARM = _SharedArm()


class ArmNode(LupinNode):
    """A node that commands the arm through the shared `motion`."""

    def __init__(self, name: str, parameters: dict[str, Any] | None = None) -> None:
        super().__init__(name, parameters)
        self.motion = _SHARED_ARM.join(self)

    def before_shutdown(self) -> None:
        """Hold the arm if it is still following a trajectory."""
        if self.motion.stop_unfinished():
            time.sleep(LAST_COMMAND_S)

    def destroy_node(self) -> None:
        """Leave the shared arm and destroy the node."""
        _SHARED_ARM.leave(self)
        super().destroy_node()
