"""The health of plants: readings compared with ideal ranges."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

MAX_DEVIATION = 2.0
# Each state applies to deviations below its limit.
STATES = ((0.3, "healthy"), (0.7, "stressed"), (math.inf, "critical"))
OFF_RANGE = "off_range"


@dataclass(frozen=True)
class IdealRange:
    """The ideal range of a sensor, in its natural unit."""

    minimum: float
    maximum: float
    unit: str


IDEAL_RANGES: Mapping[str, IdealRange] = {
    "temperature": IdealRange(18.0, 26.0, "°C"),
    "humidity": IdealRange(40.0, 70.0, "%"),
    "co2": IdealRange(400.0, 1000.0, "ppm"),
    "light": IdealRange(200.0, 800.0, "lux"),
    "soil_moisture": IdealRange(30.0, 60.0, "%"),
}


@dataclass(frozen=True)
class WorstReading:
    """The reading with the largest deviation, which decides the health."""

    tag_id: str
    sensor: str
    value: float
    ideal: IdealRange
    deviation: float


@dataclass(frozen=True)
class Health:
    """`state` is healthy, stressed, critical or no_data; `score` the worst deviation; `worst` is its reading."""

    state: str
    score: float
    worst: WorstReading | None


def in_natural_unit(sensor: str, value: float) -> float:
    """Return a value in the sensor's natural unit.

    The greenhouse package gives soil moisture as a fraction, other sources in percent. Values up to 1 are fractions: no soil
    with plants has a moisture of 1 %.
    """
    return value * 100.0 if sensor == "soil_moisture" and 0.0 <= value <= 1.0 else value


def deviation(value: float, ideal: IdealRange) -> float:
    """Return the distance to the nearer bound in widths of the range, at most 2; 0 within the range and for NaN."""
    if not math.isfinite(value):
        return 0.0
    outside = max(ideal.minimum - value, value - ideal.maximum, 0.0)
    return min(MAX_DEVIATION, outside / (ideal.maximum - ideal.minimum))


def shown_state(state: str, worst_deviation: float) -> str:
    """Return the state that marks and colors show: OFF_RANGE for `healthy` with a reading outside its range, however little.

    A green mark beside a reading that is marked as too low or too high would contradict it.
    """
    return OFF_RANGE if state == STATES[0][1] and worst_deviation > 0.0 else state


def assess(readings: Iterable[tuple[str, Mapping[str, float]]], ranges: Mapping[str, IdealRange] = IDEAL_RANGES) -> Health:
    """Return the health by the worst of all (tag id, {sensor: value}). Sensors without a range are ignored."""
    worst: WorstReading | None = None
    for tag_id, values in readings:
        for sensor, value in values.items():
            ideal = ranges.get(sensor)
            if ideal is None or not math.isfinite(value):
                continue
            natural = in_natural_unit(sensor, value)
            found = WorstReading(tag_id, sensor, natural, ideal, deviation(natural, ideal))
            if worst is None or found.deviation > worst.deviation:
                worst = found
    if worst is None:
        return Health("no_data", 0.0, None)
    state = next(name for limit, name in STATES if worst.deviation < limit)
    return Health(state, worst.deviation, worst)
