"""The time from a client's stop to zero at the sink, with the drive bus and the e-stop in their own processes."""

from __future__ import annotations

import json
import queue
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from bench.processes import child_command, terminate
from bench.server_rig import ServerRig
from lupin_runtime import graph

if TYPE_CHECKING:
    from lupin_runtime.ros import LupinNode

_TIMEOUT_S = 20.0
_DRIVE_PERIOD_S = 0.05
_SPEED_MPS = 0.2
_REST_S = 1.2  # a release takes up to 0.7 s, and the drive bus holds an input at zero until it was at rest


class SinkChanges:
    """The times at which the sink changed between zero and motion, in s of the monotonic clock."""

    def __init__(self, drive: subprocess.Popen[str]) -> None:
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._read, args=(drive,), daemon=True).start()

    def _read(self, drive: subprocess.Popen[str]) -> None:
        with suppress(ValueError):  # the pipe is closed with the process
            for line in drive.stdout or ():
                self._lines.put(line)

    def wait(self, moving: bool, timeout_s: float) -> float | None:
        """Wait for the next change to motion, or to zero, and return its time; None if there is none."""
        while True:
            try:
                state, time_s = json.loads(self._lines.get(timeout=timeout_s))
            except queue.Empty:
                return None
            if state == moving:
                return float(time_s)


def measure(server: ServerRig, presses: int) -> list[float]:
    """Drive through the console, and press and release the stop; return the times in ms from frame to zero."""
    processes = [_start(function, server) for function in (run_estop, run_drive)]
    sink = SinkChanges(processes[1])
    driver = server.connect_client()
    over, moving = threading.Event(), threading.Event()

    def drive() -> None:
        while not over.wait(_DRIVE_PERIOD_S):
            _publish(driver, graph.CMD_VEL_MANUAL, {"linear": {"x": _SPEED_MPS if moving.is_set() else 0.0}})

    driving = threading.Thread(target=drive)
    driving.start()
    try:
        times_ms = []
        for number in range(presses):
            _start_driving(moving, sink)
            time.sleep(0.2 + 0.01 * (number % 7))
            began_s = time.monotonic()
            _publish(driver, graph.HMI_ESTOP, {"data": True})
            ended_s = sink.wait(moving=False, timeout_s=_TIMEOUT_S)
            if ended_s is None:
                raise SystemExit(f"the sink did not change to zero within {_TIMEOUT_S:g} s")
            times_ms.append((ended_s - began_s) * 1e3)
            moving.clear()
            _publish(driver, graph.HMI_ESTOP, {"data": False})
        return times_ms
    finally:
        over.set()
        driving.join()
        for process in processes:
            terminate(process, _TIMEOUT_S)


def _start_driving(moving: threading.Event, sink: SinkChanges) -> None:
    """Rest, and then drive, until the sink follows. The first time, the e-stop and the drive bus have to start first."""
    for _ in range(10):
        moving.clear()
        time.sleep(_REST_S)
        moving.set()
        if sink.wait(moving=True, timeout_s=2.0) is not None:
            return
    raise SystemExit("the sink did not change to motion")


def _start(function: Callable[[], int], server: ServerRig) -> subprocess.Popen[str]:
    command, pipe, null = child_command(function), subprocess.PIPE, subprocess.DEVNULL
    return subprocess.Popen(command, env=server.environment, stdout=pipe, stderr=null, text=True)


def _publish(client: object, topic: graph.Topic, contents: dict[str, object]) -> None:
    message = {"op": "publish", "topic": topic.name, "type": topic.type, "msg": contents}
    client.send(json.dumps(message))  # type: ignore[attr-defined]


def _watch_sink() -> LupinNode:
    """Return a node that prints every change of the sink, and its time."""
    from lupin_runtime.ros import LupinNode

    node, last = LupinNode("sink"), [False]

    def receive(message: object) -> None:
        moving = message.linear.x != 0.0  # type: ignore[attr-defined]
        if moving != last[0]:
            last[0] = moving
            print(json.dumps([moving, time.monotonic()]), flush=True)

    node.subscription(graph.CMD_VEL_SINK_SIM, receive)
    return node


def run_estop() -> int:
    """Run the e-stop, without a button and without a console that it expects, since the console may be another one."""
    from lupin_runtime.ros import run
    from lupin_runtime.safety.expected_sources import WITNESS
    from lupin_runtime.safety.node import EstopBridge

    return run([lambda: EstopBridge({"expected_sources": WITNESS})])


def run_drive() -> int:
    """Run the drive bus, and print the changes of its sink."""
    from lupin_runtime.drive.node import TwistMux
    from lupin_runtime.ros import run
    from lupin_runtime.safety.node import EstopWitness

    return run([TwistMux, EstopWitness, _watch_sink])
