"""The e-stop on the whole stack under full load: the time from the button's edge to zero at the sink, and to wheels at rest.

    python -m bench.bench_estop [--presses 30] [--by button|console] [--world walled] [--json]

Starts the stack with `lupin up`, drives at 0.4 m/s back and forth, and presses the simulated button repeatedly, or sends the
stop of a client of the console. Times start before the call or frame. The limits for p99 are 50 ms (zero at the sink; by the
console 60 ms) and 300 ms (no wheel faster than 0.05 rad/s, in joint states of 50 Hz). The third figure is for comparison: the
time from an operator's zero command on the same input to wheels at rest.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import threading
import time
from collections.abc import Callable

from bench.detached_run import start_run, stop_run
from lupin_runtime import graph
from lupin_runtime.console.description import read_description
from lupin_runtime.ros import LupinNode
from tests.support.rosbridge_client import RosbridgeClient

AT_REST_RAD_S = 0.05
SPEED_M_S = 0.4
LIMITS_MS = {"zero_at_sink": 50.0, "wheels_at_rest": 300.0}
CONSOLE_LIMIT_MS = 60.0
TIMEOUT_S = 10.0
# The release takes effect after 0.5 to 0.7 s, and discovery of the bench's publisher may take a second.
REST_S = 2.0


class Probe:
    """Drives, presses the button, and records sink and wheels; all times are from the monotonic clock."""

    def __init__(self, console: RosbridgeClient | None) -> None:
        import rclpy
        from geometry_msgs.msg import Twist
        from rclpy.executors import SingleThreadedExecutor
        from std_srvs.srv import SetBool

        rclpy.init(args=[])
        self.node = LupinNode("bench_estop")
        self._twist, self._press = Twist, SetBool.Request
        self._console = console
        self.speed = 0.0
        self.sink: list[tuple[float, bool]] = []
        self.wheels: list[tuple[float, float]] = []
        self._drive = self.node.publisher(graph.CMD_VEL_MANUAL)
        self._button = self.node.client(graph.SIM_PRESS_ESTOP)
        self.node.subscription(graph.CMD_VEL_SINK_SIM, self._on_sink)
        self.node.subscription(graph.JOINT_STATES, self._on_joints)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        threading.Thread(target=self._executor.spin, daemon=True).start()
        threading.Thread(target=self._keep_driving, daemon=True).start()

    def _keep_driving(self) -> None:
        message = self._twist()
        while True:
            message.linear.x = self.speed
            self._drive.publish(message)
            time.sleep(0.05)

    def _on_sink(self, message: object) -> None:
        zero = not (message.linear.x or message.linear.y or message.angular.z)  # type: ignore[attr-defined]
        self.sink.append((time.monotonic(), zero))

    def _on_joints(self, message: object) -> None:
        turning = [abs(v) for n, v in zip(message.name, message.velocity) if n in graph.WHEEL_JOINTS]  # type: ignore[attr-defined]
        self.wheels.append((time.monotonic(), max(turning)))

    def press(self, pressed: bool) -> float:
        """Press or release the button, or the console's stop; returns the time before the call."""
        start = time.monotonic()
        if self._console is not None:
            self._console.send("publish", topic=graph.HMI_ESTOP.name, msg={"data": pressed})
            return start
        self._button.call_async(self._press(data=pressed))
        return start

    def wait_for(self, what: str, condition: Callable[[], float | None]) -> float:
        """Wait until `condition` returns a value, and return it. Raises SystemExit with `what` after TIMEOUT_S."""
        deadline = time.monotonic() + TIMEOUT_S
        while (value := condition()) is None:
            if time.monotonic() > deadline:
                raise SystemExit(f"waited {TIMEOUT_S:.0f} s for {what}")
            time.sleep(0.002)
        return value

    def wait_for_motion(self) -> None:
        """Wait until the wheels turn, and 0.3 s more."""
        self.wait_for("wheels that turn", lambda: self.wheels[-1][1] if self.wheels and self.wheels[-1][1] > 1.0 else None)
        time.sleep(0.3)

    def zero_after(self, start: float) -> float:
        """The time of the first zero at the sink after `start`."""
        return self.wait_for("zero at the sink", lambda: next((t for t, zero in self.sink if zero and t > start), None))

    def rest_after(self, start: float) -> float:
        """The time of the first joint state with wheels at rest after `start`."""
        return self.wait_for(
            "wheels at rest", lambda: next((t for t, v in self.wheels if v < AT_REST_RAD_S and t > start), None)
        )


def measure(presses: int, console: RosbridgeClient | None = None) -> dict[str, list[float]]:
    """The times of every press, ms."""
    probe = Probe(console)
    time.sleep(REST_S)
    times: dict[str, list[float]] = {"zero_at_sink": [], "wheels_at_rest": [], "own_zero_to_rest": []}
    sign = 1.0
    for _ in range(presses):
        for name, stop in (("press", True), ("zero", False)):
            sign = -sign if name == "press" else sign
            probe.sink.clear()
            probe.wheels.clear()
            probe.speed = sign * SPEED_M_S
            probe.wait_for_motion()
            if stop:
                start = probe.press(True)
                times["zero_at_sink"].append((probe.zero_after(start) - start) * 1e3)
                times["wheels_at_rest"].append((probe.rest_after(start) - start) * 1e3)
            else:
                start, probe.speed = time.monotonic(), 0.0
                times["own_zero_to_rest"].append((probe.rest_after(start) - start) * 1e3)
            # After an e-stop, every input must send zero before the drive bus passes motion again.
            probe.speed = 0.0
            time.sleep(0.5)
            if stop:
                probe.press(False)
                time.sleep(REST_S)
    return times


def main() -> int:
    """Press the e-stop of a running stack again and again, and print the times to zero and to rest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--presses", type=int, default=30)
    parser.add_argument("--by", choices=("button", "console"), default="button")
    parser.add_argument("--world", default="walled")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    limits_ms = {**LIMITS_MS, "zero_at_sink": CONSOLE_LIMIT_MS} if options.by == "console" else LIMITS_MS
    run = start_run(["--world", options.world, *(["--web"] if options.by == "console" else [])])
    try:
        described = read_description(run.path)
        times = measure(options.presses, RosbridgeClient(described.rosbridge_port) if described else None)
    finally:
        stop_run(run)
    result: dict[str, float] = {}
    for name, values in times.items():
        ordered = sorted(values)
        result[f"{name}_median_ms"] = round(ordered[len(ordered) // 2], 1)
        result[f"{name}_p99_ms"] = round(ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))], 1)
    for name, limit in limits_ms.items():
        result[f"{name}_ratio_to_limit"] = round(result[f"{name}_p99_ms"] / limit, 2)
    if not options.json:
        for name in times:
            limit_text = f", limit {limits_ms[name]:.0f}" if name in limits_ms else ""
            print(f"{name:18s} median {result[name + '_median_ms']} ms, p99 {result[name + '_p99_ms']} ms{limit_text}")
    print(json.dumps(result), flush=True)
    os._exit(0 if all(result[f"{name}_ratio_to_limit"] <= 1.0 for name in limits_ms) else 1)


if __name__ == "__main__":
    sys.exit(main())
