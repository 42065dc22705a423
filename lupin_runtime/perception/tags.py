"""Finds the tags of family 36h11 in a gray image: two engines, one order of corners, corners refined on the whole tag.

It uses the AprilTag library where it is installed, else OpenCV's ArUco module. Both give top-left, top-right,
bottom-right, bottom-left as an upright official print shows them, in pixels, the center of the first pixel being (0, 0).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.apriltag import tag_image
from lupin_runtime.perception.corner_refinement import align

Gray = NDArray[np.uint8]

# At full resolution the library spends nine tenths of its time on quads of sensor noise. Smoothing the parts with less
# contrast than a tag has makes full resolution cheaper than half resolution was.
CONTRAST_WINDOW_PX = 5
CONTRAST_OVER_MEDIAN = 1.8  # the median is the noise, since most of an image has no edges
CONTRAST_LIMITS = (12.0, 40.0)
SMOOTHING_PX = 7
BUSY_SHARE = 0.25  # of the pixels: with more, even that is too slow, and half resolution is used

# Two pixels per module; the AprilTag library crashes on images a few pixels high.
MIN_SIDE_PX = 16

# tag36h11 corrects two wrong bits; a corrected tag is accepted only if the image correlates with it as well.
MIN_FIT = 0.45
MIN_FIT_WITH_WRONG_BITS = 0.75


@dataclass(frozen=True, eq=False)
class TagDetection:
    """One tag in one image.

    `corners` (4, 2): top-left, top-right, bottom-right, bottom-left of the black square, pixels. `hamming`: corrected bits.
    `fit`: correlation of the image with the tag's template, 0 if the tag is too small or too far outside the image.
    """

    id: int
    corners: NDArray[np.float64]
    hamming: int
    fit: float


class TagEngine(Protocol):
    """Finds tags: yields (id, corners (4, 2) in the order of TagDetection, corrected bits)."""

    name: str

    def find(self, gray: Gray) -> Iterable[tuple[int, NDArray[np.float64], int]]:
        """Yield the tags of a gray image, in no particular order."""


class EngineMissing(ImportError):
    """The requested engine is not installed."""


def smooth_low_contrast(gray: Gray) -> tuple[Gray, float]:
    """Smooth the parts with too little contrast for a tag; returns the image and the share of unchanged pixels."""
    kernel = np.ones((CONTRAST_WINDOW_PX, CONTRAST_WINDOW_PX), np.uint8)
    contrast = cv2.subtract(cv2.dilate(gray, kernel), cv2.erode(gray, kernel))
    threshold = float(np.clip(CONTRAST_OVER_MEDIAN * np.median(contrast[::4, ::4]), *CONTRAST_LIMITS))
    keep = cv2.threshold(contrast, threshold, 255, cv2.THRESH_BINARY)[1]
    smoothed = cv2.blur(gray, (SMOOTHING_PX, SMOOTHING_PX))
    cv2.copyTo(gray, keep, smoothed)
    return np.asarray(smoothed, np.uint8), cv2.countNonZero(keep) / keep.size


class AprilTagEngine:
    """The AprilTag library, through pyapriltags."""

    name = "apriltag"

    def __init__(self) -> None:
        try:
            from pyapriltags import Detector
        except ImportError as error:
            raise EngineMissing(
                "the engine 'apriltag' needs the package pyapriltags; run: pip install pyapriltags  (or use 'aruco')"
            ) from error
        # One detector for both resolutions: each detector holds a table of 35 MB.
        self._detector = Detector(families="tag36h11", nthreads=1, quad_decimate=1.0)

    def find(self, gray: Gray) -> Iterable[tuple[int, NDArray[np.float64], int]]:
        prepared, busy = smooth_low_contrast(gray)
        self._detector.tag_detector_ptr.contents.quad_decimate = 2.0 if busy > BUSY_SHARE else 1.0
        for found in self._detector.detect(prepared):
            # The library's pixel coordinates start at a pixel's corner; its corners run counter-clockwise from the bottom left.
            yield int(found.tag_id), np.asarray(found.corners, np.float64)[[3, 2, 1, 0]] - 0.5, int(found.hamming)


class ArucoEngine:
    """OpenCV's ArUco module, by the interface of the installed version."""

    name = "aruco"

    def __init__(self) -> None:
        self._dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        make = getattr(cv2.aruco, "DetectorParameters_create", None) or cv2.aruco.DetectorParameters
        self._parameters = make()
        self._parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        if hasattr(self._parameters, "relativeCornerRefinmentWinSize"):
            # In modules: a window that reaches into the code shifts the corners of a small tag by a third of a pixel.
            self._parameters.relativeCornerRefinmentWinSize = 0.6
        detector_class = getattr(cv2.aruco, "ArucoDetector", None)
        self._detector = detector_class(self._dictionary, self._parameters) if detector_class else None
        self._first_corner = self._learn_first_corner()

    def _detect(self, gray: Gray) -> list[tuple[int, NDArray[np.float64]]]:
        if self._detector is not None:
            corners, ids, _ = self._detector.detectMarkers(gray)
        else:
            detect_markers = getattr(cv2.aruco, "detectMarkers")  # noqa: B009 - newer stubs don't know it
            corners, ids, _ = detect_markers(gray, self._dictionary, parameters=self._parameters)
        if ids is None:
            return []
        return [(int(i), np.asarray(c, np.float64).reshape(4, 2)) for i, c in zip(np.ravel(ids), corners)]

    def _learn_first_corner(self) -> int:
        """Find which of the module's corners is the top left one of an upright official tag.

        It is the bottom right one (2) up to OpenCV 5.0 and changes in later versions, so it is measured on a drawn tag.
        """
        shown = np.pad(tag_image(0, 16), 32, constant_values=255)
        answer = [corners for tag_id, corners in self._detect(shown) if tag_id == 0]
        if len(answer) != 1:
            raise RuntimeError(f"OpenCV {cv2.__version__} does not recognize the official tag36h11 id 0")
        return int(np.argmin(answer[0].sum(axis=1)))

    def find(self, gray: Gray) -> Iterable[tuple[int, NDArray[np.float64], int]]:
        for tag_id, corners in self._detect(gray):
            yield tag_id, np.roll(corners, -self._first_corner, axis=0), 0


