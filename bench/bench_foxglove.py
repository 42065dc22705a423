"""The Foxglove server: messages per CPU-second beside the console's rosbridge, five clients, and an idle server.

    python -m bench.bench_foxglove [--seconds 10] [--json]

Each part runs a server and a load in processes and on a graph of their own.
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

from bench.bench_console import Rig, receive, rig, small_messages
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
_ANSWER_S = 20.0


def serve() -> int:
    """Run the server; prints its port."""
    from lupin_runtime.foxglove.node import FoxgloveBridge
    from lupin_runtime.ros import run

    def announce(nodes: Any) -> None:
        print(nodes[0].port, flush=True)

    return run([lambda: FoxgloveBridge({"port": 0})], ready=announce)


def subscribed_client(server: Rig, topics: Sequence[str]) -> ClientConnection:
    """A client that is subscribed to topics, as soon as they are advertised."""
    address = f"ws://127.0.0.1:{server.port}"
    client = server.exits.enter_context(connect(address, subprotocols=[_SUBPROTOCOL], max_size=None, max_queue=None))
    due = set(topics)
    while due:
        message = json.loads(client.recv(timeout=_ANSWER_S))
        channels = [each for each in message.get("channels", ()) if each["topic"] in due]
        due -= {channel["topic"] for channel in channels}
        wanted = [{"id": channel["id"], "channelId": channel["id"]} for channel in channels]
        client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    return client


def small_messages_to_foxglove(seconds: float) -> dict[str, float]:
    """Small messages to one client: how many the server passes on per second of its processor time."""
    with rig(module=_MODULE) as server:
        load = server.load("small", seconds)
        client = subscribed_client(server, ["/bench/small"])
        client.recv(timeout=_ANSWER_S)
        before_s = server.cpu_s()
        received = receive(client, 1.5)
        used_s = server.cpu_s() - before_s
        assert load.stdout is not None  # it is a pipe
        return {"messages_per_cpu_s": received / used_s, "received": received, "sent": int(load.stdout.readline())}


def five_clients(seconds: float) -> dict[str, float]:
    """Transforms, scan, map and odometry to five clients: the server's share of a core."""
    with rig(module=_MODULE) as server:
        server.load("robot", seconds + 6.0)
        for _ in range(5):
            client = subscribed_client(server, [row.name for row in (graph.TF, graph.SCAN, graph.ODOM, graph.MAP)])
            threading.Thread(target=receive, args=(client, seconds), daemon=True).start()
        time.sleep(4.0)
        before_s = server.cpu_s()
        time.sleep(seconds)
        return {"five_clients_percent": 100.0 * (server.cpu_s() - before_s) / seconds}


def idle(seconds: float) -> dict[str, float]:
    """A server without clients."""
    with rig(module=_MODULE) as server:
        time.sleep(3.0)
        before_s = server.cpu_s()
        time.sleep(seconds)
        used = 100.0 * (server.cpu_s() - before_s) / seconds
        return {"idle_percent": used, "idle_mb": server.process.memory_full_info().pss / 1e6}


def main() -> int:
    """Measure every part, or be the measured server with `--as`."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--as", dest="role", choices=("server",), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role == "server":
        return serve()
    figures = small_messages_to_foxglove(options.seconds)
    peer = small_messages(options.seconds)["messages_per_cpu_s"]
    figures.update(console_messages_per_cpu_s=peer, ratio_to_console=figures["messages_per_cpu_s"] / peer)
    for part in (five_clients(options.seconds), idle(options.seconds)):
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
