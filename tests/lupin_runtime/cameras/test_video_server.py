"""The video server: what clients get, how it treats slow and vanishing ones, and that they leave nothing behind."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from lupin_runtime.cameras import http_server
from lupin_runtime.cameras import jpeg as jpeg_module
from lupin_runtime.cameras.http_server import VideoHttpServer
from lupin_runtime.cameras.stream_request import IMAGE
from lupin_runtime.cameras.video_streams import VideoStreams
from tests.support.image_messages import decoded, gradient, jpeg
from tests.support.published_images import PublishedImages
from tests.support.video_client import VideoClient
from tests.support.waiting import wait_until

BGR = gradient()
JPEG = jpeg(BGR)


@pytest.fixture
def graph() -> PublishedImages:
    return PublishedImages()


@pytest.fixture
def warnings() -> list[str]:
    return []


@pytest.fixture
def server(graph: PublishedImages, warnings: list[str]) -> Iterator[VideoHttpServer]:
    made = VideoHttpServer("127.0.0.1", 0, VideoStreams(graph, warnings.append))
    made.start()
    yield made
    made.stop()


@pytest.fixture
def client(server: VideoHttpServer) -> Iterator[VideoClient]:
    made = VideoClient(server.port)
    yield made
    made.close()


def watched(graph: PublishedImages) -> int:
    return len(graph.subscriptions)


def test_jpeg_images_are_forwarded_with_their_stamps(graph: PublishedImages, client: VideoClient) -> None:
    stream = client.stream("/stream?topic=/jpeg")
    assert stream.headers["Content-Type"].startswith("multipart/x-mixed-replace; boundary=")
    for number in range(1, 5):
        graph.publish(JPEG + bytes([number]), stamp_ns=number * 1_000_000_001)
        assert stream.image() == (JPEG + bytes([number]), number * 1_000_000_001)


def test_raw_images_are_encoded_once_for_all_clients(
    graph: PublishedImages, server: VideoHttpServer, client: VideoClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoded: list[int] = []

    def counting(*arguments: Any) -> bytes:
        encoded.append(1)
        return encode(*arguments)

    encode = jpeg_module.encode
    monkeypatch.setattr("lupin_runtime.cameras.video_streams.encode", counting)
    streams = [client.stream("/stream?topic=/raw") for _ in range(4)]
    wait_until(lambda: sum(row["clients"] for row in server.streams.describe()) == 4, "four clients")
    for number in range(1, 4):
        graph.publish_raw(number)
        images = {stream.image() for stream in streams}
        assert len(images) == 1 and len(encoded) == number
    assert decoded(next(iter(images))[0]).shape == BGR.shape
    assert graph.subscribe_count == 1


@pytest.mark.parametrize("topic", ["/raw", "/jpeg"])
def test_clients_get_the_width_that_they_asked_for(graph: PublishedImages, client: VideoClient, topic: str) -> None:
    small, full = client.stream(f"/stream?topic={topic}&width=32"), client.stream(f"/stream?topic={topic}")
    wait_until(lambda: watched(graph) == 1, "one subscription for both")
    graph.publish(JPEG, 1)
    graph.publish_raw(1)
    assert decoded(small.image()[0]).shape == (24, 32, 3)
    assert decoded(full.image()[0]).shape == BGR.shape


def test_camera_is_subscribed_to_only_while_it_has_clients(graph: PublishedImages, client: VideoClient) -> None:
    assert watched(graph) == 0
    streams = [client.stream("/stream?topic=/jpeg") for _ in range(3)]
    assert watched(graph) == 1
    for stream in streams[:2]:
        stream.close()
    graph.publish(JPEG)
    streams[2].image()
    streams[2].close()
    wait_until(lambda: watched(graph) == 0, "the end of the subscription, though no image comes")


def test_streams_opened_and_closed_quickly_leave_nothing(graph: PublishedImages, server: VideoHttpServer) -> None:
    threads_before = threading.active_count()

    def visit() -> None:
        for _ in range(25):
            client = VideoClient(server.port)
            client.stream("/stream?topic=/jpeg")
            client.close()

    visitors = [threading.Thread(target=visit) for _ in range(4)]
    for visitor in visitors:
        visitor.start()
    while any(visitor.is_alive() for visitor in visitors):
        graph.publish(JPEG)
        time.sleep(0.001)
    wait_until(lambda: watched(graph) == 0, "the end of the subscription")
    wait_until(lambda: threading.active_count() <= threads_before, "the end of all threads")


def test_client_that_never_reads_is_disconnected(
    graph: PublishedImages, server: VideoHttpServer, client: VideoClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_server._Handler, "timeout", 1.0)
    large = JPEG + bytes(1_000_000)
    stuck = socket.create_connection(("127.0.0.1", server.port))
    stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    stuck.sendall(b"GET /stream?topic=/jpeg HTTP/1.1\r\nHost: x\r\n\r\n")
    wait_until(lambda: watched(graph) == 1, "the first client")
    reader = client.stream("/stream?topic=/jpeg")
    wait_until(lambda: server.streams.describe()[0]["clients"] == 2, "both clients")
    for number in range(1, 20):
        graph.publish(large, number)
        assert reader.image()[1] == number
    wait_until(lambda: server.streams.describe()[0]["clients"] == 1, "the end of the client that does not read")
    stuck.close()


def test_slow_client_gets_the_newest_image(graph: PublishedImages, client: VideoClient) -> None:
    stream = client.stream("/stream?topic=/jpeg")
    for number in range(1, 200):
        graph.publish(JPEG + bytes(100_000), number)
    seen: list[int] = []
    while not seen or seen[-1] != 199:
        seen.append(stream.image()[1])
    assert seen == sorted(seen) and len(seen) < 150


def test_snapshot_is_taken_after_the_request(graph: PublishedImages, client: VideoClient) -> None:
    stream = client.stream("/stream?topic=/jpeg")
    graph.publish(JPEG + b"old", 1)
    stream.image()
    answer: list[Any] = []
    asking = threading.Thread(target=lambda: answer.extend(client.get("/snapshot?topic=/jpeg")))
    asking.start()
    number = 1
    while asking.is_alive():
        number += 1
        graph.publish(JPEG + b"new", number)
        time.sleep(0.01)
    status, content, headers = answer
    assert status == 200 and content == JPEG + b"new" and headers["Content-Type"] == "image/jpeg"
    assert headers["Cache-Control"] == "no-store" and headers["X-Timestamp"].startswith("0.0000000")


def test_snapshot_of_silent_camera_is_refused_with_reason(
    graph: PublishedImages, client: VideoClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_server, "SNAPSHOT_TIMEOUT_S", 0.2)
    assert "no image came from /jpeg within 0.2 s" in client.text("/snapshot?topic=/jpeg", 504)
    wait_until(lambda: watched(graph) == 0, "the end of the subscription")


def test_snapshot_of_an_unsupported_encoding_names_it(
    graph: PublishedImages, client: VideoClient, warnings: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_server, "SNAPSHOT_TIMEOUT_S", 1.0)
    answer: list[str] = []
    asking = threading.Thread(target=lambda: answer.append(client.text("/snapshot?topic=/raw", 504)))
    asking.start()
    wait_until(lambda: watched(graph) == 1, "the subscription")
    graph.publish_raw(1, encoding="64FC4")
    wait_until(lambda: warnings, "a warning")
    asking.join()
    assert "/raw is not shown: images of encoding '64FC4' are not supported; those are: 16UC1, 32FC1, 8UC1" in answer[0]


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/streams",
        "/stream_viewer?topic=/jpeg",
        "/nothing",
        "/stream",
        "/stream?topic=/nothing",
        "/snapshot?topic=/nothing",
    ],
)
def test_head_answers_as_get_without_content(client: VideoClient, path: str) -> None:
    status, content, headers = client.get(path)
    head_status, nothing, head_headers = client.get(path, "HEAD")
    assert (head_status, nothing) == (status, b"")
    for name in ("Content-Type", "Content-Length", "Cache-Control"):
        assert head_headers[name] == headers[name]
    assert len(content) == int(headers["Content-Length"])


def test_head_of_a_stream_ends_at_once(graph: PublishedImages, client: VideoClient) -> None:
    status, nothing, headers = client.get("/stream?topic=/jpeg", "HEAD")
    assert (status, nothing) == (200, b"")
    assert headers["Content-Type"].startswith("multipart/x-mixed-replace")
    wait_until(lambda: watched(graph) == 0, "the end of the subscription")


def test_cameras_are_listed_with_their_rate(graph: PublishedImages, client: VideoClient) -> None:
    idle = {"clients": 0, "fps": None, "age_s": None}
    assert client.json("/streams") == [{"topic": "/jpeg", "jpeg": True, **idle}, {"topic": "/raw", "jpeg": False, **idle}]
    stream = client.stream("/stream?topic=/jpeg")
    began_s = time.monotonic()
    for _ in range(10):
        graph.publish(JPEG)
        stream.image()
        time.sleep(0.01)
    row = client.json("/streams")[0]
    whole_s = time.monotonic() - began_s
    assert row["clients"] == 1 and 9 / whole_s - 0.1 < row["fps"] < 101 and 0 <= row["age_s"] < whole_s + 0.01


def test_html_pages_escape_topic_names(graph: PublishedImages, client: VideoClient) -> None:
    graph.topics["/<script>alert(1)</script>"] = [IMAGE]
    page = client.text("/")
    assert "stream?topic=/jpeg" in page and "<script>" not in page
    assert "stream?topic=/raw&amp;width=32" in client.text("/stream_viewer?topic=/raw&width=32")
    status, _, headers = client.get("/stream?topic=/%3Cscript%3E")
    assert status == 400 and headers["Content-Type"].startswith("text/plain") and headers["X-Content-Type-Options"] == "nosniff"


@pytest.mark.parametrize(
    ("path", "status", "reason"),
    [
        ("/stream", 400, "/streams lists the cameras"),
        ("/stream?topic=/jpeg&quality=0.5", 400, "quality must be a whole number from 1 to 100"),
        ("/stream?topic=/jpeg&" + "&".join(f"a{n}" for n in range(30)), 400, "fields"),
        ("/stream?topic=/nothing", 404, "cameras: /jpeg, /raw"),
        ("/snapshot?topic=/nothing", 404, "cameras: /jpeg, /raw"),
        ("/etc/passwd", 404, "there are /stream"),
    ],
)
def test_refusals_name_the_valid_choices(client: VideoClient, path: str, status: int, reason: str) -> None:
    assert reason in client.text(path, status)


def test_graph_that_does_not_respond_is_reported(graph: PublishedImages, client: VideoClient) -> None:
    graph.silent = True
    for path in ("/stream?topic=/jpeg", "/snapshot?topic=/jpeg", "/streams"):
        assert "has not responded" in client.text(path, 504)


@pytest.mark.parametrize("damaged", [b"", b"\xff\xd8", b"\x89PNG damaged", bytes(5000)])
def test_damaged_images_are_skipped_and_logged_once(
    graph: PublishedImages, client: VideoClient, warnings: list[str], damaged: bytes
) -> None:
    stream = client.stream("/stream?topic=/jpeg")
    for _ in range(3):
        graph.publish(damaged)
    wait_until(lambda: warnings, "a warning")
    assert "error" in client.json("/streams")[0]
    graph.publish(JPEG, 9)
    assert stream.image() == (JPEG, 9)
    assert len(warnings) == 1 and "error" not in client.json("/streams")[0]


def test_malformed_messages_are_reported(graph: PublishedImages, client: VideoClient, warnings: list[str]) -> None:
    streams = [client.stream(f"/stream?topic={topic}") for topic in ("/jpeg", "/raw")]
    for receive in graph.subscriptions.values():
        receive(b"\0\1\0\0no message")
    wait_until(lambda: len(warnings) == 2, "two warnings")
    graph.publish_raw(3, encoding="rgb32")
    wait_until(lambda: any("'rgb32' are not supported" in warning for warning in warnings), "a third")
    graph.publish(JPEG, 4)
    graph.publish_raw(4)
    assert [stream.image()[1] for stream in streams] == [4, 4]


def test_client_without_a_request_is_disconnected(server: VideoHttpServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_server, "REQUEST_TIMEOUT_S", 0.5)
    slow = socket.create_connection(("127.0.0.1", server.port), timeout=60)
    slow.sendall(b"GET /streams HTTP/1.1\r\n")

    def drip() -> bool:
        """Send another line before the handler's own timeout; return whether the connection was closed."""
        try:
            slow.sendall(b"X: y\r\n")
        except OSError:
            return True
        return False

    wait_until(drip, "the end of the connection")
    slow.close()


