"""The e-stop on the whole stack, under its full load: from the button's edge to zero at the sink, and to wheels at rest.

    python -m bench.bench_estop [--presses 30] [--world walled] [--json]

Brings the stack up as `lupin up` does, drives at 0.4 m/s back and forth, presses the simulated button again and again. Times
run from before the call that presses the button. The limits are p99 50 ms (zero at the sink) and 300 ms (no wheel turns faster
than 0.05 rad/s, in joint states of 50 Hz). The third figure is what stopping costs without the e-stop: an operator's own zero
on the same input, to wheels at rest.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_runtime.stack.runs import find_live_run

AT_REST_RAD_S = 0.05
SPEED_M_S = 0.4
LIMITS_MS = {"zero_at_sink": 50.0, "wheels_at_rest": 300.0}
BOUND_S = 10.0


class Probe:
    """Drives, presses, listens; all times are of the monotonic clock."""

    def __init__(self) -> None:
        import rclpy
        from geometry_msgs.msg import Twist
        from rclpy.executors import SingleThreadedExecutor
        from std_srvs.srv import SetBool

        rclpy.init(args=[])
        self.node = LupinNode("bench_estop")
        self._twist, self._press = Twist, SetBool.Request
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
        """When the button was told, before the call."""
        began = time.monotonic()
        self._button.call_async(self._press(data=pressed))
        return began

    def until(self, what: str, condition: Callable[[], float | None]) -> float:
        """The first value of `condition`; SystemExit with `what` where none comes."""
        deadline = time.monotonic() + BOUND_S
        while (value := condition()) is None:
            if time.monotonic() > deadline:
                raise SystemExit(f"waited {BOUND_S:.0f} s for {what}")
            time.sleep(0.002)
        return value

    def moving(self) -> None:
        self.until("wheels that turn", lambda: self.wheels[-1][1] if self.wheels and self.wheels[-1][1] > 1.0 else None)
        time.sleep(0.3)

    def zero_after(self, began: float) -> float:
        return self.until("zero at the sink", lambda: next((t for t, zero in self.sink if zero and t > began), None))

    def rest_after(self, began: float) -> float:
        return self.until("wheels at rest", lambda: next((t for t, v in self.wheels if v < AT_REST_RAD_S and t > began), None))


def measure(presses: int) -> dict[str, list[float]]:
    """Milliseconds of every press."""
    probe = Probe()
    times: dict[str, list[float]] = {"zero_at_sink": [], "wheels_at_rest": [], "own_zero_to_rest": []}
    sign = 1.0
    for _ in range(presses):
        for name, stop in (("press", True), ("zero", False)):
            sign = -sign if name == "press" else sign
            probe.sink.clear(), probe.wheels.clear()
            probe.speed = sign * SPEED_M_S
            probe.moving()
            if stop:
                began = probe.press(True)
                times["zero_at_sink"].append((probe.zero_after(began) - began) * 1e3)
                times["wheels_at_rest"].append((probe.rest_after(began) - began) * 1e3)
            else:
                began, probe.speed = time.monotonic(), 0.0
                times["own_zero_to_rest"].append((probe.rest_after(began) - began) * 1e3)
            # After an e-stop every input must be seen at rest before motion passes again.
            probe.speed = 0.0
            time.sleep(0.5)
            if stop:
                probe.press(False)
                time.sleep(0.5)
    return times


def everything_up(state: Path) -> bool:
    """Whether the supervisor says so; it has said nothing in the first second."""
    stages = json.loads(state.read_text())["stages"] if state.exists() else []
    return bool(stages) and all(stage["phase"] == "up" for stage in stages)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--presses", type=int, default=30)
    parser.add_argument("--world", default="walled")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    lupin = [sys.executable, "-m", "lupin_cli.app"]
    command = [*lupin, "up", "--detach", "--headless", "--world", options.world]
    up = subprocess.run(command, check=False, timeout=60, stdout=subprocess.PIPE, text=True)
    begun = re.match(r"run (\S+) has begun", up.stdout)
    if begun is None:
        return up.returncode or 1
    run = find_live_run(begun[1])  # others may be up
    try:
        deadline = time.monotonic() + 60.0
        while not everything_up(run.path / "state.json"):
            if time.monotonic() > deadline:
                raise SystemExit(f"the stack was not up within 60 s: lupin logs {run.path.name}")
            time.sleep(0.2)
        os.environ.update(run.info()["environment"])
        times = measure(options.presses)
    finally:
        subprocess.run([*lupin, "down", "--run", run.id], check=False, timeout=60)
    result: dict[str, float] = {}
    for name, values in times.items():
        ordered = sorted(values)
        result[f"{name}_median_ms"] = round(ordered[len(ordered) // 2], 1)
        result[f"{name}_p99_ms"] = round(ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))], 1)
    for name, limit in LIMITS_MS.items():
        result[f"{name}_ratio_to_limit"] = round(result[f"{name}_p99_ms"] / limit, 2)
    if not options.json:
        for name in times:
            limit = f", limit {LIMITS_MS[name]:.0f}" if name in LIMITS_MS else ""
            print(f"{name:18s} median {result[name + '_median_ms']} ms, p99 {result[name + '_p99_ms']} ms{limit}")
    print(json.dumps(result), flush=True)
    os._exit(0 if all(result[f"{name}_ratio_to_limit"] <= 1.0 for name in LIMITS_MS) else 1)


if __name__ == "__main__":
    sys.exit(main())
