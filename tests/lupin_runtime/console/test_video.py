"""`/_video` on port 8090: a video server's images, forwarded to paired browsers."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime.cameras.http_server import VideoHttpServer
from lupin_runtime.cameras.video_streams import VideoStreams
from lupin_runtime.console.authority import Role
from lupin_runtime.console.sessions import Sessions
from tests.support.console_browser import Browser
from tests.support.image_messages import gradient, jpeg
from tests.support.published_images import PublishedImages
from tests.support.video_client import VideoClient

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

JPEG = jpeg(gradient())
Serve = Callable[[str], "Console"]


@pytest.fixture
def images() -> PublishedImages:
    return PublishedImages()


@pytest.fixture
def server(images: PublishedImages) -> Iterator[VideoHttpServer]:
    """A robot's video server."""
    made = VideoHttpServer("127.0.0.1", 0, VideoStreams(images, lambda _: None))
    made.start()
    yield made
    made.stop()


@pytest.fixture
def serve(graph_host: GraphHost, tmp_path: Path) -> Iterator[Serve]:
    """Starts consoles that take the images from a URL."""
    from lupin_runtime.console.node import Console

    nodes: list[Console] = []

    def start(target: str) -> Console:
        files = {"folder": str(tmp_path), "sessions_file": str(tmp_path / "sessions.json")}
        nodes.append(graph_host.add(Console({"port": 0, "rosbridge_port": 0, "video_target": target, **files})))
        return nodes[-1]

    yield start
    for node in nodes:
        node.before_shutdown()


@pytest.fixture
def console(serve: Serve, server: VideoHttpServer) -> Console:
    return serve(f"http://127.0.0.1:{server.port}")


@pytest.fixture
def client(console: Console) -> Iterator[VideoClient]:
    """A client on this computer."""
    made = VideoClient(console.port, "/_video")
    yield made
    made.close()


def clients_of(server: VideoHttpServer) -> int:
    return sum(row["clients"] for row in server.streams.describe())


def test_images_cross_the_link_once_for_all_browsers(
    graph_host: GraphHost, server: VideoHttpServer, images: PublishedImages, client: VideoClient
) -> None:
    streams = [client.stream("/stream?topic=/jpeg") for _ in range(4)]
    for number in range(1, 4):
        images.publish(JPEG, number)
        assert {stream.image() for stream in streams} == {(JPEG, number)}
    assert clients_of(server) == 1
    client.close()
    graph_host.until(lambda: clients_of(server) == 0, what="the end of the stream with its last browser")
    assert not images.subscriptions


def test_another_address_ends_the_streams_of_the_first(
    graph_host: GraphHost, console: Console, server: VideoHttpServer, images: PublishedImages, client: VideoClient
) -> None:
    other_images = PublishedImages()
    other = VideoHttpServer("127.0.0.1", 0, VideoStreams(other_images, lambda _: None))
    other.start()
    try:
        client.stream("/stream?topic=/jpeg")
        browser = Browser(console.port)
        browser.post("/_api/settings", settings={"webVideoServerUrl": f"http://127.0.0.1:{other.port}/"})
        graph_host.until(lambda: clients_of(server) == 0, what="the end of the first server's stream")
        stream = client.stream("/stream?topic=/jpeg")
        other_images.publish(JPEG, 7)
        assert stream.image() == (JPEG, 7)
        browser.post("/_api/settings", settings={"webVideoServerUrl": ""})
        graph_host.until(lambda: clients_of(other) == 0, what="the end of the other server's stream")
        images.publish(JPEG, 8)
        assert client.get("/streams")[0] == 200
    finally:
        other.stop()


def test_browsers_that_join_and_leave_quickly_leave_nothing(
    graph_host: GraphHost, console: Console, server: VideoHttpServer, images: PublishedImages
) -> None:
    def visit() -> None:
        for _ in range(15):
            client = VideoClient(console.port, "/_video")
            client.stream("/stream?topic=/jpeg")
            client.close()

    visitors = [threading.Thread(target=visit) for _ in range(3)]
    for visitor in visitors:
        visitor.start()
    while any(visitor.is_alive() for visitor in visitors):
        images.publish(JPEG)
        time.sleep(0.002)
    graph_host.until(lambda: clients_of(server) == 0, what="the end of all streams")


