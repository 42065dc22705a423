"""Video: 640 × 480 pixels at 30 frames per second to four browsers, through the console and from the video server.

A camera publishes pictures like photographs, as JPEG or raw. CPU time is that of the video server and the console together.
With --suite, a checkout of rosbridge_suite, the JPEG pictures are also sent to four of its clients as messages, as pages
without a video server get them.
"""

from __future__ import annotations

import http.client
import json
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil

from bench.peers import rosbridge_suite
from bench.processes import child_command, private_graph, terminate
from bench.runner import Figures, Seconds, Suite, benchmark
from bench.server_rig import CAMERA_TOPIC, send, server_rig
from lupin_runtime import graph
from lupin_runtime.cameras.mjpeg import PartReader

CLIENTS = 4
FPS = 30.0
SETTLE_S = 3.0
_CAMERA = graph.BODY_IMAGE_ROBOT


# -- the measured processes ---------------------------------------------------------------------------------------------
def serve(make_node: Callable[[], Any]) -> int:
    """Run a node, and print its port once it listens."""
    from lupin_runtime.ros import run

    return run([make_node], ready=lambda nodes: print(nodes[0].port, flush=True))


def serve_video() -> int:
    """Run the video server."""
    from lupin_runtime.cameras.node import VideoServer

    return serve(lambda: VideoServer({"port": 0}))


def serve_console(video_port: int) -> int:
    """Run the console."""
    from lupin_runtime.console.node import Console

    return serve(lambda: Console({"port": 0, "rosbridge_port": 0, "video_target": f"http://127.0.0.1:{video_port}"}))


def publish_pictures(kind: str) -> int:
    """Publish `jpeg` or `raw` pictures, stamped with the wall clock, until the process is terminated."""
    import rclpy
    from sensor_msgs.msg import CompressedImage, Image

    from lupin_runtime.ros import LupinNode

    rclpy.init(args=[])
    node = LupinNode("camera")
    # Noise on smooth shapes compresses to about as much as a photograph of a room: 40 kB.
    noise = np.random.default_rng(0).normal(0, 6, (480, 640, 3))
    shapes = 90 + 60 * np.sin(np.arange(640) / 37)[None, :, None] + 50 * np.cos(np.arange(480) / 23)[:, None, None]
    pixels = np.clip(shapes + noise, 0, 255).astype(np.uint8)
    if kind == "raw":
        publisher = node.publisher(_CAMERA)
        message: Any = Image(height=480, width=640, encoding="rgb8", step=1920, data=pixels.tobytes())
    else:
        publisher = node.publisher(CAMERA_TOPIC)
        message = CompressedImage(format="jpeg", data=bytes(cv2.imencode(".jpg", pixels, (cv2.IMWRITE_JPEG_QUALITY, 75))[1]))
    due_s = time.monotonic()
    while True:
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(time.time_ns(), 1_000_000_000)
        publisher.publish(message)
        due_s += 1.0 / FPS
        time.sleep(max(0.0, due_s - time.monotonic()))


# -- the rig ------------------------------------------------------------------------------------------------------------
class VideoRig:
    """A video server, a console in front of it, and a camera, on a private graph."""

    def __init__(self, environment: dict[str, str], exits: ExitStack) -> None:
        self._environment, self._exits = environment, exits
        self.video_port, video = self._start_server(serve_video)
        self.console_port, console = self._start_server(serve_console, video_port=self.video_port)
        self._servers = (psutil.Process(video.pid), psutil.Process(console.pid))

    def start_camera(self, kind: str) -> None:
        """Start the camera, and wait until the video server lists it."""
        self._start(publish_pictures, kind=kind)
        deadline_s = time.monotonic() + 20.0
        while not self._listed_cameras():
            if time.monotonic() > deadline_s:
                raise SystemExit("the video server did not find the camera within 20 s")
            time.sleep(0.1)

    def cpu_s(self) -> float:
        """Return the CPU time that both servers have used."""
        return sum(sum(each.cpu_times()[:2]) for each in self._servers)

    def _listed_cameras(self) -> Any:
        connection = http.client.HTTPConnection("127.0.0.1", self.console_port, timeout=20)
        try:
            connection.request("GET", "/_video/streams")
            return json.loads(connection.getresponse().read())
        finally:
            connection.close()

    def _start_server(self, function: Callable[..., int], **arguments: Any) -> tuple[int, subprocess.Popen[str]]:
        process = self._start(function, **arguments)
        assert process.stdout is not None  # it is a pipe
        return int(process.stdout.readline()), process

    def _start(self, function: Callable[..., int], **arguments: Any) -> subprocess.Popen[str]:
        command, pipe, null = child_command(function, **arguments), subprocess.PIPE, subprocess.DEVNULL
        process = subprocess.Popen(command, env=self._environment, stdout=pipe, stderr=null, text=True)
        self._exits.callback(terminate, process, 20.0)
        return process


