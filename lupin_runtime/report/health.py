"""Names and units of the sensors for people, and the health of plants by the twin's rules."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from lupin_runtime.twin.health import IDEAL_RANGES, STATES, assess
from lupin_runtime.twin.health import deviation as deviation_from

HEALTHY, STRESSED, CRITICAL, NO_DATA = "healthy", "stressed", "critical", "no_data"

_LABELS = {
    "temperature": "Temperature",
    "humidity": "Humidity",
    "co2": "CO₂",
    "light": "Light",
    "soil_moisture": "Soil moisture",
}


@dataclass(frozen=True)
class Sensor:
    """A sensor's name for people, its unit and its ideal range."""

    label: str
    unit: str
    low: float
    high: float


SENSORS: dict[str, Sensor] = {
    name: Sensor(_LABELS.get(name, name), ideal.unit, ideal.minimum, ideal.maximum) for name, ideal in IDEAL_RANGES.items()
}


def deviation(sensor: str, value: float) -> float:
    """Return how far a value is outside its ideal range, in widths of the range, at most 2.

    Returns 0 inside the range, for NaN and for unknown sensors.
    """
    ideal = IDEAL_RANGES.get(sensor)
    return deviation_from(value, ideal) if ideal is not None else 0.0


def grade(worst_deviation: float) -> str:
    """Return healthy, stressed or critical."""
    return next(name for limit, name in STATES if worst_deviation < limit)


def health(readings: Iterable[tuple[str, float]]) -> tuple[str, float]:
    """Return (grade, worst deviation) of all (sensor, value); (no_data, 0) without a known sensor."""
    found = assess(("", {sensor: value}) for sensor, value in readings)
    return found.state, found.score
