"""The interpolated field and the health of plants."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lupin_runtime.twin.field import FieldCache, FieldError, FieldRequest, IdwOptions, interpolate
from lupin_runtime.twin.health import IDEAL_RANGES, OFF_RANGE, assess, deviation, shown_state

Box = tuple[float, float, float, float]
Samples = list[tuple[float, float, float]]
Floats = NDArray[np.float64]

OPTIONS = IdwOptions()
ROUNDING_M = 1e-9
coordinate = st.floats(-3.0, 3.0)
samples_lists = st.lists(st.tuples(coordinate, coordinate, st.floats(-1e4, 1e4)), min_size=1, max_size=8)


def request(resolution: float = 0.25, box: Box = (-2.0, -2.0, 2.0, 2.0), sensor: str = "co2") -> FieldRequest:
    return FieldRequest(sensor, resolution, *box)


def reference_field(field_request: FieldRequest, samples: Samples, options: IdwOptions) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the field, computed cell by cell, and a mask of the cells whose value does not depend on rounding.

    Rounding decides a cell whose distance to a sample is at a limit, and one that takes the value of the nearest sample but is
    equally near to another."""
    values = np.full((field_request.height, field_request.width), np.nan)
    decided = np.ones(values.shape, bool)
    limits = (1e-3, options.falloff_radius_m, options.max_distance_m)
    for row in range(field_request.height):
        for column in range(field_request.width):
            x = field_request.min_x + (column + 0.5) * field_request.resolution
            y = field_request.min_y + (row + 0.5) * field_request.resolution
            distances = [math.dist((x, y), s[:2]) for s in samples]
            nearest = min(range(len(samples)), key=lambda k: distances[k])
            decided[row, column] = all(abs(distance - limit) >= ROUNDING_M for distance in distances for limit in limits)
            if distances[nearest] > options.max_distance_m:
                continue
            near = [k for k, d in enumerate(distances) if d <= options.falloff_radius_m]
            if distances[nearest] < 1e-3 or not near:
                values[row, column] = samples[nearest][2]
                rivals = {s[2] for s, distance in zip(samples, distances) if distance < distances[nearest] + ROUNDING_M}
                decided[row, column] &= len(rivals) == 1
                continue
            weights = [distances[k] ** -options.power for k in near]
            values[row, column] = sum(w * samples[k][2] for w, k in zip(weights, near)) / sum(weights)
    return values, decided


@settings(max_examples=40)
@example([(0.0, 0.0, 0.0), (0.0, 2.220446049250313e-16, 1.0)], 1.0, 2.0, 1.0)
@given(samples_lists, st.floats(0.3, 2.0), st.floats(0.3, 3.0), st.sampled_from([1.0, 2.0, 3.0]))
def test_field_matches_reference_implementation(samples: Samples, falloff: float, max_distance: float, power: float) -> None:
    options = IdwOptions(power, falloff, max_distance)
    field_request = request(0.5)
    field = interpolate(field_request, samples, options)
    expected, decided = reference_field(field_request, samples, options)
    assert np.array_equal(np.isnan(field.values[decided]), np.isnan(expected[decided]))
    assert np.allclose(field.values[decided], expected[decided], rtol=1e-4, atol=1e-2, equal_nan=True)


@settings(max_examples=40)
@given(samples_lists)
def test_field_stays_within_range_of_samples(samples: Samples) -> None:
    field = interpolate(request(), samples, OPTIONS)
    known = field.values[np.isfinite(field.values)]
    values = np.array([s[2] for s in samples], np.float32)
    if known.size:
        assert values.min() <= known.min() and known.max() <= values.max()
        assert (field.minimum, field.maximum) == (known.min(), known.max())
    else:
        assert (field.minimum, field.maximum) == (0.0, 0.0)


@settings(max_examples=30)
@given(samples_lists, st.randoms())
def test_field_does_not_depend_on_order_of_samples(samples: Samples, chance: Any) -> None:
    shuffled = list(samples)
    chance.shuffle(shuffled)
    one, two = (interpolate(request(), s, OPTIONS).values for s in (samples, shuffled))
    # Two samples at the same position with different values have no correct order.
    if len({(round(x, 3), round(y, 3)) for x, y, _ in samples}) == len(samples):
        assert np.allclose(one, two, rtol=1e-4, atol=1e-2, equal_nan=True)


def test_equal_radii_leave_no_ring_of_nearest_values() -> None:
    """If the falloff radius were smaller than the maximum distance, a ring of each sample's own value would show."""
    field = interpolate(request(0.1), [(0.0, 0.0, 10.0), (1.2, 0.0, 20.0)], OPTIONS)
    row = field.values[20]
    steps = np.abs(np.diff(row[np.isfinite(row)]))
    assert steps.max() < 2.0


def test_rows_run_along_x_from_the_minimum() -> None:
    field = interpolate(request(1.0, (0.0, 0.0, 3.0, 2.0)), [(2.5, 0.5, 7.0)], OPTIONS)
    assert field.values.shape == (2, 3)
    assert field.values[0, 2] == 7.0 and np.isnan(field.values[0, 0])
    assert field.samples == 1


