"""The console's server: throughput, service calls beside a camera, five clients, a silent one, the e-stop, and an idle server.

    python -m bench.bench_console [--seconds 10] [--only REGEX] [--suite FOLDER] [--json]

Each part runs a server and a load in processes and on a graph of their own. With `--seconds 3600 --only five`, the growth of
memory is that of an hour. With FOLDER, a checkout of rosbridge_suite, its server is measured too, with the same load.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from lupin_runtime import graph
from lupin_runtime.stack.dds import claim_domain, loopback_environment

LIMITS = {
    "messages_per_cpu_s": 15_000.0,
    "call_median_ms": 3.0,
    "call_p99_ms": 10.0,
    "five_clients_percent": 15.0,
    "five_clients_growth_mb": 8.0,
    "silent_client_mb": 8.0,
    "stop_p99_ms": 60.0,
    "idle_percent": 2.0,
    "idle_mb": 120.0,
}
AT_LEAST = ("messages_per_cpu_s",)
SMALL_HZ = 10_000.0
_ANSWER_S = 20.0


# -- processes of their own ---------------------------------------------------------------------------------------------
def serve() -> int:
    """Run the console's server; prints its port."""
    from lupin_runtime.console.node import Console
    from lupin_runtime.ros import run

    def announce(nodes: Any) -> None:
        print(nodes[0].rosbridge_port, flush=True)

    return run([lambda: Console({"port": 0, "rosbridge_port": 0, "unlisted": True})], ready=announce)


def publish(kind: str, seconds: float) -> int:
    """Publish small messages as fast as SMALL_HZ, or what a robot publishes, and answer calls; prints the number sent."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from std_srvs.srv import SetBool

    from bench.bench_record import make_message
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.node import interface

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
        camera = graph.compressed(graph.BODY_IMAGE_ROBOT)
        chosen = (graph.TF, graph.SCAN, graph.ODOM, graph.MAP, camera)
        rows = {row: make_message(interface(row.type), row.name) for row in chosen}
    publishers = {row: node.publisher(row) for row in rows}
    counted = next(iter(rows))
    while kind == "small" and not publishers[counted].get_subscription_count():
        time.sleep(0.01)
    time.sleep(1.0)
    began, sent = time.monotonic(), dict.fromkeys(rows, 0)
    while (elapsed_s := time.monotonic() - began) < seconds:
        for row, message in rows.items():
            while sent[row] < elapsed_s * (row.rate_hz or 1.0):
                publishers[row].publish(message)
                sent[row] += 1
        time.sleep(0.002)
    print(sent[counted], flush=True)
    time.sleep(2.0)
    return 0


# -- the rig ------------------------------------------------------------------------------------------------------------
@dataclass
class Rig:
    """A server and its graph."""

    port: int
    process: psutil.Process
    environment: dict[str, str]
    exits: ExitStack

    def client(self) -> ClientConnection:
        """A connection to the server."""
        return self.exits.enter_context(connect(f"ws://127.0.0.1:{self.port}", max_size=None, max_queue=None))

    def load(self, kind: str, seconds: float) -> subprocess.Popen[str]:
        """Start a load."""
        command = [sys.executable, "-m", "bench.bench_console", "--as", kind, "--seconds", str(seconds)]
        process = subprocess.Popen(command, env=self.environment, stdout=subprocess.PIPE, text=True)
        self.exits.callback(process.wait, 60)
        return process

    def memory_mb(self) -> float:
        """The memory that is the server's own."""
        return float(self.process.memory_full_info().uss) / 1e6

    def cpu_s(self) -> float:
        """The processor time that the server has used."""
        times = self.process.cpu_times()
        return float(times.user + times.system)


