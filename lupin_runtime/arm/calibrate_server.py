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
from lupin_runtime.arm.motion import CALIBRATING, FRESH_S, Refused
from lupin_runtime.arm.shared_arm import ArmNode
from lupin_runtime.arm.torque import PIN_SETTLE_S
from lupin_runtime.safety.estop_subscription import subscribe_estop

READY_S = 2.0
CALL_S = 3.0
SETTLE_S = 2.0
SAMPLE_S = 2.0


class _Estopped(Refused):
    """The e-stop is engaged, or was since the action began."""


class ArmCalibrateServer(ArmNode):
    """`/lupin/arm/calibrate`: start, commit, cancel, status.

    Between start and commit or cancel the arm is limp and refuses other commands. A cancel, or a start that fails, restores
    the offsets that the start has set to zero.

    While the e-stop is engaged, start and commit are refused. If it engages during an action, each servo that may be moving is
    commanded to hold its present angle, and no further servo moves. A stiff servo also moves when its offset is written, so a
    start that the e-stop ends leaves the offsets as they are, and `cancel` restores them after the release. The cancel of a
    limp arm moves nothing, and works under the e-stop like status.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("arm_calibrate_server", parameters)
        self._group = ReentrantCallbackGroup()
        self._mutex = async_wait.AsyncMutex()
        self._state = State.IDLE
        self._estop_count = 0  # the arm's count when the action was accepted
        self._offsets: dict[str, int] = {}  # the offsets before start that have not been restored
        self._moving: set[str] = set()  # servos that the action may have set in motion
        self._stop_due: set[str] = set()  # of these, the ones to hold at the angle of their next message
        self._samples: dict[str, list[int]] | None = None
        rows = [graph.VENDOR_ARM_GATE, graph.VENDOR_TORQUE]
        for servo in HOME_COUNTS:
            rows += [graph.servo_offset(servo), graph.servo_set_offset(servo), graph.servo_set_angle(servo)]
            self.subscription(graph.servo_position(servo), partial(self._on_position, servo))
        self._vendor = {row.name: self.client(row, self._group) for row in rows}
        subscribe_estop(self, self._on_estop)
        self.service(graph.ARM_CALIBRATE, self._on_calibrate, self._group)

    async def _on_calibrate(self, request: Any, response: Any) -> Any:
        actions = {"start": self._start, "commit": self._commit, "cancel": self._cancel, "status": self._status}
        action = actions.get(request.action.strip().lower())
        async with self._mutex:
            try:
                if action is None:
                    raise Refused(f"action is {request.action!r}, expected one of {', '.join(actions)}")
                if action in (self._start, self._commit):
                    self.motion.require_released()
                self._estop_count = self.motion.estop_count
                response.message = await action(response)
                response.success = True
            except (Refused, ValueError) as refusal:
                response.success, response.message = False, str(refusal)
            self._moving.clear()
            response.state = self._state.value
        return response

    async def _status(self, _: Any) -> str:
        if self._state is State.AWAITING_POSE:
            return "pose the arm by hand, then commit"
        return f"the e-stop ended a start: {self._unrestored()}" if self._offsets else "no calibration is in progress"

    def _unrestored(self) -> str:
        return f"{', '.join(self._offsets)}: held, with an offset of 0; after the release, cancel restores the offsets"

    async def _start(self, _: Any) -> str:
        if self._state is not State.IDLE:
            raise Refused("a calibration is in progress: commit or cancel it first")
        if self._offsets:
            raise Refused(f"the e-stop ended the last start: {self._unrestored()}")
        self.motion.hold(CALIBRATING)
        try:
            await self._switch(graph.VENDOR_ARM_GATE, False)
            await async_wait.sleep(self, SETTLE_S)
            for servo in HOME_COUNTS:
                offset = await self._offset(servo)
                self._require_released()
                self._offsets[servo] = offset
                self.get_logger().info(f"{servo}: the offset before the calibration is {offset}")
                await self._set_offset(servo, 0)
                await self._set_angle_zero(servo)
            self._require_released()  # a limp arm sinks
            self.motion.torque = False  # also if the answer is lost
            await self._switch(graph.VENDOR_TORQUE, False)
        except Refused as refusal:
            raise await self._undo_start(refusal) from refusal
        self._state = State.AWAITING_POSE
        return "the arm is limp: pose it by hand with every joint at zero, then commit"

    async def _undo_start(self, refusal: Refused) -> Refused:
        """Undo a start that failed, or only hold its servos if the e-stop engaged; return the refusal for the operator."""
        if not (isinstance(refusal, _Estopped) and self._offsets):
            try:
                return Refused(f"{refusal}{await self._restore()}")
            except _Estopped:
                pass
        self._stop_servos()
        return Refused(f"{refusal}; {self._unrestored()}")

    async def _commit(self, response: Any) -> str:
        if self._state is not State.AWAITING_POSE:
            raise Refused("nothing to commit: start first, and pose the arm by hand")
        self._samples = {servo: [] for servo in HOME_COUNTS}
        await async_wait.sleep(self, SAMPLE_S)
        samples, self._samples = self._samples, None
        self._require_released()
        # All joints are evaluated before the first offset is written, so that a failed commit can be repeated.
        offsets: dict[str, ServoOffset] = {}
        for servo, raw in samples.items():
            offsets[servo] = find_offset(servo, raw, await self._offset(servo))
        for servo, found in offsets.items():
            if found.offset is not None:
                self._require_released()
                await self._set_offset(servo, found.offset)
        self._offsets = {}
        await self._stiffen(zero=[servo for servo, found in offsets.items() if found.offset is not None])
        response.joint_names = list(offsets)
        response.offsets_applied = [found.offset or 0 for found in offsets.values()]
        response.diffs_observed = [found.diff for found in offsets.values()]
        return "; ".join(found.remark for found in offsets.values())

    async def _cancel(self, _: Any) -> str:
        if self._state is State.IDLE and not self._offsets:
            return "no calibration is in progress"
        try:
            problems = await self._restore()
        except _Estopped as refusal:
            self._stop_servos()
            raise Refused(f"{refusal}; {self._unrestored()}") from refusal
        if problems:
            raise Refused(f"cancelled{problems}")
        return "cancelled; the offsets are as they were"

    async def _restore(self) -> str:
        """Undo a start; every step is tried. Return the failures as the end of a message.

        Raises _Estopped, with the remaining offsets not restored, if the e-stop engages while the arm is stiff.
        """
        problems = []
        for servo, offset in list(self._offsets.items()):
            if self._state is not State.AWAITING_POSE:
                self._require_released()
            try:
                await self._set_offset(servo, offset)
            except Refused as refusal:
                problems.append(f"{refusal} (its offset was {offset})")
            del self._offsets[servo]
        try:
            await self._stiffen(zero=[])
        except Refused as refusal:
            problems.append(str(refusal))
        return "".join(f"; and {text}" for text in problems)

    async def _stiffen(self, zero: list[str]) -> None:
        """Switch the torque on, move the servos `zero` to zero, hold the arm where it is, and open the gate.

        The calibration ends even if a step fails; /lupin/arm/set_torque can then complete the switch. Without `zero` this moves
        nothing.
        """
        self._state = State.IDLE
        self.motion.release(CALIBRATING)
        await async_wait.sleep(self, PIN_SETTLE_S)  # the angles follow the offsets; switched on earlier, the servos would move
        await self._switch(graph.VENDOR_TORQUE, True)
        self.motion.torque = True
        try:
            for servo in zero:
                await self._set_angle_zero(servo)
        except _Estopped:
            self._stop_servos()
        await async_wait.sleep(self, PIN_SETTLE_S)
        self.motion.pin(FRESH_S)
        await async_wait.sleep(self, PIN_SETTLE_S)
        await self._switch(graph.VENDOR_ARM_GATE, True)
        if zero and self._estop_count != self.motion.estop_count:
            raise Refused("e-stop engaged: the offsets are written, and the arm is held before its joints are at zero")

    # -- e-stop -------------------------------------------------------------------------------------------------------
    def _on_estop(self, engaged: bool) -> None:
        if engaged:
            self._stop_servos()

    def _stop_servos(self) -> None:
        """Hold every servo that may be moving, once its present angle is known."""
        self._stop_due |= self._moving
        self._moving.clear()

    def _require_released(self) -> None:
        try:
            self.motion.require_released(since=self._estop_count)
        except Refused as refusal:
            raise _Estopped(str(refusal)) from refusal

    # -- single calls; each raises Refused ----------------------------------------------------------------------------
    async def _switch(self, row: graph.Service, value: bool) -> None:
        answer = await self._call(row, SetBool.Request(data=value))
        if not answer.success:
            raise Refused(f"{row.name} refused: {answer.message or 'no reason given'}")

    async def _offset(self, servo: str) -> int:
        answer = await self._call(graph.servo_offset(servo), GetServoOffset.Request())
        return int(answer.centidegrees)

    async def _set_offset(self, servo: str, counts: int) -> None:
        if self._state is not State.AWAITING_POSE:
            self._moving.add(servo)
        await self._call(graph.servo_set_offset(servo), SetServoOffset.Request(centidegrees=counts))

    async def _set_angle_zero(self, servo: str) -> None:
        self._require_released()
        self._moving.add(servo)
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
        if servo in self._stop_due:
            self._stop_due.remove(servo)
            client = self._vendor[graph.servo_set_angle(servo).name]
            client.call_async(SetServoAngle.Request(angle=message.angle, degrees=False))
        if self._samples is not None:
            self._samples[servo].append(int(message.raw))
