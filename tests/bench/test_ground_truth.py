"""What ground truth calls usable, and how it reads a stamp."""

from __future__ import annotations

import struct
from collections import deque

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.ground_truth import DRIVE_INPUT, MAX_AGE_S, SERVICES, TOPICS, WINDOW_S, Heard, broken_lines, is_usable, stamp_s
from lupin_runtime import graph

NOW_S = 1000.0
ANSWERED: dict[str, float | None] = dict.fromkeys(SERVICES, 0.01)


def heard(rate_hz: float, age_s: float | None = None) -> Heard:
    count = round(rate_hz * WINDOW_S)
    arrivals = deque(NOW_S - (index + 0.5) / rate_hz for index in range(count))
    return Heard(arrivals, deque() if age_s is None else deque([age_s] * 5))


def all_heard() -> dict[str, Heard]:
    return {name: heard(required.rate_hz, 0.02 if required.stamped else None) for name, required in TOPICS.items()}


@given(st.integers(0, 2**31 - 1), st.integers(0, 999_999_999))
def test_stamp_is_read_from_a_serialized_header(seconds: int, nanoseconds: int) -> None:
    sample = b"\x00\x01\x00\x00" + struct.pack("<iI", seconds, nanoseconds) + b"\x05\x00\x00\x00laser"
    assert stamp_s(sample) == pytest.approx(seconds + nanoseconds / 1e9)


def test_nothing_is_broken_when_all_is_heard() -> None:
    assert broken_lines(all_heard(), ANSWERED, True, NOW_S) == ()


@pytest.mark.parametrize("name", TOPICS)
def test_each_silent_topic_is_broken(name: str) -> None:
    (line,) = broken_lines({**all_heard(), name: Heard()}, ANSWERED, True, NOW_S)
    assert line.startswith(f"{name}: 0 samples")


@pytest.mark.parametrize("name", SERVICES)
def test_each_service_without_answer_is_broken(name: str) -> None:
    assert broken_lines(all_heard(), {**ANSWERED, name: None}, True, NOW_S) == (f"{name}: no answer",)


def test_deaf_drive_bus_is_broken() -> None:
    (line,) = broken_lines(all_heard(), ANSWERED, False, NOW_S)
    assert line.startswith(DRIVE_INPUT)


def test_slow_or_stopped_topic_is_not_usable() -> None:
    required = TOPICS["/scan"]
    assert is_usable(required, heard(10.0), NOW_S)
    assert is_usable(required, heard(6.0), NOW_S)
    assert not is_usable(required, heard(2.0), NOW_S)
    assert not is_usable(required, heard(10.0), NOW_S + 2 * WINDOW_S)


@pytest.mark.parametrize("age_s", [-2 * MAX_AGE_S, 2 * MAX_AGE_S])
def test_samples_from_another_time_are_not_usable(age_s: float) -> None:
    assert not is_usable(TOPICS["/scan"], heard(10.0, age_s), NOW_S)
    (line,) = broken_lines({**all_heard(), "/scan": heard(10.0, age_s)}, ANSWERED, True, NOW_S)
    assert line.endswith("s old")


def test_required_topics_and_services_are_those_of_the_graph() -> None:
    for name, required in TOPICS.items():
        row = graph.topic(name)
        assert row is not None and row.rate_hz == required.rate_hz
        assert row.type.replace("/msg/", "/") == required.type
    types = {row.name: row.type.replace("/srv/", "/") for row in graph.services()}
    assert {name: types[name] for name in SERVICES} == SERVICES
    assert graph.CMD_VEL_MANUAL.name == DRIVE_INPUT
