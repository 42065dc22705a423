"""Clients that send anything: nothing crashes, nothing piles up, and others are served."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
import pytest

from tests.support.rosbridge_client import RosbridgeClient

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

FRAMES = 10_000
OPERATIONS = [
    *(
        "advertise",
        "unadvertise",
        "publish",
        "subscribe",
        "unsubscribe",
        "call_service",
        "advertise_service",
        "service_response",
    ),
    *("unadvertise_service", "send_action_goal", "cancel_action_goal", "advertise_action", "unadvertise_action", "set_level"),
    *("action_feedback", "action_result", "fragment", "png", "status", "auth"),
]
NAMES = [
    *("/a", "b", "/rosapi/topics", "/rosapi/get_param", "/cmd_vel_manual", "/lupin/hmi/estop", "/ü", "", "//", "/a" * 500),
    *("~x", "{y}", "/a b", "a/", "/rosapi/topics_and_raw_types", "/rosapi/node_details"),
]
TYPES = [
    *("std_msgs/String", "std_msgs/msg/Bool", "geometry_msgs/Twist", "std_srvs/SetBool", "os/path", "a/../b", "x"),
    *("std_msgs/srv/String", "nav2_msgs/NavigateToPose", "rclpy/ActionClient", "sensor_msgs/LaserScan"),
]
KEYS = [
    *("topic", "service", "action", "type", "action_type", "id", "msg", "args", "values", "result", "status", "compression"),
    *("throttle_rate", "queue_length", "fragment_size", "latch", "queue_size", "data", "num", "total", "level", "timeout"),
    "feedback",
]


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path) -> Iterator[Console]:
    """A server that allows any name, so that more of it is reached."""
    from lupin_runtime.console.node import Console

    files = {"folder": str(tmp_path), "sessions_file": str(tmp_path / "sessions.json")}
    node = graph_host.add(Console({"port": 0, "rosbridge_port": 0, "unlisted": True, "unregister_after_s": 0.2, **files}))
    yield node
    node.before_shutdown()


def any_value(rng: random.Random, depth: int = 0) -> Any:
    choice = rng.randrange(12 if depth < 3 else 10)
    if choice == 10:
        return [any_value(rng, depth + 1) for _ in range(rng.randrange(4))]
    if choice == 11:
        return {rng.choice((*KEYS, "linear", "x", "header")): any_value(rng, depth + 1) for _ in range(rng.randrange(4))}
    values = (None, True, -1, 2**63, 1e308, 0.5, rng.choice(NAMES), rng.choice(TYPES), "none", rng.choice(("cbor", "png")))
    return values[choice]


def any_frame(rng: random.Random) -> str | bytes:
    """A message with some sense in it, or a broken one."""
    message: dict[str, Any] = {"op": rng.choice(OPERATIONS)}
    for key in rng.sample(KEYS, rng.randrange(2, 9)):
        message[key] = any_value(rng)
    likely = {"topic": NAMES, "service": NAMES, "action": NAMES, "type": TYPES, "action_type": TYPES}
    for key, choices in likely.items():
        if rng.random() < 0.6:
            message[key] = rng.choice(choices)
    text = json.dumps(message)
    match rng.randrange(20):
        case 0:
            return text[: rng.randrange(len(text))]
        case 1:
            return rng.randbytes(rng.randrange(60))
        case 2:
            return "[" * rng.randrange(2000) + text
        case 3:
            return json.dumps({**message, "msg": {"data": "x" * rng.randrange(200_000)}})
        case 4:
            return text + text
        case _:
            return text


def test_ten_thousand_hostile_frames_leave_no_trace(
    graph_host: GraphHost, console: Console, capfd: pytest.CaptureFixture[str]
) -> None:
    rng = random.Random(17)
    witness = RosbridgeClient(console.rosbridge_port)
    before = 0
    for batch in range(20):
        client = RosbridgeClient(console.rosbridge_port)
        for _ in range(FRAMES // 20):
            client.socket.send(any_frame(rng))
        client.close()
        assert witness.call("/rosapi/get_ros_version")["result"]
        witness.received.clear()
        if batch == 4:
            before = psutil.Process().memory_info().rss
    grown_mb = (psutil.Process().memory_info().rss - before) / 1e6
    graph_host.until(lambda: console.count_publishers("/a") == 0, timeout_s=60.0, what="the end of what the clients advertised")
    witness.close()
    logged = capfd.readouterr().err
    assert "Traceback" not in logged, logged[logged.index("Traceback") :][:3000]
    assert grown_mb < 150.0


def test_two_hundred_vanishing_clients_leave_no_trace(graph_host: GraphHost, console: Console) -> None:
    clients = [RosbridgeClient(console.rosbridge_port) for _ in range(200)]
    for client in clients:
        client.send("subscribe", topic="/shared", type="std_msgs/String")
    assert clients[-1].call("/rosapi/get_ros_version")["result"]
    for client in clients[:100]:
        client.socket.socket.close()
    for client in clients[100:]:
        client.close()
    graph_host.until(lambda: console.count_subscribers("/shared") == 0, what="the end of all subscriptions")
