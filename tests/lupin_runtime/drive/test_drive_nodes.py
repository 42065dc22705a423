"""The bus, the smoother and the idle stop on a real graph."""

from __future__ import annotations

import itertools
import json
import math
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.drive import Twist, decode, encode
from tests.support.optional import present

if TYPE_CHECKING:
    from lupin_runtime.drive.node import TwistMux
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

FORWARD = encode(Twist(0.25, -0.1, 0.5))
STILL = encode(Twist(0.0, 0.0, 0.0))
NOT_A_NUMBER = encode(Twist(math.nan, 0.0, 0.0))


class Probe:
    """Simulates the command sources, the e-stop bridge, and the base at the sink."""

    def __init__(self, host: GraphHost, sink: graph.Topic = graph.CMD_VEL_SINK_SIM, heartbeat: bool = True) -> None:
        from lupin_runtime.ros import LupinNode

        self.node = LupinNode("probe")
        self.sink: list[tuple[float, bytes]] = []
        self.status: list[dict[str, Any]] = []
        self.engaged = False
        self.node.subscription(sink, lambda data: self.sink.append((time.monotonic(), data)), raw=True)
        self.node.subscription(graph.DRIVE_STATUS, lambda message: self.status.append(json.loads(message.data)))
        self.sources = {
            row.name: self.node.publisher(row)
            for row in (graph.CMD_VEL_JOY, graph.CMD_VEL_MANUAL, graph.CMD_VEL_AUTO, graph.CMD_VEL_NAV)
        }
        self._estop = self.node.publisher(graph.ESTOP_STATE)
        if heartbeat:
            self.node.create_timer(0.1, lambda: self.estop(self.engaged))
        host.add(self.node)

    def estop(self, engaged: bool) -> None:
        from std_msgs.msg import Bool

        self.engaged = engaged
        self._estop.publish(Bool(data=engaged))

    def at_sink(self, data: bytes) -> bool:
        return any(received == data for _, received in self.sink)

    def flow(
        self, host: GraphHost, row: graph.Topic, data: bytes, until: Callable[..., Any], what: str, expires: bool = False
    ) -> None:
        """Publish `data` at 50 Hz until the condition holds, which a watchdog brings about if `expires`."""

        def step() -> Any:
            self.sources[row.name].publish(data)
            threading.Event().wait(0.02)
            return until()

        (host.until_expired if expires else host.until)(step, what=what)


def bus(host: GraphHost, **parameters: Any) -> TwistMux:
    from lupin_runtime.drive.node import TwistMux

    result: TwistMux = host.add(TwistMux(parameters))
    return result


def test_passed_command_reaches_the_sink_byte_for_byte(graph_host: GraphHost) -> None:
    probe = Probe(graph_host)
    bus(graph_host)
    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, lambda: probe.at_sink(FORWARD), "the command at the sink")


def test_robot_target_uses_its_own_sink(graph_host: GraphHost) -> None:
    probe = Probe(graph_host, sink=graph.CMD_VEL_SINK_ROBOT)
    bus(graph_host, sink="robot")
    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, lambda: probe.at_sink(FORWARD), "the command at the sink")


def test_sink_is_best_effort_and_status_counts_its_listeners(graph_host: GraphHost) -> None:
    from rclpy.qos import ReliabilityPolicy

    probe = Probe(graph_host)
    bus(graph_host)
    graph_host.until(
        lambda: probe.status and probe.status[-1]["sink"] == {"topic": "/cmd_vel", "listeners": 1}, what="the status"
    )
    (publisher,) = probe.node.get_publishers_info_by_topic(graph.CMD_VEL_SINK_SIM.name)
    assert publisher.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    bus(graph_host, sink="robot")
    graph_host.until(
        lambda: probe.status[-1]["sink"] == {"topic": "/mirte_base_controller/cmd_vel", "listeners": 0},
        what="a status",
    )


def test_unknown_sink_is_refused(graph_host: GraphHost) -> None:
    with pytest.raises(ValueError, match="expected one of sim, robot"):
        bus(graph_host, sink="gazebo")


def test_estop_sends_zero_and_no_motion_afterwards(graph_host: GraphHost) -> None:
    probe = Probe(graph_host)
    bus(graph_host)
    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, lambda: probe.at_sink(FORWARD), "the command at the sink")
    probe.estop(True)
    graph_host.until(lambda: probe.sink[-1][1] == STILL, what="zero at the sink")
    count = len(probe.sink)
    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, lambda: len(probe.sink) >= count + 10, "the repeated zero")
    assert {data for _, data in probe.sink[count:]} == {STILL}
    graph_host.until(lambda: probe.status and probe.status[-1]["locks"] == ["e-stop engaged"], what="the status")


def test_forged_releases_pass_no_command_and_raise_an_alarm(graph_host: GraphHost) -> None:
    from std_msgs.msg import Bool

    from lupin_runtime.ros import LupinNode

    probe = Probe(graph_host)
    bus(graph_host)
    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, lambda: probe.at_sink(FORWARD), "the command at the sink")
    probe.estop(True)
    graph_host.until(lambda: probe.sink[-1][1] == STILL, what="zero at the sink")
    intruder = graph_host.add(LupinNode("intruder"))
    forged = intruder.publisher(graph.ESTOP_STATE)
    intruder.subscription(graph.ESTOP_STATE, lambda message: forged.publish(Bool(data=False)) if message.data else None)
    count, sent = len(probe.sink), itertools.count(1)
    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, lambda: next(sent) >= 500, "500 commands")
    assert {data for _, data in probe.sink[count:]} == {STILL}
    assert any(alarm.startswith("/e_stop_state is also published by the node intruder") for alarm in probe.status[-1]["alarms"])
    probe.engaged = False  # two publishers, which both publish released
    probe.flow(graph_host, graph.CMD_VEL_AUTO, STILL, lambda: next(sent) >= 600, "two seconds")
    assert {data for _, data in probe.sink[count:]} == {STILL}
    assert probe.status[-1]["locks"] == ["e-stop engaged"]
    graph_host.remove(intruder)
    graph_host.until(lambda: probe.status[-1]["locks"] == [], what="the bus to be unlocked")