def test_browser_that_never_reads_slows_nobody_down(
    graph_host: GraphHost, console: Console, server: VideoHttpServer, images: PublishedImages, client: VideoClient
) -> None:
    with socket.create_connection(("127.0.0.1", console.port)) as stuck:
        stuck.sendall(b"GET /_video/stream?topic=/jpeg HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        graph_host.until(lambda: clients_of(server) == 1)
        reader = client.stream("/stream?topic=/jpeg")
        for number in range(1, 60):
            images.publish(JPEG + bytes(500_000), number)
            assert reader.image()[1] == number


def test_snapshots_and_camera_list_are_forwarded(images: PublishedImages, client: VideoClient) -> None:
    assert [row["topic"] for row in client.json("/streams")] == ["/jpeg", "/raw"]
    stop = threading.Event()

    def publish() -> None:
        while not stop.wait(0.01):
            images.publish(JPEG, 5_000_000_006)

    publishing = threading.Thread(target=publish)
    publishing.start()
    status, content, headers = client.get("/snapshot?topic=/jpeg")
    stop.set()
    publishing.join()
    assert (status, content, headers["X-Timestamp"]) == (200, JPEG, "5.000000006")
    assert headers["Content-Type"] == "image/jpeg" and headers["Cross-Origin-Resource-Policy"] == "same-origin"


@pytest.mark.parametrize("path", ["/streams", "/stream?topic=/jpeg", "/stream?topic=/nothing", "/snapshot?topic=/nothing"])
def test_head_answers_as_get(client: VideoClient, images: PublishedImages, graph_host: GraphHost, path: str) -> None:
    status, content, headers = client.get(path, "HEAD")
    assert (status, content) == (404 if "nothing" in path else 200, b"")
    assert headers["Cache-Control"] == "no-store"
    graph_host.until(lambda: not images.subscriptions, what="the end of the stream")


@pytest.mark.parametrize("path", ["/streams", "/snapshot?topic=/jpeg", "/stream?topic=/jpeg"])
def test_images_are_only_for_paired_browsers_and_own_page(console: Console, server: VideoHttpServer, path: str) -> None:
    unpaired = VideoClient(console.port, "/_video", {"X-Forwarded-For": "192.0.2.7"})
    assert "not paired" in unpaired.text(path, 401)
    for site in ("cross-site", "same-site"):
        assert "other sites" in VideoClient(console.port, "/_video", {"Sec-Fetch-Site": site}).text(path, 403)
    assert "this server is not evil.example" in VideoClient(console.port, "/_video", {"Host": "evil.example"}).text(path, 421)
    assert clients_of(server) == 0


def test_stream_ends_when_its_session_is_revoked(
    graph_host: GraphHost, console: Console, images: PublishedImages, tmp_path: Path
) -> None:
    phone = Browser(console.port, proxied=True)
    code = json.loads((tmp_path / "console.json").read_text())["codes"][Role.VIEWER.value]
    assert phone.post("/_api/pair", code=code)["role"] == "viewer"
    client = VideoClient(console.port, "/_video", phone.headers)
    stream = client.stream("/stream?topic=/jpeg")
    images.publish(JPEG)
    stream.image()
    Sessions(tmp_path / "sessions.json").revoke("phone-1")
    with pytest.raises(EOFError):
        stream.image()
    graph_host.until(lambda: not images.subscriptions, what="the end of the stream")


@pytest.mark.parametrize(
    ("path", "status", "reason"),
    [
        ("/stream", 400, "/streams lists the cameras"),
        ("/stream?topic=/jpeg&width=1", 400, "width must be a whole number"),
        ("/stream?topic=/nothing", 404, "cameras: /jpeg, /raw"),
        ("/snapshot?topic=/nothing", 404, "cameras: /jpeg, /raw"),
    ],
)
def test_refusals_are_forwarded(client: VideoClient, path: str, status: int, reason: str) -> None:
    assert reason in client.text(path, status)


def test_stream_can_be_reopened_after_robot_returns(
    server: VideoHttpServer, images: PublishedImages, client: VideoClient
) -> None:
    stream = client.stream("/stream?topic=/jpeg")
    images.publish(JPEG, 1)
    stream.image()
    port = server.port
    server.stop()
    with pytest.raises(EOFError):
        stream.image()
    for path in ("/stream?topic=/jpeg", "/snapshot?topic=/jpeg", "/streams"):
        assert f"no video from http://127.0.0.1:{port}" in client.text(path, 502)
    again = VideoHttpServer("127.0.0.1", port, VideoStreams(images, lambda _: None))
    again.start()
    try:
        stream = client.stream("/stream?topic=/jpeg")
        images.publish(JPEG, 2)
        assert stream.image() == (JPEG, 2)
    finally:
        again.stop()


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"SSH-2.0-OpenSSH_9.2\r\n",
        b"HTTP/1.1 302 Found\r\nLocation: http://127.0.0.1:1/\r\n\r\n",
        b"HTTP/1.1 500 Oops\r\nContent-Length: 3\r\n\r\nbad",
        b"HTTP/1.1 200 OK\r\nContent-Length: 3\r\n\r\nbad",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nzz",
        b"HTTP/1.1 200 OK\r\n\r\n" + b"[" * 100_000,
    ],
)
def test_other_server_at_the_video_port_is_reported(serve: Serve, answer: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as impostor:

        def reply() -> None:
            while True:
                try:
                    connection, _ = impostor.accept()
                except OSError:
                    return
                with connection:
                    connection.recv(65536)
                    connection.sendall(answer)

        threading.Thread(target=reply, daemon=True).start()
        client = VideoClient(serve(f"http://127.0.0.1:{impostor.getsockname()[1]}").port, "/_video")
        for path in ("/streams", "/snapshot?topic=/jpeg", "/stream?topic=/jpeg"):
            assert "127.0.0.1" in client.text(path, 502)
        impostor.shutdown(socket.SHUT_RDWR)
    assert "Traceback" not in capfd.readouterr().err


def test_request_to_silent_video_server_times_out(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    from lupin_runtime.console import video

    monkeypatch.setattr(video, "_ANSWER_TIMEOUT_S", 0.5)
    monkeypatch.setattr(video, "_SILENCE_TIMEOUT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        client = VideoClient(serve(f"http://127.0.0.1:{silent.getsockname()[1]}").port, "/_video")
        for path in ("/streams", "/snapshot?topic=/jpeg", "/stream?topic=/jpeg"):
            assert "does not respond" in client.text(path, 504)


def test_number_of_streams_that_cross_the_link_is_limited(
    graph_host: GraphHost, server: VideoHttpServer, client: VideoClient
) -> None:
    from lupin_runtime.console import video

    streams = [client.stream(f"/stream?topic=/jpeg&quality={quality}") for quality in range(1, video.MAX_UPSTREAMS + 1)]
    assert "8 other streams are being watched" in client.text("/stream?topic=/jpeg&quality=99", 503)
    streams.append(client.stream("/stream?topic=/jpeg&quality=1"))
    assert clients_of(server) == video.MAX_UPSTREAMS
    client.close()
    graph_host.until(lambda: clients_of(server) == 0, what="the end of all streams")
    assert client.stream("/stream?topic=/jpeg&quality=99")


def test_number_of_browsers_is_limited(client: VideoClient, monkeypatch: pytest.MonkeyPatch) -> None:
    from lupin_runtime.console import video

    monkeypatch.setattr(video, "MAX_CLIENTS", 2)
    streams: list[Any] = [client.stream("/stream?topic=/jpeg") for _ in range(2)]
    assert "2 browsers are already watching" in client.text("/stream?topic=/jpeg", 503)
    assert streams
