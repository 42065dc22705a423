"""One client's messages, without a graph: whatever they contain, handling one raises nothing, and its answer can be sent."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from lupin_runtime.console.authority import Authority, Role, Session
from lupin_runtime.console.outbox import Frame
from lupin_runtime.console.rosbridge import RosbridgeClient

FIELDS = [
    *("op", "id", "topic", "service", "action", "type", "action_type", "msg", "args", "values", "result", "status"),
    *("compression", "throttle_rate", "queue_length", "fragment_size", "latch", "queue_size", "data", "num", "total"),
    *("level", "timeout", "feedback"),
]
COMPLETE: dict[str, Any] = {
    "id": "a",
    "topic": "/cmd_vel_manual",
    "service": "/twin/get_field",
    "action": "navigate_to_pose",
    "type": "geometry_msgs/Twist",
    "action_type": "nav2_msgs/NavigateToPose",
    "msg": {"linear": {"x": 0.1}},
    "args": {},
    "values": {},
    "result": True,
    "status": 4,
    "data": "x",
    "num": 0,
    "total": 2,
    "level": "error",
}


class FakeBridge:
    """Accepts everything, and answers calls at once."""

    def __init__(self) -> None:
        self.authority = Authority(lambda _: None)
        self.manual = self  # which this stands for as well
        self.logged: list[str] = []

    def log_request(self, _session: Session, _level: str, text: str) -> None:
        self.logged.append(text)

    def call_service(self, _client: Any, _service: str, _args: Any, _timeout_s: Any, done: Callable[[bool, Any], None]) -> None:
        done(True, {"data": 1})

    def __getattr__(self, _name: str) -> Any:
        return lambda *_, **__: None


@pytest.fixture
def bridge() -> FakeBridge:
    return FakeBridge()


@pytest.fixture
def sent() -> list[Frame]:
    return []


@pytest.fixture
def client(bridge: FakeBridge, sent: list[Frame]) -> RosbridgeClient:
    made = RosbridgeClient(Session("anne", Role.OPERATOR), bridge, sent.append)  # type: ignore[arg-type]
    made.handle('{"op": "set_level", "level": "info"}')
    return made


def nested(depth: int, kind: str = "[]") -> str:
    return "[" * depth + "]" * depth if kind == "[]" else '{"x":' * depth + "1" + "}" * depth


@pytest.mark.parametrize("depth", [100, 300, 1015])
@pytest.mark.parametrize("kind", ["[]", "{}"])
def test_nested_value_in_any_field_raises_nothing(client: RosbridgeClient, sent: list[Frame], depth: int, kind: str) -> None:
    for operation in client._operations:
        for field in FIELDS:
            message = {**COMPLETE, "op": operation, field: "@"}
            client.handle(json.dumps(message).replace('"@"', nested(depth, kind)))
        client.handle(json.dumps({**COMPLETE, "op": operation, "msg": {"linear": {"x": "@"}}}).replace('"@"', nested(depth)))
    assert all(json.loads(frame.data)["op"] for frame in sent)


@pytest.mark.parametrize("identifier", ["x", "", 7, 0.5, True, 2**63])
def test_answer_carries_the_id_of_its_request(client: RosbridgeClient, sent: list[Frame], identifier: Any) -> None:
    client.handle(json.dumps({"op": "call_service", "service": "/twin/get_field", "id": identifier}))
    assert json.loads(sent[-1].data)["id"] == identifier


@pytest.mark.parametrize("identifier", [[], {}, ["a"], {"a": 1}])
def test_id_that_is_no_plain_value_is_refused(client: RosbridgeClient, sent: list[Frame], identifier: Any) -> None:
    client.handle(json.dumps({"op": "call_service", "service": "/twin/get_field", "id": identifier}))
    assert "id must be text, a number" in json.loads(sent[-1].data)["msg"]


def test_answer_that_cannot_be_encoded_is_logged(client: RosbridgeClient, sent: list[Frame], bridge: FakeBridge) -> None:
    client.answer({"op": "service_response", "values": {1, 2}})
    assert not sent
    assert "an answer was not sent" in bridge.logged[-1]


def test_fragments_within_fragments_are_refused(client: RosbridgeClient, sent: list[Frame]) -> None:
    inner = json.dumps({"op": "call_service", "service": "/twin/get_field"})
    for _ in range(300):
        # Escaped so that each level adds little, instead of doubling the number of backslashes.
        data = inner.replace("\\", "\\u005c").replace('"', "\\u0022")
        inner = '{"op":"fragment","id":1,"num":0,"total":1,"data":"' + data + '"}'
    client.handle(inner)
    assert "must not be a fragment itself" in json.loads(sent[-1].data)["msg"]
    client.handle('{"op": "call_service", "service": "/twin/get_field"}')
    assert json.loads(sent[-1].data)["result"]
