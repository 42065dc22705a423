"""The Foxglove server: messages per second of CPU time, compared with the console's rosbridge; five clients; idling.

    python -m bench.bench_foxglove [--seconds 10] [--json]

Each part starts a server and a load generator as separate processes on a private graph.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from bench.bench_console import ServerRig, idle, receive, server_rig, small_messages
from lupin_runtime import graph

LIMITS = {
    "messages_per_cpu_s": 15_000.0,
    "ratio_to_console": 1.0,
    "five_clients_percent": 15.0,
    "idle_percent": 2.0,
    "idle_mb": 130.0,
}
AT_LEAST = ("messages_per_cpu_s", "ratio_to_console")
_MODULE = "bench.bench_foxglove"
_SUBPROTOCOL = Subprotocol("foxglove.sdk.v1")
_ANSWER_TIMEOUT_S = 20.0


def serve() -> int:
    """Run the server, and print its port once it listens."""
    from lupin_runtime.foxglove.node import FoxgloveBridge
    from lupin_runtime.ros import run

    def announce(nodes: Any) -> None:
        print(nodes[0].port, flush=True)

    return run([lambda: FoxgloveBridge({"port": 0})], ready=announce)


def subscribed_client(server: ServerRig, topics: Sequence[str]) -> ClientConnection:
    """Connect a client, and subscribe it to each topic once it is advertised."""
    address = f"ws://127.0.0.1:{server.port}"
    client = server.exits.enter_context(connect(address, subprotocols=[_SUBPROTOCOL], max_size=None, max_queue=None))
    missing = set(topics)
    while missing:
        message = json.loads(client.recv(timeout=_ANSWER_TIMEOUT_S))
        channels = [each for each in message.get("channels", ()) if each["topic"] in missing]
        missing -= {channel["topic"] for channel in channels}
        subscriptions = [{"id": channel["id"], "channelId": channel["id"]} for channel in channels]
        client.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
    return client


def small_messages_to_foxglove(seconds: float) -> dict[str, float]:
    """Measure how many small messages the server forwards to one client per second of its CPU time."""
    with server_rig(module=_MODULE) as server:
        load = server.start_process("small", seconds)
        client = subscribed_client(server, ["/bench/small"])
        client.recv(timeout=_ANSWER_TIMEOUT_S)
        before_s = server.cpu_s()
        received = receive(client, 1.5)
        used_s = server.cpu_s() - before_s
        assert load.stdout is not None  # it is a pipe
        return {"messages_per_cpu_s": received / used_s, "received": received, "sent": int(load.stdout.readline())}


def five_clients(seconds: float) -> dict[str, float]:
    """Measure the server's CPU while five clients receive transforms, scan, map and odometry."""
    with server_rig(module=_MODULE) as server:
        server.start_process("robot", seconds + 6.0)
        for _ in range(5):
            client = subscribed_client(server, [row.name for row in (graph.TF, graph.SCAN, graph.ODOM, graph.MAP)])
            threading.Thread(target=receive, args=(client, seconds), daemon=True).start()
        time.sleep(4.0)  # until the load has started
        before_s = server.cpu_s()
        time.sleep(seconds)
        return {"five_clients_percent": 100.0 * (server.cpu_s() - before_s) / seconds}


def main() -> int:
    """Measure every part; with `--as`, run the measured server instead."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=10.0, help="measure each part for this long")
    parser.add_argument("--json", action="store_true", help="print one JSON line instead of a table")
    parser.add_argument("--as", dest="role", choices=("server",), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role == "server":
        return serve()
    figures = small_messages_to_foxglove(options.seconds)
    peer = small_messages(options.seconds)["messages_per_cpu_s"]
    figures.update(console_messages_per_cpu_s=peer, ratio_to_console=figures["messages_per_cpu_s"] / peer)
    for part in (five_clients(options.seconds), idle(options.seconds, module=_MODULE, role="server")):
        figures.update(part)
    met = {name: (figures[name] >= limit) == (name in AT_LEAST) for name, limit in LIMITS.items()}
    if options.json:
        print(json.dumps({"figures": figures, "limits": LIMITS, "met": met}))
    else:
        for name, value in figures.items():
            limit = f"  limit {LIMITS[name]:g}  {'ok' if met[name] else 'MISSED'}" if name in LIMITS else ""
            print(f"{name:28} {value:10.1f}{limit}")
    return 0 if all(met.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
