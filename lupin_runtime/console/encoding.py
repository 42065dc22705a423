"""Encodes a topic's message for clients: as JSON, JSON in a PNG image, CBOR, or CBOR around the serialized message."""

from __future__ import annotations

import base64
import math
from typing import Any

import cbor2
import cv2
import numpy as np
import orjson

from lupin_runtime.console.cdr import Format, decoder
from lupin_runtime.console.outbox import Frame

COMPRESSIONS = ("none", "png", "cbor", "cbor-raw")  # if one client asks for several, the last of these is used


def to_json(values: Any) -> bytes:
    """Convert plain values to JSON text; NaN and infinities become null."""
    return orjson.dumps(values, option=orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_NON_STR_KEYS)


def json_frame(text: bytes) -> Frame:
    """Build a frame of a text from `to_json`, of which many may wait for a slow client.

    orjson's text keeps the buffer that it was written to, six times as large where measured: the frame has a copy.
    """
    return Frame(bytes(memoryview(text)))


def publication(compression: str, topic: str, message_class: Any, data: bytes, received_ns: int) -> Frame:
    """Build the frame with a serialized message for clients that asked for this compression.

    Raises UnsupportedType and MalformedMessage.
    """
    if compression == "cbor-raw":
        secs, nsecs = divmod(received_ns, 1_000_000_000)
        return _cbor(topic, {"secs": secs, "nsecs": nsecs, "bytes": data})
    if compression == "cbor":
        return _cbor(topic, decoder(message_class, Format.CBOR)(data))
    message = to_json(decoder(message_class, Format.JSON)(data))
    text = b'{"op":"publish","topic":' + to_json(topic) + b',"msg":' + message + b"}"
    return Frame(_png(text) if compression == "png" else text)


def _cbor(topic: str, message: Any) -> Frame:
    return Frame(cbor2.dumps({"op": "publish", "topic": topic, "msg": message}), binary=True)


def _png(text: bytes) -> bytes:
    """Build a `png` message: the text as the pixels of an RGB image, padded with line feeds."""
    width = max(1, math.isqrt(len(text) // 3))
    height = math.ceil(len(text) / (3 * width))
    pixels = np.frombuffer(text.ljust(3 * width * height, b"\n"), np.uint8).reshape(height, width, 3)
    _, image = cv2.imencode(".png", np.ascontiguousarray(pixels[:, :, ::-1]))  # OpenCV expects blue first
    return to_json({"op": "png", "data": base64.b64encode(image.tobytes()).decode("ascii")})


def fragments(text: bytes, size: int, identifier: str) -> list[bytes]:
    """Split the text into `fragment` messages with at most `size` characters of it each."""
    characters = text.decode("utf-8")
    parts = [characters[start : start + size] for start in range(0, len(characters), size)]
    return [
        to_json({"op": "fragment", "id": identifier, "data": part, "num": number, "total": len(parts)})
        for number, part in enumerate(parts)
    ]