@pytest.mark.parametrize(
    ("resolution", "box", "shape"),
    [(0.25, (0, 0, 1, 0.5), (2, 4)), (0.3, (0, 0, 1, 1), (4, 4)), (5.0, (0, 0, 1, 1), (1, 1)), (0.5, (1, 1, 1, 1), (1, 1))],
)
def test_sizes_are_rounded_up_and_at_least_one(resolution: float, box: Box, shape: tuple[int, int]) -> None:
    assert interpolate(request(resolution, box), [], OPTIONS).values.shape == shape


def test_float32_bounds_do_not_add_a_cell() -> None:
    tenth = float(np.float32(0.1))
    assert FieldRequest("co2", tenth, 0.0, 0.0, 1.0, float(np.float32(0.7))).width == 10
    assert FieldRequest("co2", tenth, 0.0, 0.0, 1.0, float(np.float32(0.7))).height == 7


def test_field_without_samples_is_unknown() -> None:
    field = interpolate(request(), [], OPTIONS)
    assert np.isnan(field.values).all() and (field.minimum, field.maximum, field.samples) == (0.0, 0.0, 0)


@pytest.mark.parametrize(
    ("field_request", "problem"),
    [
        (request(sensor=""), "sensor_type is empty"),
        (request(0.0), "expected a positive number"),
        (request(-1.0), "expected a positive number"),
        (request(math.nan), "expected a positive number"),
        (request(box=(0, 0, -1, 1)), "is below its minimum"),
        (request(box=(0, 0, math.inf, 1)), "not a finite number"),
        (request(1e-6), "request a coarser resolution"),
    ],
)
def test_invalid_field_requests_are_refused(field_request: FieldRequest, problem: str) -> None:
    with pytest.raises(FieldError, match=problem):
        interpolate(field_request, [], OPTIONS)


def test_cache_keeps_most_recently_used_fields() -> None:
    cache = FieldCache(entries=3)
    fields = [interpolate(request(0.5 + k), [(0.0, 0.0, float(k))], OPTIONS) for k in range(4)]
    for k in range(3):
        cache.put(request(0.5 + k), 1, fields[k])
    assert cache.get(request(0.5), 1) is fields[0]
    cache.put(request(3.5), 1, fields[3])
    assert cache.get(request(1.5), 1) is None and cache.get(request(0.5), 1) is fields[0]
    assert cache.get(request(0.5), 2) is None and len(cache) == 3


# -- health ------------------------------------------------------------------------------------------------------------

TEMPERATURE = IDEAL_RANGES["temperature"]


@pytest.mark.parametrize(
    ("value", "expected"), [(18, 0), (26, 0), (22, 0), (30, 0.5), (14, 0.5), (99, 2.0), (math.nan, 0), (math.inf, 0)]
)
def test_deviation_is_in_widths_of_the_range_and_capped(value: float, expected: float) -> None:
    assert deviation(value, TEMPERATURE) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("value", "state"), [(26.0, "healthy"), (28.3, "healthy"), (28.5, "stressed"), (31.5, "stressed"), (31.7, "critical")]
)
def test_health_states_begin_at_their_limits(value: float, state: str) -> None:
    assert assess([("1", {"temperature": value})]).state == state


@given(st.sampled_from(sorted(IDEAL_RANGES)), st.floats(1.5, 5000.0))
def test_only_readings_within_their_range_are_shown_healthy(sensor: str, value: float) -> None:
    health, ideal = assess([("1", {sensor: value})]), IDEAL_RANGES[sensor]
    shown = shown_state(health.state, health.score)
    assert (shown == "healthy") == (ideal.minimum <= value <= ideal.maximum)
    assert shown in (health.state, OFF_RANGE)


def test_worst_reading_decides_and_is_named() -> None:
    health = assess([("1", {"temperature": 28.0, "ph": 900.0}), ("2", {"co2": 1500.0, "light": math.nan})])
    assert health.worst is not None
    assert (health.state, health.worst.tag_id, health.worst.sensor) == ("critical", "2", "co2")
    assert health.score == pytest.approx(500 / 600) == health.worst.deviation


def test_health_without_known_reading_is_no_data() -> None:
    assert assess([]).state == "no_data"
    assert assess([("1", {"ph": 7.0}), ("2", {"co2": math.nan})]).worst is None


def test_soil_moisture_as_fraction_and_percent_are_equal() -> None:
    """The greenhouse package gives 0.45 for 45 %."""
    for value in (0.45, 45.0):
        health = assess([("1", {"soil_moisture": value})])
        assert health.worst is not None
        assert (health.state, health.worst.value) == ("healthy", 45.0)


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_deviation_is_always_within_its_cap(value: float) -> None:
    assert 0.0 <= deviation(value, TEMPERATURE) <= 2.0
