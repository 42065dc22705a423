"""`estop_bridge`: publishes `/e_stop_state`, as its only publisher, from the robot's button and the consoles' stop.

`estop_witness`, in another process: reports to the bridge what it, or the bridge that it replaces, has missed.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

from rclpy.clock import Clock, ClockType
from std_msgs.msg import Bool, String

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.priority import request_realtime_scheduling
from lupin_runtime.safety.console_server_stop import ConsoleServerStop
from lupin_runtime.safety.console_stop import EXPIRY_S, ConsoleStop
from lupin_runtime.safety.estop import BUTTON_SILENCE_S, ButtonSilence, EstopSources, EstopState
from lupin_runtime.safety.expected_sources import BUTTON, tells_of_no_press
from lupin_runtime.safety.missed_press import ANSWER_S, MissedPress
from lupin_runtime.safety.unheard_press import REPORT_PERIOD_S, PressCounter

SLOWEST_HZ = 0.5
# Two periods of a console.
SHORT_LISTEN_S = 1.0
# Through a discovery server, a first sample usually takes up to 3.3 s; then a period of a console.
LISTEN_S = 4.0
WARNING_PERIOD_S = 30.0


class EstopBridge(LupinNode):
    """Publishes the e-stop state at `publish_rate_hz` and on every edge.

    It publishes released only after it has heard every one of its `expected_sources`, and not within `listen_s` of its start,
    because there may also be sources that it cannot expect: the console of another machine. SHORT_LISTEN_S is enough if
    `estop_witness`, which has listened for at least `listen_s`, says that nothing is missed.

    It publishes engaged as soon as a source holds the stop, and after `listen_s` if it has not heard every expected source.
    Until then it is silent, which locks the drive bus as well, so that a restart does not end a mission.

    Parameters: `expected_sources` (some of button, console, witness, separated by spaces), `button_topic`, `estop_topic`,
    `hmi_estop_topic`, `engaged_value` (the button's value when pressed), `publish_rate_hz` (floor 0.5), `listen_s`,
    `hmi_expiry_s`, `hmi_silence_engages`, `button_silence_s`, `button_silence_engages`, `serve_first` (request real-time
    scheduling of the process).
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("estop_bridge", parameters)
        if self.parameter("serve_first", False):
            self.get_logger().info(request_realtime_scheduling())
        engaged_value = self.parameter("engaged_value", True)
        self._sources = EstopSources(
            ConsoleStop(
                expiry_s=self.parameter("hmi_expiry_s", EXPIRY_S),
                silence_engages=self.parameter("hmi_silence_engages", True),
            ),
            expected=self.parameter("expected_sources", BUTTON).split(),
            engaged_value=engaged_value,
            button_silence_s=self.parameter("button_silence_s", BUTTON_SILENCE_S),
            button_silence_engages=self.parameter("button_silence_engages", True),
        )
        # Real time, because discovery and consoles do not follow the simulation's clock.
        self._started_ns = self.monotonic_ns()
        self._listen_ns = int(self.parameter("listen_s", LISTEN_S) * 1e9)
        self._published: EstopState | None = None
        self._presses = PressCounter()
        self._reported_ns = 0
        self._output = self.publisher(self._named(graph.ESTOP_STATE, "estop_topic"))
        self._status = self.publisher(graph.ESTOP_STATUS)
        self.subscription(self._named(graph.ESTOP_BUTTON, "button_topic"), self._on_button)
        self.subscription(self._named(graph.HMI_ESTOP, "hmi_estop_topic"), self._on_console)
        self.subscription(graph.CONSOLE_STOP, self._on_console_server)
        self.subscription(graph.ESTOP_MISSED_PRESS, self._on_missed_press)
        rate_hz = max(SLOWEST_HZ, self.parameter("publish_rate_hz", 5.0))
        self.create_timer(1.0 / rate_hz, lambda: self._publish(repeat=True))
        # The polarity has not been verified on a real button, so every start logs how to check it.
        self.get_logger().warning(
            f"the button counts as pressed when its value is {str(engaged_value).lower()}; press it once: if "
            f"{self._output.topic_name} does not become true, set engaged_value to {str(not engaged_value).lower()}"
        )

    def _named(self, row: graph.Topic, parameter: str) -> graph.Topic:
        return replace(row, name=self.parameter(parameter, row.name))

    def _on_button(self, message: Any) -> None:
        self._sources.button(bool(message.value), self.elapsed_clock_ns(), self.monotonic_ns())
        self._publish()

    def _on_console(self, message: Any) -> None:
        self._sources.consoles.update(bool(message.data), self.monotonic_ns())
        self._publish()

    def _on_console_server(self, message: Any) -> None:
        self._sources.console_server(message.data, self.monotonic_ns())
        self._publish()

    def _on_missed_press(self, message: Any) -> None:
        self._sources.missed_press(bool(message.data))
        self._publish()

    def _is_listening(self, state: EstopState, now_ns: int) -> bool:
        """Return whether it is too early to say anything."""
        listened_ns = now_ns - self._started_ns
        if state.stops or listened_ns >= self._listen_ns:
            return False
        short = self._sources.is_told_of_no_missed_press and not state.unheard
        return not short or listened_ns < SHORT_LISTEN_S * 1e9

    def _publish(self, repeat: bool = False) -> None:
        now_ns = self.monotonic_ns()
        state = self._sources.state(self.elapsed_clock_ns(), now_ns)
        if self._published is None and self._is_listening(state, now_ns):
            return
        edge = self._published is None or state.engaged != self._published.engaged
        # That a source has not been heard yet is no press: a mission or the arm may start as soon as it is heard.
        self._presses.update(bool(state.stops), now_ns)
        if edge or repeat:
            self._output.publish(Bool(data=state.engaged))
        is_due = self._presses.is_recent(now_ns) and now_ns - self._reported_ns >= REPORT_PERIOD_S * 1e9
        if is_due or state != self._published:
            self._reported_ns = now_ns
            status = {
                "engaged": state.engaged,
                "reasons": state.reasons,
                "unheard": state.unheard,
                "warnings": state.warnings,
                **self._presses.report(now_ns),
            }
            self._status.publish(String(data=json.dumps(status)))
        if edge and (state.engaged or self._published is not None):
            text = "e-stop engaged: " + ", ".join(state.reasons) if state.engaged else "e-stop released"
            self.get_logger().warning(text)
        if state.warnings and repeat:
            self.get_logger().warning(", ".join(state.warnings), throttle_duration_sec=WARNING_PERIOD_S)
        self._published = state


class EstopWitness(LupinNode):
    """Publishes true from when `estop_bridge` has missed a press of the button or a console's stop until it has made up for it.

    It is also true while the button is silent that was received before, because a bridge that has just been started knows
    nothing of that; and from when the bridge is gone while the button is held, or while a lost console has left its stop, until
    that ends. A bridge that is engaged only because it has not heard every source has not responded to a press. It publishes
    false only after `listen_s`, so that it has probably discovered what it reports about; until then true stays.

    Parameters, the same as those of `estop_bridge`: `engaged_value`, `listen_s`, `hmi_expiry_s`, `hmi_silence_engages`,
    `button_silence_s`, `button_silence_engages`.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("estop_witness", parameters)
        self._engaged_value = self.parameter("engaged_value", True)
        self._press = MissedPress()
        self._engaged = False  # the last state of the e-stop
        self._no_press = False  # whether the bridge has counted no press: an engaged state is then no answer to one
        # A little later than the bridge, which names its own reason first.
        self._silence = ButtonSilence(self.parameter("button_silence_s", BUTTON_SILENCE_S) + ANSWER_S)
        self._silence_engages = self.parameter("button_silence_engages", True)
        self._was_silent = False
        self._consoles = ConsoleStop(
            expiry_s=self.parameter("hmi_expiry_s", EXPIRY_S),
            silence_engages=self.parameter("hmi_silence_engages", True),
        )
        self._console_server = ConsoleServerStop()
        self._false_from_ns = self.monotonic_ns() + int(self.parameter("listen_s", LISTEN_S) * 1e9)
        self._published: bool | None = None  # so that the first value replaces that of a former witness
        self._output = self.publisher(graph.ESTOP_MISSED_PRESS)
        self.subscription(graph.ESTOP_STATE, self._on_state)
        self.subscription(graph.ESTOP_STATUS, self._on_status)
        self.subscription(graph.ESTOP_BUTTON, self._on_button)
        self.subscription(graph.HMI_ESTOP, self._on_console)
        self.subscription(graph.CONSOLE_STOP, self._on_console_server)
        self.create_timer(ANSWER_S / 2, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_state(self, message: Any) -> None:
        self._engaged = bool(message.data)
        self._note_state()

    def _on_status(self, message: Any) -> None:
        self._no_press = tells_of_no_press(message.data)
        self._note_state()

    def _note_state(self) -> None:
        if self._no_press:
            self._press.note_no_press()
        else:
            self._press.state(self._engaged, self.monotonic_ns())
        self._publish()

    def _on_button(self, message: Any) -> None:
        self._silence.receive(self.elapsed_clock_ns(), self.monotonic_ns())
        self._press.button(bool(message.value) == self._engaged_value, self.monotonic_ns())

    def _on_console(self, message: Any) -> None:
        self._consoles.update(bool(message.data), self.monotonic_ns())
        if message.data:
            self._press.press(self.monotonic_ns())

    def _on_console_server(self, message: Any) -> None:
        if self._console_server.update(message.data, self.monotonic_ns()):
            self._press.press(self.monotonic_ns())

    def _publish(self) -> None:
        now_ns = self.monotonic_ns()
        self._press.lose_stop(self._consoles.is_lost(now_ns) or self._console_server.is_lost(now_ns))
        missed = self._press.tick(now_ns)
        silent = self._silence_engages and self._silence.is_silent(self.elapsed_clock_ns(), now_ns)
        if silent and not self._was_silent:
            self.get_logger().error("the e-stop's button has fallen silent; the e-stop is engaged until it is back")
        self._was_silent = silent
        engages = missed or silent
        if engages == self._published or (not engages and now_ns < self._false_from_ns):
            return
        self._published = engages
        if missed:
            self.get_logger().error(
                "the e-stop was pressed, or is held, but its process did not respond; it engages once the process is back"
            )
        self._output.publish(Bool(data=engages))
