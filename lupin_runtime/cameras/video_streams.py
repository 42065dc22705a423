"""The streams that clients watch. Any number of clients share one subscription per camera and one encoding per request.

A camera is subscribed to only while it has clients.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

from lupin_runtime.cameras.frames import NewestFrame
from lupin_runtime.cameras.image_message import MalformedImage, read_compressed, read_image
from lupin_runtime.cameras.jpeg import DEFAULT_QUALITY, UnsupportedImage, encode, is_jpeg, transcode
from lupin_runtime.cameras.stream_request import Source, StreamRequest, cameras, choose_source

_RATE_FRAMES = 30  # the frame rate is measured over this many intervals
_WORKER_CHECK_PERIOD_S = 1.0


class GraphSilent(RuntimeError):
    """The graph does not respond."""


class Cameras(Protocol):
    """The part of the graph that the streams need. The methods raise GraphSilent."""

    def publishers(self) -> Mapping[str, Sequence[str]]:
        """Return the image topics that have a publisher, with their types."""

    def subscribe(self, source: Source, receive: Callable[[bytes], None]) -> Callable[[], None]:
        """Call `receive`, on any thread, with a topic's serialized messages until the returned function is called.

        That function does not block.
        """


class VideoStreams:
    """All methods may be called on any thread. They wait for the graph, each time for a limited time only."""

    def __init__(self, graph: Cameras, warn: Callable[[str], None]) -> None:
        self._graph = graph
        self._warn = warn
        # Held while a subscription is opened or closed. Threads that receive messages never take it.
        self._lock = threading.Lock()
        self._feeds: dict[Source, _Feed] = {}

    @contextmanager
    def watch(self, request: StreamRequest) -> Iterator[View]:
        """Provide the frames that match a request. Raises NoSuchCamera and GraphSilent."""
        source = choose_source(request, self._graph.publishers())
        with self._lock:
            feed = self._feeds.get(source)
            if feed is None:
                feed = _Feed(source, self._warn)
                feed.unsubscribe = self._graph.subscribe(source, feed.receive)
                self._feeds[source] = feed
            view = feed.join(request)
        try:
            yield view
        finally:
            with self._lock:
                feed.leave(request)
                if not feed.views:
                    del self._feeds[source]
                    feed.unsubscribe()

    def close(self) -> None:
        """Wake all threads that wait for a frame of an open stream; no more frames follow."""
        with self._lock:
            for feed in self._feeds.values():
                for view in feed.views.values():
                    view.close()

    def describe(self) -> list[dict[str, Any]]:
        """List the cameras on the graph: topic, whether it publishes JPEG, and if it is watched, clients, rate and age."""
        publishers = self._graph.publishers()
        rows = []
        for topic in cameras(publishers):
            source = choose_source(StreamRequest(topic), publishers)
            row: dict[str, Any] = {"topic": topic, "jpeg": source.compressed, "clients": 0, "fps": None, "age_s": None}
            feed = self._feeds.get(source)
            rows.append(row if feed is None else {**row, **feed.describe()})
        return rows


class _Feed:
    """One camera's subscription, and the views of it that clients watch."""

    def __init__(self, source: Source, warn: Callable[[str], None]) -> None:
        self.source = source
        self.unsubscribe: Callable[[], None] = lambda: None
        self.views: dict[StreamRequest, View] = {}
        self._warn = warn
        self._watched: tuple[View, ...] = ()  # replaced as a whole, because `receive` takes no lock
        self._received_s: list[float] = []

    def join(self, request: StreamRequest) -> View:
        view = self.views.get(request)
        if view is None:
            view = self.views[request] = View(self.source, request, self._warn)
            self._watched = tuple(self.views.values())
        view.clients += 1
        return view

    def leave(self, request: StreamRequest) -> None:
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


class View:
    """One camera's frames in one quality, width and orientation, as some clients asked for; `error` if it cannot be shown.

    Images that must be encoded are encoded on the view's own thread. It skips to the newest, so that no messages pile up.
    """

    def __init__(self, source: Source, request: StreamRequest, warn: Callable[[str], None]) -> None:
        self.frames = NewestFrame()
        self.clients = 0
        self.error = ""  # why the last message yielded no frame
        self._source, self._request, self._warn = source, request, warn
        self._messages = NewestFrame()
        self._worker: threading.Thread | None = None
        self._closed = False

    def receive(self, message: bytes) -> None:
        """Take a serialized message."""
        if self._source.compressed and self._request.unchanged and self._pass_on(message):
            return
        if self._worker is None:
            self._worker = threading.Thread(target=self._work, name=f"encode {self._source.topic}", daemon=True)
            self._worker.start()
        self._messages.put(message)

    def close(self) -> None:
        """End the view: whoever waits for a frame goes on."""
        self._closed = True
        self._messages.close()
        self.frames.close()

    def _pass_on(self, message: bytes) -> bool:
        """Forward a JPEG image unchanged. Return False if the image is not JPEG; malformed messages are dropped."""
        try:
            image = read_compressed(message)
        except MalformedImage as error:
            self._note(str(error))
            return True
        if not is_jpeg(image.data):
            return False
        self.error = ""
        self.frames.put(bytes(image.data), image.stamp_ns)
        return True

    def _work(self) -> None:
        number = 0
        while not self._closed:
            message = self._messages.after(number, _WORKER_CHECK_PERIOD_S)
            if message is None:
                continue
            number = message.number
            try:
                jpeg, stamp_ns = self._encoded(message.data)
            except (MalformedImage, UnsupportedImage) as error:
                self._note(str(error))
                continue
            self.error = ""
            self.frames.put(jpeg, stamp_ns)

    def _encoded(self, message: bytes) -> tuple[bytes, int]:
        quality, request = self._request.quality or DEFAULT_QUALITY, self._request
        if self._source.compressed:
            encoded = read_compressed(message)
            return transcode(encoded.data, quality, request.width_px, request.rotated), encoded.stamp_ns
        image = read_image(message)
        return encode(image, quality, request.width_px, request.rotated), image.stamp_ns

    def _note(self, error: str) -> None:
        """Store an error, and log it unless it is the same as the last one."""
        if error != self.error:
            self._warn(f"{self._source.topic} is not shown: {error}")
        self.error = error