def test_connections_per_address_are_limited(graph: PublishedImages, server: VideoHttpServer) -> None:
    client = VideoClient(server.port)
    for _ in range(http_server.MAX_CONNECTIONS_PER_ADDRESS):
        client.stream("/stream?topic=/jpeg")
    with pytest.raises((ConnectionError, OSError)):
        VideoClient(server.port).get("/streams")
    client.close()
    wait_until(lambda: watched(graph) == 0, "the end of the streams")
    assert VideoClient(server.port).json("/streams")


@pytest.mark.parametrize(
    "request_",
    [
        b"\r\n\r\n",
        b"GET\r\n\r\n",
        b"GET /stream?topic=%ff HTTP/1.1\r\n\r\n",
        b"GET http://[ HTTP/1.1\r\n\r\n",
        b"POST / HTTP/1.1\r\n\r\n",
        b"GET /" + b"a" * 70_000 + b" HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 200 + b"\r\n",
        b"\x16\x03\x01\0\0" * 20 + b"\r\n",
    ],
)
def test_hostile_requests_end_without_a_traceback(
    server: VideoHttpServer, request_: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as hostile:
        hostile.sendall(request_)
        hostile.shutdown(socket.SHUT_WR)
        answer = b""
        try:
            while data := hostile.recv(65536):
                answer += data
        except ConnectionResetError:
            pass
    assert b" 200 " not in answer
    assert VideoClient(server.port).json("/streams")
    assert "Traceback" not in capfd.readouterr().err


def test_stopping_the_server_ends_its_streams(graph: PublishedImages, server: VideoHttpServer, client: VideoClient) -> None:
    stream = client.stream("/stream?topic=/jpeg")
    server.stop()
    with pytest.raises(EOFError):
        stream.image()
    wait_until(lambda: watched(graph) == 0, "the end of the subscription")
