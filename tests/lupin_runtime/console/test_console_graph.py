"""The console on a real graph, used by clients over their WebSockets."""

from __future__ import annotations

import base64
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from websockets.exceptions import InvalidStatus

from lupin_runtime import graph
from lupin_runtime.console.description import read_description
from tests.support.console_browser import Browser
from tests.support.rosbridge_client import RosbridgeClient
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from lupin_runtime.ros import LupinNode
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

Connect = Callable[..., RosbridgeClient]


def serve(host: GraphHost, folder: Path, **parameters: Any) -> Console:
    from lupin_runtime.console.node import Console

    files = {"folder": str(folder), "sessions_file": str(folder / "sessions.json")}
    console: Console = host.add(Console({"port": 0, "rosbridge_port": 0, **files, **parameters}))
    return console


@pytest.fixture
def peer(graph_host: GraphHost) -> LupinNode:
    """Another node on the graph."""
    from lupin_runtime.ros import LupinNode

    node: LupinNode = graph_host.add(LupinNode("peer"))
    return node


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path) -> Iterator[Console]:
    """A console that allows any name."""
    node = serve(graph_host, tmp_path, unlisted=True, unregister_after_s=0.5)
    yield node
    node.before_shutdown()


@pytest.fixture
def strict(graph_host: GraphHost, tmp_path: Path) -> Iterator[Console]:
    """A console with its default settings, as operators use it."""
    node = serve(graph_host, tmp_path)
    yield node
    node.before_shutdown()


def clients_of(node: Console) -> tuple[list[RosbridgeClient], Connect]:
    made: list[RosbridgeClient] = []

    def connect(**options: Any) -> RosbridgeClient:
        made.append(RosbridgeClient(node.rosbridge_port, **options))
        return made[-1]

    return made, connect


@pytest.fixture
def connect(console: Console) -> Iterator[Connect]:
    """Connects clients to `console`."""
    made, new = clients_of(console)
    yield new
    for client in made:
        client.close()


@pytest.fixture
def connect_strict(strict: Console) -> Iterator[Connect]:
    """Connects clients to `strict`."""
    made, new = clients_of(strict)
    yield new
    for client in made:
        client.close()


def repeat_until(host: GraphHost, action: Callable[[], None], received: list[Any]) -> None:
    """Repeat an action, which may be lost until discovery is done, until something is received."""

    def repeat() -> list[Any]:
        action()
        return received

    host.until(repeat)


