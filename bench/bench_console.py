"""The console: throughput, service calls during video, five clients, clients that never read, the e-stop, idling.

Each part starts a server and a load generator as separate processes on a private graph. `--seconds 3600 --only five` measures
the growth of memory over an hour. With --suite, a checkout of rosbridge_suite, its server is measured too, with the same load.
"""

from __future__ import annotations

import json
import re
import statistics
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated

from websockets.sync.client import ClientConnection

from bench import stop_to_sink
from bench.peers import rosbridge_suite
from bench.processes import child_command
from bench.runner import Figures, Only, Seconds, Suite, benchmark
from bench.server_rig import (
    ANSWER_TIMEOUT_S,
    CALL_PAUSE_S,
    CAMERA_TOPIC,
    ROBOT_TOPICS,
    call,
    publish,
    receive,
    send,
    serve_console,
    server_rig,
)
from tests.support.raw_websocket import open_raw_websocket, text_frame


def _command(suite: Path | None) -> list[str]:
    return rosbridge_suite.server_command(suite) if suite else child_command(serve_console)


def small_messages(seconds: float, suite: Path | None = None) -> dict[str, float]:
    """Measure how many small messages the server forwards to one client per second of its CPU time."""
    with server_rig(_command(suite)) as server:
        client = server.connect_client()
        send(client, "subscribe", topic="/bench/small", type="std_msgs/String", queue_length=1000)
        load = server.start_process(publish, kind="small", seconds=seconds)
        client.recv(timeout=ANSWER_TIMEOUT_S)
        before_s = server.cpu_s()
        received = receive(client, 1.5)
        used_s = server.cpu_s() - before_s
        assert load.stdout is not None  # it is a pipe
        return {"messages_per_cpu_s": received / used_s, "received": received, "sent": int(load.stdout.readline())}


def calls_during_robot_load(seconds: float, suite: Path | None = None) -> dict[str, float]:
    """Measure service calls while another client receives camera, scan, map and transforms; then calls without a bridge."""
    with server_rig(_command(suite)) as server:
        watcher, caller = server.connect_client(), server.connect_client()
        for row in (*ROBOT_TOPICS, CAMERA_TOPIC):
            send(watcher, "subscribe", topic=row.name, type=row.type, compression="cbor")
        server.start_process(publish, kind="robot", seconds=2 * seconds + 8.0)
        threading.Thread(target=receive, args=(watcher, 2 * seconds + 5.0), daemon=True).start()
        figures = _call_figures("call", _call_repeatedly(caller, seconds))
        if suite is None:
            direct = server.start_process(call, seconds=seconds)
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
            for row in ROBOT_TOPICS:
                send(client, "subscribe", topic=row.name, type=row.type, compression="cbor")
            threading.Thread(target=receive, args=(client, seconds), daemon=True).start()
        server.start_process(publish, kind="robot", seconds=seconds + 6.0)
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
        server.start_process(publish, kind="robot", seconds=2 * seconds + 8.0)
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
    rows = (*ROBOT_TOPICS, CAMERA_TOPIC)
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
        send(caller, "call_service", service="/bench/call", timeout=ANSWER_TIMEOUT_S)
        answered = json.loads(caller.recv(timeout=ANSWER_TIMEOUT_S))["result"]
    deadline_s = time.monotonic() + seconds
    while time.monotonic() < deadline_s:
        began_s = time.perf_counter()
        send(caller, "call_service", service="/bench/call")
        answer = json.loads(caller.recv(timeout=ANSWER_TIMEOUT_S))
        times_ms.append((time.perf_counter() - began_s) * 1e3)
        if not answer["result"]:
            raise SystemExit(f"a call failed: {answer['values']}")
        time.sleep(CALL_PAUSE_S)
    return times_ms


def stop(presses: int) -> dict[str, float]:
    """Measure the time from a client's stop frame to zero at the sink, while the client drives."""
    with server_rig() as server:
        times_ms = stop_to_sink.measure(server, presses)
        return {
            "stop_to_sink_median_ms": statistics.median(times_ms),
            "stop_to_sink_p99_ms": statistics.quantiles(times_ms, n=100)[98],
        }


def idle(seconds: float, command: Sequence[str]) -> dict[str, float]:
    """Measure a server without clients."""
    with server_rig(command) as server:
        time.sleep(3.0)  # until the server has started completely
        before_s = server.cpu_s()
        time.sleep(seconds)
        used = 100.0 * (server.cpu_s() - before_s) / seconds
        return {"idle_percent": used, "idle_mb": server.process.memory_full_info().pss / 1e6}


@benchmark(
    at_least={"messages_per_cpu_s": 15_000.0, "ratio_to_suite": 5.0},
    at_most={
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
    },
)
def main(
    seconds: Seconds = 10.0,
    presses: Annotated[int, "press the stop this many times"] = 60,
    only: Only = "",
    suite: Suite = None,
) -> Figures:
    """Measure every part."""
    if suite and (problem := rosbridge_suite.missing(suite)):
        raise SystemExit(problem)
    parts: dict[str, Callable[[], dict[str, float]]] = {
        "small messages": lambda: small_messages(seconds),
        "calls": lambda: calls_during_robot_load(seconds),
        "five clients": lambda: five_clients(seconds),
        "silent client": lambda: silent_client(seconds),
        "sending client": lambda: silent_client(seconds, sending=True),
        "stop": lambda: stop(presses),
        # With HTTPS on all addresses, as in the stack.
        "idle": lambda: idle(seconds, child_command(serve_console, tls=True, host="")),
    }
    figures: dict[str, float] = {}
    for name, part in parts.items():
        if re.search(only, name):
            figures.update(part())
    if suite and "messages_per_cpu_s" in figures:
        peer = small_messages(seconds, suite)["messages_per_cpu_s"]
        figures["suite_messages_per_cpu_s"] = peer
        figures["ratio_to_suite"] = figures["messages_per_cpu_s"] / peer
    if suite and "call_median_ms" in figures:
        figures |= {f"suite_{name}": value for name, value in calls_during_robot_load(seconds, suite).items()}
    return figures


if __name__ == "__main__":
    sys.exit(main())
