"""The stream of images: writing it and splitting it again."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.cameras import mjpeg

PICTURES = st.lists(st.tuples(st.binary(max_size=300), st.integers(0, 10**18)), max_size=6)


@given(PICTURES, st.lists(st.integers(0, 2000), max_size=8))
def test_stream_in_any_chunks_is_read_completely(images: list[tuple[bytes, int]], cuts: list[int]) -> None:
    stream = mjpeg.OPENING + b"".join(mjpeg.part(*image) for image in images)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    reader = mjpeg.PartReader()
    assert [one for a, b in itertools.pairwise(edges) for one in reader.feed(stream[a:b])] == images


@given(st.lists(st.binary(max_size=3000), max_size=5))
def test_any_bytes_are_parsed_or_refused(pieces: list[bytes]) -> None:
    reader = mjpeg.PartReader()
    try:
        for piece in pieces:
            list(reader.feed(piece))
    except mjpeg.MalformedStream:
        return


@pytest.mark.parametrize(
    "header",
    [
        "Content-Length: 99999999",
        "Content-Length: -1",
        "Content-Length: 1e3",
        "X-Timestamp: 1.0",
        "Content-Length: 5\r\nX-Timestamp: soon",
        "x" * 3000,
    ],
)
def test_damaged_header_is_refused(header: str) -> None:
    with pytest.raises(mjpeg.MalformedStream):
        list(mjpeg.PartReader().feed(mjpeg.OPENING + f"{header}\r\n\r\n12345".encode()))
