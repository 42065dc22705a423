"""Colours with a meaning: species, health, sensors, mission states. Each also stands as a word wherever it is used."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence

SPECIES = {"tulip_red": "#e23a3a", "tulip_white": "#e8e8ee", "tulip_pink": "#ec6aa6"}
SPECIES_OTHER = "#9aa0aa"
HEALTH = {"healthy": "#3ec46d", "stressed": "#e0b341", "critical": "#e23a3a", "no_data": "#6b7280"}

STATES = {
    "BOOT": "#8b929c",
    "READY": "#6b7785",
    "PREPARE": "#8a79c9",
    "EXPLORING": "#3f7fd6",
    "INSPECTING": "#1f9a8a",
    "MONITORING": "#2c9f5d",
    "RETURNING": "#d08a1d",
    "DONE": "#3c8f4f",
    "FAULT": "#cf3b3b",
}
STATE_OTHER = "#8b929c"

# hue in degrees, lightness of the lowest and of the highest value in percent; the saturation is 70 % for all.
_HEAT = {
    "temperature": (30, 80, 40),
    "humidity": (190, 75, 45),
    "co2": (5, 78, 42),
    "light": (50, 80, 50),
    "soil_moisture": (165, 75, 42),
}
HEAT_SATURATION = 0.70
HEAT_ALPHA = 0.6

# Readable on light and on dark ground: no stop is near white or near black.
TIME_RAMP = ("#5b4bb7", "#2f86c9", "#1fa187", "#a9b72f", "#f0952c")
SPEED_RAMP = ("#4a6fb5", "#27a39a", "#8cb83d", "#f0a02c", "#d8432f")


def species_label(species: str) -> str:
    """`tulip_red` as people say it."""
    if not species:
        return "Unclassified"
    kind, _, colour = species.partition("_")
    return f"{colour} {kind}".capitalize() if colour else species.capitalize()


def ramp(stops: Sequence[str], fraction: float) -> str:
    """The colour at `fraction` (clamped to [0, 1]) of evenly spaced stops."""
    position = min(1.0, max(0.0, fraction)) * (len(stops) - 1)
    low = min(int(position), len(stops) - 2)
    between = position - low
    a, b = (_rgb(stops[low]), _rgb(stops[low + 1]))
    return "#" + "".join(f"{round(x + (y - x) * between):02x}" for x, y in zip(a, b))


def heat_rgb(sensor: str, fraction: float) -> tuple[int, int, int]:
    """The heat map's colour of a value at `fraction` between the lowest and the highest."""
    hue, low, high = _HEAT.get(sensor, (220, 78, 42))
    lightness = (low + (high - low) * fraction) / 100.0
    r, g, b = colorsys.hls_to_rgb(hue / 360.0, lightness, HEAT_SATURATION)
    return round(r * 255), round(g * 255), round(b * 255)


def _rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
