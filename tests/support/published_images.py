"""A stand-in for the graph in tests of the video server: the test publishes the cameras' images."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from lupin_runtime.cameras.stream_request import COMPRESSED_IMAGE, IMAGE, Source
from lupin_runtime.cameras.video_streams import GraphSilent
from tests.support.image_messages import compressed_message, gradient, image_message


class PublishedImages:
    """A camera that publishes JPEG and one that publishes raw images, both controlled by the test."""

    def __init__(self) -> None:
        self.topics: dict[str, list[str]] = {"/jpeg/compressed": [COMPRESSED_IMAGE], "/raw": [IMAGE]}
        self.subscriptions: dict[Source, Callable[[bytes], None]] = {}
        self.subscribe_count = 0
        self.silent = False

    def publishers(self) -> Mapping[str, Sequence[str]]:
        if self.silent:
            raise GraphSilent("the graph has not responded for 5 s")
        return self.topics

    def subscribe(self, source: Source, receive: Callable[[bytes], None]) -> Callable[[], None]:
        assert source not in self.subscriptions
        self.subscribe_count += 1
        self.subscriptions[source] = receive
        return lambda: self.subscriptions.__delitem__(source)

    def publish(self, data: bytes, stamp_ns: int = 0) -> None:
        """Publish a JPEG image."""
        self._publish(Source("/jpeg/compressed", True), compressed_message(data, stamp_ns=stamp_ns))

    def publish_raw(self, stamp_ns: int = 0, encoding: str = "bgr8") -> None:
        """Publish `gradient()` as a raw image."""
        pixels = gradient()
        height, width, _ = pixels.shape
        message = image_message(pixels.tobytes(), width, height, encoding, 3 * width, stamp_ns=stamp_ns)
        self._publish(Source("/raw", False), message)

    def _publish(self, source: Source, message: bytes) -> None:
        receive = self.subscriptions.get(source)
        if receive is not None:
            receive(message)
