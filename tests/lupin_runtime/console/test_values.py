"""Messages from clients' values: which are accepted, and the protocol's error texts for all others."""

from __future__ import annotations

import math
import random
from typing import Any

import cbor2
import numpy as np
import orjson
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped, PoseWithCovariance, Twist
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Bool, Byte, Float32, Float64, Float64MultiArray, Int16, String, UInt8MultiArray, UInt64
from std_srvs.srv import SetBool

from lupin_runtime.console.cdr import Format, decoder
from lupin_runtime.console.encoding import to_json
from lupin_runtime.console.values import ValueMismatch, by_name, fill
from tests.support.random_messages import installed_classes, random_message

NOW = Time(sec=12, nanosec=34)


def filled(message_class: Any, values: Any) -> Any:
    return fill(message_class, values, lambda: NOW)


def test_every_installed_type_survives_the_round_trip() -> None:
    rng = random.Random(3)
    for message_class in installed_classes():
        data = serialize_message(random_message(message_class, rng))
        values = orjson.loads(to_json(decoder(message_class, Format.JSON)(data)))
        again = serialize_message(filled(message_class, values))
        assert orjson.loads(to_json(decoder(message_class, Format.JSON)(again))) == values, message_class


@pytest.mark.parametrize(
    ("message_class", "values", "text"),
    [
        (String, {"date": "x"}, "Message type std_msgs/String does not have a field date"),
        (String, {"data": 3}, "std_msgs/String message requires a string for field data, but got a <class 'int'>"),
        (Bool, {"data": 1}, "requires a boolean for field data"),
        (Int16, {"data": True}, "requires a int16 for field data"),
        (Int16, {"data": 3.0}, "requires a int16 for field data"),
        (Int16, {"data": 40_000}, "40000 is out of range for field data"),
        (UInt64, {"data": -1}, "-1 is out of range for field data"),
        (Byte, {"data": 256}, "256 is out of range for field data"),
        (Float32, {"data": 1e300}, "out of range for field data"),
        (Float64, {"data": "1"}, "requires a double for field data"),
        (Twist, {"linear": {"q": 1}}, "Message type geometry_msgs/Twist does not have a field linear.q"),
        (Twist, {"linear": [1, 2, 3]}, "requires a geometry_msgs/Vector3 for field linear"),
        (Twist, [], "Expected a JSON object for type geometry_msgs/Twist but received a <class 'list'>"),
        (PoseWithCovariance, {"covariance": [1.0, 2.0]}, "covariance has 36 elements, got 2"),
        (SolidPrimitive, {"dimensions": [1.0] * 4}, "dimensions holds at most 3 elements, got 4"),
        (UInt8MultiArray, {"data": "not base64!"}, "field data is not base64"),
        (UInt8MultiArray, {"data": [1, 300]}, "300 is out of range"),
        (PointStamped, {"header": 3}, "requires a std_msgs/Header for field header"),
        (PointStamped, {"header": {"stamp": "yesterday"}}, "requires a builtin_interfaces/Time for field header.stamp"),
        (PointStamped, {"header": {"stamp": {"sec": 2**40}}}, "is out of range for field header.stamp.sec"),
    ],
)
def test_wrong_value_is_refused_with_the_fields_name(message_class: Any, values: Any, text: str) -> None:
    with pytest.raises(ValueMismatch) as caught:
        filled(message_class, values)
    assert text in str(caught.value)


def test_header_without_stamp_gets_the_current_time() -> None:
    assert filled(PointStamped, {}).header.stamp == NOW
    assert filled(PointStamped, {"header": {"frame_id": "map"}}).header.stamp == NOW
    given_stamp = filled(PointStamped, {"header": {"stamp": {"secs": 5, "nsecs": 6}}}).header.stamp
    assert (given_stamp.sec, given_stamp.nanosec) == (5, 6)
    assert filled(Time, "now") == NOW


def test_null_is_nan_and_bytes_may_be_text_or_numbers() -> None:
    assert math.isnan(filled(Float64, {"data": None}).data)
    assert list(filled(UInt8MultiArray, {"data": "AQID"}).data) == [1, 2, 3]
    assert list(filled(UInt8MultiArray, {"data": [1, 2, 3]}).data) == [1, 2, 3]
    tagged = cbor2.CBORTag(86, np.array([1.5, -2.0]).tobytes())
    assert list(filled(Float64MultiArray, {"data": tagged}).data) == [1.5, -2.0]


def test_lone_surrogate_is_replaced() -> None:
    assert serialize_message(filled(String, orjson.loads(b'{"data":"x"}') | {"data": "a\ud800b"}))


def test_list_arguments_are_in_the_order_of_the_fields() -> None:
    assert by_name(SetBool.Request, [True]) == {"data": True}
    assert by_name(SetBool.Request, None) == {}


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["header", "data", "linear", "x"]), inner),
    max_leaves=12,
)


@given(values=_JSON, message_class=st.sampled_from([PointStamped, Twist, Float64MultiArray, UInt8MultiArray, String, Byte]))
def test_any_values_are_refused_or_serializable(values: Any, message_class: Any) -> None:
    try:
        message = filled(message_class, values)
    except ValueMismatch:
        return
    assert serialize_message(message)
