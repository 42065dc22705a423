"""Malformed JSON raises ValueError, and nothing else."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.json_text import conform, parse_json

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "1" * 5000, "{", "", b"\xff", "nul"])
def test_malformed_text_is_a_value_error(text: str | bytes) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 -- any message; it is Python's
        parse_json(text)


def test_integer_beyond_floats_is_infinite() -> None:
    assert parse_json(f"[1{'0' * 400}, -1{'0' * 400}, 1e400]") == [math.inf, -math.inf, math.inf]


@given(VALUES)
def test_values_are_those_of_the_standard_library(value: object) -> None:
    assert parse_json(json.dumps(value)) == value


SHAPE: dict[str, Any] = {
    "name": "",
    "pid": None,
    "age_s": 0.0,
    "stages": [{"phase": "up", "why": ""}],
    "any": {},
    "texts": [""],
}


def test_value_of_the_shape_is_kept() -> None:
    value = {
        "name": "a",
        "pid": 4,
        "age_s": 1,
        "stages": [{"phase": "x", "why": "y"}],
        "any": {"k": [1]},
        "texts": ["t"],
        "own": 1,
    }
    assert conform(value, SHAPE) == value


@pytest.mark.parametrize("value", [None, [], "x", 3, {}, {"stages": "x"}, {"stages": [None, 3]}, {"age_s": float("nan")}])
def test_value_of_another_shape_gets_every_key(value: object) -> None:
    assert conform(value, SHAPE) == {"name": "", "pid": None, "age_s": 0.0, "stages": [], "any": {}, "texts": []}


def test_items_of_a_list_are_completed_or_dropped() -> None:
    found = conform({"stages": [{"phase": 7}, None, {"why": "w", "x": 1}], "age_s": 10**400}, SHAPE)
    assert found["stages"] == [{"phase": "up", "why": ""}, {"phase": "up", "why": "w", "x": 1}]
    assert found["age_s"] == 0.0
