"""The streams that clients watch: one subscription per camera, and one encoding per wish, whatever the number of clients.

A camera's subscription begins with its first client and ends with its last.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

from lupin_runtime.cameras.frames import NewestFrame
from lupin_runtime.cameras.image_message import MalformedImage, read_compressed, read_image
from lupin_runtime.cameras.jpeg import DEFAULT_QUALITY, UnsupportedPicture, encode, is_jpeg, transcode
from lupin_runtime.cameras.stream_request import Source, StreamRequest, cameras, choose_source

_RATE_FRAMES = 30  # that a rate is measured over
_WORKER_WAIT_S = 1.0


class GraphSilent(RuntimeError):
    """The graph does not respond."""


class Cameras(Protocol):
    """The graph, as the streams need it. The methods raise GraphSilent."""

    def publishers(self) -> Mapping[str, Sequence[str]]:
        """The topics that have a publisher, with their types."""

    def subscribe(self, source: Source, receive: Callable[[bytes], None]) -> Callable[[], None]:
        """Receive a topic's serialized messages, on any thread, until the returned function is called, which never waits."""


class VideoStreams:
    """All methods may be called on any thread; they wait for the graph, which bounds each of its answers."""

    def __init__(self, graph: Cameras, warn: Callable[[str], None]) -> None:
        self._graph = graph
        self._warn = warn
        # Held while a subscription begins or ends. Whoever receives messages never takes it.
        self._lock = threading.Lock()
        self._feeds: dict[Source, _Feed] = {}

    @contextmanager
    def watch(self, request: StreamRequest) -> Iterator[NewestFrame]:
        """The frames that a request asks for. Raises NoSuchCamera and GraphSilent."""
        source = choose_source(request, self._graph.publishers())
        with self._lock:
            feed = self._feeds.get(source)
            if feed is None:
                feed = _Feed(source, self._warn)
                feed.leave = self._graph.subscribe(source, feed.receive)
                self._feeds[source] = feed
            view = feed.join(request)
        try:
            yield view.frames
        finally:
            with self._lock:
                feed.part(request)
                if not feed.views:
                    del self._feeds[source]
                    feed.leave()

    def close(self) -> None:
        """Wake all who wait for a frame of a stream that is open; none follows."""
        with self._lock:
            for feed in self._feeds.values():
                for view in feed.views.values():
                    view.close()

    def describe(self) -> list[dict[str, Any]]:
        """The cameras of the graph: topic, whether they publish JPEG, and of those that are watched, clients and rate."""
        publishers = self._graph.publishers()
        rows = []
        for topic in cameras(publishers):
            source = choose_source(StreamRequest(topic), publishers)
            row: dict[str, Any] = {"topic": topic, "jpeg": source.compressed, "clients": 0, "fps": None, "age_s": None}
            feed = self._feeds.get(source)
            rows.append(row if feed is None else {**row, **feed.describe()})
        return rows


class _Feed:
    """One camera's messages, and the views of them that clients watch."""

    def __init__(self, source: Source, warn: Callable[[str], None]) -> None:
        self.source = source
        self.leave: Callable[[], None] = lambda: None
        self.views: dict[StreamRequest, _View] = {}
        self._warn = warn
        self._watched: tuple[_View, ...] = ()  # replaced as a whole, because `receive` takes no lock
        self._received_s: list[float] = []

    def join(self, request: StreamRequest) -> _View:
        view = self.views.get(request)
        if view is None:
            view = self.views[request] = _View(self.source, request, self._warn)
            self._watched = tuple(self.views.values())
        view.clients += 1
        return view

    def part(self, request: StreamRequest) -> None:
        view = self.views[request]
        view.clients -= 1
        if not view.clients:
            del self.views[request]
            self._watched = tuple(self.views.values())
            view.close()

    def receive(self, message: bytes) -> None:
        self._received_s = [*self._received_s[-_RATE_FRAMES:], time.monotonic()]
        for view in self._watched:
            view.receive(message)

    def describe(self) -> dict[str, Any]:
        times_s = self._received_s
        fps = None
        if len(times_s) > 1 and times_s[-1] > times_s[0]:
            fps = round((len(times_s) - 1) / (times_s[-1] - times_s[0]), 1)
        errors = [view.error for view in self._watched if view.error]
        return {
            "clients": sum(view.clients for view in self._watched),
            "fps": fps,
            "age_s": round(time.monotonic() - times_s[-1], 2) if times_s else None,
            **({"error": errors[0]} if errors else {}),
        }


class _View:
    """One camera's frames in the quality and width that some clients asked for.

    Pictures that need work are encoded on a thread of the view, the newest first, so that a camera is never held up.
    """

    def __init__(self, source: Source, request: StreamRequest, warn: Callable[[str], None]) -> None:
        self.frames = NewestFrame()
        self.clients = 0
        self.error = ""  # why the last message gave no frame
        self._source, self._request, self._warn = source, request, warn
        self._messages = NewestFrame()
        self._worker: threading.Thread | None = None
        self._closed = False

    def receive(self, message: bytes) -> None:
        if self._source.compressed and self._request.unchanged and self._pass_on(message):
            return
        if self._worker is None:
            self._worker = threading.Thread(target=self._work, name=f"encode {self._source.topic}", daemon=True)
            self._worker.start()
        self._messages.put(message)

    def close(self) -> None:
        self._closed = True
        self._messages.close()
        self.frames.close()

    def _pass_on(self, message: bytes) -> bool:
        """Pass a JPEG picture on as it is; False where it is none."""
        try:
            picture = read_compressed(message)
        except MalformedImage as error:
            self._note(str(error))
            return True
        if not is_jpeg(picture.data):
            return False
        self.error = ""
        self.frames.put(bytes(picture.data), picture.stamp_ns)
        return True

    def _work(self) -> None:
        number = 0
        while not self._closed:
            message = self._messages.after(number, _WORKER_WAIT_S)
            if message is None:
                continue
            number = message.number
            try:
                jpeg, stamp_ns = self._encoded(message.data)
            except (MalformedImage, UnsupportedPicture) as error:
                self._note(str(error))
                continue
            self.error = ""
            self.frames.put(jpeg, stamp_ns)

    def _encoded(self, message: bytes) -> tuple[bytes, int]:
        quality, request = self._request.quality or DEFAULT_QUALITY, self._request
        if self._source.compressed:
            picture = read_compressed(message)
            return transcode(picture.data, quality, request.width_px, request.rotated), picture.stamp_ns
        image = read_image(message)
        return encode(image, quality, request.width_px, request.rotated), image.stamp_ns

    def _note(self, error: str) -> None:
        """Log an error once, until a frame comes or another error."""
        if error != self.error:
            self._warn(f"{self._source.topic} is not shown: {error}")
        self.error = error
