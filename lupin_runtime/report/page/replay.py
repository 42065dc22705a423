"""The data of the page's time slider: the robot's pose, scans, images and readings over time, in a compact form."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.report.health import SENSORS
from lupin_runtime.report.images import data_uri, known_extent, map_png, thumbnail
from lupin_runtime.report.page.canvas import Canvas
from lupin_runtime.report.report_json import ReportInput, thin
from lupin_runtime.report.run_log import LidarScan

_POSE_PERIOD_S = 0.2
_SPEED_PERIOD_S = 1.0
_MAX_POSES, _MAX_SCANS, _MAX_IMAGES = 9000, 600, 150
_MIN_MAPS, _MAX_MAPS, _MAX_MAP_CELLS = 8, 48, 4_000_000
_BEAMS = 120
_IMAGE_PX = 240


def replay_data(report: ReportInput, canvas: Canvas) -> dict[str, Any]:
    """Return plain data for the script. Poses are in tenths of a second, centimeters of the canvas and milliradians."""
    log = report.log
    bands = report.timeline
    return {
        "end": round(log.end_s, 1),
        "origin": [round(v, 1) for v in canvas.at(0.0, 0.0)],
        "pose": _poses(report, canvas),
        "states": [[round(b.from_s, 1), round(b.to_s, 1), b.label] for b in bands.states],
        "legs": [[round(b.from_s, 1), round(b.to_s, 1), b.label, b.detail] for b in bands.legs],
        "flags": [[round(b.from_s, 1), round(b.to_s, 1), b.label] for b in bands.flags],
        "speed": _thin([(t, v) for t, v, _ in log.speed], 2),
        "battery": _thin(log.battery, 3),
        "events": sorted({round(event.t_s, 1) for event in bands.events}),
        "maps": _maps(report, canvas),
        "tags": sorted([round(d.first_t_s, 1), tag_id] for tag_id, d in log.discovered.items()),
        "readings": [
            [round(entry.t_s, 1), entry.tag_id, _summary(entry.readings)]
            for entry in log.observations
            if entry.kind == "tag_reading" and entry.status == "ok"
        ],
        "pictures": _images(report),
        "scans": _scans(report),
    }


def _poses(report: ReportInput, canvas: Canvas) -> dict[str, list[int]]:
    path = report.log.trajectory
    if not len(path):
        return {"t": [], "x": [], "y": [], "yaw": []}
    keep = thin(path.t_s, max(_POSE_PERIOD_S, report.log.end_s / _MAX_POSES))
    x, y = canvas.at(path.x[keep], path.y[keep])  # type: ignore[arg-type]
    return {
        "t": np.round(path.t_s[keep] * 10).astype(int).tolist(),
        "x": np.round(x).astype(int).tolist(),
        "y": np.round(y).astype(int).tolist(),
        "yaw": np.round(path.yaw[keep] * 1000).astype(int).tolist(),
    }


def _maps(report: ReportInput, canvas: Canvas) -> list[dict[str, Any]]:
    """Return the map over time: fewer of them where it is large."""
    snapshots = report.log.map_history.snapshots
    if not snapshots:
        return []
    count = min(_MAX_MAPS, max(_MIN_MAPS, _MAX_MAP_CELLS // max(1, snapshots[-1].height * snapshots[-1].width)))
    found = []
    for snapshot in snapshots[:: max(1, math.ceil(len(snapshots) / count))]:
        grid = snapshot.grid
        extent = known_extent(grid)
        if extent is None:
            continue
        found.append(
            {
                "t": round(snapshot.t_s, 1),
                "box": {name: round(value, 1) for name, value in canvas.box(extent).items()},
                **{theme: data_uri(map_png(grid, extent, theme, scale=1), "png") for theme in ("light", "dark")},
            }
        )
    return found


def _thin(points: list[tuple[float, float]], digits: int) -> list[list[float]]:
    keep = thin([t for t, _ in points], _SPEED_PERIOD_S)
    return [[round(points[i][0], 1), round(points[i][1], digits)] for i in keep]


def _summary(readings: tuple[tuple[str, float], ...]) -> str:
    parts = []
    for sensor, value in readings:
        ideal = SENSORS.get(sensor)
        parts.append(f"{value:.4g} {ideal.unit}" if ideal else f"{sensor} {value:.4g}")
    return " · ".join(parts)


def _images(report: ReportInput) -> list[list[Any]]:
    images = report.log.body_images
    step = max(1, math.ceil(len(images) / _MAX_IMAGES))
    found: list[list[Any]] = []
    for image in images[::step]:
        jpeg = thumbnail(image.jpeg, _IMAGE_PX, quality=50)
        if jpeg is not None:
            found.append([round(image.t_s, 1), data_uri(jpeg, "jpeg")])
    return found


def _scans(report: ReportInput) -> dict[str, Any] | None:
    scans = report.log.scans
    if not scans:
        return None
    scans = scans[:: max(1, math.ceil(len(scans) / _MAX_SCANS))]
    beams = scans[0].ranges.size
    every = max(1, beams // _BEAMS)
    laser = report.log.base_from_laser or Pose2()
    return {
        "first": round(scans[0].angle_min, 5),
        "step": round(scans[0].angle_step * every, 6),
        "laser": [round(laser.x * 100.0, 1), round(laser.y * 100.0, 1), round(laser.yaw, 5)],
        "rows": [[round(scan.t_s, 1), _pack(scan, every)] for scan in scans if scan.ranges.size == beams],
    }


def _pack(scan: LidarScan, every: int) -> str:
    """Encode ranges in whole centimeters as base64 of little-endian uint16; 0 means no echo."""
    centimeters = np.nan_to_num(scan.ranges[::every] * 100.0, nan=0.0).clip(0, 65535).astype("<u2")
    return base64.b64encode(centimeters.tobytes()).decode("ascii")
