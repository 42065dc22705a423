"""The data behind the page's time slider: where the robot was, what it saw and knew at any moment, in few bytes."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np

from lupin_runtime.report.content import Material, thin
from lupin_runtime.report.health import SENSORS
from lupin_runtime.report.log import Scan
from lupin_runtime.report.page.map_svg import Canvas
from lupin_runtime.report.raster import data_uri, thumbnail

_POSE_PERIOD_S = 0.2
_SPEED_PERIOD_S = 1.0
_MOST_POSES, _MOST_SCANS, _MOST_PICTURES = 9000, 600, 150
_BEAMS = 120
_PICTURE_PX = 240


def replay_data(material: Material, canvas: Canvas) -> dict[str, Any]:
    """Plain data for the script: times in tenths of a second, places in centimetres of the canvas, angles in milliradians."""
    log = material.log
    bands = material.timeline
    return {
        "end": round(log.end_s, 1),
        "origin": [round(v, 1) for v in canvas.at(0.0, 0.0)],
        "pose": _poses(material, canvas),
        "states": [[round(b.from_s, 1), round(b.to_s, 1), b.label] for b in bands.states],
        "legs": [[round(b.from_s, 1), round(b.to_s, 1), b.label, b.detail] for b in bands.legs],
        "flags": [[round(b.from_s, 1), round(b.to_s, 1), b.label] for b in bands.flags],
        "speed": _thin([(t, v) for t, v, _ in log.speed], 2),
        "battery": _thin(log.battery, 3),
        "tags": sorted([round(d.first_t_s, 1), tag_id] for tag_id, d in log.discovered.items()),
        "readings": [
            [round(seen.t_s, 1), seen.tag_id, _words(seen.readings)]
            for seen in log.seen
            if seen.kind == "tag_reading" and seen.status == "ok"
        ],
        "pictures": _pictures(material),
        "scans": _scans(material),
    }


def _poses(material: Material, canvas: Canvas) -> dict[str, list[int]]:
    path = material.log.trajectory
    if not len(path):
        return {"t": [], "x": [], "y": [], "yaw": []}
    keep = thin(path.t_s, max(_POSE_PERIOD_S, material.log.end_s / _MOST_POSES))
    x, y = canvas.at(path.x[keep], path.y[keep])  # type: ignore[arg-type]
    return {
        "t": np.round(path.t_s[keep] * 10).astype(int).tolist(),
        "x": np.round(x).astype(int).tolist(),
        "y": np.round(y).astype(int).tolist(),
        "yaw": np.round(path.yaw[keep] * 1000).astype(int).tolist(),
    }


def _thin(points: list[tuple[float, float]], digits: int) -> list[list[float]]:
    keep = thin([t for t, _ in points], _SPEED_PERIOD_S)
    return [[round(points[i][0], 1), round(points[i][1], digits)] for i in keep]


def _words(readings: tuple[tuple[str, float], ...]) -> str:
    parts = []
    for sensor, value in readings:
        ideal = SENSORS.get(sensor)
        parts.append(f"{value:.4g} {ideal.unit}" if ideal else f"{sensor} {value:.4g}")
    return " · ".join(parts)


def _pictures(material: Material) -> list[list[Any]]:
    pictures = material.log.body_pictures
    step = max(1, math.ceil(len(pictures) / _MOST_PICTURES))
    found: list[list[Any]] = []
    for picture in pictures[::step]:
        small = thumbnail(picture.jpeg, _PICTURE_PX, quality=50)
        if small is not None:
            found.append([round(picture.t_s, 1), data_uri(small, "jpeg")])
    return found


def _scans(material: Material) -> dict[str, Any] | None:
    scans = material.log.scans
    if not scans:
        return None
    scans = scans[:: max(1, math.ceil(len(scans) / _MOST_SCANS))]
    beams = scans[0].ranges.size
    every = max(1, beams // _BEAMS)
    laser = material.log.laser_in_base
    return {
        "first": round(scans[0].angle_min, 5),
        "step": round(scans[0].angle_step * every, 6),
        "laser": [round(laser.x * 100.0, 1), round(laser.y * 100.0, 1), round(laser.yaw, 5)],
        "rows": [[round(scan.t_s, 1), _packed(scan, every)] for scan in scans if scan.ranges.size == beams],
    }


def _packed(scan: Scan, every: int) -> str:
    """Ranges in whole centimetres as base64 of little-endian uint16; 0 is no echo."""
    centimetres = np.nan_to_num(scan.ranges[::every] * 100.0, nan=0.0).clip(0, 65535).astype("<u2")
    return base64.b64encode(centimetres.tobytes()).decode("ascii")
