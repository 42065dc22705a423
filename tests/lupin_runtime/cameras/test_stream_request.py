"""The queries that pages send, and the topic chosen for each."""

from __future__ import annotations

import pytest

from lupin_runtime.cameras.stream_request import (
    COMPRESSED_IMAGE,
    IMAGE,
    BadRequest,
    NoSuchCamera,
    Source,
    StreamRequest,
    cameras,
    choose_source,
    read_request,
)

GRAPH = {
    "/camera/image_raw": [IMAGE],
    "/camera/image_raw/compressed": [COMPRESSED_IMAGE],
    "/depth/image_raw": [IMAGE],
    "/depth/image_raw/compressedDepth": [COMPRESSED_IMAGE],
    "/phone/compressed": [COMPRESSED_IMAGE],
    "/photo": [COMPRESSED_IMAGE],
    "/scan": ["sensor_msgs/msg/LaserScan"],
}


@pytest.mark.parametrize(
    ("query", "request_"),
    [
        ({"topic": "/camera/image_raw"}, StreamRequest("/camera/image_raw")),
        ({"topic": "camera/image_raw/compressed"}, StreamRequest("/camera/image_raw")),
        ({"topic": "/c", "quality": "50", "width": "320"}, StreamRequest("/c", 50, 320)),
        ({"topic": "/c", "quality": "-1", "width": "0", "height": "480"}, StreamRequest("/c")),
        ({"topic": "/c", "type": "ros_compressed", "qos_profile": "sensor_data"}, StreamRequest("/c")),
        ({"topic": "/c", "invert": ""}, StreamRequest("/c", rotated=True)),
        ({"topic": "/c", "invert": "false"}, StreamRequest("/c")),
    ],
)
def test_queries_of_web_video_server_are_understood(query: dict[str, str], request_: StreamRequest) -> None:
    assert read_request(query) == request_
    assert read_request(request_.query()) == request_


@pytest.mark.parametrize(
    "query",
    [
        {},
        {"topic": ""},
        {"topic": "/a//b"},
        {"topic": "/a/"},
        {"topic": "/1a"},
        {"topic": "/a?x"},
        {"topic": "/a\r\nX: y"},
        {"topic": "/a\n"},
        {"topic": "/" + "a" * 300},
        {"topic": "/c", "quality": "101"},
        {"topic": "/c", "quality": "1e2"},
        {"topic": "/c", "quality": "٣"},
        {"topic": "/c", "width": "8"},
        {"topic": "/c", "width": "9" * 400},
        {"topic": "/c", "type": "h264"},
        {"topic": "/c", "color": "1"},
    ],
)
def test_invalid_queries_are_refused(query: dict[str, str]) -> None:
    with pytest.raises(BadRequest):
        read_request(query)


@pytest.mark.parametrize(
    ("topic", "source"),
    [
        ("/camera/image_raw", Source("/camera/image_raw/compressed", True)),
        ("/depth/image_raw", Source("/depth/image_raw", False)),
        ("/phone", Source("/phone/compressed", True)),
        ("/photo", Source("/photo", True)),
    ],
)
def test_compressed_images_are_preferred(topic: str, source: Source) -> None:
    assert choose_source(StreamRequest(topic), GRAPH) == source


def test_unknown_camera_is_refused_with_list_of_cameras() -> None:
    for topic in ("/scan", "/nothing"):
        with pytest.raises(NoSuchCamera, match="cameras: /camera/image_raw, /depth/image_raw, /phone, /photo"):
            choose_source(StreamRequest(topic), GRAPH)
    assert cameras(GRAPH) == ["/camera/image_raw", "/depth/image_raw", "/phone", "/photo"]
