"""The Foxglove server: messages per second of CPU time, compared with the console's rosbridge; five clients; idling.

Each part starts a server and a load generator as separate processes on a private graph.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from bench.bench_console import idle, small_messages
from bench.processes import child_command
from bench.runner import Figures, Seconds, benchmark
from bench.server_rig import ANSWER_TIMEOUT_S, ROBOT_TOPICS, ServerRig, publish, receive, server_rig

_SUBPROTOCOL = Subprotocol("foxglove.sdk.v1")


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
        message = json.loads(client.recv(timeout=ANSWER_TIMEOUT_S))
        channels = [each for each in message.get("channels", ()) if each["topic"] in missing]
        missing -= {channel["topic"] for channel in channels}
        subscriptions = [{"id": channel["id"], "channelId": channel["id"]} for channel in channels]
        client.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
    return client


def small_messages_to_foxglove(seconds: float) -> dict[str, float]:
    """Measure how many small messages the server forwards to one client per second of its CPU time."""
    with server_rig(child_command(serve)) as server:
        load = server.start_process(publish, kind="small", seconds=seconds)
        client = subscribed_client(server, ["/bench/small"])
        client.recv(timeout=ANSWER_TIMEOUT_S)
        before_s = server.cpu_s()
        received = receive(client, 1.5)
        used_s = server.cpu_s() - before_s
        assert load.stdout is not None  # it is a pipe
        return {"messages_per_cpu_s": received / used_s, "received": received, "sent": int(load.stdout.readline())}


def five_clients(seconds: float) -> dict[str, float]:
    """Measure the server's CPU while five clients receive transforms, scan, map and odometry."""
    with server_rig(child_command(serve)) as server:
        server.start_process(publish, kind="robot", seconds=seconds + 6.0)
        for _ in range(5):
            client = subscribed_client(server, [row.name for row in ROBOT_TOPICS])
            threading.Thread(target=receive, args=(client, seconds), daemon=True).start()
        time.sleep(4.0)  # until the load has started
        before_s = server.cpu_s()
        time.sleep(seconds)
        return {"five_clients_percent": 100.0 * (server.cpu_s() - before_s) / seconds}


@benchmark(
    at_least={"messages_per_cpu_s": 15_000.0, "ratio_to_console": 1.0},
    at_most={"five_clients_percent": 15.0, "idle_percent": 2.0, "idle_mb": 130.0},
)
def main(seconds: Seconds = 10.0) -> Figures:
    """Measure every part, and small messages through the console."""
    figures = small_messages_to_foxglove(seconds)
    peer = small_messages(seconds)["messages_per_cpu_s"]
    figures |= {"console_messages_per_cpu_s": peer, "ratio_to_console": figures["messages_per_cpu_s"] / peer}
    return figures | five_clients(seconds) | idle(seconds, child_command(serve))


if __name__ == "__main__":
    sys.exit(main())
