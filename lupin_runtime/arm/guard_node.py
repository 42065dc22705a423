"""`arm_guard`, in the process `drive`: holds the arm and cancels goals when the process `body` cannot."""

from __future__ import annotations

from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from lupin_runtime import graph
from lupin_runtime.arm.backup_hold import BackupHold
from lupin_runtime.arm.controllers import ARM_ACTIONS
from lupin_runtime.arm.joint_state import arm_state
from lupin_runtime.arm.limits import Arm
from lupin_runtime.arm.messages import poses_of, trajectory_message
from lupin_runtime.arm.trajectory import MIN_DURATION_S, to_pose
from lupin_runtime.heartbeat import names_process
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.goal_canceler import GoalCanceler
from lupin_runtime.ros.polled_subscription import take_newest_with
from lupin_runtime.safety.estop_subscription import subscribe_estop

BODY = "body"  # the process of the stack's table that sends Lupin's arm commands
PERIOD_S = 0.1
_MARK = graph.ARM_JOINTS[0].encode()  # the wheels may be published in separate messages


class ArmGuard(LupinNode):
    """Holds the arm while `body` does not respond, by the rules of BackupHold, and cancels the goals of arm and gripper.

    It is light, because the drive bus shares its process: joint states are read only while they are needed.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("arm_guard", parameters)
        self._hold = BackupHold()
        self._acts = self._estop_engaged = False
        self._publisher = self.publisher(graph.ARM_TRAJECTORY)
        self._canceler = GoalCanceler(self, ARM_ACTIONS)
        self._joints = self.polled_subscription(graph.JOINT_STATES, graph.BEST5)
        subscribe_estop(self, self._on_estop)
        self.subscription(graph.ARM_TRAJECTORY, self._on_trajectory)
        # Real time, like the supervisor's messages and the e-stop's.
        self.create_timer(PERIOD_S, self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_estop(self, engaged: bool) -> None:
        was_engaged, self._estop_engaged = self._estop_engaged, engaged
        self._hold.estop(engaged, self.monotonic_ns())
        if self._acts and (engaged or was_engaged):
            self._canceler.cancel_all()  # also with the release: a goal may have arrived just before it

    def _on_trajectory(self, message: Any) -> None:
        self._hold.trajectory(poses_of(message), self._new_pose())

    def _on_tick(self) -> None:
        now_ns = self.monotonic_ns()
        body_responds = not names_process(LupinNode.motion_hold(), BODY)
        acted, self._acts = self._acts, self._hold.is_needed(body_responds, now_ns)
        pose = self._new_pose() if acted or self._acts else None
        if self._acts and not acted:
            self.get_logger().error(f"the process {BODY} does not respond: holding the arm")
            self._canceler.cancel_all()
            return  # the joint states that were waiting may be old
        if acted and not self._acts:
            self.get_logger().info(f"the process {BODY} holds the arm again")
        held = self._hold.tick(body_responds, pose, now_ns)
        if held is not None:
            self._publisher.publish(trajectory_message(to_pose(held, MIN_DURATION_S)))

    def _new_pose(self) -> Arm | None:
        """Return the newest pose that has arrived since the last call, in rad; None if none has."""
        newest = take_newest_with(self._joints, _MARK)
        if newest is None:
            return None
        message = deserialize_message(newest.data, JointState)
        state = arm_state(message.name, message.position, 0)
        return None if state is None else state.arm
