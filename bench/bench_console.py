"""The console: throughput, service calls during video, five clients, clients that never read, the e-stop, idling.

    python -m bench.bench_console [--seconds 10] [--presses 60] [--only REGEX] [--suite FOLDER] [--json]

Each part starts a server and a load generator as separate processes on a private graph. `--seconds 3600 --only five` measures
the growth of memory over an hour. With FOLDER, a checkout of rosbridge_suite, its server is measured too, with the same load.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from bench import stop_to_sink
from bench.peers import rosbridge_suite
from lupin_runtime import graph
from lupin_runtime.stack.dds import claim_domain, loopback_environment
from tests.support.raw_websocket import open_raw_websocket, text_frame

LIMITS = {
    "messages_per_cpu_s": 15_000.0,
    "call_median_ms": 3.0,
    "call_p99_ms": 10.0,
    "five_clients_percent": 15.0,
    "five_clients_growth_mb": 8.0,
    "silent_client_mb": 8.0,
    "silent_client_adds_p99_ms": 3.0,
    "sending_client_mb": 8.0,
    "sending_client_adds_p99_ms": 3.0,
    "stop_to_sink_p99_ms": 60.0,
    "idle_percent": 2.0,
    "idle_mb": 120.0,
    "ratio_to_suite": 5.0,
}
AT_LEAST = ("messages_per_cpu_s", "ratio_to_suite")
SMALL_HZ = 10_000.0
_ANSWER_TIMEOUT_S = 20.0
_START_TIMEOUT_S = 2 * rosbridge_suite.LISTEN_TIMEOUT_S
_END_TIMEOUT_S = 5.0
_LAST_WORDS = 2000  # characters of a server's errors
_CALL_PAUSE_S = 0.02


# -- the measured processes ---------------------------------------------------------------------------------------------
def serve(**parameters: Any) -> int:
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
        camera = graph.compressed(graph.BODY_IMAGE_ROBOT)
        chosen = (graph.TF, graph.SCAN, graph.ODOM, graph.MAP, camera)
        rows = {row: make_message(interface(row.type), row.name) for row in chosen}
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
    client.wait_for_service(_ANSWER_TIMEOUT_S)
    times_ms = []
    deadline_s = time.monotonic() + seconds
    while time.monotonic() < deadline_s:
        began_s = time.perf_counter()
        executor.spin_until_future_complete(client.call_async(SetBool.Request()), _ANSWER_TIMEOUT_S)
        times_ms.append((time.perf_counter() - began_s) * 1e3)
        time.sleep(_CALL_PAUSE_S)
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

    def start_process(self, kind: str, seconds: float) -> subprocess.Popen[str]:
        """Start a process that publishes or calls for some seconds; see `publish` and `call`."""
        command = [sys.executable, "-m", "bench.bench_console", "--as", kind, "--seconds", str(seconds)]
        process = subprocess.Popen(command, env=self.environment, stdout=subprocess.PIPE, text=True)
        self.exits.callback(_kill, process)  # if the server has failed, it waits for a subscription without end
        return process

    def memory_mb(self) -> float:
        """Return the server's unshared memory."""
        return float(self.process.memory_full_info().uss) / 1e6

    def cpu_s(self) -> float:
        """Return the CPU time that the server has used."""
        times = self.process.cpu_times()
        return float(times.user + times.system)


@contextmanager
def server_rig(suite: Path | None = None, module: str = "bench.bench_console", role: str = "server") -> Iterator[ServerRig]:
    """Start the server of a rosbridge_suite checkout, or else of a benchmark's module, on a private graph.

    Raises SystemExit with the server's last words if it does not listen.
    """
    claim = claim_domain()
    with ExitStack() as exits, tempfile.TemporaryDirectory() as directory:
        exits.callback(claim.release)
        environment = loopback_environment(claim.domain, Path(directory), {**os.environ, "XDG_STATE_HOME": directory})
        command = [sys.executable, "-m", "bench.peers.rosbridge_suite", str(suite)] if suite else None
        errors = exits.enter_context(Path(directory, "stderr").open("w+"))
        server = subprocess.Popen(
            command or [sys.executable, "-m", module, "--as", role],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        )
        exits.callback(_end, server)
        port = _read_port(server)
        if port is None:
            _end(server)
            errors.seek(0)
            last = errors.read().strip()[-_LAST_WORDS:] or f"it said nothing for {_START_TIMEOUT_S:g} s"
            raise SystemExit(f"{shlex.join(map(str, server.args))} does not listen: {last}")  # type: ignore[arg-type]
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