def test_second_publisher_on_the_sink_is_an_alarm(graph_host: GraphHost) -> None:
    from lupin_runtime.ros import LupinNode

    probe = Probe(graph_host)
    bus(graph_host)
    graph_host.until(lambda: probe.status, what="the status")

    def sink_alarms() -> list[str]:
        return [alarm for alarm in probe.status[-1]["alarms"] if alarm.startswith("/cmd_vel ")]

    assert sink_alarms() == []
    intruder = graph_host.add(LupinNode("intruder"))
    intruder.publisher(graph.CMD_VEL_SINK_SIM)
    graph_host.until(sink_alarms, what="the alarm")
    assert sink_alarms() == [
        "/cmd_vel is also published by the node intruder, whose commands bypass the drive bus and the e-stop"
    ]
    graph_host.remove(intruder)
    graph_host.until(lambda: sink_alarms() == [], what="the end of the alarm")


def test_without_an_estop_bridge_the_bus_is_locked(graph_host: GraphHost) -> None:
    probe = Probe(graph_host, heartbeat=False)
    bus(graph_host)
    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, lambda: len(probe.sink) >= 20, "zeros at the sink")
    assert not probe.at_sink(FORWARD)
    graph_host.until(lambda: probe.status, what="the status")
    assert probe.status[-1]["locks"] == ["no e-stop state received yet"]


def test_lost_estop_bridge_stops_the_base(graph_host: GraphHost) -> None:
    probe = Probe(graph_host, heartbeat=False)
    bus(graph_host)

    def alive() -> bool:
        probe.estop(False)
        return probe.at_sink(FORWARD)

    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, alive, "the command at the sink")
    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, lambda: probe.sink[-1][1] == STILL, "zero at the sink", expires=True)


def test_joy_outranks_manual_outranks_auto_in_the_status(graph_host: GraphHost) -> None:
    probe = Probe(graph_host)
    bus(graph_host)
    for row in (graph.CMD_VEL_AUTO, graph.CMD_VEL_MANUAL, graph.CMD_VEL_JOY):
        key = row.name.rsplit("_", 1)[1]
        probe.flow(
            graph_host, row, STILL, lambda k=key: probe.status and probe.status[-1]["winner"] == k, f"{key} wins the bus"
        )
    # While joy publishes, the others are outranked.
    command = encode(Twist(0.1, 0.0, 0.0))

    def both() -> bool:
        probe.sources[graph.CMD_VEL_AUTO.name].publish(FORWARD)
        return probe.at_sink(command)

    probe.flow(graph_host, graph.CMD_VEL_JOY, command, both, "joy at the sink")
    assert not probe.at_sink(FORWARD)


def test_nan_never_reaches_the_sink_and_is_counted(graph_host: GraphHost) -> None:
    probe = Probe(graph_host)
    bus(graph_host)
    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, lambda: probe.at_sink(FORWARD), "the command at the sink")
    probe.flow(
        graph_host,
        graph.CMD_VEL_AUTO,
        NOT_A_NUMBER,
        lambda: probe.status and probe.status[-1]["inputs"]["auto"]["rejected"] > 0,
        "the rejected count",
    )
    assert all(decode(data) is not None for _, data in probe.sink)
    assert probe.sink[-1][1] == STILL


def test_bus_sends_zero_several_times_at_shutdown(graph_host: GraphHost) -> None:
    probe = Probe(graph_host)
    mux = bus(graph_host)
    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, lambda: probe.at_sink(FORWARD), "the command at the sink")
    probe.sink.clear()
    assert mux is not None
    mux.before_shutdown()
    graph_host.until(lambda: [d for _, d in probe.sink].count(STILL) >= 5, what="five zeros")
    probe.flow(graph_host, graph.CMD_VEL_AUTO, FORWARD, lambda: True, "one more command")
    assert not probe.at_sink(FORWARD)


def test_smoother_node_ramps_up_and_ends_with_zero(graph_host: GraphHost) -> None:
    from lupin_runtime.drive.smoother_node import VelocitySmoother

    probe = Probe(graph_host, sink=graph.CMD_VEL_AUTO)
    graph_host.add(VelocitySmoother())
    target = Twist(0.5, 0.0, 0.0)
    full_speed = encode(target)
    probe.flow(graph_host, graph.CMD_VEL_NAV, full_speed, lambda: probe.at_sink(full_speed), "full speed", expires=True)
    xs = [present(decode(data)).x for _, data in probe.sink]
    assert max(b - a for a, b in itertools.pairwise(xs)) <= 2.5 * 0.1 + 1e-9, "no step is larger than two periods allow"
    graph_host.until_expired(lambda: probe.sink[-1][1] == STILL, what="rest after the timeout")
    graph_host.until(lambda: time.monotonic() - probe.sink[-1][0] > 0.5, what="half a second without a command at the sink")


def test_idle_stop_publishes_zero(graph_host: GraphHost) -> None:
    from lupin_runtime.drive.node import IdleStop

    probe = Probe(graph_host, sink=graph.ZERO_CMD_VEL)
    graph_host.add(IdleStop())
    graph_host.until(lambda: len(probe.sink) >= 5, what="zeros")
    assert {data for _, data in probe.sink} == {STILL}
