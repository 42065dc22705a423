"""`arm_preset_server` and `gripper_action_bridge`; the servers of library and calibration have their own modules.

All four run in one process, in which they share the arm (see `shared_arm`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from control_msgs.action import GripperCommand
from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import SetBool

from lupin_runtime import graph
from lupin_runtime.arm import async_wait
from lupin_runtime.arm.calibrate_server import ArmCalibrateServer
from lupin_runtime.arm.controllers import ARM_ACTIONS
from lupin_runtime.arm.library_server import ArmLibraryServer
from lupin_runtime.arm.limits import GRIPPER_MAX_EFFORT, gripper_rad
from lupin_runtime.arm.motion import CALIBRATING, Refused
from lupin_runtime.arm.presets import PRESET_DURATION_S, preset
from lupin_runtime.arm.shared_arm import ArmNode
from lupin_runtime.arm.torque import HOLD, TORQUE_OFF, TorqueStep, steps
from lupin_runtime.ros.goal_canceler import GoalCanceler
from lupin_runtime.safety.estop_subscription import subscribe_estop

__all__ = ["ArmCalibrateServer", "ArmLibraryServer", "ArmPresetServer", "GripperActionBridge"]

PIN_POLL_S = 0.1
PIN_TRIES = 5  # of a pin that needs feedback of now
GRIPPER_SERVER_S = 2.0
INIT_DURATION_S = 5.0


class ArmPresetServer(ArmNode):
    """`/lupin/arm/preset`: one move to a named pose. Success means that it was sent. The gripper is not moved."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("arm_preset_server", parameters)
        self.service(graph.ARM_PRESET, self._on_preset)

    def _on_preset(self, request: Any, response: Any) -> Any:
        try:
            self.motion.move(preset(request.name), PRESET_DURATION_S)
        except (ValueError, Refused) as refusal:
            response.success, response.message = False, str(refusal)
        else:
            response.success = True
            response.message = f"moving to {request.name.strip().lower()}, {PRESET_DURATION_S:g} s"
        return response


