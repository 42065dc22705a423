"""A server of rosbridge or Foxglove in its own process, and processes with the load of a robot, on a private graph."""

from __future__ import annotations

import json
import shlex
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from bench.peers import rosbridge_suite
from bench.processes import child_command, kill, private_graph, terminate
from lupin_runtime import graph

ANSWER_TIMEOUT_S = 20.0
CALL_PAUSE_S = 0.02
END_TIMEOUT_S = 5.0
SMALL_HZ = 10_000.0
_START_TIMEOUT_S = 2 * rosbridge_suite.LISTEN_TIMEOUT_S
_LAST_WORDS = 2000  # characters of a server's errors
ROBOT_TOPICS = (graph.TF, graph.SCAN, graph.ODOM, graph.MAP)
CAMERA_TOPIC = graph.compressed(graph.BODY_IMAGE_ROBOT)


# -- the measured processes ---------------------------------------------------------------------------------------------
def serve_console(**parameters: Any) -> int:
    """Run the console, and print its port once it listens."""
    from lupin_runtime.console.node import Console
    from lupin_runtime.ros import run

    def announce(nodes: Any) -> None:
        print(nodes[0].rosbridge_port, flush=True)

    return run([lambda: Console({"port": 0, "rosbridge_port": 0, "unlisted": True, **parameters})], ready=announce)


def publish(kind: str, seconds: float) -> int:
    """Publish `small` messages at SMALL_HZ, or what a `robot` publishes, and answer calls; print how many were sent."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from std_srvs.srv import SetBool

    from bench.bench_record import make_message
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.interfaces import interface

    rclpy.init(args=[])
    node = LupinNode("load")
    node.create_service(SetBool, "/bench/call", lambda _, response: response)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()
    if kind == "small":
        row = graph.Topic("/bench/small", "std_msgs/msg/String", graph.REL100, SMALL_HZ)
        rows = {row: interface(row.type)(data="x" * 50)}
    else:
        rows = {row: make_message(interface(row.type), row.name) for row in (*ROBOT_TOPICS, CAMERA_TOPIC)}
    publishers = {row: node.publisher(row) for row in rows}
    counted = next(iter(rows))
    while kind == "small" and not publishers[counted].get_subscription_count():
        time.sleep(0.01)
    time.sleep(1.0)  # until all subscriptions are matched
    began, sent = time.monotonic(), dict.fromkeys(rows, 0)
    while (elapsed_s := time.monotonic() - began) < seconds:
        for row, message in rows.items():
            while sent[row] < elapsed_s * (row.rate_hz or 1.0):
                publishers[row].publish(message)
                sent[row] += 1
        time.sleep(0.002)
    print(sent[counted], flush=True)
    time.sleep(2.0)  # until the last messages have been sent
    return 0


def call(seconds: float) -> int:
    """Call the load generator's service without a bridge for some seconds; print the times in ms as JSON."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from std_srvs.srv import SetBool

    from lupin_runtime.ros import LupinNode

    rclpy.init(args=[])
    node = LupinNode("caller")
    client = node.create_client(SetBool, "/bench/call")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    client.wait_for_service(ANSWER_TIMEOUT_S)
    times_ms = []
    deadline_s = time.monotonic() + seconds
    while time.monotonic() < deadline_s:
        began_s = time.perf_counter()
        executor.spin_until_future_complete(client.call_async(SetBool.Request()), ANSWER_TIMEOUT_S)
        times_ms.append((time.perf_counter() - began_s) * 1e3)
        time.sleep(CALL_PAUSE_S)
    print(json.dumps(times_ms), flush=True)
    return 0


# -- the rig ------------------------------------------------------------------------------------------------------------
@dataclass
class ServerRig:
    """A running server and its private graph."""

    port: int
    process: psutil.Process
    environment: dict[str, str]
    exits: ExitStack

    def connect_client(self) -> ClientConnection:
        """Open a connection to the server."""
        return self.exits.enter_context(connect(f"ws://127.0.0.1:{self.port}", max_size=None, max_queue=None))

    def start_process(self, function: Callable[..., int], **arguments: Any) -> subprocess.Popen[str]:
        """Call a function, like `publish`, in a process on the server's graph."""
        process = subprocess.Popen(
            child_command(function, **arguments), env=self.environment, stdout=subprocess.PIPE, text=True
        )
        self.exits.callback(kill, process)  # if the server has failed, it waits for a subscription without end
        return process

    def memory_mb(self) -> float:
        """Return the server's unshared memory."""
        return float(self.process.memory_full_info().uss) / 1e6

    def cpu_s(self) -> float:
        """Return the CPU time that the server has used."""
        times = self.process.cpu_times()
        return float(times.user + times.system)


@contextmanager
def server_rig(command: Sequence[str] | None = None) -> Iterator[ServerRig]:
    """Start a server, by default the console, on a private graph. The command prints the port once the server listens.

    Raises SystemExit with the server's last words if it does not listen.
    """
    command = command or child_command(serve_console)
    with private_graph() as environment, tempfile.TemporaryFile("w+") as errors, ExitStack() as exits:
        server = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=errors, text=True)
        exits.callback(lambda: terminate(server, END_TIMEOUT_S))
        port = _read_port(server)
        if port is None:
            terminate(server, END_TIMEOUT_S)
            errors.seek(0)
            last = errors.read().strip()[-_LAST_WORDS:] or f"it said nothing for {_START_TIMEOUT_S:g} s"
            raise SystemExit(f"{shlex.join(command)} does not listen: {last}")
        yield ServerRig(port, psutil.Process(server.pid), environment, exits.enter_context(ExitStack()))


def _read_port(server: subprocess.Popen[str]) -> int | None:
    """Return the port that a server prints once it listens; None if it ends, or is silent for _START_TIMEOUT_S."""
    assert server.stdout is not None  # it is a pipe
    timer = threading.Timer(_START_TIMEOUT_S, server.kill)
    timer.start()
    try:
        line = server.stdout.readline().strip()
    finally:
        timer.cancel()
    return int(line) if line.isdigit() else None


def send(client: ClientConnection, op: str, **fields: Any) -> None:
    """Send one message of the protocol."""
    client.send(json.dumps({"op": op, **fields}))


def receive(client: ClientConnection, timeout_s: float) -> int:
    """Receive messages until none arrives for `timeout_s`, and return their number."""
    count = 0
    try:
        while True:
            client.recv(timeout=timeout_s)
            count += 1
    except (TimeoutError, ConnectionClosed):
        return count