def _end(process: subprocess.Popen[str]) -> None:
    """End a process, whatever it does by SIGTERM, and wait until it has ended."""
    process.terminate()
    with suppress(subprocess.TimeoutExpired):
        process.wait(_END_TIMEOUT_S)
    _kill(process)


def _kill(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()
    if process.stdout is not None:
        process.stdout.close()


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


# -- the parts of the benchmark -----------------------------------------------------------------------------------------
def small_messages(seconds: float, suite: Path | None = None) -> dict[str, float]:
    """Measure how many small messages the server forwards to one client per second of its CPU time."""
    with server_rig(suite) as server:
        client = server.connect_client()
        send(client, "subscribe", topic="/bench/small", type="std_msgs/String", queue_length=1000)
        load = server.start_process("small", seconds)
        client.recv(timeout=_ANSWER_TIMEOUT_S)
        before_s = server.cpu_s()
        received = receive(client, 1.5)
        used_s = server.cpu_s() - before_s
        assert load.stdout is not None  # it is a pipe
        return {"messages_per_cpu_s": received / used_s, "received": received, "sent": int(load.stdout.readline())}


def calls_during_robot_load(seconds: float, suite: Path | None = None) -> dict[str, float]:
    """Measure service calls while another client receives camera, scan, map and transforms; then calls without a bridge."""
    with server_rig(suite) as server:
        watcher, caller = server.connect_client(), server.connect_client()
        for row in (graph.TF, graph.SCAN, graph.ODOM, graph.MAP, graph.compressed(graph.BODY_IMAGE_ROBOT)):
            send(watcher, "subscribe", topic=row.name, type=row.type, compression="cbor")
        server.start_process("robot", 2 * seconds + 8.0)
        threading.Thread(target=receive, args=(watcher, 2 * seconds + 5.0), daemon=True).start()
        figures = _call_figures("call", _call_repeatedly(caller, seconds))
        if suite is None:
            direct = server.start_process("caller", seconds)
            assert direct.stdout is not None  # it is a pipe
            figures |= _call_figures("direct_call", json.loads(direct.stdout.readline()))
        return figures


def _call_figures(name: str, times_ms: list[float]) -> dict[str, float]:
    return {f"{name}_median_ms": statistics.median(times_ms), f"{name}_p99_ms": statistics.quantiles(times_ms, n=100)[98]}


def five_clients(seconds: float) -> dict[str, float]:
    """Measure the server's CPU and memory growth while five clients receive transforms, scan, map and odometry."""
    with server_rig() as server:
        clients = [server.connect_client() for _ in range(5)]
        for client in clients:
            for row in (graph.TF, graph.SCAN, graph.ODOM, graph.MAP):
                send(client, "subscribe", topic=row.name, type=row.type, compression="cbor")
            threading.Thread(target=receive, args=(client, seconds), daemon=True).start()
        server.start_process("robot", seconds + 6.0)
        time.sleep(4.0)  # until the load has started
        before_s, before_mb = server.cpu_s(), server.memory_mb()
        time.sleep(seconds)
        return {
            "five_clients_percent": 100.0 * (server.cpu_s() - before_s) / seconds,
            "five_clients_growth_mb": server.memory_mb() - before_mb,
        }


def silent_client(seconds: float, *, sending: bool = False) -> dict[str, float]:
    """Measure the peak memory for a client that never reads, and another client's calls before and after it connects.

    With `sending`, it also asks for answers without end, and connects again whenever it is disconnected.
    """
    name = "sending_client" if sending else "silent_client"
    with server_rig() as server:
        caller = server.connect_client()
        server.start_process("robot", 2 * seconds + 8.0)
        alone_ms, before_mb = _call_repeatedly(caller, seconds), server.memory_mb()
        over = threading.Event()
        silent = threading.Thread(target=_never_read, args=(server.port, over, sending))
        silent.start()
        peak_mb, beside_ms = before_mb, []
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            beside_ms += _call_repeatedly(caller, 0.5)
            peak_mb = max(peak_mb, server.memory_mb())
        over.set()
        silent.join()
        alone_p99_ms, beside_p99_ms = (statistics.quantiles(times_ms, n=100)[98] for times_ms in (alone_ms, beside_ms))
        return {
            f"{name}_call_p99_alone_ms": alone_p99_ms,
            f"{name}_adds_p99_ms": beside_p99_ms - alone_p99_ms,
            f"{name}_mb": peak_mb - before_mb,
        }


def _never_read(port: int, over: threading.Event, sending: bool) -> None:
    rows = (graph.TF, graph.SCAN, graph.ODOM, graph.MAP, graph.compressed(graph.BODY_IMAGE_ROBOT))
    while not over.is_set():
        with open_raw_websocket(port, receive_buffer=65536) as client, suppress(OSError):
            client.settimeout(1.0)
            for row in rows:
                client.sendall(text_frame("subscribe", topic=row.name, type=row.type))
            while not over.wait(0.02):
                client.sendall(text_frame("call_service", service="/rosapi/interfaces") if sending else b"")


def _call_repeatedly(caller: ClientConnection, seconds: float) -> list[float]:
    """Call a service repeatedly for some seconds; return the times in ms."""
    times_ms: list[float] = []
    answered = False
    while not answered:  # until the load generator offers the service
        send(caller, "call_service", service="/bench/call", timeout=_ANSWER_TIMEOUT_S)
        answered = json.loads(caller.recv(timeout=_ANSWER_TIMEOUT_S))["result"]
    deadline_s = time.monotonic() + seconds
    while time.monotonic() < deadline_s:
        began_s = time.perf_counter()
        send(caller, "call_service", service="/bench/call")
        answer = json.loads(caller.recv(timeout=_ANSWER_TIMEOUT_S))
        times_ms.append((time.perf_counter() - began_s) * 1e3)
        if not answer["result"]:
            raise SystemExit(f"a call failed: {answer['values']}")
        time.sleep(_CALL_PAUSE_S)
    return times_ms


def stop(presses: int) -> dict[str, float]:
    """Measure the time from a client's stop frame to zero at the sink, while the client drives."""
    with server_rig() as server:
        times_ms = stop_to_sink.measure(server, presses)
        return {
            "stop_to_sink_median_ms": statistics.median(times_ms),
            "stop_to_sink_p99_ms": statistics.quantiles(times_ms, n=100)[98],
        }


def idle(seconds: float, module: str = "bench.bench_console", role: str = "server-tls") -> dict[str, float]:
    """Measure a server without clients; the console's with HTTPS on all addresses, as in the stack."""
    with server_rig(module=module, role=role) as server:
        time.sleep(3.0)  # until the server has started completely
        before_s = server.cpu_s()
        time.sleep(seconds)
        used = 100.0 * (server.cpu_s() - before_s) / seconds
        return {"idle_percent": used, "idle_mb": server.process.memory_full_info().pss / 1e6}


def main() -> int:
    """Measure every part; with `--as`, run one of the measured processes instead."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=10.0, help="measure each part for this long")
    parser.add_argument("--presses", type=int, default=60, help="press the stop this many times")
    parser.add_argument("--only", default="", help="measure only the parts whose name matches this regular expression")
    parser.add_argument("--suite", type=Path, help="also measure the server of this checkout of rosbridge_suite")
    parser.add_argument("--json", action="store_true", help="print one JSON line instead of a table")
    roles = ("server", "server-tls", "small", "robot", "caller")
    parser.add_argument("--as", dest="role", choices=roles, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role == "server":
        return serve()
    if options.role == "server-tls":
        return serve(tls=True, host="")
    if options.role == "caller":
        return call(options.seconds)
    if options.role:
        return publish(options.role, options.seconds)
    if options.suite and (problem := rosbridge_suite.missing(options.suite)):
        parser.error(problem)
    parts: dict[str, Callable[[], dict[str, float]]] = {
        "small messages": lambda: small_messages(options.seconds),
        "calls": lambda: calls_during_robot_load(options.seconds),
        "five clients": lambda: five_clients(options.seconds),
        "silent client": lambda: silent_client(options.seconds),
        "sending client": lambda: silent_client(options.seconds, sending=True),
        "stop": lambda: stop(options.presses),
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
    if options.suite and "call_median_ms" in figures:
        suite_calls = calls_during_robot_load(options.seconds, options.suite)
        figures |= {f"suite_{name}": value for name, value in suite_calls.items()}
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
