"""Motion JPEG, the stream of images that browsers show in an <img>: `multipart/x-mixed-replace`."""

from __future__ import annotations

from collections.abc import Iterator

BOUNDARY = "lupin-frame"
CONTENT_TYPE = f"multipart/x-mixed-replace; boundary={BOUNDARY}"
# A browser shows an image once the next boundary has arrived, so the boundary is sent right after each image, and this one
# before the first.
OPENING = f"--{BOUNDARY}\r\n".encode()
MAX_IMAGE_BYTES = 16_000_000
_MAX_HEADER_BYTES = 2000
_END_OF_HEADER = b"\r\n\r\n"


class MalformedStream(ValueError):
    """The data is not a stream in this format."""


def part(jpeg: bytes, stamp_ns: int) -> bytes:
    """Return an image with its header and the boundary after it. X-Timestamp is in seconds, as in web_video_server."""
    header = f"Content-Type: image/jpeg\r\nX-Timestamp: {stamp_text(stamp_ns)}\r\nContent-Length: {len(jpeg)}\r\n\r\n"
    return b"".join((header.encode(), jpeg, b"\r\n", OPENING))


def stamp_text(stamp_ns: int) -> str:
    """Format a stamp in seconds."""
    return f"{stamp_ns // 1_000_000_000}.{stamp_ns % 1_000_000_000:09d}"


def stamp_ns_of(text: str) -> int:
    """Parse an X-Timestamp header, and return the stamp in ns. Raises MalformedStream."""
    seconds, _, fraction = text.strip().partition(".")
    if not (seconds.isdecimal() and len(seconds) <= 12 and (fraction or "0").isdecimal() and len(fraction) <= 9):
        raise MalformedStream(f"{text[:40]!r} is not a time")
    return int(seconds) * 1_000_000_000 + int(fraction.ljust(9, "0"))


class PartReader:
    """Splits a stream that arrives in chunks into images."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._image: tuple[int, int] | None = None  # length in bytes, and stamp, of the image that is arriving

    def feed(self, data: bytes) -> Iterator[tuple[bytes, int]]:
        """Add a chunk; yields the images that are now complete, each with its stamp in ns. Raises MalformedStream."""
        self._data += data
        while True:
            if self._image is None:
                end = self._data.find(_END_OF_HEADER)
                if end < 0:
                    if len(self._data) > _MAX_HEADER_BYTES:
                        raise MalformedStream("an image's header has no end")
                    return
                self._image = _read_header(bytes(self._data[:end]))
                del self._data[: end + len(_END_OF_HEADER)]
            length, stamp_ns = self._image
            if len(self._data) < length:
                return
            image = bytes(self._data[:length])
            del self._data[:length]
            self._image = None
            yield image, stamp_ns


def _read_header(header: bytes) -> tuple[int, int]:
    fields = {}
    for line in header.decode("latin-1").split("\r\n"):
        name, separator, value = line.partition(":")
        if separator:
            fields[name.strip().lower()] = value.strip()
    length = fields.get("content-length", "")
    if not length.isdecimal() or len(length) > 9 or int(length) > MAX_IMAGE_BYTES:
        raise MalformedStream(f"an image of {length[:20]!r} bytes")
    return int(length), stamp_ns_of(fields.get("x-timestamp", "0"))