@contextmanager
def rig(suite: Path | None = None, module: str = "bench.bench_console") -> Iterator[Rig]:
    """Start a server on a graph of its own: that of a checkout of rosbridge_suite, or of a benchmark's module."""
    claim = claim_domain()
    with ExitStack() as exits, tempfile.TemporaryDirectory() as directory:
        exits.callback(claim.release)
        environment = loopback_environment(claim.domain, Path(directory), {**os.environ, "XDG_STATE_HOME": directory})
        command = [sys.executable, "-m", "bench.peers.rosbridge_suite", str(suite)] if suite else None
        server = subprocess.Popen(
            command or [sys.executable, "-m", module, "--as", "server"],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        exits.callback(server.wait, 20)
        exits.callback(server.terminate)
        assert server.stdout is not None  # it is a pipe
        yield Rig(int(server.stdout.readline()), psutil.Process(server.pid), environment, exits.enter_context(ExitStack()))


def send(client: ClientConnection, op: str, **fields: Any) -> None:
    """Send one message of the protocol."""
    client.send(json.dumps({"op": op, **fields}))


def receive(client: ClientConnection, timeout_s: float) -> int:
    """Count the messages until none comes for a while."""
    count = 0
    try:
        while True:
            client.recv(timeout=timeout_s)
            count += 1
    except (TimeoutError, ConnectionClosed):
        return count


# -- the parts ----------------------------------------------------------------------------------------------------------
def small_messages(seconds: float, suite: Path | None = None) -> dict[str, float]:
    """Small messages to one client: how many the server passes on per second of its processor time."""
    with rig(suite) as server:
        client = server.client()
        send(client, "subscribe", topic="/bench/small", type="std_msgs/String", queue_length=1000)
        load = server.load("small", seconds)
        client.recv(timeout=_ANSWER_S)
        before_s = server.cpu_s()
        received = receive(client, 1.5)
        used_s = server.cpu_s() - before_s
        assert load.stdout is not None  # it is a pipe
        return {"messages_per_cpu_s": received / used_s, "received": received, "sent": int(load.stdout.readline())}


def calls_beside_a_robot(seconds: float) -> dict[str, float]:
    """Service calls while another client gets camera, scan, map and transforms."""
    with rig() as server:
        watcher, caller = server.client(), server.client()
        for row in (graph.TF, graph.SCAN, graph.ODOM, graph.MAP, graph.compressed(graph.BODY_IMAGE_ROBOT)):
            send(watcher, "subscribe", topic=row.name, type=row.type, compression="cbor")
        server.load("robot", seconds + 3.0)
        threading.Thread(target=receive, args=(watcher, seconds), daemon=True).start()
        times_ms = _call_for(caller, seconds)
        return {"call_median_ms": statistics.median(times_ms), "call_p99_ms": statistics.quantiles(times_ms, n=100)[98]}


def five_clients(seconds: float) -> dict[str, float]:
    """Transforms, scan, map and odometry to five clients: the server's share of a core."""
    with rig() as server:
        clients = [server.client() for _ in range(5)]
        for client in clients:
            for row in (graph.TF, graph.SCAN, graph.ODOM, graph.MAP):
                send(client, "subscribe", topic=row.name, type=row.type, compression="cbor")
            threading.Thread(target=receive, args=(client, seconds), daemon=True).start()
        server.load("robot", seconds + 6.0)
        time.sleep(4.0)
        before_s, before_mb = server.cpu_s(), server.memory_mb()
        time.sleep(seconds)
        return {
            "five_clients_percent": 100.0 * (server.cpu_s() - before_s) / seconds,
            "five_clients_growth_mb": server.memory_mb() - before_mb,
        }


def silent_client(seconds: float) -> dict[str, float]:
    """A client that subscribes and never reads: what it costs at most, and another's calls before it comes and beside it."""
    with rig() as server:
        caller = server.client()
        server.load("robot", 2 * seconds + 8.0)
        alone_ms, before_mb = _call_for(caller, seconds), server.memory_mb()
        silent = server.exits.enter_context(connect(f"ws://127.0.0.1:{server.port}", max_size=None, max_queue=1))
        for row in (graph.TF, graph.SCAN, graph.ODOM, graph.MAP, graph.compressed(graph.BODY_IMAGE_ROBOT)):
            send(silent, "subscribe", topic=row.name, type=row.type)
        peak_mb, beside_ms = before_mb, []
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            beside_ms += _call_for(caller, 0.5)
            peak_mb = max(peak_mb, server.memory_mb())
        return {
            "call_p99_alone_ms": statistics.quantiles(alone_ms, n=100)[98],
            "call_p99_beside_silent_ms": statistics.quantiles(beside_ms, n=100)[98],
            "silent_client_mb": peak_mb - before_mb,
        }


def _call_for(caller: ClientConnection, seconds: float) -> list[float]:
    """Call a service again and again; returns the times in ms."""
    times_ms: list[float] = []
    answered = False
    while not answered:  # until the load has come up
        send(caller, "call_service", service="/bench/call", timeout=_ANSWER_S)
        answered = json.loads(caller.recv(timeout=_ANSWER_S))["result"]
    deadline_s = time.monotonic() + seconds
    while time.monotonic() < deadline_s:
        began_s = time.perf_counter()
        send(caller, "call_service", service="/bench/call")
        answer = json.loads(caller.recv(timeout=_ANSWER_S))
        times_ms.append((time.perf_counter() - began_s) * 1e3)
        if not answer["result"]:
            raise SystemExit(f"a call failed: {answer['values']}")
        time.sleep(0.02)
    return times_ms


def stop_to_topic(presses: int) -> dict[str, float]:
    """A client's stop, from the frame that is sent to the message on the console's stop topic."""
    with rig() as server:
        watcher, presser = server.client(), server.client()
        name = graph.HMI_ESTOP.name
        send(watcher, "subscribe", topic=graph.CONSOLE_STOP.name, type=graph.CONSOLE_STOP.type)
        times_ms = []
        time.sleep(2.0)
        for number in range(presses):
            began_s = time.perf_counter()
            send(presser, "publish", topic=name, msg={"data": True})
            while not _is_engaged(watcher):
                pass
            times_ms.append((time.perf_counter() - began_s) * 1e3)
            send(presser, "publish", topic=name, msg={"data": False})
            while _is_engaged(watcher):
                pass
            time.sleep(0.05 + 0.001 * (number % 7))
        return {"stop_p99_ms": statistics.quantiles(times_ms, n=100)[98]}


def _is_engaged(watcher: Any) -> bool:
    return bool(json.loads(json.loads(watcher.recv(timeout=_ANSWER_S))["msg"]["data"])["engaged"])


def idle(seconds: float) -> dict[str, float]:
    """A server without clients."""
    with rig() as server:
        time.sleep(3.0)
        before_s = server.cpu_s()
        time.sleep(seconds)
        used = 100.0 * (server.cpu_s() - before_s) / seconds
        return {"idle_percent": used, "idle_mb": server.process.memory_full_info().pss / 1e6}


def main() -> int:
    """Measure every part, or be one of the measured processes with `--as`."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--only", default="", help="regular expression for the names of the parts")
    parser.add_argument("--suite", type=Path, help="checkout of rosbridge_suite, to be measured too")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--as", dest="role", choices=("server", "small", "robot"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role == "server":
        return serve()
    if options.role:
        return publish(options.role, options.seconds)
    parts: dict[str, Callable[[], dict[str, float]]] = {
        "small messages": lambda: small_messages(options.seconds),
        "calls": lambda: calls_beside_a_robot(options.seconds),
        "five clients": lambda: five_clients(options.seconds),
        "silent client": lambda: silent_client(options.seconds),
        "stop": lambda: stop_to_topic(60),
        "idle": lambda: idle(options.seconds),
    }
    figures: dict[str, float] = {}
    for name, part in parts.items():
        if re.search(options.only, name):
            figures.update(part())
    if options.suite and "messages_per_cpu_s" in figures:
        peer = small_messages(options.seconds, options.suite)["messages_per_cpu_s"]
        figures["suite_messages_per_cpu_s"] = peer
        figures["ratio_to_suite"] = figures["messages_per_cpu_s"] / peer
    met = {name: (figures[name] >= limit) == (name in AT_LEAST) for name, limit in LIMITS.items() if name in figures}
    if options.json:
        print(json.dumps({"figures": figures, "limits": LIMITS, "met": met}))
    else:
        for name, value in figures.items():
            limit = f"  limit {LIMITS[name]:g}  {'ok' if met[name] else 'MISSED'}" if name in met else ""
            print(f"{name:28} {value:10.1f}{limit}")
    return 0 if all(met.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
