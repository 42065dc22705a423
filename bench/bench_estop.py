"""The e-stop on the whole stack under full load: the time from a press to zero at the sink, and to wheels at rest.

Starts the stack with `lupin up`, drives back and forth at 0.4 m/s, and presses the e-stop repeatedly: the simulated button, or
with `--by console` the stop of a console client. Times start just before the service call or the WebSocket frame is sent; those
from the edge start when the button's first pressed message arrives here, because on a robot nothing calls the simulator.
At rest means slower than 0.05 rad/s, in joint states at 50 Hz. For comparison, the last figure is the time from an operator's
zero command to wheels at rest.
"""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from typing import Annotated

from bench.detached_run import detached_run
from bench.processes import spinning_node
from bench.runner import Figures, World, benchmark
from lupin_runtime import graph
from lupin_runtime.console.description import read_description
from lupin_runtime.ros import LupinNode
from tests.support.rosbridge_client import RosbridgeClient

AT_REST_RAD_S = 0.05
SPEED_M_S = 0.4
TIMEOUT_S = 10.0
# Discovery of the bench's publisher may take a second; a release takes effect after 0.5 to 0.7 s.
SETTLE_S = 2.0


class EstopRig:
    """Drives, presses the e-stop, and records sink and wheels; all times are from the monotonic clock.

    The e-stop is the simulated button, or the stop of `console` if that is given.
    """

    def __init__(self, node: LupinNode, console: RosbridgeClient | None) -> None:
        from geometry_msgs.msg import Twist
        from std_srvs.srv import SetBool

        self._twist_type, self._button_request = Twist, SetBool.Request
        self._console = console
        self.speed = 0.0
        self.sink_commands: list[tuple[float, bool]] = []  # time, and whether it was zero
        self.wheel_speeds: list[tuple[float, float]] = []  # time, and the speed of the fastest wheel (rad/s)
        self.edges: list[float] = []  # times of pressed messages of the button
        self._drive_publisher = node.publisher(graph.CMD_VEL_MANUAL)
        self._press_client = node.client(graph.SIM_PRESS_ESTOP)
        node.subscription(graph.CMD_VEL_SINK_SIM, self._on_sink)
        node.subscription(graph.JOINT_STATES, self._on_joints)
        node.subscription(graph.ESTOP_BUTTON, self._on_button)
        self._over = threading.Event()
        self._driving = threading.Thread(target=self._keep_driving)
        self._driving.start()

    def _keep_driving(self) -> None:
        message = self._twist_type()
        while not self._over.wait(0.05):
            message.linear.x = self.speed
            self._drive_publisher.publish(message)

    def close(self) -> None:
        """Stop driving."""
        self._over.set()
        self._driving.join()

    def _on_sink(self, message: object) -> None:
        is_zero = not (message.linear.x or message.linear.y or message.angular.z)  # type: ignore[attr-defined]
        self.sink_commands.append((time.monotonic(), is_zero))

    def _on_joints(self, message: object) -> None:
        speeds = [abs(v) for n, v in zip(message.name, message.velocity) if n in graph.WHEEL_JOINTS]  # type: ignore[attr-defined]
        self.wheel_speeds.append((time.monotonic(), max(speeds)))

    def _on_button(self, message: object) -> None:
        if message.value:  # type: ignore[attr-defined]
            self.edges.append(time.monotonic())

    def set_estop(self, engaged: bool) -> float:
        """Press or release the e-stop; return the time just before the request was sent."""
        start = time.monotonic()
        if self._console is not None:
            self._console.send("publish", topic=graph.HMI_ESTOP.name, msg={"data": engaged})
            return start
        self._press_client.call_async(self._button_request(data=engaged))
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
        """Wait until the wheels turn, and then for 0.3 s."""
        self.wait_for("turning wheels", lambda: next((v for _, v in self.wheel_speeds[-1:] if v > 1.0), None))
        time.sleep(0.3)

    def wait_for_zero(self, start: float) -> float:
        """Wait for the first zero at the sink after `start`, and return its time."""
        return self.wait_for(
            "zero at the sink", lambda: next((t for t, is_zero in self.sink_commands if is_zero and t > start), None)
        )

    def wait_for_rest(self, start: float) -> float:
        """Wait for the first joint state after `start` with wheels at rest, and return its time."""
        return self.wait_for(
            "wheels at rest", lambda: next((t for t, v in self.wheel_speeds if v < AT_REST_RAD_S and t > start), None)
        )


def measure(rig: EstopRig, presses: int, by_console: bool) -> dict[str, list[float]]:
    """Press the e-stop `presses` times; return the times in ms, by figure."""
    time.sleep(SETTLE_S)
    names = ("edge_to_zero", "zero_at_sink", "wheels_at_rest", "zero_command_to_rest")
    times: dict[str, list[float]] = {name: [] for name in names[by_console:]}
    sign = 1.0
    for _ in range(presses):
        for by_estop in (True, False):
            sign = -sign if by_estop else sign
            rig.sink_commands.clear()
            rig.wheel_speeds.clear()
            rig.speed = sign * SPEED_M_S
            rig.wait_for_motion()
            if by_estop:
                rig.edges.clear()
                start = rig.set_estop(True)
                zero = rig.wait_for_zero(start)
                times["zero_at_sink"].append((zero - start) * 1e3)
                if not by_console:
                    edge = rig.wait_for("the button's edge", lambda: next(iter(rig.edges), None))
                    times["edge_to_zero"].append((zero - edge) * 1e3)
                times["wheels_at_rest"].append((rig.wait_for_rest(start) - start) * 1e3)
            else:
                start, rig.speed = time.monotonic(), 0.0
                times["zero_command_to_rest"].append((rig.wait_for_rest(start) - start) * 1e3)
            # After an e-stop, every input must send zero before the drive bus passes motion again.
            rig.speed = 0.0
            time.sleep(0.5)
            if by_estop:
                rig.set_estop(False)
                time.sleep(SETTLE_S)
    return times


@benchmark(at_most={"button.edge_to_zero.p99_ms": 50.0, "console.zero_at_sink.p99_ms": 60.0, "wheels_at_rest.p99_ms": 300.0})
def main(
    presses: Annotated[int, "press the e-stop this many times"] = 30,
    by: Annotated[str, "press the simulated button, or the stop of a console client", ("button", "console")] = "button",
    world: World = "walled",
) -> Figures:
    """Start the stack, and press the e-stop repeatedly."""
    by_console = by == "console"
    with detached_run(["--world", world, "--web" if by_console else "--no-web"]) as run:
        client = None
        if by_console:
            description = read_description(run.path)
            if description is None:
                raise SystemExit(f"the console is not running; see: lupin logs console --run {run.id}")
            client = RosbridgeClient(description.rosbridge_port)
        with spinning_node("bench_estop") as node, closing(EstopRig(node, client)) as rig:
            times = measure(rig, presses, by_console)
    figures = {}
    for name, values in times.items():
        ordered = sorted(values)
        median_ms, p99_ms = ordered[len(ordered) // 2], ordered[math.ceil(0.99 * len(ordered)) - 1]
        figures[name] = {"median_ms": median_ms, "p99_ms": p99_ms, "max_ms": ordered[-1]}
    return {by: figures}


if __name__ == "__main__":
    sys.exit(main())