def test_messages_pass_both_ways_in_order(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import String

    client, received = connect(), []
    peer.create_subscription(String, "/up", lambda message: received.append(message.data), 100)
    publisher = peer.create_publisher(String, "/down", 100)
    client.send("subscribe", topic="/down", type="std_msgs/String", queue_length=100)
    client.send("advertise", topic="/up", type="std_msgs/msg/String")
    graph_host.until(lambda: publisher.get_subscription_count() and peer.count_publishers("/up"))
    for number in range(50):
        publisher.publish(String(data=f"{number} é"))
    client.publication("/down", lambda message: message["data"] == "49 é")
    assert [m["msg"]["data"] for m in client.received] == [f"{number} é" for number in range(50)]
    repeat_until(graph_host, lambda: client.send("publish", topic="/up", msg={"data": "first"}), received)
    for number in range(50):
        client.send("publish", topic="/up", msg={"data": str(number)})
    graph_host.until(lambda: received[-1] == "49")
    assert received[-50:] == [str(number) for number in range(50)]


def test_late_client_gets_the_latched_message_once(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import String

    from lupin_runtime.ros.node import qos_profile

    latched = peer.create_publisher(String, "/latched", qos_profile(graph.LATCHED1))
    latched.publish(String(data="state"))
    graph_host.until(lambda: peer.count_publishers("/latched"))
    clients = [connect() for _ in range(3)]
    for client in clients:
        client.send("subscribe", topic="/latched", type="std_msgs/String")
        assert client.publication("/latched") == {"data": "state"}
    clients[0].send("subscribe", topic="/latched", id="again")
    assert clients[0].call("/rosapi/get_ros_version")["result"]
    assert [len([m for m in client.received if m["op"] == "publish"]) for client in clients] == [1, 1, 1]


def test_subscription_follows_qos_of_later_publishers(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import String

    from lupin_runtime.ros.node import qos_profile

    client = connect()
    client.send("subscribe", topic="/later", type="std_msgs/String")
    graph_host.until(lambda: peer.count_subscribers("/later"))
    best_effort = peer.create_publisher(String, "/later", qos_profile(graph.BEST1))
    graph_host.until(lambda: best_effort.get_subscription_count(), what="a compatible subscription")
    graph_host.until(lambda: best_effort.publish(String(data="heard")) or _has(client, "/later"))


def test_client_stays_connected_while_graph_disappears(graph_host: GraphHost, connect: Connect) -> None:
    client = connect()
    client.send("subscribe", topic="/state", type="std_msgs/String")
    client.send("advertise", topic="/command", type="std_msgs/String")
    # The next robot offers another QoS, which the subscription follows.
    for number, qos in enumerate((graph.REL10, graph.LATCHED1, graph.BEST1)):
        _use_robot(graph_host, client, f"robot_{number}", qos)
        graph_host.until(partial(_lacks, client, "/ask"), what="a graph without the robot")


def test_service_replaced_with_another_type_is_called(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_srvs.srv import Empty, Trigger

    client = connect()
    for kind, fields in ((Trigger, {"success", "message"}), (Empty, set()), (Trigger, {"success", "message"})):
        service = peer.create_service(kind, "/changing", lambda _, response: response)
        graph_host.until(lambda: client.call("/changing")["result"], what="an answer")
        assert set(client.call("/changing")["values"]) == fields
        peer.destroy_service(service)
        graph_host.until(partial(_lacks, client, "/changing"), what="a graph without the service")
        assert client.call("/changing")["values"] == "Service /changing does not exist"


def test_number_of_ros_clients_is_limited(graph_host: GraphHost, peer: LupinNode, connect: Connect, console: Console) -> None:
    from std_srvs.srv import Trigger

    from lupin_runtime.console.service_calls import MAX_CLIENTS

    client = connect()
    names = [f"/many_{number}" for number in range(MAX_CLIENTS + 5)]
    for name in names:
        peer.create_service(Trigger, name, lambda _, response: response)
    before = len(list(console.clients))
    for name in names:
        graph_host.until(partial(_is_answered, client, name), what=name)
    assert len(list(console.clients)) - before <= MAX_CLIENTS
    assert client.call(names[0])["result"], "a destroyed ROS client is created again"


def _is_answered(client: RosbridgeClient, service: str) -> bool:
    return bool(client.call(service)["result"])


def _lacks(client: RosbridgeClient, service: str) -> bool:
    return service not in client.call("/rosapi/services")["values"]["services"]


def _use_robot(graph_host: GraphHost, client: RosbridgeClient, name: str, qos: graph.Qos) -> None:
    """Add a robot, receive its state, command it, call its service, and remove it."""
    from std_msgs.msg import String
    from std_srvs.srv import Trigger

    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.node import qos_profile

    commands: list[Any] = []
    robot = LupinNode(name)
    states = robot.create_publisher(String, "/state", qos_profile(qos))
    robot.create_subscription(String, "/command", commands.append, 10)
    robot.create_service(Trigger, "/ask", lambda _, response: response)
    graph_host.add(robot)
    graph_host.until(lambda: states.publish(String(data="on")) or _has(client, "/state"), what="a state")
    client.send("publish", topic="/command", msg={"data": "go"})
    graph_host.until(lambda: commands, what="a command")
    graph_host.until(lambda: client.call("/ask")["result"], what="an answer")
    graph_host.remove(robot)


def _has(client: RosbridgeClient, topic: str) -> bool:
    try:
        message = client.take(0.05)
    except TimeoutError:
        return False
    return bool(message["op"] == "publish" and message["topic"] == topic)


@pytest.mark.parametrize("compression", ["none", "png", "cbor", "cbor-raw"])
def test_scan_arrives_in_every_encoding(graph_host: GraphHost, peer: LupinNode, connect: Connect, compression: str) -> None:
    import cv2
    import numpy as np
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import LaserScan

    scan = LaserScan(angle_min=-1.5, ranges=[1.0, float("inf"), float("nan"), 2.5])
    client = connect()
    publisher = peer.create_publisher(LaserScan, "/a_scan", 10)
    client.send("subscribe", topic="/a_scan", type="sensor_msgs/LaserScan", compression=compression)
    graph_host.until(lambda: publisher.get_subscription_count())
    publisher.publish(scan)
    message = client.take(10.0)
    if compression == "png":
        assert message["op"] == "png"
        image = cv2.imdecode(np.frombuffer(base64.b64decode(message["data"]), np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        message = json.loads(image[:, :, ::-1].tobytes())
    contents = message["msg"]
    if compression == "cbor-raw":
        assert deserialize_message(contents["bytes"], LaserScan).angle_min == -1.5
    elif compression == "cbor":
        assert contents["ranges"].tag == 85
        assert np.frombuffer(contents["ranges"].value, "<f4")[3] == 2.5
    else:
        assert contents["ranges"] == [1.0, None, None, 2.5]


def test_clients_share_one_subscription_until_the_last_leaves(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    clients = [connect() for _ in range(5)]
    for client in clients:
        client.send("subscribe", topic="/shared", type="std_msgs/String", compression="cbor")
    graph_host.until(lambda: peer.count_subscribers("/shared"))
    assert all(client.call("/rosapi/get_ros_version")["result"] for client in clients)
    assert peer.count_subscribers("/shared") == 1
    for client in clients:
        client.close()
    graph_host.until(lambda: not peer.count_subscribers("/shared"))


def test_service_call_succeeds_fails_and_times_out(peer: LupinNode, connect: Connect) -> None:
    from std_srvs.srv import SetBool

    def handle(request: Any, response: Any) -> Any:
        time.sleep(0.5 if not request.data else 0.0)
        response.success, response.message = request.data, "done"
        return response

    peer.create_service(SetBool, "/switch", handle)
    client = connect()
    assert client.call("/switch", data=True)["values"] == {"success": True, "message": "done"}
    wrong = client.call("/switch", date=True)
    assert (wrong["result"], wrong["values"]) == (False, "Message type std_srvs/SetBool_Request does not have a field date")
    assert client.call("/nowhere")["values"] == "Service /nowhere does not exist"
    client.send("call_service", service="/switch", args=[False], timeout=0.1)
    late = client.wait(lambda m: m["op"] == "service_response" and "id" not in m)
    assert late == {
        "op": "service_response",
        "service": "/switch",
        "values": "Timeout exceeded while waiting for service response",
        "result": False,
    }


def test_service_with_unsupported_response_is_refused(
    graph_host: GraphHost, peer: LupinNode, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    from std_srvs.srv import Trigger

    from lupin_runtime.console import service_calls
    from lupin_runtime.console.cdr import UnsupportedType

    def refuse(*_: Any) -> None:
        raise UnsupportedType("wstring has no decoder")

    monkeypatch.setattr(service_calls, "decoder", refuse)
    client = connect()
    client.send("call_service", service="/later", id="early")  # waits for the service, and is sent by a timer
    peer.create_service(Trigger, "/later", lambda _, response: response)
    answer = client.wait(lambda m: m.get("id") == "early")
    assert (answer["result"], answer["values"]) == (False, "wstring has no decoder")
    graph_host.until(lambda: client.call("/later")["values"] == "wstring has no decoder", what="another answer")


def test_unknown_type_and_conflicting_type_are_reported(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import String

    peer.create_publisher(String, "/typed", 10)
    graph_host.until(lambda: peer.count_publishers("/typed"))
    client = connect()
    client.send("set_level", level="error")
    client.send("subscribe", topic="/typed", type="std_msgs/Bool", id="wrong")
    assert client.refusal("already established with type std_msgs/msg/String")["id"] == "wrong"
    client.send("subscribe", topic="/a", type="no_such_msgs/Thing")
    client.refusal("Unable to import no_such_msgs.msg")
    client.send("subscribe", topic="/unknown")
    client.refusal("Cannot infer topic type for topic /unknown")
    client.send("advertise", topic="not a valid name", type="std_msgs/String")
    client.refusal("not a valid name")


def test_every_malformed_message_is_reported_and_harmless(connect: Connect) -> None:
    client = connect()
    client.send("set_level", level="error")
    bad: list[Any] = [b"\xff\xfe", "", "[]", "7", "{", '{"op":3}', '{"op":"fly"}', '{"op":"publish"}', "[" * 100_000]
    bad += ['{"op":"subscribe","topic":""}', '{"op":"subscribe","topic":"/a","throttle_rate":"x"}', '{"op":null}']
    bad += ['{"op":"call_service"}', '{"op":"fragment","id":1}', '{"op":"set_level","level":"loud"}']
    for message in bad:
        client.socket.send(message)
        client.take(10.0)
    assert [m["op"] for m in client.received] == ["status"] * (len(bad) - 1) + ["service_response"] * 0 + ["status"]
    assert client.call("/rosapi/get_ros_version")["result"]


def test_sinks_and_estop_state_are_closed_to_clients(peer: LupinNode, connect_strict: Connect) -> None:
    client = connect_strict()
    client.send("set_level", level="error")
    for topic in ("/cmd_vel", "cmd_vel", "/e_stop_state", "/cmd_vel_auto", "/io/motor/left/speed"):
        client.send("advertise", topic=topic, type="geometry_msgs/Twist")
        client.send("publish", topic=topic, type="geometry_msgs/Twist", msg={})
        client.refusal(f"publishing on {topic} is not allowed")
    assert client.call("/controller_manager/switch_controller")["result"] is False
    assert peer.count_publishers("/cmd_vel") == 0


def test_first_driver_has_control_until_it_leaves(graph_host: GraphHost, peer: LupinNode, connect_strict: Connect) -> None:
    received: list[Any] = []
    peer.subscription(graph.CMD_VEL_MANUAL, received.append)
    anne, ben = connect_strict(), connect_strict()
    ben.send("set_level", level="error")
    drive = {"linear": {"x": 5.0, "y": 0.0}, "angular": {"z": -9.0}}
    repeat_until(graph_host, lambda: anne.send("publish", topic="/cmd_vel_manual", msg=drive), received)
    assert (received[-1].linear.x, received[-1].angular.z) == (pytest.approx(0.6), pytest.approx(-1.9))
    ben.send("publish", topic="/cmd_vel_manual", msg=drive)
    ben.refusal("has had control for")
    ben.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": None}})
    anne.send("publish", topic="/cmd_vel_manual", msg=drive)
    anne.close()
    graph_host.until(lambda: received[-1].linear.x == 0.0, what="a zero velocity after the driver left")
    ben.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.1}})
    graph_host.until(lambda: received[-1].linear.x == 0.1)


def test_lost_driver_engages_the_stop_until_released(graph_host: GraphHost, peer: LupinNode, connect_strict: Connect) -> None:
    stops: list[bool] = []
    peer.subscription(graph.CONSOLE_STOP, lambda message: stops.append(json.loads(message.data)["engaged"]))
    driver, other = connect_strict(), connect_strict()
    graph_host.until(lambda: peer.count_publishers(graph.CONSOLE_STOP.name))
    driver.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    assert driver.call("/rosapi/get_ros_version")["result"]
    driver.socket.socket.close()
    graph_host.until(lambda: stops and stops[-1], what="the stop")
    count = len(stops)
    other.send("publish", topic="/lupin/hmi/estop", msg={"data": False})
    graph_host.until(lambda: len(stops) > count + 1, what="repeats of the stop")
    assert all(stops[count:]), "repeating a released state releases nothing"
    other.send("publish", topic="/lupin/hmi/estop", msg={"data": True})
    other.send("publish", topic="/lupin/hmi/estop", msg={"data": False})
    graph_host.until(lambda: not stops[-1], what="the stop to be released")


def test_any_client_stops_and_lets_go_of_its_own_stop(graph_host: GraphHost, peer: LupinNode, connect_strict: Connect) -> None:
    stops: list[bool] = []
    peer.subscription(graph.CONSOLE_STOP, lambda message: stops.append(json.loads(message.data)["engaged"]))
    driver, visitor = connect_strict(), connect_strict()
    graph_host.until(lambda: peer.count_publishers(graph.CONSOLE_STOP.name))
    driver.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    assert driver.call("/rosapi/get_ros_version")["result"]
    for client in (driver, visitor):
        client.send("publish", topic="/lupin/hmi/estop", msg={"data": True})
    graph_host.until(lambda: stops and stops[-1])
    count = len(stops)
    visitor.send("publish", topic="/lupin/hmi/estop", msg={"data": False})
    graph_host.until(lambda: len(stops) > count + 1, what="repeats of the stop")
    assert all(stops[count:]), "the driver holds it, too"
    driver.send("publish", topic="/lupin/hmi/estop", msg={"data": False})
    graph_host.until(lambda: not stops[-1], what="the release by the client in control")


def test_visitor_releases_no_stop_of_a_lost_client(graph_host: GraphHost, peer: LupinNode, connect_strict: Connect) -> None:
    stops: list[bool] = []
    peer.subscription(graph.CONSOLE_STOP, lambda message: stops.append(json.loads(message.data)["engaged"]))
    driver, visitor, lost = connect_strict(), connect_strict(), connect_strict()
    graph_host.until(lambda: peer.count_publishers(graph.CONSOLE_STOP.name))
    driver.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    assert driver.call("/rosapi/get_ros_version")["result"]
    lost.send("publish", topic="/lupin/hmi/estop", msg={"data": True})
    graph_host.until(lambda: stops and stops[-1])
    lost.socket.socket.close()
    for engaged in (True, False):
        visitor.send("publish", topic="/lupin/hmi/estop", msg={"data": engaged})
    count = len(stops)
    graph_host.until(lambda: len(stops) > count + 3, what="repeats of the stop")
    assert all(stops[count:])
    for engaged in (True, False):
        driver.send("publish", topic="/lupin/hmi/estop", msg={"data": engaged})
    graph_host.until(lambda: not stops[-1], what="the release by the client in control")


def test_other_origin_is_refused(console: Console) -> None:
    for origin in ("https://evil.example", "http://localhost.evil.example:8090", "null"):
        with pytest.raises(InvalidStatus, match="403"):
            RosbridgeClient(console.rosbridge_port, origin=origin)
    for origin in ("http://localhost:8090", "http://127.0.0.1", "http://[::1]:3000"):
        RosbridgeClient(console.rosbridge_port, origin=origin).close()


def test_port_in_use_is_reported_with_its_owner(graph_host: GraphHost, peer: LupinNode, tmp_path: Path) -> None:
    from lupin_runtime.console.ports import PortInUse

    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with pytest.raises(PortInUse, match=rf"port {port} is in use by process \d+"):
            serve(graph_host, tmp_path, port=port)
    wait_until(lambda: peer.get_node_names() == ["peer"], lambda: f"a graph without the console: {peer.get_node_names()}")


def test_browsers_are_served_while_the_rosbridge_port_is_in_use(
    graph_host: GraphHost, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        node = serve(graph_host, tmp_path, rosbridge_port=port)
        try:
            assert Browser(node.port).get("/_api/session")["session"]
            described = read_description(tmp_path)
            assert described is not None and described.rosbridge_port == 0
            assert f"no rosbridge for programs: port {port} is in use by process" in capfd.readouterr().err
        finally:
            node.before_shutdown()


def test_client_that_never_reads_slows_nobody_down(graph_host: GraphHost, peer: LupinNode, connect: Connect) -> None:
    from std_msgs.msg import UInt8MultiArray

    publisher = peer.create_publisher(UInt8MultiArray, "/large", 1)
    stuck, reader = connect(max_queue=1), connect()
    for client in (stuck, reader):
        client.send("subscribe", topic="/large", type="std_msgs/UInt8MultiArray", compression="cbor")
    assert reader.call("/rosapi/get_ros_version")["result"], "its subscription was handled, too"
    graph_host.until(lambda: publisher.get_subscription_count())
    for number in range(300):
        publisher.publish(UInt8MultiArray(data=bytes([number % 256]) * 200_000))
        while reader.take(60.0)["msg"]["data"][0] != number % 256:
            pass
        reader.received.clear()
        reader.raw.clear()


def test_event_loop_that_hangs_ends_the_node(graph_host: GraphHost, tmp_path: Path) -> None:
    node = serve(graph_host, tmp_path)
    release = threading.Event()
    node._server._loop.call_soon_threadsafe(release.wait, 100.0)
    with pytest.raises(RuntimeError, match="event loop has not responded for 3 s"):
        graph_host.until(lambda: False, what="the node's end")
    graph_host._errors.clear()
    release.set()
    node.before_shutdown()
