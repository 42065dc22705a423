from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.drive import HardLimits, Twist, decode, encode

ANY = st.floats(width=64)
FINITE = st.floats(-1e6, 1e6)
TWISTS = st.builds(Twist, FINITE, FINITE, FINITE)


@given(TWISTS)
def test_decoding_undoes_encoding(twist):
    assert decode(encode(twist)) == twist


@given(TWISTS)
def test_big_endian_bytes_mean_the_same(twist):
    data = b"\x00\x00\x00\x00" + struct.pack(">6d", twist.x, twist.y, 0, 0, 0, twist.yaw)
    assert decode(data) == twist


@given(st.lists(ANY, min_size=6, max_size=6))
def test_any_component_that_is_not_finite_spoils_the_message(values):
    decoded = decode(b"\x00\x01\x00\x00" + struct.pack("<6d", *values))
    if not all(map(math.isfinite, values)):
        assert decoded is None
    elif decoded is not None:
        assert decoded == (values[0], values[1], values[5])


@pytest.mark.parametrize("data", [b"", b"\x00\x01\x00\x00", encode(Twist(1.0, 2.0, 3.0))[:-1]])
def test_a_short_message_is_not_a_twist(data):
    assert decode(data) is None


@given(TWISTS, st.floats(0.01, 10), st.floats(0.01, 10))
def test_limits_bound_every_axis_and_keep_the_direction_of_travel(twist, linear, yaw):
    out = HardLimits(linear, yaw).clamp(twist)
    assert abs(out.x) <= linear * (1 + 1e-12) and abs(out.y) <= linear * (1 + 1e-12) and abs(out.yaw) <= yaw
    assert out.x * twist.y == pytest.approx(out.y * twist.x)
    assert out.x * twist.x >= 0 and out.y * twist.y >= 0 and out.yaw * twist.yaw >= 0


@given(TWISTS)
def test_a_command_within_the_limits_is_the_very_same_object(twist):
    assert HardLimits(1e6, 1e6).clamp(twist) is twist
