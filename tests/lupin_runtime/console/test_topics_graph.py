"""Topics on a real graph: names with and without a slash, throttling, and how much one client may ask for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.console import publisher_pool, topic_hub
from tests.support.rosbridge_client import RosbridgeClient

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from lupin_runtime.ros import LupinNode
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path) -> Iterator[Console]:
    """A console that allows any name."""
    from lupin_runtime.console.node import Console

    files = {"folder": str(tmp_path), "sessions_file": str(tmp_path / "sessions.json")}
    node = graph_host.add(Console({"port": 0, "rosbridge_port": 0, "unlisted": True, "unregister_after_s": 0.3, **files}))
    yield node
    node.before_shutdown()


@pytest.fixture
def peer(graph_host: GraphHost) -> LupinNode:
    """Another node on the graph."""
    from lupin_runtime.ros import LupinNode

    node: LupinNode = graph_host.add(LupinNode("peer"))
    return node


@pytest.fixture
def client(console: Console) -> Iterator[RosbridgeClient]:
    """A client that gets status messages about errors."""
    made = RosbridgeClient(console.rosbridge_port)
    made.send("set_level", level="error")
    yield made
    made.close()


def contents(client: RosbridgeClient, topic: str) -> list[Any]:
    """Return what the client got on a topic, once all its requests so far were handled."""
    assert client.call("/rosapi/get_ros_version")["result"]
    return [m["msg"]["data"] for m in client.received if m["op"] == "publish" and m["topic"] == topic]


# -- names ------------------------------------------------------------------------------------------------------------
def test_name_without_slash_is_the_same_topic_and_comes_back(
    graph_host: GraphHost, peer: LupinNode, console: Console, client: RosbridgeClient
) -> None:
    from std_msgs.msg import String

    publisher = peer.create_publisher(String, "/shared", 10)
    graph_host.until(lambda: console.count_publishers("/shared"))
    for name in ("shared", "/shared"):
        client.send("subscribe", topic=name)  # the type is the graph's
    assert contents(client, "/shared") == []
    graph_host.until(lambda: publisher.get_subscription_count())
    publisher.publish(String(data="both"))
    assert [client.publication(name) for name in ("shared", "/shared")] == [{"data": "both"}] * 2
    assert peer.count_subscribers("/shared") == 1
    client.send("unsubscribe", topic="shared")
    assert contents(client, "shared") == ["both"]
    publisher.publish(String(data="one"))
    client.publication("/shared", lambda message: message["data"] == "one")
    assert contents(client, "shared") == ["both"]


def test_name_without_slash_has_type_and_qos_of_the_table(
    graph_host: GraphHost, peer: LupinNode, client: RosbridgeClient
) -> None:
    from lupin_runtime.ros.node import qos_profile

    received: list[Any] = []
    peer.subscription(graph.GOAL_POSE, received.append)

    def publish() -> list[Any]:
        client.send("publish", topic="goal_pose", msg={"header": {"frame_id": "map"}})
        return received

    graph_host.until(publish, what="a goal")
    offered = peer.get_publishers_info_by_topic(graph.GOAL_POSE.name)[0].qos_profile
    assert offered.depth in (0, qos_profile(graph.GOAL_POSE.qos).depth)  # 0: the middleware does not report it
    client.send("advertise", topic="goal_pose", type="std_msgs/String", id="wrong")
    assert client.refusal("Tried to register topic goal_pose with type std_msgs/msg/String")["id"] == "wrong"


# -- throttling -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", [graph.ESTOP_STATE.name, graph.ESTOP_STATE.name.lstrip("/")])
def test_changes_of_state_are_not_throttled(graph_host: GraphHost, peer: LupinNode, client: RosbridgeClient, name: str) -> None:
    from std_msgs.msg import Bool

    publisher = peer.publisher(graph.ESTOP_STATE)
    client.send("subscribe", topic=name, type="std_msgs/Bool", throttle_rate=60_000)
    graph_host.until(lambda: publisher.get_subscription_count())
    for engaged in (False, True, False):
        publisher.publish(Bool(data=engaged))
    graph_host.until(lambda: contents(client, name) == [False, True, False], what="every change")


def test_samples_are_throttled(graph_host: GraphHost, peer: LupinNode, client: RosbridgeClient) -> None:
    from nav_msgs.msg import Odometry

    publisher = peer.publisher(graph.ODOM)
    client.send("subscribe", topic=graph.ODOM.name, type=graph.ODOM.type, throttle_rate=60_000)
    graph_host.until(lambda: publisher.get_subscription_count())
    for _ in range(5):
        publisher.publish(Odometry())
    client.publication(graph.ODOM.name)
    assert client.call("/rosapi/get_ros_version")["result"]
    assert len([m for m in client.received if m["op"] == "publish"]) == 1


# -- limits -----------------------------------------------------------------------------------------------------------
def test_unadvertise_withdraws_a_topic_after_many_publications(
    graph_host: GraphHost, peer: LupinNode, client: RosbridgeClient
) -> None:
    client.send("advertise", topic="/told", type="std_msgs/String", id="advertise:/told:1")
    for number in range(300):
        client.send("publish", topic="/told", msg={"data": "x"}, id=f"publish:/told:{number}")
    graph_host.until(lambda: peer.count_publishers("/told"))
    client.send("unadvertise", topic="/told", id="advertise:/told:1")
    graph_host.until(lambda: not peer.count_publishers("/told"), what="the end of the advertisement")


def test_topic_that_was_only_published_on_can_be_unadvertised(
    graph_host: GraphHost, peer: LupinNode, client: RosbridgeClient
) -> None:
    client.send("publish", topic="/told", type="std_msgs/String", msg={"data": "x"}, id="publish:/told:1")
    graph_host.until(lambda: peer.count_publishers("/told"))
    client.send("unadvertise", topic="/told", id="advertise:/told:2")
    graph_host.until(lambda: not peer.count_publishers("/told"), what="the end of the advertisement")


def test_subscriptions_of_one_client_are_limited(
    graph_host: GraphHost, peer: LupinNode, client: RosbridgeClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(topic_hub, "MAX_TOPICS", 5)
    for number in range(topic_hub.MAX_REQUESTS + 1):
        client.send("subscribe", topic="/one", type="std_msgs/String", id=f"request {number}")
    assert client.refusal("/one: a client may have 100 subscriptions to one topic")["id"] == "request 100"
    client.send("subscribe", topic="/one", id="request 7", throttle_rate=100)  # replaces one
    for number in range(5):
        client.send("subscribe", topic=f"/many_{number}", type="std_msgs/String", id=f"topic {number}")
    assert client.refusal("a client may subscribe to 5 topics")["id"] == "topic 4"
    client.send("unsubscribe", topic="/one")
    client.send("subscribe", topic="/many_4", type="std_msgs/String")
    assert client.call("/rosapi/get_ros_version")["result"]
    assert len([m for m in client.received if m["op"] == "status"]) == 2
    graph_host.until(lambda: peer.count_subscribers("/many_4"), what="a topic after another was unsubscribed")


def test_advertisements_of_one_client_are_limited(client: RosbridgeClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publisher_pool, "MAX_TOPICS", 5)
    for number in range(publisher_pool.MAX_ADVERTISEMENTS + 1):
        client.send("advertise", topic="/one", type="std_msgs/String", id=f"advertisement {number}")
    assert client.refusal("/one: a client may advertise a topic 100 times")["id"] == "advertisement 100"
    for number in range(5):
        client.send("publish", topic=f"/many_{number}", type="std_msgs/String", msg={}, id=f"topic {number}")
    assert client.refusal("a client may publish on 5 topics")["id"] == "topic 4"
