"""Gamepad: the time from an event to the velocity at the sink, and to zero after a release, an unplugging, and the node's end.

A pad made of a pipe, the node of the gamepads, the drive bus and the e-stop bridge run on a private graph on loopback, the
nodes in processes of their own. Times begin just before the event is written, the pad is unplugged or the signal is sent, and
end when the message arrives from the sink. The intervals between changes of the stick drift through the node's period of 50 ms.
`resumed` counts motions at the sink after a stopped node was continued, while its pad was held all along.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

from bench.bench_drive import percentiles, run_drive_bus, run_estop_bridge
from bench.processes import child_command, kill, private_graph, spinning_node, terminate
from bench.runner import Figures, benchmark, note
from lupin_runtime import graph
from lupin_runtime.drive import ZERO, Twist, decode
from lupin_runtime.ros import LupinNode, run
from lupin_runtime.ros.priority import request_realtime_scheduling
from lupin_runtime.teleop.events import ABS_RX, BTN_TL
from lupin_runtime.teleop.pad_maps import DEAD_ZONES, SIGNED_16, USB
from lupin_runtime.teleop.pad_state import SETTLE_S
from lupin_runtime.teleop.velocity import Sticks, command_velocity, normalize
from tests.support import pad_ids
from tests.support.fake_pads import FakePads
from tests.support.pad_events import axis, key

PAD = "event5"
STEP_S = 0.053  # between two changes of the stick
REST_S = 0.5  # the drive bus requires this long a rest after a lock
STEADY_S = 0.3  # until the drive bus has accelerated, and until its last messages have arrived
ENDED_S = 1.5  # longer than any limit of an end, so that the motion has ended, or goes on
RESUME_S = 1.0  # within which a node that was stopped and continued would move the robot again
TIMEOUT_S = 20.0
BUTTON_PERIOD_S = 0.1
# Turning left, at speeds between which the drive bus's limit of the acceleration does not matter.
RAW_VALUES = range(-22_000, -27_000, -1)


def run_pads(devices: str, sysfs: str, maps: str) -> int:
    """Run the node of the gamepads."""
    from lupin_runtime.teleop.node import PadTeleop

    return run([lambda: PadTeleop({"devices": devices, "sysfs": sysfs, "maps": maps})])


def start_pads(pads: FakePads) -> subprocess.Popen[Any]:
    """Start a process with the node of the gamepads."""
    folders = {"devices": pads.devices, "sysfs": pads.sysfs, "maps": pads.maps}
    command = child_command(run_pads, **{name: str(folder) for name, folder in folders.items()})
    return subprocess.Popen(command, stdout=sys.stderr, start_new_session=True)


class PadRig:
    """A pad, the node that reads it, and what arrives from the sink: each velocity with its time (ns, system clock)."""

    def __init__(self, fake: FakePads, client: LupinNode) -> None:
        from mirte_msgs.msg import IntensityDigital

        self.fake = fake
        self.sink: list[tuple[int, Twist]] = []
        self.node: subprocess.Popen[Any] | None = None
        receive: Callable[..., None] = self._receive
        client.subscription(graph.CMD_VEL_SINK_SIM, receive, qos=graph.Qos(reliable=False, depth=50), raw=True)
        button = client.publisher(graph.ESTOP_BUTTON)
        client.create_timer(BUTTON_PERIOD_S, lambda: button.publish(IntensityDigital(value=False)))

    def _receive(self, data: bytes, info: dict[str, int]) -> None:
        command = decode(data)
        if command is not None:
            self.sink.append((info["received_timestamp"], command))

    def start_node(self) -> None:
        """Start the node of the gamepads."""
        self.node = start_pads(self.fake)

    def end_node(self) -> None:
        """End the node of the gamepads."""
        if self.node is not None:
            terminate(self.node, 5.0)

    def turn(self, raw: int) -> None:
        """Move the stick that turns."""
        self.fake.send(PAD, axis(ABS_RX, raw, time.monotonic_ns()))

    def press(self, value: int) -> None:
        """Press or release the dead-man button."""
        self.fake.send(PAD, key(BTN_TL, value, time.monotonic_ns()))

    def drive(self) -> None:
        """Press the button anew until the sink moves. Exits after a timeout."""
        deadline = time.monotonic() + TIMEOUT_S
        while time.monotonic() < deadline:
            start = len(self.sink)
            self.press(0)
            time.sleep(REST_S)
            self.turn(RAW_VALUES[0])
            self.press(1)
            if self._has_moved_since(start):
                time.sleep(STEADY_S)
                return
        raise SystemExit(f"not measured: the sink did not move within {TIMEOUT_S:g} s")

    def _has_moved_since(self, start: int) -> bool:
        """Return whether the sink moves within half a second, after its first `start` messages."""
        deadline = time.monotonic() + 0.5
        while all(twist == ZERO for _, twist in self.sink[start:]):
            if time.monotonic() > deadline:
                return False
            time.sleep(0.001)
        return True

    def time_to_zero_ms(self, action: Callable[[], object]) -> float:
        """Drive, act, and return the time until the first of the zeros that end the motion arrives (ms)."""
        self.drive()
        began_ns = time.time_ns()
        action()
        time.sleep(ENDED_S)
        moved_ns = max(time_ns for time_ns, twist in self.sink if twist != ZERO)
        zeros = [time_ns for time_ns, twist in self.sink if time_ns > moved_ns and twist == ZERO]
        if not zeros:
            raise SystemExit(f"not measured: the sink still moves after {ENDED_S:g} s")
        return (zeros[0] - began_ns) / 1e6


def measure_latency(rig: PadRig, samples: int) -> dict[str, float]:
    """Move the stick repeatedly; return the times until each velocity arrives from the sink."""
    if samples > len(RAW_VALUES):
        raise SystemExit(f"not measured: at most {len(RAW_VALUES)} samples can be told apart")
    rig.drive()
    rig.sink.clear()
    sent_ns: dict[float, int] = {}
    start = time.monotonic()
    for index in range(samples):
        raw = RAW_VALUES[7 * index % len(RAW_VALUES)]  # 7 is no divisor of 5000: each value comes once
        sticks = Sticks(0.0, 0.0, -normalize(raw, *SIGNED_16))
        velocity = command_velocity(sticks, turbo=False, dead_zone=DEAD_ZONES[USB])
        sent_ns[velocity.yaw] = time.time_ns()
        rig.turn(raw)
        time.sleep(max(0.0, start + (index + 1) * STEP_S - time.monotonic()))
    time.sleep(STEADY_S)
    first: dict[float, int] = {}
    for time_ns, twist in rig.sink:
        first.setdefault(twist.yaw, time_ns)
    rig.press(0)
    delays = percentiles([(first[yaw] - began_ns) / 1e6 for yaw, began_ns in sent_ns.items() if yaw in first])
    # On a busy machine, a node that could not read for 0.25 s no longer believes that its pad is held.
    return {**delays, "lost_share": 1.0 - len(first.keys() & sent_ns.keys()) / samples}


def measure_ends(rig: PadRig, rounds: int) -> tuple[dict[str, dict[str, float]], int]:
    """End the motion in each way; return the times until zero by name, and the motions after a stopped node was continued."""

    def replug() -> None:
        rig.fake.unplug(PAD)

    def signal_node(number: int) -> None:
        assert rig.node is not None
        os.kill(rig.node.pid, number)

    times: dict[str, list[float]] = {"release": [], "unplugged": [], "killed": [], "stopped": []}
    resumed = 0
    for _ in range(rounds):
        times["release"].append(rig.time_to_zero_ms(lambda: rig.press(0)))
        times["unplugged"].append(rig.time_to_zero_ms(replug))
        rig.fake.plug(PAD, pad_ids.XBOX_USB)
        time.sleep(2 * SETTLE_S)
        times["stopped"].append(rig.time_to_zero_ms(lambda: signal_node(signal.SIGSTOP)))
        count = len(rig.sink)
        rig.turn(RAW_VALUES[-1])  # waits in the pipe
        signal_node(signal.SIGCONT)
        time.sleep(RESUME_S)
        resumed += sum(twist != ZERO for _, twist in rig.sink[count:])
        times["killed"].append(rig.time_to_zero_ms(lambda: signal_node(signal.SIGKILL)))
        assert rig.node is not None
        kill(rig.node)
        rig.start_node()
    return {name: percentiles(values) for name, values in times.items()}, resumed


@benchmark(
    at_most={
        "event_to_sink.median_ms": 5.0,
        "event_to_sink.p99_ms": 25.0,
        "event_to_sink.lost_share": 0.01,
        "release.max_ms": 350.0,
        "unplugged.max_ms": 350.0,
        "killed.max_ms": 1000.0,
        "stopped.max_ms": 1000.0,
        "resumed": 0,
    }
)
def main(
    samples: Annotated[int, "move the stick this many times"] = 400,
    rounds: Annotated[int, "end the motion in each way this many times"] = 10,
    ordinary: Annotated[bool, "let bus and bridge run without real-time scheduling"] = False,
) -> Figures:
    """Measure all times."""
    with private_graph() as environment, ExitStack() as exits:
        os.environ.update(environment)
        fake = FakePads(Path(exits.enter_context(tempfile.TemporaryDirectory(prefix="lupin-pads-"))))
        exits.callback(fake.close)
        for function in (run_drive_bus, run_estop_bridge):
            command = child_command(function, realtime=not ordinary)
            exits.callback(terminate, subprocess.Popen(command, stdout=sys.stderr, start_new_session=True), 5.0)
        rig = PadRig(fake, exits.enter_context(spinning_node("bench_client")))
        fake.plug(PAD, pad_ids.XBOX_USB)
        rig.start_node()
        exits.callback(rig.end_node)
        rig.drive()
        request_realtime_scheduling()  # this process is both pad and sink; its own scheduling delays must not count
        note(f"{samples} changes of the stick, {rounds} ends of each kind")
        latency = measure_latency(rig, samples)
        note("event to sink", latency)
        ends, resumed = measure_ends(rig, rounds)
        return {"event_to_sink": latency, "to_zero": ends, "resumed": resumed}


if __name__ == "__main__":
    sys.exit(main())
