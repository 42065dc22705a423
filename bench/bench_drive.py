"""The drive bus: the latency that it adds, compared with a plain relay, and the time from a press of the e-stop button to zero.

The drive bus is the node `twist_mux` of this project, not the ROS package of that name. Bus, e-stop bridge and relay each run
in their own process and POSIX session, as in the stack, on a private graph on loopback. The relay, an rclpy node that only
publishes what it receives, gets the same messages as the bus. The added latency of a command is the time from its publication
by the source to its publication by the bus or the relay, both stamped by the middleware. `--load` starts this number of busy
processes with ordinary scheduling; with `--ordinary`, bus and bridge have that, too, instead of real-time scheduling. The time
to stop is measured from just before the press of the button is published until zero arrives.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Annotated

from bench.processes import busy_processes, child_command, private_graph, spinning_node, terminate
from bench.runner import Figures, Load, Seconds, benchmark
from lupin_runtime import graph
from lupin_runtime.drive import INPUTS, Twist, decode, encode
from lupin_runtime.ros import LupinNode, run
from lupin_runtime.ros.priority import request_realtime_scheduling

RELAY_OUTPUT = graph.Topic("/bench/relay", graph.CMD_VEL_AUTO.type, graph.BEST1)
ZERO_BYTES = encode(Twist(0.0, 0.0, 0.0))
CPUS = os.cpu_count() or 1
PERIOD_S = 0.02  # of the commands
BUTTON_PERIOD_S = 0.1  # as on the robot; a button that falls silent engages the e-stop
# After an e-stop, the bus passes motion only once its input has sent zero for longer than the input's timeout.
REST_S = next(item.timeout_s for item in INPUTS if item.key == "auto") + 0.1


def run_drive_bus(realtime: bool) -> int:
    """Run the drive bus, with real-time scheduling if asked to."""
    from lupin_runtime.drive.node import TwistMux

    return run([lambda: TwistMux({"serve_first": realtime})])


def run_estop_bridge(realtime: bool) -> int:
    """Run the e-stop bridge, with real-time scheduling if asked to."""
    from lupin_runtime.safety.node import EstopBridge

    return run([lambda: EstopBridge({"serve_first": realtime})])


def run_relay() -> int:
    """Run the relay."""
    return run([relay_node])


def relay_node() -> LupinNode:
    """Return the relay: a node that deserializes each Twist and publishes it again."""
    node = LupinNode("relay")
    out = node.publisher(RELAY_OUTPUT)
    node.subscription(graph.CMD_VEL_AUTO, out.publish, qos=graph.BEST1)
    return node


class DriveClient:
    """Publishes commands and the state of the e-stop button.

    Records when the source, the bus and the relay published each command: the time (ns, system clock) by the y value, which
    identifies the command.
    """

    def __init__(self, node: LupinNode) -> None:
        from mirte_msgs.msg import IntensityDigital

        self._button_type = IntensityDigital
        self.sent_ns: dict[float, int] = {}
        self.via_bus_ns: dict[float, int] = {}
        self.via_relay_ns: dict[float, int] = {}
        self.zero_ns = 0
        self.is_pressed = False
        self.moving = threading.Event()
        self.command_publisher = node.publisher(graph.CMD_VEL_AUTO)
        self.button_publisher = node.publisher(graph.ESTOP_BUTTON)
        qos = graph.Qos(reliable=False, depth=50)
        node.subscription(graph.CMD_VEL_AUTO, self._recorder(self.sent_ns), qos=qos, raw=True)
        node.subscription(RELAY_OUTPUT, self._recorder(self.via_relay_ns), qos=qos, raw=True)
        record_sink: Callable[..., None] = self._record_sink
        node.subscription(graph.CMD_VEL_SINK_SIM, record_sink, qos=qos, raw=True)
        node.create_timer(BUTTON_PERIOD_S, self._publish_button)

    def _recorder(self, table: dict[float, int]) -> Callable[..., None]:
        def record(data: bytes, info: dict[str, int]) -> None:
            command = decode(data)
            if command is not None:
                table[command.y] = info["source_timestamp"]

        return record

    def _record_sink(self, data: bytes, info: dict[str, int]) -> None:
        command = decode(data)
        if data == ZERO_BYTES:
            self.zero_ns = self.zero_ns or info["received_timestamp"]
        elif command is not None:
            self.via_bus_ns[command.y] = info["source_timestamp"]
            self.moving.set()

    def _publish_button(self) -> None:
        self.button_publisher.publish(self._button_type(value=self.is_pressed))

    def set_button(self, pressed: bool) -> None:
        """Publish the state of the button, now and from now on."""
        self.is_pressed = pressed
        self._publish_button()

    def drive_until_motion(self, timeout_s: float = 20.0) -> None:
        """Rest and then send motion, repeatedly, until motion arrives at the sink. Exits after the timeout."""
        self.moving.clear()
        deadline = time.monotonic() + timeout_s
        while not self.moving.is_set():
            if time.monotonic() > deadline:
                raise SystemExit(f"bench_drive: no command reached the sink within {timeout_s:g} s; is the bus locked?")
            self._publish_until_motion(ZERO_BYTES)
            self._publish_until_motion(encode(Twist(0.1, 0.0, 0.0)))

    def _publish_until_motion(self, command: bytes) -> None:
        """Publish a command for REST_S, or until motion arrives at the sink."""
        end = time.monotonic() + REST_S
        while time.monotonic() < end and not self.moving.is_set():
            self.command_publisher.publish(command)
            self.moving.wait(PERIOD_S)


def percentiles(values_ms: list[float]) -> dict[str, float]:
    """Return the median, the 99th percentile, the maximum (ms) and the number of values. Exits if there are none."""
    ordered = sorted(values_ms)
    if not ordered:
        raise SystemExit("bench_drive: no message was received")
    return {
        "median_ms": ordered[len(ordered) // 2],
        "p99_ms": ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))],
        "max_ms": ordered[-1],
        "samples": len(ordered),
    }


def measure_latency(client: DriveClient, seconds: float) -> dict[str, dict[str, float]]:
    """Publish commands at 50 Hz; return the latency that the bus and the relay add to them."""
    client.drive_until_motion()
    count = int(seconds / PERIOD_S)
    start = time.monotonic()
    for index in range(1, count + 1):
        client.command_publisher.publish(encode(Twist(0.2, index * 1e-6, 0.0)))
        time.sleep(max(0.0, start + index * PERIOD_S - time.monotonic()))
    time.sleep(0.5)  # until the last commands have arrived

    def added(table: dict[float, int]) -> list[float]:
        keys = [y for y in client.sent_ns if y > 0 and y in table]
        return [(table[y] - client.sent_ns[y]) / 1e6 for y in keys]

    return {"twist_mux": percentiles(added(client.via_bus_ns)), "relay": percentiles(added(client.via_relay_ns))}


def measure_stop(client: DriveClient, presses: int) -> dict[str, float]:
    """Press the button repeatedly while commands flow at 50 Hz; return the times from press to first zero at the sink."""
    delays = []
    for _ in range(presses):
        client.drive_until_motion()
        for _ in range(5):
            client.command_publisher.publish(encode(Twist(0.1, 0.0, 0.0)))
            time.sleep(PERIOD_S)
        client.zero_ns = 0
        pressed_ns = time.time_ns()
        client.set_button(True)
        deadline = time.monotonic() + 5.0
        while not client.zero_ns:
            if time.monotonic() > deadline:
                raise SystemExit("bench_drive: no zero at the sink within 5 s of the press of the button")
            time.sleep(0.001)
        delays.append((client.zero_ns - pressed_ns) / 1e6)
        client.set_button(False)
        time.sleep(0.15)  # until the release has reached the bus
    return percentiles(delays)


@benchmark()
def main(
    seconds: Seconds = 20.0,
    presses: Annotated[int, "press the button this many times"] = 40,
    load: Load = CPUS,
    ordinary: Annotated[bool, "let bus and bridge run without real-time scheduling"] = False,
) -> Figures:
    """Run both measurements."""
    with private_graph() as environment, ExitStack() as exits:
        os.environ.update(environment)
        serve_first = {"realtime": not ordinary}
        for command in (
            child_command(run_drive_bus, **serve_first),
            child_command(run_estop_bridge, **serve_first),
            child_command(run_relay),
        ):
            child = subprocess.Popen(command, stdout=sys.stderr, start_new_session=True)
            exits.callback(terminate, child, 5.0)
        client = DriveClient(exits.enter_context(spinning_node("bench_client")))
        client.drive_until_motion()
        exits.enter_context(busy_processes(load))
        request_realtime_scheduling()  # this process is both source and sink; its own scheduling delays must not count
        rows = measure_latency(client, seconds)
        rows["stop"] = measure_stop(client, presses)
    return {
        "load": load,
        "scheduling": "ordinary" if ordinary else "real-time",
        "times": rows,
        "ratio_median": rows["twist_mux"]["median_ms"] / rows["relay"]["median_ms"],
    }


if __name__ == "__main__":
    sys.exit(main())
