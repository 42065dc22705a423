"""Whether a plant is well: ideal ranges per sensor, and how far a reading is outside."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class IdealRange:
    """Where a sensor's reading should be, in its own unit."""

    label: str
    unit: str
    low: float
    high: float


SENSORS: dict[str, IdealRange] = {
    "temperature": IdealRange("Temperature", "°C", 18.0, 26.0),
    "humidity": IdealRange("Humidity", "%", 40.0, 70.0),
    "co2": IdealRange("CO₂", "ppm", 400.0, 1000.0),
    "light": IdealRange("Light", "lux", 200.0, 800.0),
    "soil_moisture": IdealRange("Soil moisture", "%", 30.0, 60.0),
}

HEALTHY, STRESSED, CRITICAL, NO_DATA = "healthy", "stressed", "critical", "no_data"
_STRESSED_FROM, _CRITICAL_FROM, _LARGEST = 0.3, 0.7, 2.0


def deviation(sensor: str, value: float) -> float:
    """Distance outside the ideal range in widths of that range, at most 2; 0 inside, for NaN and for unknown sensors."""
    ideal = SENSORS.get(sensor)
    if ideal is None or not math.isfinite(value):
        return 0.0
    outside = max(ideal.low - value, value - ideal.high, 0.0)
    return min(_LARGEST, outside / (ideal.high - ideal.low))


def grade(worst_deviation: float) -> str:
    """healthy, stressed or critical."""
    if worst_deviation < _STRESSED_FROM:
        return HEALTHY
    return STRESSED if worst_deviation < _CRITICAL_FROM else CRITICAL


def health(readings: Iterable[tuple[str, float]]) -> tuple[str, float]:
    """(grade, worst deviation) of all readings of known sensors; (no_data, 0) without one."""
    deviations = [deviation(sensor, value) for sensor, value in readings if sensor in SENSORS and math.isfinite(value)]
    if not deviations:
        return NO_DATA, 0.0
    return grade(max(deviations)), max(deviations)
