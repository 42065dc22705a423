"""The Foxglove server on a real graph, used by clients over their WebSockets."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import aiohttp
import pytest

from lupin_runtime import graph
from tests.support.foxglove_client import FoxgloveClient

if TYPE_CHECKING:
    from lupin_runtime.foxglove.node import FoxgloveBridge
    from lupin_runtime.ros import LupinNode
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

# This many messages, each in one datagram, fill the buffers of a connection that is not read, and its queue in the server.
DATAGRAM_BYTES, FILLING_MESSAGES = 60_000, 400

Connect = Callable[..., FoxgloveClient]


@pytest.fixture
def peer(graph_host: GraphHost) -> LupinNode:
    """Another node on the graph."""
    from lupin_runtime.ros import LupinNode

    node: LupinNode = graph_host.add(LupinNode("peer"))
    return node


@pytest.fixture
def bridge(graph_host: GraphHost) -> Iterator[FoxgloveBridge]:
    """The server."""
    from lupin_runtime.foxglove.node import FoxgloveBridge

    node: FoxgloveBridge = graph_host.add(FoxgloveBridge({"port": 0}))
    yield node
    node.before_shutdown()


@pytest.fixture
def connect(bridge: FoxgloveBridge) -> Iterator[Connect]:
    """Connects clients to the server."""
    made: list[FoxgloveClient] = []

    def new(**options: Any) -> FoxgloveClient:
        made.append(FoxgloveClient(bridge.port, **options))
        return made[-1]

    yield new
    for client in made:
        client.close()


def string_cdr(text: str) -> bytes:
    from rclpy.serialization import serialize_message
    from std_msgs.msg import String

    return bytes(serialize_message(String(data=text)))


def test_topics_are_advertised_with_their_schemas(peer: LupinNode, connect: Connect) -> None:
    from sensor_msgs.msg import LaserScan

    peer.create_publisher(LaserScan, "/a_scan", 10)
    client = connect()
    channel = client.channel("/a_scan")
    assert (channel["encoding"], channel["schemaName"], channel["schemaEncoding"]) == (
        "cdr",
        "sensor_msgs/msg/LaserScan",
        "ros2msg",
    )
    assert "float32[] ranges" in channel["schema"]
    assert "MSG: std_msgs/Header\n" in channel["schema"]
    assert client.server_info["capabilities"] == []


def test_messages_arrive_byte_for_byte_in_order(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import String

    publisher = peer.create_publisher(String, "/down", 100)
    client = connect()
    client.subscribe("/down")
    graph_host.until(publisher.get_subscription_count)
    before_ns = time.time_ns()
    sent = [string_cdr(f"{number} é") for number in range(50)]
    for data in sent:
        publisher.publish(data)
    client.last(len(sent))
    assert client.on("/down") == sent
    assert all(before_ns <= message.time_ns <= time.time_ns() for message in client.messages)


def test_each_late_client_gets_the_latched_message_once(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import String

    from lupin_runtime.ros.node import qos_profile

    latched = peer.create_publisher(String, "/latched", qos_profile(graph.LATCHED1))
    latched.publish(String(data="state"))
    clients = []
    for _ in range(4):
        clients.append(connect())
        clients[-1].subscribe("/latched")
        clients[-1].last()
    for client in clients:
        client.synchronize()
    graph_host.until(lambda: peer.count_subscribers("/latched") == 1)
    assert [client.on("/latched") for client in clients] == [[string_cdr("state")]] * 4


def test_topic_is_subscribed_to_only_while_it_has_clients(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import String

    peer.create_publisher(String, "/shared", 10)
    clients = [connect() for _ in range(3)]
    for client in clients:
        client.channel("/shared")
    assert peer.count_subscribers("/shared") == 0
    for client in clients:
        client.subscribe("/shared")
        client.synchronize()
    graph_host.until(lambda: peer.count_subscribers("/shared") == 1)
    for client in clients[:2]:
        client.unsubscribe("/shared")
        client.synchronize()
    assert peer.count_subscribers("/shared") == 1
    clients[2].unsubscribe("/shared")
    graph_host.until(lambda: peer.count_subscribers("/shared") == 0)
    clients[0].subscribe("/shared")
    graph_host.until(lambda: peer.count_subscribers("/shared") == 1)


def test_client_that_vanishes_leaves_nothing(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import String

    publisher = peer.create_publisher(String, "/watched", 10)
    client = connect()
    client.subscribe("/watched")
    graph_host.until(lambda: peer.count_subscribers("/watched") == 1)
    client.vanish()
    publisher.publish(String(data="to nobody"))
    graph_host.until(lambda: peer.count_subscribers("/watched") == 0)


def test_channels_are_added_and_removed_with_topics(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import Bool, String

    client = connect()
    for kind in (String, Bool):
        assert "/comes" not in client.channels
        publisher = peer.create_publisher(kind, "/comes", 10)
        assert client.channel("/comes")["schemaName"] == f"std_msgs/msg/{kind.__name__}"
        client.subscribe("/comes")
        graph_host.until(lambda: peer.count_subscribers("/comes") == 1)
        peer.destroy_publisher(publisher)
        client.until(lambda: "/comes" not in client.channels, "the end of the channel")
        graph_host.until(lambda: peer.count_subscribers("/comes") == 0)


def test_channel_without_subscribers_is_announced_again(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    """A viewer needs another announcement if the SDK refused its subscription because it came too early."""
    from std_msgs.msg import String

    from lupin_runtime.foxglove.channels import RENEWALS

    client = connect()
    client.subscribe_later("/watched")
    publishers = [peer.create_publisher(String, name, 10) for name in ("/ignored", "/watched")]
    client.until(lambda: len(client.announcements("/ignored")) == 1 + RENEWALS, "all announcements")
    peer.create_publisher(String, "/marker", 10)
    client.until(lambda: len(client.announcements("/marker")) == 2, "two later looks at the graph")
    assert len(client.announcements("/ignored")) == 1 + RENEWALS
    graph_host.until(lambda: publishers[1].get_subscription_count() == 1)
    client.subscribe("/ignored")
    graph_host.until(lambda: publishers[0].get_subscription_count() == 1)


def test_subscription_follows_qos_of_later_publishers(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import String

    from lupin_runtime.ros.node import qos_profile

    peer.create_subscription(String, "/later", lambda _: None, qos_profile(graph.BEST1))
    client = connect()
    client.subscribe("/later")
    graph_host.until(lambda: peer.count_subscribers("/later") == 2)
    best_effort = peer.create_publisher(String, "/later", qos_profile(graph.BEST1))
    graph_host.until(lambda: best_effort.publish(String(data="heard")) or client.on("/later"), what="a message")


def test_unknown_type_is_harmless_and_logged_once(
    peer: LupinNode, connect: Connect, bridge: FoxgloveBridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    from std_msgs.msg import Bool, String

    from lupin_runtime.ros import type_names

    find = type_names.find

    def without_bool(name: str, kind: str) -> Any:
        if name == "std_msgs/msg/Bool":
            raise type_names.UnknownType("Unable to import std_msgs.msg")
        return find(name, kind)

    reports: list[str] = []
    monkeypatch.setattr(type_names, "find", without_bool)
    monkeypatch.setattr(bridge.get_logger(), "warning", reports.append)
    peer.create_publisher(Bool, "/unknown", 10)
    client = connect()
    client.until(lambda: reports, "the report")
    peer.create_publisher(String, "/known", 10)
    client.channel("/known")
    assert "/unknown" not in client.channels
    assert reports == ["'/unknown' of type 'std_msgs/msg/Bool' is not served: Unable to import std_msgs.msg"]


def test_clients_can_change_nothing(peer: LupinNode, connect: Connect) -> None:
    client = connect()
    client.send(op="advertise", channels=[{"id": 1, "topic": "/cmd_vel", "encoding": "cdr", "schemaName": "Twist"}])
    client.send_binary(b"\x01" + (1).to_bytes(4, "little") + string_cdr("forged"))
    client.send_binary(b"\x02" + bytes(12) + (3).to_bytes(4, "little") + b"cdr")
    client.send(op="setParameters", parameters=[{"name": "lupin_foxglove.port", "value": 1}])
    client.send(op="getParameters", parameterNames=["lupin_foxglove.port"])
    client.synchronize()
    # The server answers requests side by side, so an answer may come after that to a later request.
    refusals = ("does not support clientPublish", "does not support parameters")
    client.until(
        lambda: all(any(refusal in each["message"] for each in client.statuses) for refusal in refusals), "both refusals"
    )
    assert not peer.count_publishers("/cmd_vel")


def test_malformed_messages_are_harmless(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import String

    publisher = peer.create_publisher(String, "/still", 10)
    client = connect()
    identifier = client.channel("/still")["id"]
    for text in ({}, {"op": "fly"}, {"op": "subscribe"}, {"op": "subscribe", "subscriptions": [{"id": -1}]}, {"op": None}):
        client.send(**text)
    for data in (b"\xff", b"\x01", b"\x02\x00", bytes(1000)):
        client.send_binary(data)
    client.send(op="subscribe", subscriptions=[{"id": 1, "channelId": identifier}, {"id": 2, "channelId": identifier}])
    client.send(op="unsubscribe", subscriptionIds=[1, 1, 77])
    client.synchronize()
    other = connect()
    other.subscribe("/still")
    graph_host.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(String(data="fine"))
    assert other.last() == string_cdr("fine")


def test_other_subprotocols_are_refused(bridge: FoxgloveBridge) -> None:
    with pytest.raises(aiohttp.WSServerHandshakeError, match="400"):
        FoxgloveClient(bridge.port, subprotocol="rosbridge.v2")


def test_twenty_clients_get_every_message(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import String

    publishers = [peer.create_publisher(String, f"/many_{number}", 100) for number in range(5)]
    clients = [connect() for _ in range(20)]
    for client in clients:
        for number in range(5):
            client.subscribe(f"/many_{number}")
    for client in clients:
        client.synchronize()
    graph_host.until(lambda: all(publisher.get_subscription_count() == 1 for publisher in publishers))
    sent = [string_cdr(str(number)) for number in range(20)]
    for data in sent:
        for publisher in publishers:
            publisher.publish(data)
    for client in clients:
        client.last(100)
        assert all(client.on(f"/many_{number}") == sent for number in range(5))


def test_client_that_never_reads_slows_nobody_down(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import UInt8MultiArray

    publisher = peer.create_publisher(UInt8MultiArray, "/large", 1)
    reader = connect()
    reader.subscribe("/large")
    graph_host.until(publisher.get_subscription_count)
    stuck = connect(reads=False)
    stuck.send(op="subscribe", subscriptions=[{"id": 1, "channelId": reader.channel("/large")["id"]}])
    for number in range(FILLING_MESSAGES):
        publisher.publish(UInt8MultiArray(data=bytes([number % 256]) * DATAGRAM_BYTES))
        assert reader.last()[-1] == number % 256
        reader.messages.clear()


def test_client_that_never_reads_does_not_delay_the_stop(
    graph_host: GraphHost, peer: LupinNode, bridge: FoxgloveBridge, connect: Connect
) -> None:
    from std_msgs.msg import UInt8MultiArray

    publisher = peer.create_publisher(UInt8MultiArray, "/large", 1)
    reader, stuck = connect(), connect(reads=False)
    reader.subscribe("/large")
    graph_host.until(publisher.get_subscription_count)
    stuck.send(op="subscribe", subscriptions=[{"id": 1, "channelId": reader.channel("/large")["id"]}])
    for _ in range(FILLING_MESSAGES):
        publisher.publish(UInt8MultiArray(data=bytes(DATAGRAM_BYTES)))
        reader.last()
        reader.messages.clear()
    bridge.before_shutdown()
    with pytest.raises(aiohttp.ClientError):
        FoxgloveClient(bridge.port)


def test_simulated_time_is_announced_and_stamps_messages(
    graph_host: GraphHost, peer: LupinNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import String

    from lupin_runtime.foxglove.node import FoxgloveBridge
    from lupin_runtime.ros import LupinNode, stamp_from_ns
    from lupin_runtime.ros.clock import ClockFollower

    time_ns = 5_250_000_000
    clock, publisher = peer.publisher(graph.CLOCK), peer.create_publisher(String, "/stamped", 10)
    monkeypatch.setattr(LupinNode, "simulated_time", True)
    follower, bridge = ClockFollower(), FoxgloveBridge({"port": 0})
    follower.attach(bridge)
    follower.start()
    graph_host.add(bridge)
    client = FoxgloveClient(bridge.port)
    try:
        assert client.until(lambda: client.server_info, "the server's description")["capabilities"] == ["time"]
        graph_host.until(lambda: clock.publish(Clock(clock=stamp_from_ns(time_ns))) or client.times_ns)
        assert set(client.times_ns) == {time_ns}
        client.subscribe("/stamped")
        graph_host.until(publisher.get_subscription_count)
        publisher.publish(String(data="now"))
        client.last()
        assert client.messages[0].time_ns == time_ns
    finally:
        client.close()
        bridge.before_shutdown()
        follower.stop()


def test_port_in_use_is_reported_with_its_owner(graph_host: GraphHost) -> None:
    from lupin_runtime.console.ports import PortInUse
    from lupin_runtime.foxglove.node import FoxgloveBridge

    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with pytest.raises(PortInUse, match=rf"port {port} is in use by process \d+"):
            graph_host.add(FoxgloveBridge({"port": port}))
