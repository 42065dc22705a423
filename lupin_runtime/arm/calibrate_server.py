"""`arm_calibrate_server`: writes the servos' zero offsets from a pose set by hand. On the robot only."""

from __future__ import annotations

from functools import partial
from typing import Any

from mirte_msgs.srv import GetServoOffset, SetServoAngle, SetServoOffset
from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import SetBool

from lupin_runtime import graph
from lupin_runtime.arm import waits
from lupin_runtime.arm.calibration import HOME_COUNTS, Finding, State, find
from lupin_runtime.arm.motion import CALIBRATING, Refused
from lupin_runtime.arm.owner import ArmNode
from lupin_runtime.arm.torque import PIN_SETTLE_S

READY_S = 2.0
CALL_S = 3.0
SETTLE_S = 2.0
SAMPLE_S = 2.0


class ArmCalibrateServer(ArmNode):
    """`/lupin/arm/calibrate`: start, commit, cancel, status.

    From start to commit or cancel the arm is limp and nobody else may command it. A cancel, or a start that fails, writes
    the offsets back that start had set to zero.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("arm_calibrate_server", parameters)
        self._group = ReentrantCallbackGroup()
        self._turnstile = waits.Turnstile()
        self._state = State.IDLE
        self._offsets: dict[str, int] = {}  # as start found them
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
        async with self._turnstile:
            try:
                if action is None:
                    raise Refused(f"action is {request.action!r}, expected one of {', '.join(actions)}")
                response.message = await action(response)
                response.success = True
            except (Refused, ValueError) as refusal:
                response.success, response.message = False, str(refusal)
            response.state = self._state.value
        return response

    async def _status(self, _: Any) -> str:
        return "pose the arm by hand, then commit" if self._state is State.AWAITING_POSE else "no calibration is under way"

    async def _start(self, _: Any) -> str:
        if self._state is not State.IDLE:
            raise Refused("a calibration is under way: commit or cancel it first")
        self.motion.hold(CALIBRATING)
        self._offsets = {}
        try:
            await self._switch(graph.VENDOR_ARM_GATE, False)
            await waits.sleep(self, SETTLE_S)
            for servo in HOME_COUNTS:
                self._offsets[servo] = await self._offset(servo)
                await self._set_offset(servo, 0)
                await self._set_angle_zero(servo)
            await self._switch(graph.VENDOR_TORQUE, False)
        except Refused as refusal:
            raise Refused(f"{refusal}{await self._give_back()}") from refusal
        self.motion.torque = False
        self._state = State.AWAITING_POSE
        return "the arm is limp: pose it by hand where every joint is at zero, then commit"

    async def _commit(self, response: Any) -> str:
        if self._state is not State.AWAITING_POSE:
            raise Refused("nothing to commit: start first, and pose the arm by hand")
        self._samples = {servo: [] for servo in HOME_COUNTS}
        await waits.sleep(self, SAMPLE_S)
        samples, self._samples = self._samples, None
        # All joints are judged before the first is written: a commit that fails here may be repeated.
        findings: dict[str, Finding] = {}
        for servo, raw in samples.items():
            findings[servo] = find(servo, raw, await self._offset(servo))
        for servo, finding in findings.items():
            if finding.offset is not None:
                await self._set_offset(servo, finding.offset)
        self._offsets = {}
        await self._stiffen(zero=[servo for servo, finding in findings.items() if finding.offset is not None])
        response.joint_names = list(findings)
        response.offsets_applied = [finding.offset or 0 for finding in findings.values()]
        response.diffs_observed = [finding.diff for finding in findings.values()]
        return "; ".join(finding.remark for finding in findings.values())

    async def _cancel(self, _: Any) -> str:
        if self._state is State.IDLE:
            return "no calibration is under way"
        trouble = await self._give_back()
        if trouble:
            raise Refused(f"cancelled{trouble}")
        return "cancelled; the offsets are as they were"

    async def _give_back(self) -> str:
        """Undo a start as far as that goes: every step is tried. Returns what went wrong, for the end of a message."""
        trouble = []
        for servo, offset in self._offsets.items():
            try:
                await self._set_offset(servo, offset)
            except Refused as refusal:
                trouble.append(f"{refusal} (its offset was {offset})")
        self._offsets = {}
        try:
            await self._stiffen(zero=[])
        except Refused as refusal:
            trouble.append(str(refusal))
        return "".join(f"; and {text}" for text in trouble)

    async def _stiffen(self, zero: list[str]) -> None:
        """Torque on, the given servos to zero, the controller told to want what is, then the gate open. Whatever of it
        fails, the calibration is over: the arm is given back, and /lupin/arm/set_torque can do the rest."""
        self._state = State.IDLE
        self.motion.let_go(CALIBRATING)
        await self._switch(graph.VENDOR_TORQUE, True)
        self.motion.torque = True
        for servo in zero:
            await self._set_angle_zero(servo)
        await waits.sleep(self, PIN_SETTLE_S)
        self.motion.pin()
        await waits.sleep(self, PIN_SETTLE_S)
        await self._switch(graph.VENDOR_ARM_GATE, True)

    # -- single calls; each raises Refused ----------------------------------------------------------------------------
    async def _switch(self, row: graph.Service, value: bool) -> None:
        answer = await self._call(row, SetBool.Request(data=value))
        if not answer.success:
            raise Refused(f"{row.name} refused: {answer.message or 'it gave no reason'}")

    async def _offset(self, servo: str) -> int:
        answer = await self._call(graph.servo_offset(servo), GetServoOffset.Request())
        return int(answer.centidegrees)

    async def _set_offset(self, servo: str, counts: int) -> None:
        await self._call(graph.servo_set_offset(servo), SetServoOffset.Request(centidegrees=counts))

    async def _set_angle_zero(self, servo: str) -> None:
        row = graph.servo_set_angle(servo)
        answer = await self._call(row, SetServoAngle.Request(angle=0.0, degrees=False))
        if not answer.status:
            raise Refused(f"{row.name} refused to go to zero")

    async def _call(self, row: graph.Service, request: Any) -> Any:
        client = self._vendor[row.name]
        if not await waits.ready(self, client.service_is_ready, READY_S):
            raise Refused(f"{row.name} is not there: does the vendor's servo driver run?")
        answer = await waits.answer(self, client.call_async(request), CALL_S)
        if answer is None:
            raise Refused(f"{row.name} did not answer within {CALL_S:g} s")
        return answer

    def _on_position(self, servo: str, message: Any) -> None:
        if self._samples is not None:
            self._samples[servo].append(int(message.raw))
