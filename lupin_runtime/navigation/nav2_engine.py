"""Nav2 in place of Lupin's own navigation: its programs, and the gate that its velocities pass."""

from __future__ import annotations

from functools import partial
from typing import Any

from lupin_runtime import graph
from lupin_runtime.drive.twist import ZERO, decode, encode
from lupin_runtime.navigation.costmap import LocalCostmap
from lupin_runtime.navigation.engine_gate import EngineGate
from lupin_runtime.navigation.nav2_parameters import nav2_parameters
from lupin_runtime.navigation.parameters import declare_parameters
from lupin_runtime.navigation.robot_state import RobotState
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.goal_canceler import MOVING_ACTIONS, GoalCanceler
from lupin_runtime.ros.system_programs import SystemPrograms
from lupin_runtime.safety.estop_subscription import subscribe_estop

SILENCE_S = 0.5  # as the drive bus's, before which the velocity smoother repeats the last velocity
CANCEL_PERIOD_S = 0.2
_ENDED = 4  # action_msgs/GoalStatus: from STATUS_SUCCEEDED on, a goal has ended


class Nav2Engine(SystemPrograms):
    """Nav2's programs. Each of them that publishes velocities does so on `graph.CMD_VEL_ENGINE`."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        remapped = {"cmd_vel": graph.CMD_VEL_ENGINE.name}
        super().__init__("nav2_engine", nav2_parameters(self.simulated_time), remapped, parameters)


class Nav2Gate(LupinNode):
    """Passes Nav2's velocities to the velocity smoother, but not against the e-stop or with a lidar that cannot be trusted."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("nav2_gate", parameters)
        values = declare_parameters(self)
        known = (graph.ESTOP_STATE, graph.ESTOP_STATUS)
        self._gate = EngineGate(topic.name for topic in known)
        self._moving_since_s: float | None = None  # when the last velocity that is not zero was passed
        local = values.local_costmap
        self._robot_state = RobotState(
            self,
            LocalCostmap(local.width, local.resolution, values.inflation, local.limits()),
            self._now_s,
            values.transform_timeout_s,
            values.scan_timeout_s,
            values.velocity_threshold,
        )
        self._output = self.publisher(graph.CMD_VEL_NAV)
        self.subscription(graph.CMD_VEL_ENGINE, self._on_velocity, raw=True)
        self._canceler = GoalCanceler(self, MOVING_ACTIONS)
        for action in MOVING_ACTIONS:
            row = graph.Topic(f"{action}/_action/status", "action_msgs/msg/GoalStatusArray", graph.LATCHED1, None, ("nav",))
            self.subscription(row, partial(self._on_status, action))
        subscribe_estop(self, self._on_estop)
        for topic in known:  # subscribed after subscribe_estop, which therefore handles the same message first
            self.subscription(topic, partial(self._note_known, topic.name))
        self.create_timer(1.0 / local.update_frequency, self._robot_state.update_local)
        self.create_timer(CANCEL_PERIOD_S, self._watch)

    def _now_s(self) -> float:
        return self.elapsed_clock_ns() * 1e-9

    def _note_known(self, name: str, _: Any) -> None:
        self._gate.note_known(name)

    def _on_estop(self, engaged: bool) -> None:
        self._gate.note_estop(engaged, self.monotonic_ns() * 1e-9)
        self._watch()

    def _on_status(self, action: str, message: Any) -> None:
        self._gate.note_goals(action, any(status.status < _ENDED for status in message.status_list))

    def _on_velocity(self, data: bytes) -> None:
        if self._why_closed():
            self._stop()
            return
        self._output.publish(data)
        self._moving_since_s = self._now_s() if decode(data) != ZERO else None

    def _why_closed(self) -> str | None:
        if not self._gate.is_open(self.monotonic_ns() * 1e-9):
            return "the e-stop is engaged or not known, or an older goal has not ended"
        return self._robot_state.lidar_fault()

    def _watch(self) -> None:
        """Cancel goals if they must not move the robot, and stop it if it must not move or Nav2 has fallen silent."""
        if self._gate.cancels(self.monotonic_ns() * 1e-9):
            self._canceler.cancel_all()
        moving = self._moving_since_s
        if moving is None:
            return
        reason = self._why_closed() or ("Nav2 sends no velocity" if self._now_s() - moving > SILENCE_S else None)
        if reason is not None:
            self.get_logger().warning(f"stopped: {reason}")
            self._stop()

    def _stop(self) -> None:
        if self._moving_since_s is not None:
            self._moving_since_s = None
            self._output.publish(encode(ZERO))

    def before_shutdown(self) -> None:
        """Publish zero velocity."""
        self._output.publish(encode(ZERO))
