"""Parameter values as JSON text."""

from __future__ import annotations

import contextlib
import json
import math
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from rcl_interfaces.msg import ParameterType as Kind
from rcl_interfaces.msg import ParameterValue
from rclpy.parameter import get_parameter_value

from lupin_runtime.console import values
from lupin_runtime.console.parameter_values import MAX_YAML_CHARACTERS, normalize_json, plain_value, typed_value

INT64 = st.integers(-(2**63), 2**63 - 1)
FLOATS = st.floats(allow_nan=False, allow_infinity=False)
JSON = st.recursive(st.none() | st.booleans() | INT64 | FLOATS | st.text(), lambda inner: st.lists(inner, max_size=4))

# Without numbers such as 1e-7, which YAML reads as a string.
AS_IN_YAML = st.booleans() | INT64 | FLOATS.filter(lambda value: "e" not in repr(value))


def filled(text: str) -> Any:
    return values.fill(ParameterValue, typed_value(text), Time)


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("true", Kind.PARAMETER_BOOL, True),
        ("5", Kind.PARAMETER_INTEGER, 5),
        ("5.0", Kind.PARAMETER_DOUBLE, 5.0),
        ("1e-7", Kind.PARAMETER_DOUBLE, 1e-7),
        ('"fast"', Kind.PARAMETER_STRING, "fast"),
        ('"5"', Kind.PARAMETER_INTEGER, 5),
        ('"yes"', Kind.PARAMETER_BOOL, True),
        ('"[1, 2]"', Kind.PARAMETER_INTEGER_ARRAY, [1, 2]),
        ('"2024-01-01"', Kind.PARAMETER_STRING, "2024-01-01"),
        ('"2024-13-45"', Kind.PARAMETER_STRING, "2024-13-45"),
        ('"a: b: c"', Kind.PARAMETER_STRING, "a: b: c"),
        ('["\\ud83c\\udf31"]', Kind.PARAMETER_STRING_ARRAY, ["🌱"]),  # YAML would read two characters
        ('"\\ud800"', Kind.PARAMETER_STRING, "?"),
        ('""', Kind.PARAMETER_STRING, ""),
        ("null", Kind.PARAMETER_STRING, "null"),
        ('{"a": 1}', Kind.PARAMETER_STRING, '{"a": 1}'),
        ("[1, 2.5]", Kind.PARAMETER_STRING, "[1, 2.5]"),
        ("[true, false]", Kind.PARAMETER_BOOL_ARRAY, [True, False]),
        ("[true, 2]", Kind.PARAMETER_INTEGER_ARRAY, [1, 2]),
        ("[0.5, 2.0]", Kind.PARAMETER_DOUBLE_ARRAY, [0.5, 2.0]),
        ('["a", "5"]', Kind.PARAMETER_STRING_ARRAY, ["a", "5"]),
        ("[]", Kind.PARAMETER_BOOL_ARRAY, []),
    ],
)
def test_json_text_is_converted_to_its_parameter_type(text: str, kind: int, value: Any) -> None:
    found = filled(text)
    assert (found.type, plain_value(found)) == (kind, value)


@given(AS_IN_YAML | st.lists(AS_IN_YAML | st.just("a") | st.none(), max_size=4))
def test_types_equal_those_of_rclpy(value: Any) -> None:
    text = json.dumps(value)
    assert filled(text) == get_parameter_value(text)


@given(JSON)
def test_every_json_value_is_converted_to_a_parameter(value: Any) -> None:
    assert Kind.PARAMETER_NOT_SET < filled(json.dumps(value)).type <= Kind.PARAMETER_STRING_ARRAY


@given(st.text())
def test_invalid_text_raises_only_value_errors(text: str) -> None:
    for candidate in (text, json.dumps(text)):
        with contextlib.suppress(ValueError):
            filled(candidate)


@given(st.booleans() | INT64 | FLOATS)
def test_number_survives_the_round_trip(value: float) -> None:
    assert plain_value(filled(json.dumps(value))) == value


def test_integer_of_more_than_64_bits_is_refused() -> None:
    with pytest.raises(values.ValueMismatch, match="out of range"):
        filled(str(2**63))


def test_long_text_is_a_string() -> None:
    text = "[" + "1, " * MAX_YAML_CHARACTERS + "1]"
    assert filled(json.dumps(text)).string_value == text


def test_deep_nesting_is_refused() -> None:
    with pytest.raises(ValueError, match="nested too deeply"):
        typed_value("[" * 100_000)
    assert normalize_json("[" * 100_000) == '""'


def test_nan_and_bytes_become_null_and_numbers() -> None:
    double = ParameterValue(type=Kind.PARAMETER_DOUBLE_ARRAY, double_array_value=[0.5, math.nan, math.inf])
    assert plain_value(double) == [0.5, None, None]
    octets = ParameterValue(type=Kind.PARAMETER_BYTE_ARRAY, byte_array_value=[b"\x01", b"\xff"])
    assert plain_value(octets) == [1, 255]


@pytest.mark.parametrize(
    ("text", "normalized"), [("", '""'), ("5", "5"), ("[1,2]", "[1, 2]"), ("none", '""'), ("NaN", '""'), ("1e999", '""')]
)
def test_default_is_always_valid_json(text: str, normalized: str) -> None:
    assert normalize_json(text) == normalized
