"""`arm_teleop`: jogs the arm by the rates that gamepads send. It runs beside the other arm nodes, whose arm it shares."""

from __future__ import annotations

from typing import Any

from mirte_msgs.srv import SetServoAngleWithSpeed
from rclpy.clock import Clock, ClockType
from rclpy.task import Future

from lupin_runtime import graph
from lupin_runtime.arm.jog import ArmJog
from lupin_runtime.arm.jog_messages import jog_rates
from lupin_runtime.arm.limits import gripper_deg
from lupin_runtime.arm.shared_arm import ArmNode

TICK_S = 0.05
GRIPPER_PERIOD_S = 0.1
GRIPPER_CHANGE_RAD = 1e-3
GRIPPER_RATE_DEGPS = 45.0
# A call of the gripper's service that has no answer by then is given up.
GRIPPER_ANSWER_S = 2.5


class ArmTeleop(ArmNode):
    """The node of the jog. Its waits are real time, like a gamepad's dead-man button, also in a simulation."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("arm_teleop", parameters)
        self._jog = ArmJog(self.motion, self._want_gripper)
        self._gripper = self.client(graph.GRIPPER_ANGLE)
        self._wanted_rad: float | None = None  # the newest angle of the gripper that has not been sent
        self._sent_rad: float | None = None
        self._sent_ns = 0
        self._answer: Future | None = None
        self._gripper_refusal = ""  # why the gripper is not jogged, until a command of it is accepted or the jog ends
        self._told = ""
        self.subscription(graph.ARM_JOG, self._on_rates)
        self._tick = self.create_timer(TICK_S, self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._tick.cancel()  # it runs during a jog, and while one is refused

    def before_shutdown(self) -> None:
        """End the jog, and hold the arm."""
        self._jog.close()
        super().before_shutdown()

    def _on_rates(self, message: Any) -> None:
        try:
            self._jog.handle(jog_rates(message), self.monotonic_ns())
        except ValueError as error:
            self.get_logger().warning(f"{graph.ARM_JOG.name}: {error}", throttle_duration_sec=5.0)
        self._tell()
        if self._tick.is_canceled() and (self._jog.source or self._jog.refusal):
            self._tick.reset()

    def _on_tick(self) -> None:
        self._jog.tick(self.monotonic_ns())
        if self._jog.source:
            self._send_gripper()
        else:
            self._wanted_rad = self._sent_rad = None  # a jog that has ended moves nothing more
            self._gripper_refusal = ""
            if not self._jog.refusal:
                self._tick.cancel()
        self._tell()

    def _tell(self) -> None:
        source, refusal = self._jog.source, self._jog.refusal or self._gripper_refusal
        self.motion.jogged_by, self.motion.jog_refusal = source, refusal
        if refusal and refusal != self._told:
            self.get_logger().warning(f"the arm is not jogged: {refusal}" if self._jog.refusal else refusal)
        self._told = refusal

    def _want_gripper(self, angle_rad: float) -> None:
        self._wanted_rad = angle_rad
        self._send_gripper()

    def _send_gripper(self) -> None:
        wanted, now_ns = self._wanted_rad, self.monotonic_ns()
        since_s = (now_ns - self._sent_ns) / 1e9
        pending = self._answer is not None and not self._answer.done()
        if wanted is None or since_s < (GRIPPER_ANSWER_S if pending else GRIPPER_PERIOD_S):
            return
        if pending and self._answer is not None:
            self._gripper.remove_pending_request(self._answer)
            self._answer = None
            self._refuse_gripper(f"{graph.GRIPPER_ANGLE.name} did not respond within {GRIPPER_ANSWER_S:g} s")
        self._wanted_rad = None
        if self._sent_rad is not None and abs(wanted - self._sent_rad) < GRIPPER_CHANGE_RAD:
            return
        if not self._gripper.service_is_ready():
            self._refuse_gripper(f"{graph.GRIPPER_ANGLE.name} has no server")
            return
        self._sent_rad, self._sent_ns = wanted, now_ns
        request = SetServoAngleWithSpeed.Request(angle=gripper_deg(wanted), rate=GRIPPER_RATE_DEGPS, degrees=True)
        self._answer = self._gripper.call_async(request)
        self._answer.add_done_callback(self._on_gripper_answer)

    def _on_gripper_answer(self, answer: Any) -> None:
        if self._answer is None or answer is not self._answer or answer.cancelled():
            return  # of an earlier command
        if answer.exception() is None and answer.result().status:
            self._gripper_refusal = ""
        else:
            self._refuse_gripper("its command was refused; activate its controller: lupin home")

    def _refuse_gripper(self, why: str) -> None:
        """Say why the gripper is not moved, and send its angle again while the jog goes on."""
        self._gripper_refusal, self._sent_rad = f"the gripper does not move: {why}" if self._jog.source else "", None
        self._tell()
