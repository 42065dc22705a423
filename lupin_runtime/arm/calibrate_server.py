"""`arm_calibrate_server`: writes the servos' zero offsets from a pose that is set by hand. It runs only on the robot."""

from __future__ import annotations

from functools import partial
from typing import Any

from mirte_msgs.srv import GetServoOffset, SetServoAngle, SetServoOffset
from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import SetBool

from lupin_runtime import graph
from lupin_runtime.arm import async_wait
from lupin_runtime.arm.calibration import HOME_COUNTS, ServoOffset, State, find_offset
from lupin_runtime.arm.motion import CALIBRATING, Refused
from lupin_runtime.arm.shared_arm import ArmNode
from lupin_runtime.arm.torque import PIN_SETTLE_S

READY_S = 2.0
CALL_S = 3.0
SETTLE_S = 2.0
SAMPLE_S = 2.0


class ArmCalibrateServer(ArmNode):
    """`/lupin/arm/calibrate`: start, commit, cancel, status.

    Between start and commit or cancel the arm is limp and refuses other commands. A cancel, or a start that fails, restores
    the offsets that the start has set to zero. While the e-stop is engaged all actions but status are refused, and no further
    servo is moved.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("arm_calibrate_server", parameters)
        self._group = ReentrantCallbackGroup()
        self._mutex = async_wait.AsyncMutex()
        self._state = State.IDLE
        self._estop_count = 0  # the arm's count when the action was accepted
        self._offsets: dict[str, int] = {}  # the offsets before start
        self._samples: dict[str, list[int]] | None = None
        rows = [graph.VENDOR_ARM_GATE, graph.VENDOR_TORQUE]
        for servo in HOME_COUNTS:
            rows += [graph.servo_offset(servo), graph.servo_set_offset(servo), graph.servo_set_angle(servo)]
            self.subscription(graph.servo_position(servo), partial(self._on_position, servo))
        self._vendor = {row.name: self.client(row, self._group) for row in rows}
        self.service(graph.ARM_CALIBRATE, self._on_calibrate, self._group)

    async def _on_calibrate(self, request: Any, response: Any) -> Any:
        actions = {"start": self._start, "commit": self._commit, "cancel": self._cancel, "status": self._status}
        action = actions.get(request.action.strip().lower())
        async with self._mutex:
            try:
                if action is None:
                    raise Refused(f"action is {request.action!r}, expected one of {', '.join(actions)}")
                if action != self._status:
                    self.motion.require_released()
                self._estop_count = self.motion.estop_count
                response.message = await action(response)
                response.success = True
            except (Refused, ValueError) as refusal:
                response.success, response.message = False, str(refusal)
            response.state = self._state.value
        return response

    async def _status(self, _: Any) -> str:
        return "pose the arm by hand, then commit" if self._state is State.AWAITING_POSE else "no calibration is in progress"

    async def _start(self, _: Any) -> str:
        if self._state is not State.IDLE:
            raise Refused("a calibration is in progress: commit or cancel it first")
        self.motion.hold(CALIBRATING)
        self._offsets = {}
        try:
            await self._switch(graph.VENDOR_ARM_GATE, False)
            await async_wait.sleep(self, SETTLE_S)
            for servo in HOME_COUNTS:
                self._offsets[servo] = await self._offset(servo)
                await self._set_offset(servo, 0)
                await self._set_angle_zero(servo)
            await self._switch(graph.VENDOR_TORQUE, False)
        except Refused as refusal:
            raise Refused(f"{refusal}{await self._restore()}") from refusal
        self.motion.torque = False
        self._state = State.AWAITING_POSE
        return "the arm is limp: pose it by hand with every joint at zero, then commit"

    async def _commit(self, response: Any) -> str:
        if self._state is not State.AWAITING_POSE:
            raise Refused("nothing to commit: start first, and pose the arm by hand")
        self._samples = {servo: [] for servo in HOME_COUNTS}
        await async_wait.sleep(self, SAMPLE_S)
        samples, self._samples = self._samples, None
        self.motion.require_released(since=self._estop_count)
        # All joints are evaluated before the first offset is written, so that a failed commit can be repeated.
        offsets: dict[str, ServoOffset] = {}
        for servo, raw in samples.items():
            offsets[servo] = find_offset(servo, raw, await self._offset(servo))
        for servo, found in offsets.items():
            if found.offset is not None:
                await self._set_offset(servo, found.offset)
        self._offsets = {}
        await self._stiffen(zero=[servo for servo, found in offsets.items() if found.offset is not None])
        response.joint_names = list(offsets)
        response.offsets_applied = [found.offset or 0 for found in offsets.values()]
        response.diffs_observed = [found.diff for found in offsets.values()]
        return "; ".join(found.remark for found in offsets.values())

    async def _cancel(self, _: Any) -> str:
        if self._state is State.IDLE:
            return "no calibration is in progress"
        problems = await self._restore()
        if problems:
            raise Refused(f"cancelled{problems}")
        return "cancelled; the offsets are as they were"

    async def _restore(self) -> str:
        """Undo a start; every step is tried. Return the failures as the end of a message."""
        problems = []
        for servo, offset in self._offsets.items():
            try:
                await self._set_offset(servo, offset)
            except Refused as refusal:
                problems.append(f"{refusal} (its offset was {offset})")
        self._offsets = {}
        try:
            await self._stiffen(zero=[])
        except Refused as refusal:
            problems.append(str(refusal))
        return "".join(f"; and {text}" for text in problems)

    async def _stiffen(self, zero: list[str]) -> None:
        """Switch the torque on, move the servos `zero` to zero, hold the arm where it is, and open the gate.

        The calibration ends even if a step fails; /lupin/arm/set_torque can then complete the switch.
        """
        self._state = State.IDLE
        self.motion.release(CALIBRATING)
        await self._switch(graph.VENDOR_TORQUE, True)
        self.motion.torque = True
        estop_refusal = None
        try:
            for servo in zero:
                await self._set_angle_zero(servo)
        except Refused as refusal:
            if self._estop_count == self.motion.estop_count:
                raise
            estop_refusal = refusal
        await async_wait.sleep(self, PIN_SETTLE_S)
        self.motion.pin()
        await async_wait.sleep(self, PIN_SETTLE_S)
        await self._switch(graph.VENDOR_ARM_GATE, True)
        if estop_refusal is not None:
            raise estop_refusal

    # -- single calls; each raises Refused ----------------------------------------------------------------------------
    async def _switch(self, row: graph.Service, value: bool) -> None:
        answer = await self._call(row, SetBool.Request(data=value))
        if not answer.success:
            raise Refused(f"{row.name} refused: {answer.message or 'no reason given'}")

    async def _offset(self, servo: str) -> int:
        answer = await self._call(graph.servo_offset(servo), GetServoOffset.Request())
        return int(answer.centidegrees)

    async def _set_offset(self, servo: str, counts: int) -> None:
        await self._call(graph.servo_set_offset(servo), SetServoOffset.Request(centidegrees=counts))

    async def _set_angle_zero(self, servo: str) -> None:
        self.motion.require_released(since=self._estop_count)
        row = graph.servo_set_angle(servo)
        answer = await self._call(row, SetServoAngle.Request(angle=0.0, degrees=False))
        if not answer.status:
            raise Refused(f"{row.name} refused to go to zero")

    async def _call(self, row: graph.Service, request: Any) -> Any:
        client = self._vendor[row.name]
        if not await async_wait.ready(self, client.service_is_ready, READY_S):
            raise Refused(f"{row.name} has no server; check that the vendor's servo driver runs")
        answer = await async_wait.answer(self, client.call_async(request), CALL_S)
        if answer is None:
            raise Refused(f"{row.name} did not respond within {CALL_S:g} s")
        return answer

    def _on_position(self, servo: str, message: Any) -> None:
        if self._samples is not None:
            self._samples[servo].append(int(message.raw))
