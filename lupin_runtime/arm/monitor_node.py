"""`arm_monitor`: says what the arm does, which joints do not follow, and how long shoulder_lift has held it extended."""

from __future__ import annotations

import json
from typing import Any

from rclpy.clock import Clock, ClockType
from std_msgs.msg import String

from lupin_runtime import graph
from lupin_runtime.arm.load_budget import LoadBudget
from lupin_runtime.arm.messages import path_of
from lupin_runtime.arm.motion import ArmState
from lupin_runtime.arm.shared_arm import ArmNode
from lupin_runtime.arm.stall import BlockedJoint, StallWatch

TICK_S = 0.2
REPEAT_S = 1.0  # of a status that has not changed


class ArmMonitor(ArmNode):
    """The node of `/lupin/arm/status`. It compares trajectories of any publisher with feedback, and moves nothing."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("arm_monitor", parameters)
        self._watch, self._budget = StallWatch(), LoadBudget()
        self._blocked: tuple[BlockedJoint, ...] = ()
        self._published: dict[str, object] = {}  # without the figures that change all the time
        self._published_ns: int | None = None
        self._status = self.publisher(graph.ARM_STATUS)
        self.subscription(graph.ARM_TRAJECTORY, self._on_trajectory)
        # Real time: the status is repeated also while the simulated time stands still.
        self.create_timer(TICK_S, self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_trajectory(self, message: Any) -> None:
        state = self.motion.state(fresh=True)
        if state is not None:
            self._watch.expect(path_of(message), state.arm, self.elapsed_clock_ns())

    def _on_tick(self) -> None:
        self.motion.hold_if_due()
        now_ns, state = self.elapsed_clock_ns(), self.motion.state(fresh=True)
        is_limp = self.motion.torque is False
        self._find_blocked(state, is_limp, now_ns)
        if is_limp or state is not None:  # the time without a pose counts as what it is found in
            is_warning = self._budget.step(None if is_limp or state is None else state.arm, now_ns)
            if is_warning:
                self.get_logger().warning(self._budget.sentence())
        self._publish(state, self._watch.is_moving(now_ns))

    def _find_blocked(self, state: ArmState | None, is_limp: bool, now_ns: int) -> None:
        if is_limp:
            self._watch.forget()
        before = {each.joint for each in self._blocked}
        self._blocked = () if state is None else self._watch.check(state.arm, now_ns)
        self.motion.blocked = tuple(each.joint for each in self._blocked)
        for each in self._blocked:
            if each.joint not in before:
                self.get_logger().warning(f"{each.sentence()} ({each.places()})")

    def _publish(self, state: ArmState | None, is_moving: bool) -> None:
        motion, budget = self.motion, self._budget
        status = {
            "holder": motion.holder or "",
            "moving": is_moving,
            "jogged_by": motion.jogged_by,
            "jog_refusal": motion.jog_refusal,
            "blocked": list(motion.blocked),
            "limp": motion.torque is False,
            "pose_known": state is not None,
            "extended_too_long": budget.is_spent,
        }
        now_ns = self.monotonic_ns()
        is_due = self._published_ns is None or now_ns - self._published_ns >= REPEAT_S * 1e9
        if status == self._published and not is_due:
            return
        self._published, self._published_ns = status, now_ns
        alarms = [each.sentence() for each in self._blocked] + [budget.sentence()] * budget.is_spent
        figures = {"extended_s": round(budget.held_s, 1), "extended_total_s": round(budget.total_s, 1)}
        self._status.publish(String(data=json.dumps({**status, **figures, "alarms": alarms})))
