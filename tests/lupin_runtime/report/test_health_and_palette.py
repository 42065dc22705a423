"""Health grades and colors of the report."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.report.health import SENSORS, deviation, health
from lupin_runtime.report.page.tag_rows import reading_row
from lupin_runtime.report.palette import SPEED_RAMP, TIME_RAMP, heat_rgb, ramp, species_label
from lupin_runtime.report.tags import LatestReading


@pytest.mark.parametrize(
    ("sensor", "value", "expected"),
    [
        ("temperature", 18.0, 0.0),
        ("temperature", 26.0, 0.0),
        ("temperature", 28.0, 0.25),
        ("temperature", 10.0, 1.0),
        ("co2", 1480.0, 0.8),
        ("co2", 1e9, 2.0),
        ("humidity", math.nan, 0.0),
        ("radon", 1.0, 0.0),
    ],
)
def test_deviation_is_in_widths_of_the_ideal_range(sensor: str, value: float, expected: float) -> None:
    assert deviation(sensor, value) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("readings", "expected"),
    [
        ([], "no_data"),
        ([("radon", 3.0)], "no_data"),
        ([("temperature", math.nan)], "no_data"),
        ([("temperature", 20.0)], "healthy"),
        ([("temperature", 20.0), ("humidity", 82.0)], "stressed"),
        ([("temperature", 20.0), ("co2", 1480.0)], "critical"),
    ],
)
def test_worst_reading_decides(readings: list[tuple[str, float]], expected: str) -> None:
    assert health(readings)[0] == expected


@pytest.mark.parametrize(
    ("value", "note", "state"),
    [
        (26.0, "", "healthy"),
        (27.0, "a little high", "off_range"),
        (29.0, "stressed high", "stressed"),
        (40.0, "critical high", "critical"),
    ],
)
def test_reading_with_a_note_is_not_marked_healthy(value: float, note: str, state: str) -> None:
    row = reading_row(LatestReading("temperature", value, 1.0, deviation("temperature", value)))
    assert (row.note, row.health) == (note, state)


@given(st.sampled_from(sorted(SENSORS)), st.floats(allow_nan=False, allow_infinity=False))
def test_deviation_is_bounded_and_zero_inside_the_range(sensor: str, value: float) -> None:
    ideal = SENSORS[sensor]
    found = deviation(sensor, value)
    assert 0.0 <= found <= 2.0
    assert (found == 0.0) == (ideal.low <= value <= ideal.high) or found < 1e-12


def test_heat_color_darkens_with_the_value() -> None:
    for sensor in SENSORS:
        assert sum(heat_rgb(sensor, 0.0)) > sum(heat_rgb(sensor, 1.0))
    assert heat_rgb("temperature", 0.0) == (240, 204, 168)  # hsl(30 70% 80%)


@given(st.floats(-2.0, 3.0))
def test_ramp_returns_a_color_for_every_fraction(fraction: float) -> None:
    for stops in (TIME_RAMP, SPEED_RAMP):
        color = ramp(stops, fraction)
        assert len(color) == 7
        assert color.startswith("#")
        int(color[1:], 16)
    assert ramp(TIME_RAMP, 0.0) == TIME_RAMP[0]
    assert ramp(TIME_RAMP, 1.0) == TIME_RAMP[-1]


def test_species_label_is_readable() -> None:
    assert [species_label(s) for s in ("tulip_red", "", "daisy")] == ["Red tulip", "Unclassified", "Daisy"]
