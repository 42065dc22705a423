"""Colors of species, health, sensors and mission states. A label accompanies each color wherever it is used."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence

SPECIES = {"tulip_red": "#e23a3a", "tulip_white": "#e8e8ee", "tulip_pink": "#ec6aa6"}
SPECIES_OTHER = "#9aa0aa"
HEALTH = {"healthy": "#3ec46d", "off_range": "#e0b341", "stressed": "#e0b341", "critical": "#e23a3a", "no_data": "#6b7280"}

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

# Readable on light and dark backgrounds: no stop is near white or black.
TIME_RAMP = ("#5b4bb7", "#2f86c9", "#1fa187", "#a9b72f", "#f0952c")
SPEED_RAMP = ("#4a6fb5", "#27a39a", "#8cb83d", "#f0a02c", "#d8432f")


def species_label(species: str) -> str:
    """Return a label: `tulip_red` becomes `Red tulip`."""
    if not species:
        return "Unclassified"
    kind, _, color = species.partition("_")
    return f"{color} {kind}".capitalize() if color else species.capitalize()


def flower_label(species: str, count: int) -> str:
    """Return a count with the species, such as `3 × red tulip`."""
    return f"{count} × {species_label(species).lower()}"


def ramp(stops: Sequence[str], fraction: float) -> str:
    """Return the color at `fraction` (clamped to [0, 1]) between evenly spaced stops."""
    position = min(1.0, max(0.0, fraction)) * (len(stops) - 1)
    low = min(int(position), len(stops) - 2)
    between = position - low
    a, b = (_rgb(stops[low]), _rgb(stops[low + 1]))
    return "#" + "".join(f"{round(x + (y - x) * between):02x}" for x, y in zip(a, b))


def heat_rgb(sensor: str, fraction: float) -> tuple[int, int, int]:
    """Return the heat map's RGB color at `fraction` between the lowest and the highest value."""
    hue, low, high = _HEAT.get(sensor, (220, 78, 42))
    lightness = (low + (high - low) * fraction) / 100.0
    r, g, b = colorsys.hls_to_rgb(hue / 360.0, lightness, HEAT_SATURATION)
    return round(r * 255), round(g * 255), round(b * 255)


def _rgb(color: str) -> tuple[int, int, int]:
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)
