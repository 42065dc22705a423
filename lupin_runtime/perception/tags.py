"""Finds tags in a gray image: two engines, one order of corners; those of family 36h11 are refined on the whole tag.

It uses the AprilTag library where it is installed, else OpenCV's ArUco module. Both give top-left, top-right,
bottom-right, bottom-left as an upright official print shows them, in pixels, the center of the first pixel being (0, 0).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.apriltag import tag_image
from lupin_runtime.perception.corner_refinement import Alignment, align

Gray = NDArray[np.uint8]

# A tag whose border merges with the surroundings at one resolution is often found at the other.
DECIMATIONS: tuple[float, ...] = (1.0, 1.5)
# Of the decoded modules. The library's default, which pyapriltags rounds to 0.
DECODE_SHARPENING = 0.25
SAME_PLACE_SHARE = 0.5  # of a tag's size: two detections of one id with closer centers are one tag

# Two pixels per module; the AprilTag library crashes on images a few pixels high.
MIN_SIDE_PX = 16
# Three pixels per module of a tag with its white edge, ten modules wide: with fewer, not every engine finds it.
SMALL_SIDE_PX = 30
_ONE_SHADE = 8  # of 255: a picture with less contrast shows nothing

FAMILY = "tag36h11"  # the greenhouse's, and the only one whose images are known here
# The library's others have codes of 48 bits or more, whose tables of corrected codes take gigabytes.
FAMILIES = (FAMILY, "tag16h5", "tag25h9", "tagCircle21h7", "tagStandard41h12")
# Of other families nothing can be compared with the image: only error-free codes with contrast count. The library's
# decision margin is the mean difference between the modules and the threshold between black and white.
MIN_DECISION_MARGIN = 30.0

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


Found = tuple[int, NDArray[np.float64], int]  # id, corners (4, 2) in the order of TagDetection, corrected bits


class TagEngine(Protocol):
    """Finds tags. It can search at each of its `decimations`, of which 1 is full resolution."""

    name: str
    family: str
    decimations: tuple[float, ...]

    def find(self, gray: Gray, decimation: float = 1.0) -> Iterable[Found]:
        """Yield the tags of a gray image that outlines at 1 / `decimation` of its resolution show, in no particular order."""


class EngineMissing(ImportError):
    """The requested engine is not installed."""


class AprilTagEngine:
    """The AprilTag library, through pyapriltags."""

    name = "apriltag"
    decimations = DECIMATIONS

    def __init__(self, family: str = FAMILY) -> None:
        try:
            from pyapriltags import Detector
        except ImportError as error:
            raise EngineMissing(
                "the engine 'apriltag' needs the package pyapriltags; run: pip install pyapriltags  (or use 'aruco')"
            ) from error
        if family not in FAMILIES:
            raise ValueError(f"unknown tag family {family!r}; known: {', '.join(FAMILIES)}")
        self.family = family
        # One detector for all resolutions: each detector holds a table of 35 MB.
        self._detector = Detector(families=family, nthreads=1, quad_decimate=1.0)
        self._detector.tag_detector_ptr.contents.decode_sharpening = DECODE_SHARPENING

    def find(self, gray: Gray, decimation: float = 1.0) -> Iterable[Found]:
        self._detector.tag_detector_ptr.contents.quad_decimate = decimation
        for found in self._detector.detect(gray):
            if self.family != FAMILY and (found.hamming or found.decision_margin < MIN_DECISION_MARGIN):
                continue
            # The library's pixel coordinates start at a pixel's corner; its corners run counter-clockwise from the bottom left.
            yield int(found.tag_id), np.asarray(found.corners, np.float64)[[3, 2, 1, 0]] - 0.5, int(found.hamming)


class ArucoEngine:
    """OpenCV's ArUco module, by the interface of the installed version."""

    name = "aruco"
    family = FAMILY
    decimations: tuple[float, ...] = (1.0,)

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

    def find(self, gray: Gray, decimation: float = 1.0) -> Iterable[Found]:  # noqa: ARG002 - it knows one resolution
        for tag_id, corners in self._detect(gray):
            yield tag_id, np.roll(corners, -self._first_corner, axis=0), 0


ENGINES = ("apriltag", "aruco")