ENGINES: dict[str, Callable[[], TagEngine]] = {"apriltag": AprilTagEngine, "aruco": ArucoEngine}


def make_engine(name: str = "auto") -> TagEngine:
    """Create the engine of that name; "auto" is the AprilTag library if it is installed, else ArUco.

    Raises EngineMissing if its package is not installed, ValueError for an unknown name.
    """
    if name == "auto":
        try:
            return AprilTagEngine()
        except EngineMissing:
            return ArucoEngine()
    if name not in ENGINES:
        raise ValueError(f"unknown tag engine {name!r}; known: auto, {', '.join(ENGINES)}")
    return ENGINES[name]()


def detect(gray: Gray, engine: TagEngine) -> list[TagDetection]:
    """Detect the tags of a gray (height, width) uint8 image, sorted by id; of two with the same id the larger is first.

    Raises ValueError for an image of another shape or type.
    """
    if gray.ndim != 2 or gray.dtype != np.uint8:
        raise ValueError(f"a gray image (height, width) of uint8 was expected, not {gray.shape} of {gray.dtype}")
    detections: list[TagDetection] = []
    if min(gray.shape) < MIN_SIDE_PX:
        return detections
    for tag_id, corners, hamming in engine.find(np.ascontiguousarray(gray)):
        aligned = align(gray, tag_id, corners)
        fits = aligned.correlation >= (MIN_FIT_WITH_WRONG_BITS if hamming else MIN_FIT)
        untold = aligned.correlation == 0.0 and hamming == 0
        if fits or untold:
            detections.append(TagDetection(tag_id, aligned.corners, hamming, aligned.correlation))
    return sorted(detections, key=lambda found: (found.id, -float(np.ptp(found.corners, axis=0).prod())))
