"""`light_strip_bridge`: shows the robot's state on its LED strip, updated several times a second."""

from __future__ import annotations

import contextlib
import math
import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from mirte_msgs.srv import SetNeopixel
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from lupin_runtime import graph, home_report
from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.drive import decode
from lupin_runtime.lights.mission_watch import MissionWatch
from lupin_runtime.lights.motion import MotionDetector
from lupin_runtime.lights.palette import Rgb, byte_order
from lupin_runtime.lights.precedence import Mission, View, choose, shown
from lupin_runtime.lights.robot_state import JOINTS_SILENT_S, NAME, Facts, Judgement, RobotState, judge, state_text
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.polled_subscription import take_newest_with
from lupin_runtime.safety.estop_subscription import subscribe_estop

REPLY_S = 1.0
RENDER_HZ = 10.0
ONBOARD_RENDER_HZ = 4.0  # of a robot's own processes, which run all the time; a change of the e-stop is shown at once
JUDGE_PERIOD_S = 1.0
MOTION_START_S = 2.0  # the arm starts to move home within this time of being sent
_ARM = (*graph.ARM_JOINTS, graph.GRIPPER_JOINT)
_MARK = graph.ARM_JOINTS[0].encode()


class LightStripBridge(LupinNode):
    """The node of the LED strip.

    Parameters: the topics and services by name, `set_on_startup`, `unknown_state_off`, `color_order`, `drive_timeout`,
    `drive_deadband`, `arm_deadband_rad`, `arm_motion_hold`, `mission_state_timeout`, `render_rate_hz`, `blink_hz`.

    With `onboard`, on a robot, it also shows what the robot does by itself, and writes it to the folder that systemd names in
    RUNTIME_DIRECTORY; `home_report_folder` is that of auto-home's report.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("light_strip_bridge", parameters)
        self._drive_timeout_ns = int(self.parameter("drive_timeout", 0.4) * 1e9)
        self._drive_deadband = self.parameter("drive_deadband", 1e-3)
        self._onboard = self.parameter("onboard", False)
        self._missions = MissionWatch(self.parameter("mission_state_timeout", 2.0), forgets=self._onboard)
        self._home_folder = Path(self.parameter("home_report_folder", str(home_report.FOLDER)))
        self._unknown_off = self.parameter("unknown_state_off", True)
        self._blink_hz = self.parameter("blink_hz", 1.0)
        self._order = byte_order(self.parameter("color_order", "RGB"))
        self._arm = MotionDetector(self.parameter("arm_deadband_rad", 0.0087), self.parameter("arm_motion_hold", 0.3))
        self._silent = not self.parameter("set_on_startup", True)  # until a rule other than standby applies

        self._estop = False
        self._manual: Rgb | None = None
        self._joints_ns: int | None = None
        self._homing_ns: int | None = None  # when auto-home was last seen sending the arm home, until it rests there
        self._judgement = Judgement(RobotState.READY)
        self._started_ns, self._started_s = self.elapsed_clock_ns(), home_report.since_boot_s()
        self._written = ""  # the state in the file, without its time
        self._driven_ns: int | None = None
        self._requested: Rgb | None = None  # the color last requested; None: not known to be shown
        self._request: Future | None = None
        self._requested_ns = 0

        self._rule = ""  # that was last published
        self._status = self.publisher(graph.LEDS_STATUS)
        self._strip = self.client(replace(graph.VENDOR_LEDS, name=self.parameter("led_service", graph.VENDOR_LEDS.name)))
        estop = replace(graph.ESTOP_STATE, name=self.parameter("estop_topic", graph.ESTOP_STATE.name))
        subscribe_estop(self, self._on_estop, estop)
        self._mission_topic = self.parameter("mission_state_topic", graph.MISSION_STATE.name)
        joints = replace(graph.JOINT_STATES, name=self.parameter("joint_states_topic", graph.JOINT_STATES.name))
        self._joints = self.polled_subscription(joints, graph.BEST5)
        drive = replace(graph.CMD_VEL_SINK_ROBOT, name=self.parameter("drive_topic", graph.CMD_VEL_SINK_ROBOT.name))
        self.subscription(drive, self._on_drive, raw=True)
        self.subscription(replace(graph.MISSION_STATE, name=self._mission_topic), self._on_mission)
        self.service(replace(graph.LEDS_SET, name=self.parameter("manual_service", graph.LEDS_SET.name)), self._on_set)
        self.service(replace(graph.LEDS_AUTO, name=self.parameter("auto_service", graph.LEDS_AUTO.name)), self._on_auto)
        self.create_timer(
            1.0 / self.parameter("render_rate_hz", ONBOARD_RENDER_HZ if self._onboard else RENDER_HZ), self._render
        )
        if self._onboard:
            self._judge()
            self.create_timer(JUDGE_PERIOD_S, self._judge)

    # -- inputs -------------------------------------------------------------------------------------------------------
    def _on_estop(self, engaged: bool) -> None:
        was_engaged, self._estop = self._estop, engaged
        if engaged != was_engaged:
            self._render()

    def _on_mission(self, message: Any) -> None:
        mission = Mission(
            message.lifecycle_state,
            message.mission_phase,
            paused=message.paused,
            estop=message.estop_engaged,
            battery_low=message.battery_low,
        )
        self._missions.handle(mission, self.elapsed_clock_ns())

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
        return View(
            self._missions.view(now_ns, self.count_publishers(self._mission_topic) if self._onboard else 0),
            estop=self._estop,
            manual=self._manual,
            arm_moving=self._arm.moving(now_ns),
            driving=self._driven_ns is not None and 0 <= now_ns - self._driven_ns <= self._drive_timeout_ns,
            unknown_state_off=self._unknown_off,
            robot=self._judgement.state,
            mission_lost=self._missions.lost,
        )

    def _judge(self) -> None:
        """Judge what the robot does by itself, and write it to a file when it changes."""
        now_ns = self.elapsed_clock_ns()
        home = home_report.read_report(self._home_folder)
        if home is not None and home.state == home_report.HOMING:
            self._homing_ns = now_ns
        elif self._homing_ns is not None and now_ns - self._homing_ns > MOTION_START_S * 1e9 and not self._arm.moving(now_ns):
            self._homing_ns = None
        view = self._view()
        joints_age_s = None if self._joints_ns is None else (now_ns - self._joints_ns) / 1e9
        up_s = (now_ns - self._started_ns) / 1e9
        self._judgement = judge(
            Facts(up_s, joints_age_s, home, self._homing_ns is not None, view.mission_lost, self._started_s)
        )
        rule, _ = choose(replace(view, robot=self._judgement.state))
        folder = os.environ.get("RUNTIME_DIRECTORY", "")
        text = partial(state_text, self._judgement, rule, joints_age_s is not None and joints_age_s <= JOINTS_SILENT_S)
        if folder and text(0.0) != self._written:
            with contextlib.suppress(OSError):
                write_atomically(Path(folder) / NAME, text(round(home_report.since_boot_s(), 1)))
                self._written = text(0.0)

    def _render(self) -> None:
        now_ns = self.elapsed_clock_ns()
        self._update_arm(now_ns)
        rule, light = choose(self._view())
        if rule != self._rule:
            self._rule = rule
            self._status.publish(String(data=rule))
        if self._silent and rule == "ready":
            return
        self._silent = False
        self._send(shown(light, now_ns / 1e9, self._blink_hz), now_ns)

    def _update_arm(self, now_ns: int) -> None:
        taken = take_newest_with(self._joints, _MARK)
        if taken is None:
            return
        self._joints_ns = now_ns
        message = deserialize_message(taken.data, JointState)
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