@contextmanager
def video_rig() -> Iterator[VideoRig]:
    """Start a VideoRig, and stop it after the block."""
    with private_graph() as environment, ExitStack() as exits:
        yield VideoRig(environment, exits)


class Watcher(threading.Thread):
    """A browser that watches a stream, and records the age of each picture at its arrival."""

    def __init__(self, port: int, path: str) -> None:
        super().__init__(daemon=True)
        self.delays_ms: list[float] = []
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
        self._connection.request("GET", f"{path}?topic={_CAMERA.name}")
        self._response = self._connection.getresponse()
        if self._response.status != 200:
            raise SystemExit(f"no stream: {self._response.read().decode()}")
        self.start()

    def run(self) -> None:
        """Read pictures until the stream ends."""
        reader = PartReader()
        with suppress(http.client.HTTPException, ConnectionError):  # the servers are terminated while it reads
            while data := self._response.read1(1 << 16):
                for _, stamp_ns in reader.feed(data):
                    self.delays_ms.append((time.time_ns() - stamp_ns) / 1e6)


def watch(kind: str, through_console: bool, seconds: float) -> dict[str, float]:
    """Measure the delay of the pictures, and the servers' CPU time, while four browsers watch a camera."""
    with video_rig() as servers:
        servers.start_camera(kind)
        port, path = (servers.console_port, "/_video/stream") if through_console else (servers.video_port, "/stream")
        watchers = [Watcher(port, path) for _ in range(CLIENTS)]
        time.sleep(SETTLE_S)
        for watcher in watchers:
            watcher.delays_ms.clear()
        before_s, began_s = servers.cpu_s(), time.monotonic()
        time.sleep(seconds)
        elapsed_s, used_s = time.monotonic() - began_s, servers.cpu_s() - before_s
        delays_ms = [delay for watcher in watchers for delay in watcher.delays_ms]
        return {
            "one_core_percent": 100.0 * used_s / elapsed_s,
            "delay_median_ms": statistics.median(delays_ms),
            "delay_p99_ms": statistics.quantiles(delays_ms, n=100)[98],
            "fps": len(delays_ms) / elapsed_s / CLIENTS,
            "pictures_per_cpu_s": len(delays_ms) / used_s,
        }


def suite_pictures(seconds: float, suite: Path) -> dict[str, float]:
    """Measure rosbridge_suite while four of its clients receive the same JPEG pictures as messages."""
    with server_rig(rosbridge_suite.server_command(suite)) as server:
        clients = [server.connect_client() for _ in range(CLIENTS)]
        server.start_process(publish_pictures, kind="jpeg")
        for client in clients:
            send(client, "subscribe", topic=CAMERA_TOPIC.name, type=CAMERA_TOPIC.type, queue_length=1)
            client.recv(timeout=20.0)
        time.sleep(SETTLE_S)
        counts: list[int] = []
        stop_s = time.monotonic() + seconds
        before_s = server.cpu_s()

        def count(client: Any) -> None:
            number = 0
            while time.monotonic() < stop_s:
                client.recv(timeout=20.0)
                number += 1
            counts.append(number)

        readers = [threading.Thread(target=count, args=(client,)) for client in clients]
        for reader in readers:
            reader.start()
        for reader in readers:
            reader.join()
        return {"pictures_per_cpu_s": sum(counts) / (server.cpu_s() - before_s)}


@benchmark(at_most={"one_core_percent": 15.0, "delay_median_ms": 60.0})
def main(seconds: Seconds = 10.0, suite: Suite = None) -> Figures:
    """Measure every case."""
    if suite and (problem := rosbridge_suite.missing(suite)):
        raise SystemExit(problem)
    figures = {
        f"{kind}, {'console' if through_console else 'video server'}": watch(kind, through_console, seconds)
        for kind in ("jpeg", "raw")
        for through_console in (True, False)
    }
    if suite:
        ours = figures["jpeg, console"]["pictures_per_cpu_s"]
        peer = suite_pictures(seconds, suite)
        figures["jpeg, rosbridge_suite"] = {**peer, "lupin_times_as_many": ours / peer["pictures_per_cpu_s"]}
    return {"watched": figures}


if __name__ == "__main__":
    sys.exit(main())
