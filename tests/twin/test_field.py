"""The laws of the interpolated field."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lupin_runtime.twin.field import FieldCache, FieldError, FieldRequest, IdwOptions, interpolate
from lupin_runtime.twin.health import IDEAL_RANGES, assess, deviation

OPTIONS = IdwOptions()
ROUNDING_M = 1e-9
coordinate = st.floats(-3.0, 3.0)
samples_lists = st.lists(st.tuples(coordinate, coordinate, st.floats(-1e4, 1e4)), min_size=1, max_size=8)


def request(resolution=0.25, box=(-2.0, -2.0, 2.0, 2.0), sensor="co2"):
    return FieldRequest(sensor, resolution, *box)


def by_the_book(asked, samples, options):
    """The contract's rules, cell by cell; and which cells they decide beyond rounding: not one that lies on a limit, or takes
    the nearest value and is as near to one sample as to another."""
    values = np.full((asked.height, asked.width), np.nan)
    decided = np.ones(values.shape, bool)
    limits = (1e-3, options.falloff_radius_m, options.max_distance_m)
    for row in range(asked.height):
        for column in range(asked.width):
            x = asked.min_x + (column + 0.5) * asked.resolution
            y = asked.min_y + (row + 0.5) * asked.resolution
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


@settings(max_examples=40, deadline=None)
@example([(0.0, 0.0, 0.0), (0.0, 2.220446049250313e-16, 1.0)], 1.0, 2.0, 1.0)
@given(samples_lists, st.floats(0.3, 2.0), st.floats(0.3, 3.0), st.sampled_from([1.0, 2.0, 3.0]))
def test_the_field_is_the_one_of_the_rules(samples, falloff, max_distance, power):
    options = IdwOptions(power, falloff, max_distance)
    asked = request(0.5)
    field = interpolate(asked, samples, options)
    expected, decided = by_the_book(asked, samples, options)
    assert np.array_equal(np.isnan(field.values[decided]), np.isnan(expected[decided]))
    assert np.allclose(field.values[decided], expected[decided], rtol=1e-4, atol=1e-2, equal_nan=True)


@settings(max_examples=40, deadline=None)
@given(samples_lists)
def test_no_cell_leaves_the_range_of_the_samples(samples):
    field = interpolate(request(), samples, OPTIONS)
    known = field.values[np.isfinite(field.values)]
    values = np.array([s[2] for s in samples], np.float32)
    if known.size:
        assert values.min() <= known.min() and known.max() <= values.max()
        assert (field.minimum, field.maximum) == (known.min(), known.max())
    else:
        assert (field.minimum, field.maximum) == (0.0, 0.0)


@settings(max_examples=30, deadline=None)
@given(samples_lists, st.randoms())
def test_the_order_of_the_samples_changes_nothing_visible(samples, chance):
    shuffled = list(samples)
    chance.shuffle(shuffled)
    one, two = (interpolate(request(), s, OPTIONS).values for s in (samples, shuffled))
    # Two samples at one place with two values have no order that could be right.
    if len({(round(x, 3), round(y, 3)) for x, y, _ in samples}) == len(samples):
        assert np.allclose(one, two, rtol=1e-4, atol=1e-2, equal_nan=True)


def test_equal_radii_leave_no_ring_of_nearest_values():
    """Where the falloff were smaller than the maximal distance, a ring around each sample would show its value alone."""
    field = interpolate(request(0.1), [(0.0, 0.0, 10.0), (1.2, 0.0, 20.0)], OPTIONS)
    row = field.values[20]
    steps = np.abs(np.diff(row[np.isfinite(row)]))
    assert steps.max() < 2.0


def test_the_rows_run_along_x_from_the_minimum():
    field = interpolate(request(1.0, (0.0, 0.0, 3.0, 2.0)), [(2.5, 0.5, 7.0)], OPTIONS)
    assert field.values.shape == (2, 3)
    assert field.values[0, 2] == 7.0 and np.isnan(field.values[0, 0])
    assert field.samples == 1


@pytest.mark.parametrize(
    ("resolution", "box", "shape"),
    [(0.25, (0, 0, 1, 0.5), (2, 4)), (0.3, (0, 0, 1, 1), (4, 4)), (5.0, (0, 0, 1, 1), (1, 1)), (0.5, (1, 1, 1, 1), (1, 1))],
)
def test_sizes_are_rounded_up_and_at_least_one(resolution, box, shape):
    assert interpolate(request(resolution, box), [], OPTIONS).values.shape == shape


def test_sides_that_come_as_float32_do_not_grow_a_cell():
    tenth = float(np.float32(0.1))
    assert FieldRequest("co2", tenth, 0.0, 0.0, 1.0, float(np.float32(0.7))).width == 10
    assert FieldRequest("co2", tenth, 0.0, 0.0, 1.0, float(np.float32(0.7))).height == 7


def test_without_samples_all_is_unknown_and_that_is_no_error():
    field = interpolate(request(), [], OPTIONS)
    assert np.isnan(field.values).all() and (field.minimum, field.maximum, field.samples) == (0.0, 0.0, 0)


@pytest.mark.parametrize(
    ("asked", "problem"),
    [
        (request(sensor=""), "sensor_type is empty"),
        (request(0.0), "must be positive"),
        (request(-1.0), "must be positive"),
        (request(math.nan), "must be positive"),
        (request(box=(0, 0, -1, 1)), "lies below its minimum"),
        (request(box=(0, 0, math.inf, 1)), "no number"),
        (request(1e-6), "ask for a coarser resolution"),
    ],
)
def test_requests_that_make_no_sense_are_refused(asked, problem):
    with pytest.raises(FieldError, match=problem):
        interpolate(asked, [], OPTIONS)


def test_the_cache_keeps_the_fields_used_last():
    cache = FieldCache(entries=3)
    fields = [interpolate(request(0.5 + k), [(0.0, 0.0, float(k))], OPTIONS) for k in range(4)]
    for k in range(3):
        cache.put(request(0.5 + k), 1, fields[k])
    assert cache.get(request(0.5), 1) is fields[0]
    cache.put(request(3.5), 1, fields[3])
    assert cache.get(request(1.5), 1) is None and cache.get(request(0.5), 1) is fields[0]
    assert cache.get(request(0.5), 2) is None and len(cache) == 3


# -- health --------------------------------------------------------------------------------------------------------------

TEMPERATURE = IDEAL_RANGES["temperature"]


@pytest.mark.parametrize(
    ("value", "expected"), [(18, 0), (26, 0), (22, 0), (30, 0.5), (14, 0.5), (99, 2.0), (math.nan, 0), (math.inf, 0)]
)
def test_deviation_is_measured_in_widths_of_the_range_and_capped(value, expected):
    assert deviation(value, TEMPERATURE) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("value", "state"), [(26.0, "healthy"), (28.3, "healthy"), (28.5, "stressed"), (31.5, "stressed"), (31.7, "critical")]
)
def test_states_begin_at_their_limits(value, state):
    assert assess([("1", {"temperature": value})]).state == state


def test_the_worst_reading_decides_and_is_named():
    health = assess([("1", {"temperature": 28.0, "ph": 900.0}), ("2", {"co2": 1500.0, "light": math.nan})])
    assert (health.state, health.driver.tag_id, health.driver.sensor) == ("critical", "2", "co2")
    assert health.score == pytest.approx(500 / 600) == health.driver.deviation


def test_without_a_known_reading_there_is_no_data():
    assert assess([]).state == "no_data"
    assert assess([("1", {"ph": 7.0}), ("2", {"co2": math.nan})]).driver is None


def test_soil_moisture_counts_the_same_as_a_fraction_and_in_per_cent():
    """The greenhouse package gives 0.45 where people and the ideal range say 45 %."""
    for value in (0.45, 45.0):
        health = assess([("1", {"soil_moisture": value})])
        assert (health.state, health.driver.value) == ("healthy", 45.0)


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_deviation_is_always_within_its_cap(value):
    assert 0.0 <= deviation(value, TEMPERATURE) <= 2.0
