"""The drive bus: the latency that it adds, compared with a plain relay, and the time from a press of the e-stop button to zero.

    python -m bench.bench_drive [--seconds 20] [--presses 40] [--load 2] [--ordinary] [--json]

The drive bus is the node `twist_mux` of this project, not the ROS package of that name. Bus, e-stop bridge and relay each run
in their own process and POSIX session, as in the stack, on a private graph on loopback. The relay, an rclpy node that only
publishes what it receives, gets the same messages as the bus. The added latency of a command is the time from its publication
by the source to its publication by the bus or the relay, both stamped by the middleware. `--load` starts this number of busy
processes with ordinary scheduling; with `--ordinary`, bus and bridge have that, too, instead of real-time scheduling. The time
to stop is measured from just before the press of the button is published until zero arrives.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from lupin_runtime import graph
from lupin_runtime.drive import INPUTS, Twist, decode, encode
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.priority import request_realtime_scheduling
from lupin_runtime.stack.dds import claim_domain, loopback_environment

RELAY_OUTPUT = graph.Topic("/bench/relay", graph.CMD_VEL_AUTO.type, graph.BEST1)
ZERO_BYTES = encode(Twist(0.0, 0.0, 0.0))
PERIOD_S = 0.02  # of the commands
BUTTON_PERIOD_S = 0.1  # as on the robot; a button that falls silent engages the e-stop
# After an e-stop, the bus passes motion only once its input has sent zero for longer than the input's timeout.
REST_S = next(item.timeout_s for item in INPUTS if item.key == "auto") + 0.1

# Programs of the measured processes. REALTIME tells whether they request real-time scheduling.
PROCESSES = {
    "twist_mux": "from lupin_runtime.drive.node import TwistMux; nodes = [lambda: TwistMux({'serve_first': REALTIME})]",
    "estop_bridge": "from lupin_runtime.safety.node import EstopBridge; "
    "nodes = [lambda: EstopBridge({'serve_first': REALTIME})]",
    "relay": "from bench.bench_drive import relay_node; nodes = [relay_node]",
}
# As in the stack's processes: interpreter shutdown after DDS is slow and may abort.
RUN = "import os; from lupin_runtime.ros import run; s = run(nodes); os._exit(s)"
BUSY = "x = 0\nwhile True:\n    x += 1"


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

    def __init__(self) -> None:
        import rclpy
        from mirte_msgs.msg import IntensityDigital
        from rclpy.executors import SingleThreadedExecutor

        rclpy.init(args=[])
        self._button_type = IntensityDigital
        self.node = LupinNode("bench_client")
        self.sent_ns: dict[float, int] = {}
        self.via_bus_ns: dict[float, int] = {}
        self.via_relay_ns: dict[float, int] = {}
        self.zero_ns = 0
        self.is_pressed = False
        self.moving = threading.Event()
        self.command_publisher = self.node.publisher(graph.CMD_VEL_AUTO)
        self.button_publisher = self.node.publisher(graph.ESTOP_BUTTON)
        qos = graph.Qos(reliable=False, depth=50)
        self.node.subscription(graph.CMD_VEL_AUTO, self._recorder(self.sent_ns), qos=qos, raw=True)
        self.node.subscription(RELAY_OUTPUT, self._recorder(self.via_relay_ns), qos=qos, raw=True)
        record_sink: Callable[..., None] = self._record_sink
        self.node.subscription(graph.CMD_VEL_SINK_SIM, record_sink, qos=qos, raw=True)
        self.node.create_timer(BUTTON_PERIOD_S, self._publish_button)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        threading.Thread(target=self._executor.spin, daemon=True).start()

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

    def close(self) -> None:
        """Stop the executor and leave the graph."""
        import rclpy

        self._executor.shutdown(timeout_sec=2.0)
        rclpy.try_shutdown()


def percentiles(values_ms: list[float]) -> dict[str, float]:
    """Return the median, the 99th percentile, the maximum (ms) and the number of values. Exits if there are none."""
    ordered = sorted(values_ms)
    if not ordered:
        raise SystemExit("bench_drive: no message was received")
    return {
        "median_ms": round(ordered[len(ordered) // 2], 3),
        "p99_ms": round(ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))], 3),
        "max_ms": round(ordered[-1], 3),
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


def main() -> None:
    """Run both measurements and print them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="measure the latency for this long")
    parser.add_argument("--presses", type=int, default=40, help="press the button this many times")
    parser.add_argument(
        "--load", type=int, default=os.cpu_count() or 1, help="start this many busy processes; default: one per CPU"
    )
    parser.add_argument("--ordinary", action="store_true", help="let bus and bridge run without real-time scheduling")
    parser.add_argument("--json", action="store_true", help="print one JSON line instead of a table")
    args = parser.parse_args()

    claim = claim_domain()
    children: list[subprocess.Popen[bytes]] = []
    with tempfile.TemporaryDirectory() as directory:
        os.environ.update(loopback_environment(claim.domain, Path(directory)))
        try:
            for code in PROCESSES.values():
                code = f"REALTIME = {not args.ordinary}; {code}; {RUN}"
                children.append(subprocess.Popen([sys.executable, "-c", code], stdout=sys.stderr, start_new_session=True))
            client = DriveClient()
            client.drive_until_motion()
            children += [subprocess.Popen([sys.executable, "-c", BUSY], start_new_session=True) for _ in range(args.load)]
            request_realtime_scheduling()  # this process is both source and sink; its own scheduling delays must not count
            rows = measure_latency(client, args.seconds)
            rows["stop"] = measure_stop(client, args.presses)
            client.close()
        finally:
            for child in children:
                child.terminate()
            for child in children:
                try:
                    child.wait(5.0)
                except subprocess.TimeoutExpired:
                    child.kill()
            claim.release()
    scheduling = "ordinary" if args.ordinary else "real-time"
    result: dict[str, object] = {"load": args.load, "scheduling": scheduling, **rows}
    result["ratio_median"] = round(rows["twist_mux"]["median_ms"] / rows["relay"]["median_ms"], 2)
    if args.json:
        print(json.dumps(result))
        return
    print(f"{'':34}{'median ms':>10}{'p99 ms':>10}{'max ms':>10}{'samples':>9}")
    titles = ("twist_mux, added", "bare rclpy relay, added", "button press to zero at the sink")
    for title, row in zip(titles, rows.values()):
        print(f"{title:34}{row['median_ms']:10.3f}{row['p99_ms']:10.3f}{row['max_ms']:10.3f}{row['samples']:9.0f}")
    print(f"twist_mux / relay, median: {result['ratio_median']}   (load: {args.load} busy processes, {scheduling})")


if __name__ == "__main__":
    main()
