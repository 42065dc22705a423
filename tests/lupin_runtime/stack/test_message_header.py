"""Headers of serialized messages, as rclpy serializes them and as damaged ones begin."""

from __future__ import annotations

import struct

import pytest

from lupin_runtime import graph
from lupin_runtime.stack.message_header import MessageHeader, read_header

STAMPED = tuple(row for row in graph.topics() if row.frame is not None)


@pytest.mark.parametrize("row", STAMPED, ids=lambda row: row.name)
def test_header_of_a_serialized_message_is_read(row: graph.Topic) -> None:
    from rclpy.serialization import serialize_message

    from lupin_runtime.ros.interfaces import interface

    message = interface(row.type)()
    message.header.frame_id = row.frame or "b\N{LATIN SMALL LETTER A WITH DIAERESIS}r"
    message.header.stamp.sec, message.header.stamp.nanosec = 1_700_000_000, 250_000_000
    assert read_header(serialize_message(message)) == MessageHeader(1_700_000_000.25, message.header.frame_id)


def test_big_endian_header_is_read() -> None:
    message = b"\0\0\0\0" + struct.pack(">iII6s", 7, 500_000_000, 6, b"laser\0")
    assert read_header(message) == MessageHeader(7.5, "laser")


@pytest.mark.parametrize("message", [b"", b"\0\1\0\0", b"\0\1\0\0" + bytes(11), b"\0\1\0\0" + bytes(8) + b"\xff\xff\xff\x7f"])
def test_message_without_a_whole_header_has_none(message: bytes) -> None:
    assert read_header(message) is None
