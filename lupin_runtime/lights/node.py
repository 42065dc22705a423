"""`light_strip_bridge`: shows the robot's state on its LED strip, updated ten times a second."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from mirte_msgs.srv import SetNeopixel
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from sensor_msgs.msg import JointState

from lupin_runtime import graph
from lupin_runtime.drive import decode
from lupin_runtime.lights.motion import MotionDetector
from lupin_runtime.lights.palette import Rgb, byte_order
from lupin_runtime.lights.precedence import Mission, View, choose, shown
from lupin_runtime.ros import LupinNode
from lupin_runtime.safety.estop_subscription import subscribe_estop

REPLY_S = 1.0
_ARM = (*graph.ARM_JOINTS, graph.GRIPPER_JOINT)
_MARK = graph.ARM_JOINTS[0].encode()


class LightStripBridge(LupinNode):
    """The node of the LED strip.

    Parameters: the topics and services by name, `set_on_startup`, `unknown_state_off`, `color_order`, `drive_timeout`,
    `drive_deadband`, `arm_deadband_rad`, `arm_motion_hold`, `mission_state_timeout`, `render_rate_hz`, `blink_hz`.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("light_strip_bridge", parameters)
        self._drive_timeout_ns = int(self.parameter("drive_timeout", 0.4) * 1e9)
        self._drive_deadband = self.parameter("drive_deadband", 1e-3)
        self._mission_timeout_ns = int(self.parameter("mission_state_timeout", 2.0) * 1e9)
        self._unknown_off = self.parameter("unknown_state_off", True)
        self._blink_hz = self.parameter("blink_hz", 1.0)
        self._order = byte_order(self.parameter("color_order", "RGB"))
        self._arm = MotionDetector(self.parameter("arm_deadband_rad", 0.0087), self.parameter("arm_motion_hold", 0.3))
        self._silent = not self.parameter("set_on_startup", True)  # until a rule other than standby applies

        self._estop = False
        self._manual: Rgb | None = None
        self._mission: tuple[Mission, int] | None = None
        self._joints: bytes | None = None
        self._driven_ns: int | None = None
        self._requested: Rgb | None = None  # the color last requested; None: not known to be shown
        self._request: Future | None = None
        self._requested_ns = 0

        self._strip = self.client(replace(graph.VENDOR_LEDS, name=self.parameter("led_service", graph.VENDOR_LEDS.name)))
        estop = replace(graph.ESTOP_STATE, name=self.parameter("estop_topic", graph.ESTOP_STATE.name))
        subscribe_estop(self, self._on_estop, estop)
        topics = (
            ("mission_state_topic", graph.MISSION_STATE, self._on_mission, False),
            ("joint_states_topic", graph.JOINT_STATES, self._on_joints, True),
            ("drive_topic", graph.CMD_VEL_SINK_ROBOT, self._on_drive, True),
        )
        for name, topic, callback, raw in topics:
            self.subscription(replace(topic, name=self.parameter(name, topic.name)), callback, raw=raw)
        self.service(replace(graph.LEDS_SET, name=self.parameter("manual_service", graph.LEDS_SET.name)), self._on_set)
        self.service(replace(graph.LEDS_AUTO, name=self.parameter("auto_service", graph.LEDS_AUTO.name)), self._on_auto)
        self.create_timer(1.0 / self.parameter("render_rate_hz", 10.0), self._render)

    # -- inputs -------------------------------------------------------------------------------------------------------
    def _on_estop(self, engaged: bool) -> None:
        self._estop = engaged

    def _on_mission(self, message: Any) -> None:
        mission = Mission(
            message.lifecycle_state,
            message.mission_phase,
            paused=message.paused,
            estop=message.estop_engaged,
            battery_low=message.battery_low,
        )
        self._mission = (mission, self.elapsed_clock_ns())

    def _on_joints(self, data: Any) -> None:
        if _MARK in data:  # decoded when the strip is updated, a fifth as often as messages arrive
            self._joints = data

    def _on_drive(self, data: Any) -> None:
        command = decode(data)
        if command is not None and not command.is_neutral(self._drive_deadband):
            self._driven_ns = self.elapsed_clock_ns()

    def _on_set(self, request: Any, response: Any) -> Any:
        response.status = self._strip.service_is_ready()
        if response.status:
            color = request.color
            self._manual = Rgb(color.r, color.g, color.b)
            self._render()
        return response

    def _on_auto(self, _: Any, response: Any) -> Any:
        self._manual = None
        self._render()
        response.success, response.message = True, f"the strip follows the robot again: {choose(self._view())[0]}"
        return response

    # -- output -------------------------------------------------------------------------------------------------------
    def _view(self) -> View:
        now_ns = self.elapsed_clock_ns()
        mission = None
        if self._mission is not None:
            fresh = 0 <= now_ns - self._mission[1] <= self._mission_timeout_ns
            mission = replace(self._mission[0], fresh=fresh)
        return View(
            mission,
            estop=self._estop,
            manual=self._manual,
            arm_moving=self._arm.moving(now_ns),
            driving=self._driven_ns is not None and 0 <= now_ns - self._driven_ns <= self._drive_timeout_ns,
            unknown_state_off=self._unknown_off,
        )

    def _render(self) -> None:
        now_ns = self.elapsed_clock_ns()
        self._update_arm(now_ns)
        rule, light = choose(self._view())
        if self._silent and rule == "standby":
            return
        self._silent = False
        self._send(shown(light, now_ns / 1e9, self._blink_hz), now_ns)

    def _update_arm(self, now_ns: int) -> None:
        data, self._joints = self._joints, None
        if data is None:
            return
        message = deserialize_message(data, JointState)
        at = {name: angle for name, angle in zip(message.name, message.position) if math.isfinite(angle)}
        if all(joint in at for joint in graph.ARM_JOINTS):
            self._arm.update([at.get(joint, 0.0) for joint in _ARM], now_ns)

    def _send(self, color: Rgb, now_ns: int) -> None:
        if self._request is not None and not 0 <= now_ns - self._requested_ns <= REPLY_S * 1e9:
            self._strip.remove_pending_request(self._request)
            self._requested = self._request = None  # no reply: send it again
        if not self._strip.service_is_ready():
            self._requested = None  # the next server may show another color
            return
        if color == self._requested:
            return
        request = SetNeopixel.Request()
        # The only place in which colors are reordered for the wiring of this strip.
        request.color.r, request.color.g, request.color.b = (color[index] for index in self._order)
        self._requested, self._requested_ns = color, now_ns
        reply = self._strip.call_async(request)
        self._request = reply
        reply.add_done_callback(self._on_reply)

    def _on_reply(self, reply: Any) -> None:
        if self._request is None or reply is not self._request:
            return  # the reply to an older request, whose color is no longer the requested one
        self._request = None
        if reply.cancelled() or reply.exception() is not None or not reply.result().status:
            self._requested = None
