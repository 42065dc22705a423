"""`light_strip_bridge`: renders the robot's state on its LED strip, ten times a second."""

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
from lupin_runtime.lights.palette import Rgb, permutation
from lupin_runtime.lights.precedence import Mission, View, choose, shown
from lupin_runtime.ros import LupinNode

REPLY_S = 1.0
_ARM = (*graph.ARM_JOINTS, graph.GRIPPER_JOINT)
_MARK = graph.ARM_JOINTS[0].encode()


class LightStripBridge(LupinNode):
    """Parameters: the topics and services by name, `set_on_startup`, `unknown_state_off`, `color_order`, `drive_timeout`,
    `drive_deadband`, `arm_deadband_rad`, `arm_motion_hold`, `mission_state_timeout`, `render_rate_hz`, `blink_hz`."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("light_strip_bridge", parameters)
        self._drive_timeout_ns = int(self.parameter("drive_timeout", 0.4) * 1e9)
        self._drive_deadband = self.parameter("drive_deadband", 1e-3)
        self._mission_timeout_ns = int(self.parameter("mission_state_timeout", 2.0) * 1e9)
        self._unknown_off = self.parameter("unknown_state_off", True)
        self._blink_hz = self.parameter("blink_hz", 1.0)
        self._order = permutation(self.parameter("color_order", "RGB"))
        self._arm = MotionDetector(self.parameter("arm_deadband_rad", 0.0087), self.parameter("arm_motion_hold", 0.3))
        self._silent = not self.parameter("set_on_startup", True)  # until there is more to say than standby

        self._estop = False
        self._manual: Rgb | None = None
        self._mission: tuple[Mission, int] | None = None
        self._joints: bytes | None = None
        self._driven_ns: int | None = None
        self._asked: Rgb | None = None  # what the strip was last asked for; None: not known to have been heard
        self._request: Future | None = None
        self._asked_ns = 0

        self._strip = self.client(replace(graph.VENDOR_LEDS, name=self.parameter("led_service", graph.VENDOR_LEDS.name)))
        topics = (
            ("estop_topic", graph.ESTOP_STATE, self._on_estop, False),
            ("mission_state_topic", graph.MISSION_STATE, self._on_mission, False),
            ("joint_states_topic", graph.JOINT_STATES, self._on_joints, True),
            ("drive_topic", graph.CMD_VEL_SINK_ROBOT, self._on_drive, True),
        )
        for name, topic, callback, raw in topics:
            self.subscription(replace(topic, name=self.parameter(name, topic.name)), callback, raw=raw)
        self.service(replace(graph.LEDS_SET, name=self.parameter("manual_service", graph.LEDS_SET.name)), self._on_set)
        self.service(replace(graph.LEDS_AUTO, name=self.parameter("auto_service", graph.LEDS_AUTO.name)), self._on_auto)
        self.create_timer(1.0 / self.parameter("render_rate_hz", 10.0), self._render)

    # -- what is heard ------------------------------------------------------------------------------------------------
    def _on_estop(self, message: Any) -> None:
        self._estop = bool(message.data)

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
        if _MARK in data:  # decoded when it is rendered, five times less often than it comes
            self._joints = data

    def _on_drive(self, data: Any) -> None:
        command = decode(data)
        if command is not None and not command.is_neutral(self._drive_deadband):
            self._driven_ns = self.elapsed_clock_ns()

    def _on_set(self, request: Any, response: Any) -> Any:
        response.status = self._strip.service_is_ready()
        if response.status:
            colour = request.color
            self._manual = Rgb(colour.r, colour.g, colour.b)
            self._render()
        return response

    def _on_auto(self, _: Any, response: Any) -> Any:
        self._manual = None
        self._render()
        response.success, response.message = True, f"the strip follows the robot again: {choose(self._view())[0]}"
        return response

    # -- what is shown ------------------------------------------------------------------------------------------------
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
        self._look_at_arm(now_ns)
        rule, light = choose(self._view())
        if self._silent and rule == "standby":
            return
        self._silent = False
        self._ask(shown(light, now_ns / 1e9, self._blink_hz), now_ns)

    def _look_at_arm(self, now_ns: int) -> None:
        data, self._joints = self._joints, None
        if data is None:
            return
        message = deserialize_message(data, JointState)
        at = {name: angle for name, angle in zip(message.name, message.position) if math.isfinite(angle)}
        if all(joint in at for joint in graph.ARM_JOINTS):
            self._arm.update([at.get(joint, 0.0) for joint in _ARM], now_ns)

    def _ask(self, colour: Rgb, now_ns: int) -> None:
        if self._request is not None and not 0 <= now_ns - self._asked_ns <= REPLY_S * 1e9:
            self._strip.remove_pending_request(self._request)
            self._asked = self._request = None  # no reply: ask again
        if not self._strip.service_is_ready():
            self._asked = None  # whoever serves it next may have another colour on the strip
            return
        if colour == self._asked:
            return
        request = SetNeopixel.Request()
        # The one place where bytes are put in the order in which this strip is wired.
        request.color.r, request.color.g, request.color.b = (colour[index] for index in self._order)
        self._asked, self._asked_ns = colour, now_ns
        reply = self._strip.call_async(request)
        self._request = reply
        reply.add_done_callback(self._on_reply)

    def _on_reply(self, reply: Any) -> None:
        if self._request is None or reply is not self._request:
            return  # of an older request: what it says is no longer about what is shown
        self._request = None
        if reply.cancelled() or reply.exception() is not None or not reply.result().status:
            self._asked = None
