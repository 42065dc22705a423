"""The video server on a real graph, with cameras that appear, disappear and return."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from tests.support.image_messages import decoded, gradient, jpeg
from tests.support.video_client import VideoClient

if TYPE_CHECKING:
    from lupin_runtime.cameras.node import VideoServer
    from lupin_runtime.ros import LupinNode
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

BGR = gradient()
JPEG = jpeg(BGR)
CAMERA = graph.GRIPPER_IMAGE
STREAM = f"/stream?topic={CAMERA.name}"


@pytest.fixture
def server(graph_host: GraphHost) -> Iterator[VideoServer]:
    from lupin_runtime.cameras.node import VideoServer

    node: VideoServer = graph_host.add(VideoServer({"port": 0}))
    yield node
    node.before_shutdown()


@pytest.fixture
def client(server: VideoServer) -> Iterator[VideoClient]:
    made = VideoClient(server.port)
    yield made
    made.close()


@pytest.fixture
def peer(graph_host: GraphHost) -> LupinNode:
    from lupin_runtime.ros import LupinNode

    node: LupinNode = graph_host.add(LupinNode("driver"))
    return node


def listed(graph_host: GraphHost, client: VideoClient, topics: list[str]) -> None:
    """Wait until the server lists exactly these cameras."""
    graph_host.until(lambda: [row["topic"] for row in client.json("/streams")] == topics, what=f"the cameras {topics}")


def test_raw_and_compressed_images_reach_a_client(graph_host: GraphHost, peer: LupinNode, client: VideoClient) -> None:
    from sensor_msgs.msg import CompressedImage, Image

    raw, companion = peer.publisher(CAMERA), peer.publisher(graph.compressed(CAMERA))
    overlay = peer.create_publisher(Image, "/overlay", 1)
    listed(graph_host, client, [CAMERA.name, "/overlay"])
    photo, drawn = client.stream(STREAM), client.stream("/stream?topic=/overlay")
    graph_host.until(lambda: companion.get_subscription_count() == 1 and overlay.get_subscription_count() == 1)
    assert raw.get_subscription_count() == 0, "the JPEG topic is enough"
    message = CompressedImage(format="rgb8; jpeg compressed bgr8", data=JPEG)
    message.header.stamp.sec = 7
    companion.publish(message)
    assert photo.image() == (JPEG, 7_000_000_000)
    overlay.publish(Image(height=48, width=64, encoding="bgr8", step=192, data=BGR.tobytes()))
    assert decoded(drawn.image()[0]).shape == BGR.shape
    photo.close()
    graph_host.until(lambda: companion.get_subscription_count() == 0, what="the end of the subscription")


@pytest.mark.parametrize("reliable", [True, False], ids=["reliable", "best effort"])
def test_stream_continues_when_unplugged_camera_returns(
    graph_host: GraphHost, server: VideoServer, client: VideoClient, reliable: bool
) -> None:
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import CompressedImage

    from lupin_runtime.ros import LupinNode

    def plug(policy: Any) -> tuple[LupinNode, Any]:
        driver = graph_host.add(LupinNode("driver"))
        made = driver.create_publisher(CompressedImage, graph.compressed(CAMERA).name, QoSProfile(depth=1, reliability=policy))
        return driver, made

    driver, publisher = plug(ReliabilityPolicy.RELIABLE)
    listed(graph_host, client, [CAMERA.name])
    stream = client.stream(STREAM)
    graph_host.until(publisher.get_subscription_count)
    publisher.publish(CompressedImage(data=JPEG + b"1"))
    assert stream.image()[0] == JPEG + b"1"
    graph_host.remove(driver)
    listed(graph_host, client, [])
    assert f"no node publishes images on {CAMERA.name}" in client.text(STREAM, 404)
    _, publisher = plug(ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT)

    def back() -> bool:
        publisher.publish(CompressedImage(data=JPEG + b"2"))
        time.sleep(0.05)
        return bool(server._server.streams.describe()[0]["age_s"] is not None and publisher.get_subscription_count())

    graph_host.until(back, what="the camera's return")
    for _ in range(20):
        publisher.publish(CompressedImage(data=JPEG + b"2"))
        time.sleep(0.05)
    assert stream.image()[0] == JPEG + b"2"


def test_port_in_use_is_reported_and_leaves_nothing(graph_host: GraphHost, peer: LupinNode) -> None:
    from lupin_runtime.cameras.node import VideoServer

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OSError, match=f"port {port} is in use; show its owner with"):
            VideoServer({"port": port})
    graph_host.until(lambda: peer.get_node_names() == ["driver"], what="a graph without the server")
