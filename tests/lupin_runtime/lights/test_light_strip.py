"""The node of the LED strip on a graph, against a fake vendor that records every color."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph, home_report
from lupin_runtime.lights import COLORS_BY_NAME
from lupin_runtime.lights.palette import HELP
from lupin_runtime.lights.robot_state import NAME

if TYPE_CHECKING:
    from pathlib import Path

    from mirte_msgs.srv import SetNeopixel_Response
    from std_srvs.srv import Trigger_Response

    from lupin_runtime.graph import Service
    from lupin_runtime.lights.node import LightStripBridge
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


class Robot:
    """The vendor's strip, and the publishers of the node's inputs."""

    def __init__(self, host: GraphHost, strip: bool = True) -> None:
        from lupin_runtime.ros import LupinNode

        self.host, self.node = host, LupinNode("robot")
        self.colors: list[tuple[int, int, int]] = []
        self.refusals = 0
        if strip:
            self.serve()
        self._mission = self.node.publisher(graph.MISSION_STATE)
        self._estop = self.node.publisher(graph.ESTOP_STATE)
        self._drive = self.node.publisher(graph.CMD_VEL_SINK_ROBOT)
        self._joints = self.node.publisher(graph.JOINT_STATES)
        self.clients = {row: self.node.client(row) for row in (graph.LEDS_SET, graph.LEDS_AUTO)}
        self.mission_says: dict[str, Any] = {}
        self.rules: list[str] = []
        self.node.subscription(graph.LEDS_STATUS, lambda message: self.rules.append(message.data))
        self.driving = False
        self.engaged: bool | None = None
        self.pan: float | None = None
        self.still = False
        self.node.create_timer(0.1, self._repeat)
        host.add(self.node)

    def serve(self) -> None:
        self._service = self.node.service(graph.VENDOR_LEDS, self._set)

    def _set(self, request: Any, response: SetNeopixel_Response) -> SetNeopixel_Response:
        if self.refusals > 0:
            self.refusals -= 1
            response.status = False
            return response
        self.colors.append((request.color.r, request.color.g, request.color.b))
        response.status = True
        return response

    def _repeat(self) -> None:
        from geometry_msgs.msg import Twist
        from lupin_msgs.msg import MissionState
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Bool

        if self.engaged is not None:
            self._estop.publish(Bool(data=self.engaged))
        if self.mission_says:
            self._mission.publish(MissionState(**self.mission_says))
        if self.driving:
            twist = Twist()
            twist.linear.x = 0.2
            self._drive.publish(twist)
        if self.pan is not None:
            self.pan += 0.0 if self.still else 0.02
            self._joints.publish(JointState(name=list(graph.ARM_JOINTS), position=[self.pan, 0.0, 0.0, 0.0]))

    def ask(self, row: Service, **fields: Any) -> SetNeopixel_Response | Trigger_Response:
        from lupin_runtime.ros.interfaces import interface

        client = self.clients[row]
        self.host.until(client.service_is_ready, what=row.name)
        request = interface(row.type).Request()
        for name, value in fields.items():
            setattr(request.color, name, value)
        future = client.call_async(request)
        self.host.until(future.done, what=f"the answer of {row.name}")
        return future.result()

    def shows(self, name: str) -> bool:
        return bool(self.colors) and self.colors[-1] == tuple(COLORS_BY_NAME.get(name, HELP))

    def wait_for(self, name: str) -> None:
        self.host.until(lambda: self.shows(name), what=f"{name} on the strip")

    def wait_for_rule(self, rule: str) -> None:
        self.host.until(lambda: self.rules and self.rules[-1] == rule, what=f"the rule that is published: {rule}")


def lights(host: GraphHost, **parameters: Any) -> LightStripBridge:
    from lupin_runtime.lights.node import LightStripBridge

    result: LightStripBridge = host.add(LightStripBridge(parameters))
    return result


def test_strip_is_blue_and_follows_a_live_mission(graph_host: GraphHost) -> None:
    robot = Robot(graph_host)
    lights(graph_host, mission_state_timeout=0.5)
    robot.wait_for("BLUE")
    robot.mission_says = {"lifecycle_state": "EXPLORING"}
    robot.wait_for("SPRING")
    robot.mission_says = {"lifecycle_state": "INSPECTING", "mission_phase": "SCANNING"}
    robot.wait_for("PURPLE")
    robot.mission_says = {}
    robot.wait_for("BLUE")


def test_same_color_is_sent_once(graph_host: GraphHost) -> None:
    robot = Robot(graph_host)
    lights(graph_host)
    robot.mission_says = {"lifecycle_state": "EXPLORING"}
    robot.wait_for("SPRING")
    robot.mission_says = {"lifecycle_state": "RETURNING"}
    robot.wait_for("ORANGE")
    assert len(robot.colors) == len({*robot.colors})


def test_estop_shows_red_over_a_manual_color(graph_host: GraphHost) -> None:
    robot = Robot(graph_host)
    lights(graph_host)
    robot.wait_for("BLUE")
    assert robot.ask(graph.LEDS_SET, r=180, g=0, b=255).status
    robot.wait_for("PURPLE")
    robot.wait_for_rule("set by hand")
    robot.engaged = True
    robot.wait_for("RED")
    robot.wait_for_rule("e-stop or fault")
    robot.engaged = False
    robot.wait_for("PURPLE")
    robot.wait_for_rule("set by hand")
    assert robot.ask(graph.LEDS_AUTO).success
    robot.wait_for("BLUE")


def test_manual_color_is_refused_without_the_strip(graph_host: GraphHost) -> None:
    robot = Robot(graph_host, strip=False)
    lights(graph_host)
    assert not robot.ask(graph.LEDS_SET, r=1, g=2, b=3).status
    robot.serve()
    robot.wait_for("BLUE")


def test_driving_blinks_green_and_a_moving_arm_orange(graph_host: GraphHost) -> None:
    robot = Robot(graph_host)
    lights(graph_host, blink_hz=4.0)
    robot.driving = True
    robot.wait_for("GREEN")
    robot.wait_for("OFF")
    robot.wait_for("GREEN")
    robot.pan = 0.0
    robot.wait_for("ORANGE")
    robot.wait_for("OFF")
    robot.wait_for("ORANGE")
    robot.driving, robot.pan = False, None
    robot.wait_for("BLUE")


def test_failed_color_request_is_repeated(graph_host: GraphHost) -> None:
    robot = Robot(graph_host)
    robot.refusals = 3
    lights(graph_host)
    robot.wait_for("BLUE")
    assert robot.refusals == 0


def test_color_bytes_are_sent_in_the_order_of_the_strip(graph_host: GraphHost) -> None:
    robot = Robot(graph_host)
    lights(graph_host, color_order="BRG")
    graph_host.until(lambda: (255, 0, 0) in robot.colors, what="blue, as this strip is wired")
    robot.mission_says = {"lifecycle_state": "FAULT"}
    graph_host.until(lambda: robot.colors[-1] == (0, 255, 0), what="red, as this strip is wired")


def test_strip_is_untouched_in_standby_if_configured(graph_host: GraphHost) -> None:
    robot = Robot(graph_host)
    lights(graph_host, set_on_startup=False, mission_state_timeout=0.5)
    robot.driving = True
    robot.wait_for("GREEN")
    robot.driving = False
    robot.wait_for("BLUE")
    assert set(robot.colors[:-1]) <= {tuple(COLORS_BY_NAME["GREEN"]), tuple(COLORS_BY_NAME["OFF"])}


def test_robot_alone_shows_what_it_waits_for_and_does(
    graph_host: GraphHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    robot = Robot(graph_host)
    home_report.write_report(home_report.ACTIVATING)
    lights(graph_host, onboard=True, home_report_folder=str(tmp_path), mission_state_timeout=0.5)
    robot.wait_for("WHITE")
    robot.wait_for("OFF")
    robot.pan = 0.0
    robot.wait_for("ORANGE")  # an arm that moves meanwhile
    home_report.write_report(home_report.HOMING)
    robot.wait_for("YELLOW")
    home_report.write_report(home_report.FAILED, "no controller")
    robot.still = True
    robot.wait_for("HELP")
    state = json.loads((tmp_path / NAME).read_text())
    assert (state["state"], state["arm"]) == ("needs help", True)
    assert "no controller" in state["reason"]
    home_report.write_report(home_report.HOME)
    robot.wait_for("BLUE")


def test_laptop_lost_in_a_mission_is_shown_until_it_is_back(graph_host: GraphHost, tmp_path: Path) -> None:
    robot = Robot(graph_host)
    robot.pan, robot.still = 0.0, True
    lights(graph_host, onboard=True, home_report_folder=str(tmp_path), mission_state_timeout=0.5)
    robot.mission_says = {"lifecycle_state": "EXPLORING"}
    robot.wait_for("SPRING")
    robot.mission_says = {}  # silent, but not gone from the graph
    robot.wait_for("HELP")
    robot.wait_for("OFF")
    robot.mission_says = {"lifecycle_state": "EXPLORING"}
    robot.wait_for("SPRING")
