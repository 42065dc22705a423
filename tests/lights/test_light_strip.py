"""The strip's node on a graph, against a vendor whose strip remembers every colour."""

from __future__ import annotations

import pytest

from lupin_runtime import graph
from lupin_runtime.lights import COLOURS

pytestmark = pytest.mark.graph


class Robot:
    """The vendor's strip, and whatever the strip's node listens to."""

    def __init__(self, host, strip: bool = True) -> None:
        from lupin_runtime.ros import LupinNode

        self.host, self.node = host, LupinNode("robot")
        self.colours: list[tuple[int, int, int]] = []
        self.refusals = 0
        if strip:
            self.serve()
        self._mission = self.node.publisher(graph.MISSION_STATE)
        self._estop = self.node.publisher(graph.ESTOP_STATE)
        self._drive = self.node.publisher(graph.CMD_VEL_SINK_ROBOT)
        self._joints = self.node.publisher(graph.JOINT_STATES)
        self.clients = {row: self.node.client(row) for row in (graph.LEDS_SET, graph.LEDS_AUTO)}
        self.mission_says: dict = {}
        self.driving = False
        self.pan: float | None = None
        self.node.create_timer(0.1, self._repeat)
        host.add(self.node)

    def serve(self) -> None:
        self._service = self.node.service(graph.VENDOR_LEDS, self._set)

    def _set(self, request, response):
        if self.refusals > 0:
            self.refusals -= 1
            response.status = False
            return response
        self.colours.append((request.color.r, request.color.g, request.color.b))
        response.status = True
        return response

    def _repeat(self) -> None:
        from geometry_msgs.msg import Twist
        from lupin_msgs.msg import MissionState
        from sensor_msgs.msg import JointState

        if self.mission_says:
            self._mission.publish(MissionState(**self.mission_says))
        if self.driving:
            twist = Twist()
            twist.linear.x = 0.2
            self._drive.publish(twist)
        if self.pan is not None:
            self.pan += 0.02
            self._joints.publish(JointState(name=list(graph.ARM_JOINTS), position=[self.pan, 0.0, 0.0, 0.0]))

    def estop(self, engaged: bool) -> None:
        from std_msgs.msg import Bool

        self._estop.publish(Bool(data=engaged))

    def ask(self, row, **fields):
        from lupin_runtime.ros.node import interface

        client = self.clients[row]
        self.host.until(client.service_is_ready, what=row.name)
        request = interface(row.type).Request()
        for name, value in fields.items():
            setattr(request.color, name, value)
        future = client.call_async(request)
        self.host.until(future.done, what=f"the answer of {row.name}")
        return future.result()

    def shows(self, name: str) -> bool:
        return bool(self.colours) and self.colours[-1] == tuple(COLOURS[name])

    def wait_for(self, name: str) -> None:
        self.host.until(lambda: self.shows(name), what=f"{name} on the strip")


def lights(host, **parameters):
    from lupin_runtime.lights.node import LightStripBridge

    return host.add(LightStripBridge(parameters))


def test_it_is_blue_from_the_start_and_follows_the_mission_until_that_falls_silent(graph_host):
    robot = Robot(graph_host)
    lights(graph_host, mission_state_timeout=0.5)
    robot.wait_for("BLUE")
    robot.mission_says = {"lifecycle_state": "EXPLORING"}
    robot.wait_for("SPRING")
    robot.mission_says = {"lifecycle_state": "INSPECTING", "mission_phase": "SCANNING"}
    robot.wait_for("PURPLE")
    robot.mission_says = {}
    robot.wait_for("BLUE")


def test_the_same_colour_is_sent_once(graph_host):
    robot = Robot(graph_host)
    lights(graph_host)
    robot.mission_says = {"lifecycle_state": "EXPLORING"}
    robot.wait_for("SPRING")
    robot.mission_says = {"lifecycle_state": "RETURNING"}
    robot.wait_for("ORANGE")
    assert len(robot.colours) == len({*robot.colours})


def test_the_stop_is_red_over_a_colour_set_by_hand_which_returns_after_it(graph_host):
    robot = Robot(graph_host)
    lights(graph_host)
    robot.wait_for("BLUE")
    assert robot.ask(graph.LEDS_SET, r=180, g=0, b=255).status
    robot.wait_for("PURPLE")
    robot.estop(True)
    robot.wait_for("RED")
    robot.estop(False)
    robot.wait_for("PURPLE")
    assert robot.ask(graph.LEDS_AUTO).success
    robot.wait_for("BLUE")


def test_setting_by_hand_is_refused_while_the_strip_is_not_there(graph_host):
    robot = Robot(graph_host, strip=False)
    lights(graph_host)
    assert not robot.ask(graph.LEDS_SET, r=1, g=2, b=3).status
    robot.serve()
    robot.wait_for("BLUE")


def test_driving_blinks_green_and_a_moving_arm_orange(graph_host):
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


def test_a_send_that_failed_is_sent_again(graph_host):
    robot = Robot(graph_host)
    robot.refusals = 3
    lights(graph_host)
    robot.wait_for("BLUE")
    assert robot.refusals == 0


def test_bytes_go_out_in_the_order_of_the_strip(graph_host):
    robot = Robot(graph_host)
    lights(graph_host, color_order="BRG")
    graph_host.until(lambda: (255, 0, 0) in robot.colours, what="blue, as this strip is wired")
    robot.mission_says = {"lifecycle_state": "FAULT"}
    graph_host.until(lambda: robot.colours[-1] == (0, 255, 0), what="red, as this strip is wired")


def test_a_strip_may_be_left_alone_until_there_is_something_to_say(graph_host):
    robot = Robot(graph_host)
    lights(graph_host, set_on_startup=False, mission_state_timeout=0.5)
    robot.driving = True
    robot.wait_for("GREEN")
    robot.driving = False
    robot.wait_for("BLUE")
    assert set(robot.colours[:-1]) <= {tuple(COLOURS["GREEN"]), tuple(COLOURS["OFF"])}
