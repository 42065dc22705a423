"""`estop_bridge`: the only publisher of `/e_stop_state`, from the robot's button and the consoles' stop."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from typing import Any

from std_msgs.msg import Bool, String

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.priority import serve_first
from lupin_runtime.safety.consoles import EXPIRY_S, ConsoleLane
from lupin_runtime.safety.estop import BUTTON_SILENCE_S, EstopSources, EstopState

SLOWEST_HZ = 0.5
# Two periods of a console, and discovery before them.
LISTEN_S = 1.0
WARNING_PERIOD_S = 30.0


class EstopBridge(LupinNode):
    """Publishes at `publish_rate_hz` and on every edge; until it has listened for `listen_s` it may say engaged, but not
    released: a bridge that was restarted has not heard yet who holds the stop.

    Parameters: `button_topic`, `estop_topic`, `hmi_estop_topic`, `engaged_value` (what the button says when pressed),
    `publish_rate_hz` (floor 0.5), `listen_s`, `hmi_expiry_s`, `hmi_silence_engages`, `button_silence_s`,
    `button_silence_engages`, `serve_first` (ask for real-time scheduling of the process).
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("estop_bridge", parameters)
        if self.parameter("serve_first", False):
            self.get_logger().info(serve_first())
        engaged_value = self.parameter("engaged_value", True)
        self._sources = EstopSources(
            ConsoleLane(
                expiry_s=self.parameter("hmi_expiry_s", EXPIRY_S),
                silence_engages=self.parameter("hmi_silence_engages", True),
            ),
            engaged_value=engaged_value,
            button_silence_s=self.parameter("button_silence_s", BUTTON_SILENCE_S),
            button_silence_engages=self.parameter("button_silence_engages", False),
        )
        # Real time: what is waited for is the middleware's discovery and the consoles, not the simulation.
        self._released_from_ns = time.monotonic_ns() + int(self.parameter("listen_s", LISTEN_S) * 1e9)
        self._said: EstopState | None = None
        self._output = self.publisher(self._named(graph.ESTOP_STATE, "estop_topic"))
        self._status = self.publisher(graph.ESTOP_STATUS)
        self.subscription(self._named(graph.ESTOP_BUTTON, "button_topic"), self._on_button)
        self.subscription(self._named(graph.HMI_ESTOP, "hmi_estop_topic"), self._on_console)
        rate_hz = max(SLOWEST_HZ, self.parameter("publish_rate_hz", 5.0))
        self.create_timer(1.0 / rate_hz, lambda: self._publish(repeat=True))
        # Nobody has verified the polarity on a real button, so it is said where it is seen.
        self.get_logger().warning(
            f"the button counts as pressed when it says {str(engaged_value).lower()}; press it once and see "
            f"{self._output.topic_name} turn true, else set engaged_value to {str(not engaged_value).lower()}"
        )

    def _named(self, row: graph.Topic, parameter: str) -> graph.Topic:
        return replace(row, name=self.parameter(parameter, row.name))

    def _on_button(self, message: Any) -> None:
        self._sources.button(bool(message.value), self.elapsed_clock_ns())
        self._publish()

    def _on_console(self, message: Any) -> None:
        self._sources.consoles.heard(bool(message.data), time.monotonic_ns())
        self._publish()

    def _publish(self, repeat: bool = False) -> None:
        state = self._sources.state(self.elapsed_clock_ns(), time.monotonic_ns())
        if not state.engaged and self._said is None and time.monotonic_ns() < self._released_from_ns:
            return
        edge = self._said is None or state.engaged != self._said.engaged
        if edge or repeat:
            self._output.publish(Bool(data=state.engaged))
        if state != self._said:
            self._status.publish(
                String(data=json.dumps({"engaged": state.engaged, "reasons": state.reasons, "warnings": state.warnings}))
            )
        if edge and (state.engaged or self._said is not None):
            text = "e-stop engaged: " + ", ".join(state.reasons) if state.engaged else "e-stop released"
            self.get_logger().warning(text)
        if state.warnings and repeat:
            self.get_logger().warning(", ".join(state.warnings), throttle_duration_sec=WARNING_PERIOD_S)
        self._said = state
