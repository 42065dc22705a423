"""Heartbeats survive encoding, and other packets are not heartbeats."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.heartbeat import MAX_BYTES, Beat, decode, encode


@given(st.integers(0, 2**63 - 1), st.text(max_size=100))
def test_heartbeat_survives_encoding(time_ns: int, text: str) -> None:
    text = text.encode(errors="replace").decode()
    assert decode(encode(Beat(time_ns, text))) == Beat(time_ns, text)


@given(st.integers(0, 2**63 - 1), st.text(alphabet="aä🤖", min_size=MAX_BYTES))
def test_long_text_is_cut_to_one_packet(time_ns: int, text: str) -> None:
    packet = encode(Beat(time_ns, text))
    beat = decode(packet)
    assert len(packet) <= MAX_BYTES and beat is not None and beat.time_ns == time_ns


@given(st.binary(max_size=40))
def test_any_packet_is_a_heartbeat_or_none(packet: bytes) -> None:
    beat = decode(packet)
    assert beat is None or beat.time_ns >= 0
