"""Tag detection compared with the AprilTag library itself, on rendered views with blur and noise, plain and textured.

Recall and corner errors must be at least as good as those of the library's default settings (half resolution) and full
resolution, whichever is better: for `tags detect` on single views, and for live frames in sequences of a moving camera, which
also have a limit of time on one core. All detectors run on the same frames, one after the other.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.runner import Figures, Seed, benchmark
from lupin_runtime.perception.frame_detector import FrameDetector
from lupin_runtime.perception.tags import detect, make_engine
from tests.support.tag_views import BACKGROUNDS, TEXTURED, View, at_range, render

RANGES_M = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)  # a module is 1.8 pixels wide at 3 m
ANGLES_DEG = (-60, -45, -30, -15, 0, 15, 30, 45, 60)
SEQUENCE_FRAMES = 6

Corners = NDArray[np.float64]
Detector = Callable[[NDArray[np.uint8]], list[tuple[int, Corners]]]


@dataclass
class Score:
    """What one detector found in a set of frames."""

    hits: list[bool] = field(default_factory=list)
    false_detections: int = 0
    errors: dict[int, float] = field(default_factory=dict)  # root mean square error of the corners, px, by frame
    cpu_ms: list[float] = field(default_factory=list)

    def add(self, index: int, view: View, detect_tags: Detector) -> None:
        """Run a detector on a frame, and compare its result with the truth."""
        began = time.thread_time()  # excludes other processes
        found = detect_tags(view.image)
        self.cpu_ms.append((time.thread_time() - began) * 1e3)
        correct = [corners for tag_id, corners in found if tag_id == view.tag_id]
        self.hits.append(bool(correct))
        self.false_detections += sum(tag_id != view.tag_id for tag_id, _ in found)
        if correct:
            self.errors[index] = min(rms(corners, view.corners) for corners in correct)

    def summary(self, common: set[int]) -> dict[str, Any]:
        """Return recall, corner errors on the frames that all detectors share, and time."""
        errors = [error for index, error in self.errors.items() if index in common]
        return {
            "recall": statistics.mean(self.hits),
            "false_detections": self.false_detections,
            "corner_rms_px_median": statistics.median(errors),
            "corner_rms_px_p95": float(np.percentile(errors, 95)),
            "cpu_ms_median": statistics.median(self.cpu_ms),
            "cpu_ms_p95": float(np.percentile(self.cpu_ms, 95)),
        }


def ours(engine_name: str) -> Detector:
    """Return the detector of `tags detect` with the engine of that name."""
    engine = make_engine(engine_name)
    return lambda gray: [(d.id, d.corners) for d in detect(gray, engine)]


def live() -> Detector:
    """Return the detector of a camera's frames, which remembers the frame before."""
    detector = FrameDetector(make_engine("apriltag"))
    return lambda gray: [(d.id, d.corners) for d in detector.detect(gray)]


def library(quad_decimate: float) -> Detector:
    """Return the AprilTag library's detector; `quad_decimate` 1 searches at full resolution, 2 at half."""
    from pyapriltags import Detector as Library

    detector = Library(families="tag36h11", nthreads=1, quad_decimate=quad_decimate)
    # The library's pixel coordinates start at a pixel's corner; its corners run counter-clockwise from the bottom left.
    return lambda gray: [(d.tag_id, d.corners[[3, 2, 1, 0]] - 0.5) for d in detector.detect(gray)]


def appearance(rng: np.random.Generator) -> dict[str, Any]:
    """Return a random blur, noise and light; every third view is blurred by motion, too."""
    return {
        "blur_px": rng.uniform(0.3, 1.3),
        "noise": rng.uniform(1.0, 5.0),
        "contrast": (rng.uniform(10, 60), rng.uniform(140, 245)),
        "motion_px": int(rng.choice([0, 0, 3])),
    }


