"""Parses what a client requests from the video server, and chooses the topic that provides it.

The parameters are web_video_server's, so that existing pages and programs work.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

IMAGE, COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
COMPRESSED = "/compressed"
MAX_WIDTH_PX = 4096
# The supported ones of web_video_server's types; an <img> cannot show the others.
_TYPES = ("mjpeg", "ros_compressed")
_IGNORED = ("default_transport", "qos_profile", "height", "frame_rate", "_")
_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")


class BadRequest(ValueError):
    """A query that the server does not understand; the text is the reason."""


class NoSuchCamera(LookupError):
    """No node publishes images on the topic; the text lists the cameras that exist."""


@dataclass(frozen=True)
class StreamRequest:
    """A request for the images of a topic. A quality or width of 0 leaves the camera's own."""

    topic: str
    quality: int = 0  # 1 to 100
    width_px: int = 0
    rotated: bool = False  # by 180°

    @property
    def unchanged(self) -> bool:
        """Whether a camera's JPEG images are forwarded unchanged."""
        return not (self.quality or self.width_px or self.rotated)

    def query(self) -> dict[str, str]:
        """Return the query that describes this request."""
        parameters = {"quality": self.quality, "width": self.width_px, "invert": int(self.rotated)}
        return {"topic": self.topic, **{name: str(value) for name, value in parameters.items() if value}}


@dataclass(frozen=True)
class Source:
    """A topic with images, and whether they are compressed."""

    topic: str
    compressed: bool


def read_request(query: Mapping[str, str]) -> StreamRequest:
    """Parse a query. Raises BadRequest."""
    unknown = sorted(set(query) - {"topic", "quality", "width", "invert", "type", *_IGNORED})
    if unknown:
        raise BadRequest(f"unknown parameter {unknown[0][:40]!r}; known: topic, quality, width, invert, type")
    topic = query.get("topic", "")
    if not topic:
        raise BadRequest("the topic is missing; for example ?topic=/camera/image_raw; /streams lists the cameras")
    name = topic if topic.startswith("/") else f"/{topic}"
    if len(name) > 256 or not _TOPIC.fullmatch(name):
        raise BadRequest(f"{topic[:80]!r} is not the name of a topic")
    if query.get("type", "mjpeg") not in _TYPES:
        raise BadRequest(f"type {query['type'][:40]!r} is not supported; supported: {', '.join(_TYPES)}")
    return StreamRequest(
        name.removesuffix(COMPRESSED),
        _number(query, "quality", 1, 100),
        _number(query, "width", 16, MAX_WIDTH_PX),
        "invert" in query and query["invert"].lower() not in ("false", "0"),
    )


def choose_source(request: StreamRequest, publishers: Mapping[str, Sequence[str]]) -> Source:
    """Choose the topic to take the images from: preferably the camera's JPEG topic. Raises NoSuchCamera.

    `publishers` are the topics that have a publisher, with their types.
    """
    for topic in (request.topic + COMPRESSED, request.topic):
        if COMPRESSED_IMAGE in publishers.get(topic, ()):
            return Source(topic, compressed=True)
    if IMAGE in publishers.get(request.topic, ()):
        return Source(request.topic, compressed=False)
    existing = ", ".join(cameras(publishers)) or "none"
    raise NoSuchCamera(f"no node publishes images on {request.topic}; cameras: {existing}")


def cameras(publishers: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the topics that can be requested, each once, even if it is published both raw and compressed."""
    images = (
        topic
        for topic, types in publishers.items()
        if (IMAGE in types or COMPRESSED_IMAGE in types) and not topic.endswith("/compressedDepth")  # browsers cannot show it
    )
    return sorted({topic.removesuffix(COMPRESSED) for topic in images})


def _number(query: Mapping[str, str], name: str, low: int, high: int) -> int:
    """Parse a whole number; 0 if the query does not set it."""
    text = query.get(name, "")
    if not text or text in ("0", "-1"):  # some pages send these instead of leaving the parameter out
        return 0
    if not re.fullmatch(r"[0-9]{1,5}", text) or not low <= int(text) <= high:
        raise BadRequest(f"{name} must be a whole number from {low} to {high}, not {text[:40]!r}")
    return int(text)