class GripperActionBridge(ArmNode):
    """Single joints, the gripper and the torque switch, all through the vendor's controllers.

    Direct servo calls would not last: the vendor's hardware interface repeats its own set-point as soon as a servo deviates
    from it.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("gripper_action_bridge", parameters)
        # Reentrant: these services await responses to this same node.
        self._group = ReentrantCallbackGroup()
        self._mutex = async_wait.AsyncMutex()
        self._estop_engaged = False
        self._gripper = self.action_client(graph.GRIPPER_COMMAND)
        self._torque_clients = {
            row: self.create_client(SetBool, row.name, callback_group=self._group)
            for row in (graph.VENDOR_ARM_GATE, graph.VENDOR_TORQUE)
        }
        self._canceler = GoalCanceler(self, ARM_ACTIONS, self._group)
        for joint in graph.ARM_JOINTS:
            self.service(graph.arm_joint_angle(joint), self._joint_service(joint))
        self.service(graph.ARM_INIT, self._on_init)
        for row, callback in ((graph.GRIPPER_ANGLE, self._on_gripper), (graph.ARM_SET_TORQUE, self._on_torque)):
            self.service(row, callback, group=self._group)
        subscribe_estop(self, self._on_estop)
        self._pin_timer = self.create_timer(PIN_POLL_S, self._pin_once)

    def _pin_once(self) -> None:
        """Replace the controller's old set-point, which may differ from the arm's pose, by the present pose."""
        if not self.motion.pinned:
            try:
                self.motion.pin()
            except Refused:
                return  # no feedback or no controller yet: the next tick tries again
        # Destroyed, not cancelled: in simulated time a cancelled timer wakes the executor with every clock message.
        self.destroy_timer(self._pin_timer)

    def _on_estop(self, engaged: bool) -> None:
        """Cancel all clients' goals of the vendor's controllers with each message up to and including the release.

        A goal may arrive while the e-stop is engaged, even between the last two messages.
        """
        was_engaged, self._estop_engaged = self._estop_engaged, engaged
        if engaged or was_engaged:
            self._canceler.cancel_all()

    def _joint_service(self, joint: str) -> Callable[[Any, Any], Any]:
        def serve(request: Any, response: Any) -> Any:
            angle, rate = request.angle, request.rate
            if request.degrees:
                angle, rate = math.radians(angle), math.radians(rate)
            try:
                self.motion.move_joint(joint, angle, rate)
            except (ValueError, Refused) as refusal:
                self.get_logger().warning(str(refusal), throttle_duration_sec=1.0)
                response.status = False
            else:
                response.status = True
            return response

        return serve

    def _on_init(self, _: Any, response: Any) -> Any:
        try:
            self.motion.move((0.0, 0.0, 0.0, 0.0), INIT_DURATION_S)
        except Refused as refusal:
            response.success, response.message = False, str(refusal)
        else:
            response.success, response.message = True, f"all joints to 0 over {INIT_DURATION_S:g} s"
        return response

    async def _on_gripper(self, request: Any, response: Any) -> Any:
        response.status = False
        estop_count = self.motion.estop_count
        try:
            self.motion.require_released()
            # Both units use the console's scale, not the joint's angle.
            position = gripper_rad(request.angle if request.degrees else math.degrees(request.angle))
        except (ValueError, Refused) as refusal:
            self.get_logger().warning(str(refusal), throttle_duration_sec=1.0)
            return response
        if not await async_wait.ready(self, self._gripper.server_is_ready, GRIPPER_SERVER_S):
            self.get_logger().warning(
                f"{graph.GRIPPER_COMMAND.name} has no server; check that the gripper's controller is active: lupin home",
                throttle_duration_sec=5.0,
            )
            return response
        try:
            self.motion.require_released(since=estop_count)
        except Refused as refusal:
            self.get_logger().warning(str(refusal), throttle_duration_sec=1.0)
            return response
        goal = GripperCommand.Goal()
        goal.command.position, goal.command.max_effort = position, GRIPPER_MAX_EFFORT
        self._gripper.send_goal_async(goal)
        response.status = True
        return response

    async def _on_torque(self, request: Any, response: Any) -> Any:
        async with self._mutex:
            response.success, response.message = await self._switch_torque(bool(request.data))
        self.get_logger().info(f"torque {'on' if request.data else 'off'}: {response.message}")
        return response

    async def _switch_torque(self, on: bool) -> tuple[bool, str]:
        if self.motion.holder == CALIBRATING:
            return False, "a calibration is in progress: commit or cancel it first"
        done: list[TorqueStep] = []
        estop_count = self.motion.estop_count
        for step in steps(on):
            failure = "" if on else self._estop_refusal(estop_count)  # a limp arm sinks; a stiff one is held where it is
            answered = True
            if not failure:
                failure, answered = await self._execute(step)
            if not answered and step == TORQUE_OFF:
                # It may have been executed. A limp arm must count as limp, and its gate stay closed, or it jumps when the
                # torque returns; for a stiff one this only means that it moves after the next switch.
                self.motion.torque = False
                return False, f"{failure}, so the torque may be off: hold the arm, and switch the torque on or off again"
            if failure:
                for undo in (previous.undone() for previous in reversed(done)):
                    if undo is None:
                        continue
                    # The controller's set-point has gone on behind the closed gate, and the arm would jump to it. Until the
                    # gate is open again, no other command may move it on.
                    was, self.motion.torque = self.motion.torque, False
                    unknown = (await self._execute(HOLD))[0] or (await self._execute(undo))[0]
                    if unknown:
                        return False, f"{failure}, and {unknown}: the arm takes no commands; switch its torque on"
                    self.motion.torque = was
                return False, failure
            done.append(step)
            if step.row is graph.VENDOR_TORQUE:
                self.motion.torque = step.value
        return True, "the arm is stiff and takes commands" if on else "the arm is limp and takes no commands"

    async def _pin(self) -> str:
        """Hold the arm's present pose; return why it could not be held, or an empty string."""
        reason = ""
        for _ in range(PIN_TRIES):
            try:
                self.motion.pin()
            except Refused as refusal:
                reason = str(refusal)
                await async_wait.sleep(self, PIN_POLL_S)
            else:
                return ""
        return reason

    def _estop_refusal(self, estop_count: int) -> str:
        try:
            self.motion.require_released(since=estop_count)
        except Refused as refusal:
            return str(refusal)
        return ""

    async def _execute(self, step: TorqueStep) -> tuple[str, bool]:
        """Execute one step; return an error message, or an empty string, and whether it is known what became of it."""
        if step.row is None:
            if refusal := await self._pin():
                return refusal, True
            await async_wait.sleep(self, step.settle_s)
            return "", True
        client = self._torque_clients[step.row]
        if not await async_wait.ready(self, client.service_is_ready):
            return "" if step.optional else f"{step.row.name} has no server; check that the vendor's servo driver runs", True
        answer = await async_wait.answer(self, client.call_async(SetBool.Request(data=step.value)))
        if answer is None:
            return f"{step.row.name} did not respond within {async_wait.ANSWER_S:g} s", False
        return "" if answer.success else f"{step.row.name} refused: {answer.message or 'no reason given'}", True