def single_views(repeats: int, seed: int, background: str) -> Iterator[View]:
    """Yield views at every range and angle, with random id, position, tilt, blur, noise and light."""
    rng = np.random.default_rng([seed, *background.encode()])
    for range_m in RANGES_M:
        for degrees in ANGLES_DEG:
            for _ in range(repeats):
                tag_id, tilt_rad = int(rng.integers(587)), rng.uniform(-0.1, 0.1)
                look = appearance(rng)
                yield at_range(tag_id, range_m, math.radians(degrees), rng, tilt_rad, background=background, **look)


def sequence(rng: np.random.Generator, background: str) -> Iterator[View]:
    """Yield the frames of a camera that drives toward a tag, and past it."""
    look = appearance(rng)
    seed = int(rng.integers(2**32))
    first = at_range(int(rng.integers(587)), rng.uniform(0.7, 3.0), rng.uniform(-0.9, 0.9), rng, background=background, **look)
    for step in range(SEQUENCE_FRAMES):
        translation = first.translation * (1.0 - 0.02 * step) + np.array([0.015 * step, 0.0, 0.0])
        yield render(first.tag_id, first.rotation, translation, np.random.default_rng(seed), background=background, **look)


def rms(found: Corners, true: Corners) -> float:
    """Return the root mean square distance of the corners, px."""
    return float(np.sqrt(np.mean(np.sum((found - true) ** 2, axis=1))))


def compare(frames: Sequence[View] | Iterator[View], detectors: dict[str, Detector], compared: Sequence[str]) -> dict[str, Any]:
    """Run all detectors on the frames; corner errors are compared where all of `compared` found the tag."""
    scores = {name: Score() for name in detectors}
    for index, view in enumerate(frames):
        for name, detect_tags in detectors.items():
            scores[name].add(index, view, detect_tags)
    common = set.intersection(*(set(scores[name].errors) for name in compared))
    return {name: score.summary(common) for name, score in scores.items()}


def ratios(result: dict[str, Any], name: str) -> dict[str, float]:
    """Return recall and corner errors of a detector divided by those of the better setting of the library."""
    settings = [result["library_default"], result["library_full"]]
    best = {key: min(s[key] for s in settings) for key in ("corner_rms_px_median", "corner_rms_px_p95")}
    return {
        "recall_ratio": round(result[name]["recall"] / max(s["recall"] for s in settings), 3),
        **{f"{key}_ratio": round(result[name][key] / best[key], 3) for key in best},
    }


@benchmark(
    at_most={"corner_rms_px_median_ratio": 1.0, "corner_rms_px_p95_ratio": 1.0, "lupin_live.cpu_ms_p95": 15.0},
    at_least={"recall_ratio": 1.0},
)
def main(
    repeats: Annotated[int, "render this many views for each background, range and angle"] = 1,
    sequences: Annotated[int, "render this many sequences for each background"] = 8,
    seed: Seed = 1,
) -> Figures:
    """Run every detector on the same views; the ratios compare Lupin with the better of the library's two settings."""
    cv2.setNumThreads(1)
    library_settings = {"library_default": library(2.0), "library_full": library(1.0)}
    detectors = {"lupin": ours("apriltag"), "lupin_aruco": ours("aruco"), **library_settings}
    compared = ("lupin", "library_default", "library_full")
    figures: dict[str, dict[str, Any]] = {"images": {}, "sequences": {}, "ratios": {}}
    for kind, backgrounds in (("plain", [b for b in BACKGROUNDS if b not in TEXTURED]), ("textured", list(TEXTURED))):
        views = (view for background in backgrounds for view in single_views(repeats, seed, background))
        figures["images"][kind] = compare(views, detectors, compared)
        figures["ratios"][f"images, {kind}"] = ratios(figures["images"][kind], "lupin")
        rng = np.random.default_rng([seed, len(backgrounds)])
        frames = (view for background in backgrounds for _ in range(sequences) for view in sequence(rng, background))
        live_detectors = {"lupin_live": live(), **library_settings}
        figures["sequences"][kind] = compare(frames, live_detectors, tuple(live_detectors))
        figures["ratios"][f"sequences, {kind}"] = ratios(figures["sequences"][kind], "lupin_live")
    return figures


if __name__ == "__main__":
    sys.exit(main())
