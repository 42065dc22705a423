"""Decoding and limiting of serialized velocity commands."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.drive import HardLimits, Twist, decode, encode

ANY = st.floats(width=64)
FINITE = st.floats(-1e6, 1e6)
TWISTS = st.builds(Twist, FINITE, FINITE, FINITE)


@given(TWISTS)
def test_twist_decoding_inverts_encoding(twist: Any) -> None:
    assert decode(encode(twist)) == twist


@given(TWISTS)
def test_big_endian_twist_is_decoded(twist: Any) -> None:
    data = b"\x00\x00\x00\x00" + struct.pack(">6d", twist.x, twist.y, 0, 0, 0, twist.yaw)
    assert decode(data) == twist


@given(st.lists(ANY, min_size=6, max_size=6))
def test_twist_with_a_non_finite_component_is_rejected(values: list[float]) -> None:
    decoded = decode(b"\x00\x01\x00\x00" + struct.pack("<6d", *values))
    if not all(map(math.isfinite, values)):
        assert decoded is None
    elif decoded is not None:
        assert decoded == (values[0], values[1], values[5])


@pytest.mark.parametrize("data", [b"", b"\x00\x01\x00\x00", encode(Twist(1.0, 2.0, 3.0))[:-1]])
def test_short_message_is_not_a_twist(data: bytes) -> None:
    assert decode(data) is None


@given(TWISTS, st.floats(0.01, 10), st.floats(0.01, 10))
def test_hard_limits_keep_the_direction_of_travel(twist: Any, linear: float, yaw: float) -> None:
    out = HardLimits(linear, yaw).clamp(twist)
    assert abs(out.x) <= linear * (1 + 1e-12) and abs(out.y) <= linear * (1 + 1e-12) and abs(out.yaw) <= yaw
    assert out.x * twist.y == pytest.approx(out.y * twist.x)
    assert out.x * twist.x >= 0 and out.y * twist.y >= 0 and out.yaw * twist.yaw >= 0


@given(TWISTS)
def test_command_within_the_limits_is_returned_unchanged(twist: Any) -> None:
    assert HardLimits(1e6, 1e6).clamp(twist) is twist
