"""Clients that send arbitrary data: nothing crashes, nothing piles up, and other clients are served."""

from __future__ import annotations

import base64
import json
import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
import pytest

from lupin_runtime.console import connection
from tests.support.raw_websocket import open_raw_websocket, text_frame
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
NESTED = "@nested@"  # replaced in the JSON text by nested_text


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path) -> Iterator[Console]:
    """A console that allows any name, so that more of its code is reached."""
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
    if rng.random() < 0.08:
        return NESTED
    return values[choice]


def nested_text(rng: random.Random) -> str:
    """Return valid JSON, nested as deep as a parser accepts it or less."""
    depth = rng.randrange(100, 1017)
    return "[" * depth + "]" * depth if rng.random() < 0.5 else '{"linear":' * depth + "0" + "}" * depth


def as_text(rng: random.Random, message: dict[str, Any]) -> str:
    return re.sub(f'"{NESTED}"', lambda _: nested_text(rng), json.dumps(message))


def huge_contents(rng: random.Random) -> Any:
    """Return the contents of a message with large or deep arrays, or with serialized data that is none."""
    number = rng.choice((0, -1, 2**64 - 1, 1e308, 0.5, None, "x"))
    encoded = base64.b64encode(rng.randbytes(rng.randrange(1, 50_000))).decode()
    choices: tuple[Any, ...] = (
        {"data": "x" * rng.randrange(200_000)},
        {"data": [number] * rng.randrange(1, 20_000)},
        {"data": encoded[: rng.randrange(len(encoded))]},
        {"layout": {"dim": [{"size": number, "label": NESTED}] * 100}, "data": encoded},
        {"ranges": [number] * 5000, "header": {"stamp": NESTED}},
        {"linear": {"x": number, "y": NESTED}, "angular": {"z": number}},
        {f"key {index}": number for index in range(rng.randrange(2000))},
    )
    return rng.choice(choices)


def any_fragments(rng: random.Random) -> list[str | bytes]:
    """Return well-formed fragments of several messages: interleaved, reordered, and some of them unfinished or repeated."""
    parts: list[str | bytes] = []
    for _ in range(rng.randrange(1, 4)):
        text, identifier = any_text(rng)[:2000], rng.choice((None, "a", "b", 7, 0.5, True, NESTED))
        size = rng.randrange(1 + len(text) // 30, 200)
        pieces = [text[start : start + size] for start in range(0, len(text), size)]
        parts += [
            as_text(rng, {"op": "fragment", "id": identifier, "data": data, "num": number, "total": len(pieces)})
            for number, data in enumerate(pieces)
        ]
    if rng.random() < 0.5:
        rng.shuffle(parts)
    return parts[: rng.randrange(1, len(parts) + 1)] + rng.sample(parts, min(2, len(parts)))


def any_frames(rng: random.Random) -> list[str | bytes]:
    """Return partly meaningful messages, or malformed ones."""
    text = any_text(rng)
    match rng.randrange(20):
        case 0:
            return [text[: rng.randrange(len(text))]]
        case 1:
            return [rng.randbytes(rng.randrange(60))]
        case 2:
            return ["[" * rng.randrange(2000) + text]
        case 3:
            return [text + text]
        case 4:
            return any_fragments(rng)
        case _:
            return [text]


def any_text(rng: random.Random) -> str:
    message: dict[str, Any] = {"op": rng.choice(OPERATIONS)}
    for key in rng.sample(KEYS, rng.randrange(2, 9)):
        message[key] = any_value(rng)
    likely = {"topic": NAMES, "service": NAMES, "action": NAMES, "type": TYPES, "action_type": TYPES}
    for key, choices in likely.items():
        if rng.random() < 0.6:
            message[key] = rng.choice(choices)
    if rng.random() < 0.1:
        message["msg"] = huge_contents(rng)
    return as_text(rng, message)


@pytest.mark.long
def test_ten_thousand_hostile_frames_leave_no_trace(
    graph_host: GraphHost, console: Console, capfd: pytest.CaptureFixture[str]
) -> None:
    rng = random.Random(17)
    witness = RosbridgeClient(console.rosbridge_port)
    before = 0
    for batch in range(20):
        client = RosbridgeClient(console.rosbridge_port)
        sent = 0
        while sent < FRAMES // 20:
            for frame in any_frames(rng):
                client.socket.send(frame)
                sent += 1
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


def test_half_open_client_is_disconnected(graph_host: GraphHost, console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "HEARTBEAT_S", 1.0)
    with open_raw_websocket(console.rosbridge_port) as client:
        client.sendall(text_frame("subscribe", topic="/heard", type="std_msgs/String"))
        client.sendall(text_frame("advertise", topic="/told", type="std_msgs/String"))
        graph_host.until(lambda: console.count_subscribers("/heard") and console.count_publishers("/told"))
        graph_host.until(lambda: not (console.count_subscribers("/heard") or console.count_publishers("/told")))
