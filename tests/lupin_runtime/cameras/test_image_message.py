"""Reads images from serialized messages: those that rclpy writes, and malformed ones."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.cameras.image_message import MalformedImage, read_compressed, read_image
from tests.support.image_messages import compressed_message, image_message


@pytest.mark.parametrize("frame", ["", "a", "camera_color_optical_frame", "fünf"])
@pytest.mark.parametrize("encoding", ["rgb8", "mono8", "bayer_rggb8", "8UC1"])
def test_fields_equal_those_that_rclpy_wrote(frame: str, encoding: str) -> None:
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import CompressedImage, Image

    image = Image(height=2, width=3, encoding=encoding, is_bigendian=1, step=9, data=bytes(range(18)))
    image.header.frame_id = frame
    image.header.stamp.sec, image.header.stamp.nanosec = 12, 34
    seen = read_image(serialize_message(image))
    assert (seen.stamp_ns, seen.width, seen.height, seen.encoding) == (12_000_000_034, 3, 2, encoding)
    assert (seen.big_endian, seen.row_bytes, bytes(seen.data)) == (True, 9, bytes(range(18)))

    image = CompressedImage(format=encoding, data=b"\xff\xd8\xff" + bytes(7))
    image.header.frame_id = frame
    read = read_compressed(serialize_message(image))
    assert (read.stamp_ns, read.format, bytes(read.data)) == (0, encoding, b"\xff\xd8\xff" + bytes(7))


def test_images_of_the_tests_equal_those_of_rclpy() -> None:
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import CompressedImage, Image

    image = deserialize_message(image_message(b"abcdef", 1, 2, "rgb8", 3, stamp_ns=5_000_000_006), Image)
    assert (image.header.stamp.sec, image.header.stamp.nanosec, image.header.frame_id) == (5, 6, "camera")
    assert (image.height, image.width, image.encoding, image.step, bytes(image.data)) == (2, 1, "rgb8", 3, b"abcdef")
    image = deserialize_message(compressed_message(b"xyz", "png"), CompressedImage)
    assert (image.format, bytes(image.data)) == ("png", b"xyz")


def test_big_endian_messages_are_read() -> None:
    message = b"\0\0\0\0" + bytes((0, 0, 0, 1)) + bytes(4) + bytes((0, 0, 0, 1, 0, 0, 0, 0)) + bytes((0, 0, 0, 1, 0, 0, 0, 0))
    assert read_compressed(message + bytes((0, 0, 0, 2)) + b"ab").data.tobytes() == b"ab"


def test_every_truncated_message_is_refused() -> None:
    for message, read in (
        (image_message(bytes(18), 3, 2, "rgb8", 9), read_image),
        (compressed_message(bytes(18)), read_compressed),
    ):
        for length in range(len(message)):
            with pytest.raises(MalformedImage):
                read(message[:length])


@pytest.mark.parametrize(
    ("width", "height", "row_bytes"), [(0, 2, 9), (3, 0, 9), (3, 2, 10), (2**32 - 1, 2**32 - 1, 2**32 - 1)]
)
def test_size_that_contradicts_the_data_is_refused(width: int, height: int, row_bytes: int) -> None:
    with pytest.raises(MalformedImage, match="pixels"):
        read_image(image_message(bytes(18), width, height, "rgb8", row_bytes))


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(message: bytes) -> None:
    for read in (read_image, read_compressed):
        try:
            read(message)
        except MalformedImage:
            continue
