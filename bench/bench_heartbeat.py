"""CPU time of the heartbeats of a whole run, in percent of a core: the supervisor's thread, and all processes together.

The thread monitors as many processes as a simulated run with a mission and a console has. A process's share is the extra CPU
time that it takes under a supervisor, because it then sends heartbeats, for which it wakes the executors of idle nodes. Most
nodes have a timer, so their executors are never idle. That share is a small difference between two measurements, so a measured
process does everything SPEED_UP times as often as in life.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from functools import partial
from unittest import mock

from bench.processes import child_command, private_graph
from bench.runner import Figures, Seconds, benchmark
from lupin_runtime.heartbeat import MAX_BYTES, PROCESS_PERIOD_S, Beat, encode
from lupin_runtime.stack.liveness import Liveness
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.table import rows

WARM_UP_S = 2.0
REPETITIONS = 3
SPEED_UP = 10
TIMER_PERIOD_S = 0.2 / SPEED_UP
IDLE_NODES = 4  # of a whole run: those that only serve requests


def measure_thread(commands_motion: list[bool], duration_s: float) -> float:
    """Return the CPU time of the supervisor's thread, in percent of a core.

    Each item of `commands_motion` stands for one process, and tells whether it commands motion.
    """
    liveness = Liveness()
    children = []
    for index, commands in enumerate(commands_motion):
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        theirs.setblocking(False)
        liveness.monitor(f"process {index}", os.getpid(), ours, commands)
        children.append((theirs, commands))
    liveness.start()
    thread_clock = time.pthread_getcpuclockid(liveness._thread.ident or 0)
    began_s, used_s = time.monotonic(), time.clock_gettime(thread_clock)
    while (elapsed_s := time.monotonic() - began_s) < duration_s:
        for child, commands in children:
            child.send(encode(Beat(time.monotonic_ns(), "node")))
            if commands:
                _discard_packets(child)  # the supervisor writes only to these; an unread socket would become full
        time.sleep(PROCESS_PERIOD_S)
    used_s = time.clock_gettime(thread_clock) - used_s
    liveness.close()
    return 100.0 * used_s / elapsed_s


def _discard_packets(child: socket.socket) -> None:
    with contextlib.suppress(BlockingIOError):  # everything is read
        while child.recv(MAX_BYTES):
            pass


def run_child(nodes: int, are_idle: bool, duration_s: float) -> int:
    """Run nodes for a while, SPEED_UP times as fast as in life, and print their CPU time in percent of a core.

    They send heartbeats if the standard input is a socket, whose other end stands for the supervisor.
    """
    from lupin_runtime.ros import LupinNode, node_runner, run
    from lupin_runtime.ros.supervision import Supervision

    def measure() -> None:
        time.sleep(WARM_UP_S)
        began_s, used_s = time.monotonic(), time.process_time()
        time.sleep(duration_s)
        print(100.0 * (time.process_time() - used_s) / (time.monotonic() - began_s), flush=True)
        os.kill(os.getpid(), signal.SIGTERM)

    def make_node(index: int) -> LupinNode:
        node = LupinNode(f"node_{index}")
        if not are_idle:
            node.create_timer(TIMER_PERIOD_S, lambda: None)
        return node

    supervision = Supervision()
    supervision.start()
    thread = threading.Thread(target=measure, daemon=True)
    factories = [partial(make_node, index) for index in range(nodes)]
    has_supervisor = supervision._socket is not None
    idle_s = node_runner.IDLE_S / SPEED_UP
    with mock.patch.multiple(node_runner, PROCESS_PERIOD_S=PROCESS_PERIOD_S / SPEED_UP, IDLE_S=idle_s):
        return run(factories, ready=lambda _: thread.start(), supervision=supervision if has_supervisor else None)


def measure_process(nodes: int, are_idle: bool, duration_s: float, environment: dict[str, str]) -> float:
    """Return how much more CPU time a process takes in life with a supervisor than without, in percent of a core."""
    used: dict[bool, list[float]] = {False: [], True: []}
    for is_supervised in [False, True] * REPETITIONS:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = child_command(run_child, nodes=nodes, are_idle=are_idle, duration_s=duration_s)
        reader = threading.Thread(target=_read_until_closed, args=(ours,))
        reader.start()
        with theirs:
            done = subprocess.run(
                command,
                stdin=theirs.fileno() if is_supervised else subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                env=environment,
                text=True,
                timeout=60.0 + duration_s,
                check=True,
            )
        reader.join()
        ours.close()
        used[is_supervised].append(float(done.stdout))
    return max(0.0, min(used[True]) - min(used[False])) / SPEED_UP


def _read_until_closed(ours: socket.socket) -> None:
    while ours.recv(MAX_BYTES):
        pass


@benchmark(at_most={"run_percent": 1.0})
def main(seconds: Seconds = 10.0) -> Figures:
    """Measure the CPU time of each part, and add them up for a whole run."""
    processes = [row for row in rows(Options(mission=True, console=True)) if row.sends_heartbeats and not row.external]
    nodes = round(sum(len(row.nodes) or 1 for row in processes) / len(processes))
    thread_percent = measure_thread([row.commands_motion for row in processes], seconds)
    with private_graph() as environment:
        process_percent = measure_process(nodes, False, seconds, environment)
        with_idle_nodes_percent = measure_process(nodes, True, seconds, environment)
    idle_node_percent = max(0.0, with_idle_nodes_percent - process_percent) / nodes
    return {
        "processes": len(processes),
        "nodes_of_a_process": nodes,
        "idle_nodes": IDLE_NODES,
        "thread_percent": thread_percent,
        "process_percent": process_percent,
        "idle_node_percent": idle_node_percent,
        "run_percent": thread_percent + process_percent * len(processes) + idle_node_percent * IDLE_NODES,
    }


if __name__ == "__main__":
    sys.exit(main())
