"""Tag detection compared with the AprilTag library itself, on rendered views with blur, noise and clutter.

Limits: recall and corner error at least as good as the library's, with its default settings (half resolution) and at full
resolution; 10 ms per VGA frame on one core. All detectors run on the same frames, one after the other.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.perception.tags import detect, make_engine
from tests.support.tag_views import View, at_range

LIMIT_MS = 10.0
RANGES_M = (0.5, 1.0, 1.5, 2.0, 2.5)
ANGLES_DEG = (-60, -45, -30, -15, 0, 15, 30, 45, 60)

Corners = NDArray[np.float64]
Detector = Callable[[NDArray[np.uint8]], list[tuple[int, Corners]]]


def ours(engine_name: str) -> Detector:
    """Return Lupin's detector with the engine of that name."""
    engine = make_engine(engine_name)
    return lambda gray: [(d.id, d.corners) for d in detect(gray, engine)]


def library(quad_decimate: float) -> Detector:
    """Return the AprilTag library's detector; `quad_decimate` 1 searches at full resolution, 2 at half."""
    from pyapriltags import Detector as Library

    detector = Library(families="tag36h11", nthreads=1, quad_decimate=quad_decimate)
    # The library's pixel coordinates start at a pixel's corner; its corners run counter-clockwise from the bottom left.
    return lambda gray: [(d.tag_id, d.corners[[3, 2, 1, 0]] - 0.5) for d in detector.detect(gray)]


def views(repeats: int, seed: int) -> Iterator[tuple[float, View]]:
    """Yield views at every range and angle, with random id, position, tilt, blur, noise and light."""
    rng = np.random.default_rng(seed)
    for range_m in RANGES_M:
        for degrees in ANGLES_DEG:
            for _ in range(repeats):
                view = at_range(
                    int(rng.integers(587)),
                    range_m,
                    math.radians(degrees),
                    rng,
                    tilt_rad=rng.uniform(-0.1, 0.1),
                    blur_px=rng.uniform(0.3, 1.0),
                    noise=rng.uniform(1.0, 5.0),
                    contrast=(rng.uniform(10, 60), rng.uniform(140, 245)),
                )
                yield range_m, view


def rms(found: Corners, true: Corners) -> float:
    """Return the root mean square distance of the corners, px."""
    return float(np.sqrt(np.mean(np.sum((found - true) ** 2, axis=1))))


def main() -> int:
    """Run every detector on the same views; return 1 if Lupin misses a limit of recall, corner error or time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3, help="render this many views for each range and angle")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random views")
    parser.add_argument("--json", action="store_true", help="print only the JSON line")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    detectors = {
        "lupin": ours("apriltag"),
        "lupin_aruco": ours("aruco"),
        "library_default": library(2.0),
        "library_full": library(1.0),
    }
    hits: dict[str, list[bool]] = {name: [] for name in detectors}
    false_detections: dict[str, int] = dict.fromkeys(detectors, 0)
    errors: dict[str, dict[int, float]] = {name: {} for name in detectors}
    cpu_ms: dict[str, list[float]] = {name: [] for name in detectors}
    by_range: dict[str, dict[float, list[bool]]] = {name: {r: [] for r in RANGES_M} for name in detectors}
    for index, (range_m, view) in enumerate(views(options.repeats, options.seed)):
        for name, detect_tags in detectors.items():
            # CPU time of this thread, which excludes other processes.
            began = time.thread_time()
            found = detect_tags(view.image)
            cpu_ms[name].append((time.thread_time() - began) * 1e3)
            correct = [corners for tag_id, corners in found if tag_id == view.tag_id]
            hits[name].append(bool(correct))
            by_range[name][range_m].append(bool(correct))
            false_detections[name] += sum(tag_id != view.tag_id for tag_id, _ in found)
            if correct:
                errors[name][index] = min(rms(corners, view.corners) for corners in correct)
    # Corner errors are compared on the frames in which all detectors but the fallback engine found the tag.
    common = set.intersection(*(set(errors[name]) for name in detectors if name != "lupin_aruco"))
    result: dict[str, Any] = {"frames": len(hits["lupin"]), "limit_ms": LIMIT_MS}
    for name in detectors:
        common_errors = [error for index, error in errors[name].items() if index in common]
        result[name] = {
            "recall": round(statistics.mean(hits[name]), 4),
            "recall_by_range": {str(r): round(statistics.mean(h), 3) for r, h in by_range[name].items()},
            "false_detections": false_detections[name],
            "corner_rms_px_median": round(statistics.median(common_errors), 4),
            "corner_rms_px_p95": round(float(np.percentile(common_errors, 95)), 4),
            "cpu_ms_median": round(statistics.median(cpu_ms[name]), 2),
            "cpu_ms_p95": round(float(np.percentile(cpu_ms[name], 95)), 2),
        }
    best = {
        key: min(result["library_default"][key], result["library_full"][key])
        for key in ("corner_rms_px_median", "corner_rms_px_p95")
    }
    recall = max(result["library_default"]["recall"], result["library_full"]["recall"])
    result["recall_ratio"] = round(result["lupin"]["recall"] / recall, 3)
    result["corner_error_ratio"] = round(result["lupin"]["corner_rms_px_median"] / best["corner_rms_px_median"], 3)
    result["corner_error_p95_ratio"] = round(result["lupin"]["corner_rms_px_p95"] / best["corner_rms_px_p95"], 3)
    result["time_ratio_to_limit"] = round(result["lupin"]["cpu_ms_p95"] / LIMIT_MS, 3)
    if not options.json:
        show(result, list(detectors))
    print(json.dumps(result))
    meets_limits = (
        result["recall_ratio"] >= 1.0
        and result["corner_error_ratio"] <= 1.0
        and result["corner_error_p95_ratio"] <= 1.0
        and result["time_ratio_to_limit"] <= 1.0
    )
    return 0 if meets_limits else 1


def show(result: dict[str, Any], names: list[str]) -> None:
    """Print the result as tables."""
    print(f"{result['frames']} frames of 640 x 480; ranges {RANGES_M} m, angles -60 to 60 degrees")
    print(f"{'':16}{'recall':>8}{'false':>7}{'corner px':>11}{'p95':>8}{'cpu ms':>8}{'p95':>8}")
    for name in names:
        r = result[name]
        print(
            f"{name:16}{r['recall']:8.3f}{r['false_detections']:7d}{r['corner_rms_px_median']:11.3f}{r['corner_rms_px_p95']:8.3f}"
            f"{r['cpu_ms_median']:8.2f}{r['cpu_ms_p95']:8.2f}"
        )
    print(
        f"compared with the better of the library's two: recall x{result['recall_ratio']}, corner error "
        f"x{result['corner_error_ratio']} (p95 x{result['corner_error_p95_ratio']}); "
        f"p95 time / limit {result['time_ratio_to_limit']}"
    )


if __name__ == "__main__":
    sys.exit(main())
