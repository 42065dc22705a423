"""`arm_preset_server` and `gripper_action_bridge`; the servers of library and calibration stand in files of their own.

In one process they share the arm (see `owner`): run them together.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from control_msgs.action import GripperCommand
from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import SetBool

from lupin_runtime import graph
from lupin_runtime.arm import waits
from lupin_runtime.arm.calibrate_server import ArmCalibrateServer
from lupin_runtime.arm.library_server import ArmLibraryServer
from lupin_runtime.arm.limits import GRIPPER_MAX_EFFORT, gripper_rad
from lupin_runtime.arm.motion import CALIBRATING, Refused
from lupin_runtime.arm.owner import ArmNode
from lupin_runtime.arm.presets import PRESET_DURATION_S, preset
from lupin_runtime.arm.torque import Step, steps

__all__ = ["ArmCalibrateServer", "ArmLibraryServer", "ArmPresetServer", "GripperActionBridge"]

PIN_POLL_S = 0.1
GRIPPER_SERVER_S = 2.0
INIT_DURATION_S = 5.0


class ArmPresetServer(ArmNode):
    """`/lupin/arm/preset`: one move to a named pose. Success says that it was sent; the gripper is left alone."""

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
            response.message = f"{request.name.strip().lower()} sent, {PRESET_DURATION_S:g} s"
        return response


class GripperActionBridge(ArmNode):
    """Single joints, the gripper, and the torque switch, all through the vendor's controllers.

    Raw servo calls would fight them: the vendor's hardware interface sends its own set-point again as soon as a servo sits
    elsewhere.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("gripper_action_bridge", parameters)
        # Reentrant: these services wait for answers to this very node.
        self._group = ReentrantCallbackGroup()
        self._turnstile = waits.Turnstile()
        self._gripper = self.action_client(graph.GRIPPER_COMMAND)
        self._torque_clients = {
            row: self.create_client(SetBool, row.name, callback_group=self._group)
            for row in (graph.VENDOR_ARM_GATE, graph.VENDOR_TORQUE)
        }
        for joint in graph.ARM_JOINTS:
            self.service(graph.arm_joint_angle(joint), self._joint_service(joint))
        self.service(graph.ARM_INIT, self._on_init)
        for row, callback in ((graph.GRIPPER_ANGLE, self._on_gripper), (graph.ARM_SET_TORQUE, self._on_torque)):
            self.service(row, callback, group=self._group)
        self._pin_timer = self.create_timer(PIN_POLL_S, self._pin_once)

    def _pin_once(self) -> None:
        """The controller may still want what it wanted before we came: tell it to want what is."""
        if not self.motion.pinned:
            try:
                self.motion.pin()
            except Refused:
                return  # no feedback or no controller yet: the next tick tries again
        # Destroyed, not cancelled: under simulated time a cancelled timer wakes the executor with every clock message.
        self.destroy_timer(self._pin_timer)

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
        try:
            # One scale in either unit: the console's, not the joint's own angle.
            position = gripper_rad(request.angle if request.degrees else math.degrees(request.angle))
        except ValueError as refusal:
            self.get_logger().warning(str(refusal), throttle_duration_sec=1.0)
            return response
        if not await waits.ready(self, self._gripper.server_is_ready, GRIPPER_SERVER_S):
            self.get_logger().warning(
                f"{graph.GRIPPER_COMMAND.name} has no server: is the gripper's controller active?", throttle_duration_sec=5.0
            )
            return response
        goal = GripperCommand.Goal()
        goal.command.position, goal.command.max_effort = position, GRIPPER_MAX_EFFORT
        self._gripper.send_goal_async(goal)
        response.status = True
        return response

    async def _on_torque(self, request: Any, response: Any) -> Any:
        async with self._turnstile:
            response.success, response.message = await self._switch_torque(bool(request.data))
        self.get_logger().info(f"torque {'on' if request.data else 'off'}: {response.message}")
        return response

    async def _switch_torque(self, on: bool) -> tuple[bool, str]:
        if self.motion.holder == CALIBRATING:
            return False, "the arm is being calibrated: commit or cancel that first"
        done: list[Step] = []
        for step in steps(on):
            failure = await self._take(step)
            if failure:
                for undo in (previous.undone() for previous in reversed(done)):
                    if undo is not None:
                        await self._take(undo)
                return False, failure
            done.append(step)
            if step.row is graph.VENDOR_TORQUE:
                self.motion.torque = step.value
        return True, "the arm is stiff and takes commands" if on else "the arm is limp and takes no commands"

    async def _take(self, step: Step) -> str:
        """Do one step; returns what went wrong, or nothing."""
        if step.row is None:
            try:
                self.motion.pin()
            except Refused as refusal:
                return str(refusal)
            await waits.sleep(self, step.settle_s)
            return ""
        client = self._torque_clients[step.row]
        if not await waits.ready(self, client.service_is_ready):
            return "" if step.optional else f"{step.row.name} is not there: does the vendor's servo driver run?"
        answer = await waits.answer(self, client.call_async(SetBool.Request(data=step.value)))
        if answer is None:
            return f"{step.row.name} did not answer within {waits.ANSWER_S:g} s"
        return "" if answer.success else f"{step.row.name} refused: {answer.message or 'it gave no reason'}"
