"""The map's controls and legends: color ramps, layers and symbols."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lupin_runtime.report.findings import clock
from lupin_runtime.report.health import SENSORS
from lupin_runtime.report.images import HeatMap
from lupin_runtime.report.page.map_drawing import max_speed
from lupin_runtime.report.palette import HEAT_ALPHA, SPECIES, SPEED_RAMP, TIME_RAMP, heat_rgb, species_label
from lupin_runtime.report.report_json import ReportInput


@dataclass(frozen=True)
class Ramp:
    """A color ramp with the values at its ends; `css` names what it belongs to, such as `heat-legend heat-co2`."""

    css: str
    name: str
    low: str
    high: str
    stops: str
    note: str = ""


@dataclass(frozen=True)
class Layer:
    """A layer of the map that the reader may show or hide."""

    name: str
    label: str
    shown: bool


def path_ramps(report: ReportInput) -> list[Ramp]:
    """Return the ramps of the path's colors."""
    end, top = clock(report.log.end_s), f"{max_speed(report):.2f} m/s"
    return [
        Ramp("path-legend by-time", "Path by time", "0:00", end, ",".join(TIME_RAMP)),
        Ramp("path-legend by-speed", "Path by speed", "0", top, ",".join(SPEED_RAMP)),
    ]


def heat_ramps(heat: Sequence[HeatMap]) -> list[Ramp]:
    """Return the ramp of each heat map, with the sensor's ideal range."""
    ramps = []
    for h in heat:
        sensor = SENSORS[h.sensor]
        stops = ",".join("rgba({},{},{},{:.2f})".format(*heat_rgb(h.sensor, i / 8), HEAT_ALPHA * i / 8) for i in range(9))
        note = f"ideal: {sensor.low:g} to {sensor.high:g} {sensor.unit} · {h.samples} tag{'s' if h.samples != 1 else ''}"
        css = f"heat-legend heat-{h.sensor}"
        ramps.append(Ramp(css, sensor.label, f"{h.low:.4g}", f"{h.high:.4g} {sensor.unit}", stops, note))
    return ramps


def layers(report: ReportInput) -> list[Layer]:
    """Return the layers that this run has data for."""
    found = [Layer("path", "Path", True), Layer("tags", "Tags", True)]
    found += [Layer("flowers", "Flowers", True), Layer("boxes", "Boxes", True)]
    if report.log.scans:
        found.append(Layer("scan", "Lidar", True))
    if report.truth:
        found.append(Layer("truth", "Truth", False))
    return found


def species_colors(report: ReportInput) -> list[tuple[str, str]]:
    """Return (label, color) of each species on the map."""
    found = {placed.species for tag in report.tags if tag.flower for placed in tag.flower.placed}
    return [(species_label(name), color) for name, color in SPECIES.items() if name in found]