def make_engine(name: str = "auto", family: str = FAMILY) -> TagEngine:
    """Create the engine of that name; "auto" is the AprilTag library if it is installed, else ArUco.

    Raises EngineMissing if its package is not installed, ValueError for an unknown name or a family that it does not know.
    """
    if name not in ("auto", *ENGINES):
        raise ValueError(f"unknown tag engine {name!r}; known: auto, {', '.join(ENGINES)}")
    if name != "aruco":
        try:
            return AprilTagEngine(family)
        except EngineMissing:
            if name != "auto" or family != FAMILY:
                raise
    if family != FAMILY:
        raise ValueError(f"the engine 'aruco' finds {FAMILY} only, not {family!r}; use the engine 'apriltag'")
    return ArucoEngine()


def detect(gray: Gray, engine: TagEngine) -> list[TagDetection]:
    """Detect the tags of a gray (height, width) uint8 image, sorted by id; of two with the same id the larger is first.

    It searches at all resolutions of the engine, whatever time that takes; `frame_detector` is for a camera's frames.
    Raises ValueError for an image of another shape or type.
    """
    check_gray(gray)
    if min(gray.shape) < MIN_SIDE_PX:
        return []
    gray = np.ascontiguousarray(gray)
    candidates = (found for decimation in engine.decimations for found in engine.find(gray, decimation))
    return accepted(gray, candidates, has_template=engine.family == FAMILY)


def check_gray(gray: Gray) -> None:
    """Raise ValueError unless the image is gray, (height, width) of uint8."""
    if gray.ndim != 2 or gray.dtype != np.uint8:
        raise ValueError(f"a gray image (height, width) of uint8 was expected, not {gray.shape} of {gray.dtype}")


def accepted(
    gray: Gray, candidates: Iterable[Found], known: Iterable[TagDetection] = (), *, has_template: bool = True
) -> list[TagDetection]:
    """Refine the corners of candidates on the image, and add those that look like their tag to the `known` ones, each tag once.

    Without a template of the family, candidates are added as they are. The result is in the order of `detect`.
    """
    kept = list(known)
    for tag_id, corners, hamming in candidates:
        if any(each.id == tag_id and is_same_place(each.corners, corners) for each in kept):
            continue
        aligned = align(gray, tag_id, corners) if has_template else Alignment(corners, 0.0)
        fits = aligned.correlation >= (MIN_FIT_WITH_WRONG_BITS if hamming else MIN_FIT)
        untold = aligned.correlation == 0.0 and hamming == 0
        if (fits or untold) and _is_inside(gray, aligned.corners):
            kept.append(TagDetection(tag_id, aligned.corners, hamming, aligned.correlation))
    return sorted(kept, key=lambda found: (found.id, -float(np.ptp(found.corners, axis=0).prod())))


def _is_inside(gray: Gray, corners: NDArray[np.float64]) -> bool:
    """Return whether the picture shows all corners: those of a tag that its edge cuts are guesses, and so would be its pose."""
    height, width = gray.shape
    return bool((corners >= -0.5).all() and (corners <= (width - 0.5, height - 0.5)).all())


def explain_nothing(gray: Gray, engine: TagEngine) -> str:
    """Return why a picture, in which `detect` found nothing, may show a tag all the same; empty if nothing is known."""
    height, width = gray.shape
    if min(gray.shape) < SMALL_SIDE_PX:
        return (
            f"{width} x {height} pixels are too small for a tag, which needs at least {SMALL_SIDE_PX} x {SMALL_SIDE_PX}; "
            "enlarge it without smoothing (nearest neighbor)"
        )
    if int(gray.max()) - int(gray.min()) < _ONE_SHADE:
        return "the whole picture has one shade"
    inverted = ", ".join(str(tag.id) for tag in detect(np.asarray(255 - gray, np.uint8), engine))
    return f"it shows tags with black and white exchanged ({inverted}); print them as they are published" if inverted else ""


def is_same_place(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Whether two sets of corners (4, 2) are so close that they can only be one tag."""
    return float(np.abs(a.mean(axis=0) - b.mean(axis=0)).max()) < SAME_PLACE_SHARE * float(np.ptp(a, axis=0).max())
