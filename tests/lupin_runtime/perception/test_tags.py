"""The order of a tag's corners, both engines, and the accuracy of fitted corners."""

from __future__ import annotations

import builtins
import math
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from lupin_runtime import apriltag
from lupin_runtime.perception import corner_refinement, tags

if TYPE_CHECKING:
    from cv2.aruco import DetectorParameters, Dictionary

    from lupin_runtime.perception.tags import TagEngine

ENGINES = ("apriltag", "aruco")


@pytest.fixture(scope="module", params=ENGINES)
def engine(request: pytest.FixtureRequest) -> TagEngine:
    return tags.make_engine(request.param)


def official_image(module_px: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Return the official id 0 typed from its published bits - not drawn by any library - upright on white, and its corners."""
    inner = np.array([[int(bit) for bit in row] for row in apriltag.ID0_ROWS])
    square = np.zeros((8, 8))
    square[1:-1, 1:-1] = inner
    image = np.full((480, 640), 255, np.uint8)
    size = 8 * module_px
    left, top = 200, 120
    image[top : top + size, left : left + size] = np.kron(square, np.ones((module_px, module_px))) * 255
    low_x, low_y, high_x, high_y = left - 0.5, top - 0.5, left + size - 0.5, top + size - 0.5
    return image, np.array([[low_x, low_y], [high_x, low_y], [high_x, high_y], [low_x, high_y]])


def test_upright_tag_corners_start_top_left_clockwise(engine: TagEngine) -> None:
    image, corners = official_image()
    (found,) = tags.detect(image, engine)
    assert found.id == 0 and found.hamming == 0
    assert np.abs(found.corners - corners).max() < 0.1


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_turned_tag_keeps_its_first_corner(engine: TagEngine, turns: int) -> None:
    image, corners = official_image()
    turned = np.ascontiguousarray(np.rot90(image, turns))
    h, w = image.shape
    for _ in range(turns):  # np.rot90 is counter-clockwise: (x, y) of a w-wide image goes to (y, w - 1 - x)
        corners = np.stack([corners[:, 1], w - 1 - corners[:, 0]], axis=1)
        h, w = w, h
    (found,) = tags.detect(turned, engine)
    assert np.abs(found.corners - corners).max() < 0.1


def test_aruco_engine_learns_the_first_corner() -> None:
    """The engine's first corner is the top left one, whichever OpenCV returns first."""
    engine = tags.ArucoEngine()
    image, corners = official_image()
    raw = dict(engine._detect(image))[0]
    assert np.argmin(np.linalg.norm(raw - corners[0], axis=1)) == engine._first_corner


def test_aruco_engine_works_with_the_opencv_4_6_interface(monkeypatch: pytest.MonkeyPatch) -> None:
    """In 4.6 detection is a function of dictionary and parameters, and another function creates the parameters."""
    aruco = cv2.aruco
    new_detector, new_parameters = aruco.ArucoDetector, aruco.DetectorParameters

    def detect_markers(
        gray: np.ndarray, dictionary: Dictionary, parameters: DetectorParameters
    ) -> tuple[Sequence[Any], Any, Sequence[Any]]:
        return new_detector(dictionary, parameters).detectMarkers(gray)

    class Old:
        DICT_APRILTAG_36h11 = aruco.DICT_APRILTAG_36h11
        CORNER_REFINE_SUBPIX = aruco.CORNER_REFINE_SUBPIX
        getPredefinedDictionary = staticmethod(aruco.getPredefinedDictionary)
        DetectorParameters_create = staticmethod(new_parameters)
        detectMarkers = staticmethod(detect_markers)
        drawMarker = staticmethod(aruco.generateImageMarker)

    apriltag._family.cache_clear()
    apriltag.modules.cache_clear()
    monkeypatch.setattr(cv2, "aruco", Old)
    try:
        image, corners = official_image()
        (found,) = tags.detect(image, tags.ArucoEngine())
        assert np.abs(found.corners - corners).max() < 0.1
    finally:
        apriltag._family.cache_clear()
        apriltag.modules.cache_clear()


def test_both_engines_agree_on_camera_views(tag_views: ModuleType) -> None:
    rng = np.random.default_rng(4)
    for range_m, degrees in ((0.5, 40), (0.8, -30), (1.2, 10), (1.6, -20)):
        view = tag_views.at_range(int(rng.integers(587)), range_m, math.radians(degrees), rng)
        found = [tags.detect(view.image, tags.make_engine(name)) for name in ENGINES]
        assert [[d.id for d in ds] for ds in found] == [[view.tag_id]] * 2
        assert np.abs(found[0][0].corners - found[1][0].corners).max() < 0.1


def test_fitted_corners_are_twice_as_good_as_the_outline(tag_views: ModuleType) -> None:
    """At 1 to 2 m the median of the root mean square error is a factor below that of the library's corners."""
    engine = tags.make_engine("apriltag")
    rng = np.random.default_rng(2)
    outline: list[Any] = []
    fitted: list[Any] = []
    for range_m in (1.0, 1.4, 1.8):
        for degrees in (-50, -20, 0, 20, 50):
            view = tag_views.at_range(int(rng.integers(587)), range_m, math.radians(degrees), rng)
            raw = {tag_id: corners for tag_id, corners, _ in engine.find(view.image)}
            (found,) = tags.detect(view.image, engine)
            for corners, errors in ((raw[view.tag_id], outline), (found.corners, fitted)):
                errors.append(float(np.sqrt(np.mean(np.sum((corners - view.corners) ** 2, axis=1)))))
    assert np.median(fitted) < 0.5 * np.median(outline)
    assert max(fitted) < 0.25


def test_failed_fit_leaves_the_corners_unchanged() -> None:
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 255, (480, 640)).astype(np.uint8)
    corners = np.array([[100.0, 100.0], [160.0, 102.0], [158.0, 160.0], [98.0, 161.0]])
    aligned = corner_refinement.align(noise, 7, corners)
    assert aligned.correlation < 0.45
    assert np.array_equal(aligned.corners, corners)


@pytest.mark.parametrize(
    "corners",
    [
        [[5, 5], [5, 5], [5, 5], [5, 5]],
        [[0, 0], [10, 10], [20, 20], [30, 30]],
        [[-900, -900], [-800, -900], [-800, -800], [-900, -800]],
    ],
)
def test_corners_outside_the_image_do_not_break_the_fit(corners: list[list[int]]) -> None:
    given = np.array(corners, float)
    aligned = corner_refinement.align(np.zeros((480, 640), np.uint8), 3, given)
    assert np.array_equal(aligned.corners, given) and aligned.correlation < 0.45


def test_image_without_a_tag_has_no_detection(engine: TagEngine) -> None:
    rng = np.random.default_rng(0)
    for image in (
        np.zeros((480, 640), np.uint8),
        np.full((480, 640), 255, np.uint8),
        rng.integers(0, 255, (480, 640)).astype(np.uint8),
        cv2.GaussianBlur(rng.integers(0, 255, (480, 640)).astype(np.uint8), (0, 0), 3),
    ):
        assert tags.detect(image, engine) == []


@pytest.mark.parametrize("shape", [(1, 1), (3, 640), (480, 2)])
def test_tiny_images_are_no_error(shape: tuple[int, int]) -> None:
    assert tags.detect(np.zeros(shape, np.uint8), tags.make_engine("apriltag")) == []


def _picture(module_px: int, x: int, y: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return a gray picture of a tag whose black square begins at x, y."""
    tag = apriltag.tag_image(7, module_px)
    canvas = np.full((400, 520), 128, np.uint8)
    left, top = 100 + x - module_px, 100 + y - module_px
    canvas[top : top + len(tag), left : left + len(tag)] = tag
    return np.asarray(cv2.GaussianBlur(canvas, (0, 0), 0.7)[100:300, 100:420], np.uint8)


# A tag is read where the picture shows its whole black square, from one pixel inside each edge on; cut off by a pixel or more
# it is none, although error correction may still know its id: its corners and so its pose would be guesses.
@pytest.mark.parametrize("module_px", [4, 7, 10])
@pytest.mark.parametrize("cut_px", [-3, -1, 1, 2, 5, 12])
@pytest.mark.parametrize("edge", ["left", "top", "right", "bottom"])
def test_tag_cut_by_the_edge_is_no_detection(engine: TagEngine, module_px: int, cut_px: int, edge: str) -> None:
    size = 8 * module_px
    x = {"left": -cut_px, "right": 320 - size + cut_px}.get(edge, 100)
    y = {"top": -cut_px, "bottom": 200 - size + cut_px}.get(edge, 60)
    found = tags.detect(_picture(module_px, x, y), engine)
    if cut_px > 0:
        assert found == []
    elif engine.name == "apriltag" and cut_px <= -3:
        assert [tag.id for tag in found] == [7]


def test_corners_in_the_picture_are_kept_at_its_very_edge() -> None:
    corners = np.array([[-0.5, -0.5], [639.5, -0.5], [639.5, 479.5], [-0.5, 479.5]])
    gray = np.zeros((480, 640), np.uint8)
    assert tags._is_inside(gray, corners)
    for corner in range(4):
        beyond = corners.copy()
        beyond[corner] *= 1.01
        assert not tags._is_inside(gray, beyond)


def test_nothing_is_explained(engine: TagEngine) -> None:
    shown = np.pad(apriltag.tag_image(7, 8), 40, constant_values=255)
    for picture, words in (
        (apriltag.tag_image(7, 1), "10 x 10 pixels are too small for a tag, which needs at least 30 x 30"),
        (np.full((200, 29), 90, np.uint8), "29 x 200 pixels are too small"),
        (np.full((200, 300), 255, np.uint8), "one shade"),
        (np.asarray(255 - shown, np.uint8), "black and white exchanged (7)"),
    ):
        assert tags.detect(picture, engine) == []
        assert words in tags.explain_nothing(picture, engine)
    mirrored = np.ascontiguousarray(shown[:, ::-1])
    assert tags.detect(mirrored, engine) == [] and tags.explain_nothing(mirrored, engine) == ""
    assert [tag.id for tag in tags.detect(apriltag.tag_image(7, 3), engine)] == [7]


def test_image_that_is_not_gray_is_refused(engine: TagEngine) -> None:
    with pytest.raises(ValueError, match="gray image"):
        tags.detect(np.zeros((480, 640, 3), np.uint8), engine)
    with pytest.raises(ValueError, match="uint8"):
        tags.detect(np.zeros((480, 640), np.float32), engine)


def test_recall_on_textures_is_that_of_the_library(tag_views: ModuleType) -> None:
    """At full resolution, on small tags in front of everything that a greenhouse's picture is full of."""
    from pyapriltags import Detector

    library, engine = Detector(families="tag36h11", quad_decimate=1.0), tags.make_engine("apriltag")
    rng = np.random.default_rng(8)
    ours = theirs = 0
    for background in tag_views.TEXTURED:
        for range_m, degrees in ((1.5, 50), (2.2, -20), (2.8, 15)):
            tag_id = int(rng.integers(587))
            view = tag_views.at_range(tag_id, range_m, math.radians(degrees), rng, background=background, blur_px=1.0)
            assert [found.id for found in tags.detect(view.image, engine)] in ([tag_id], [])
            ours += bool(tags.detect(view.image, engine))
            theirs += any(found.tag_id == tag_id for found in library.detect(view.image))
    assert ours >= theirs >= 6


def test_tag_that_two_resolutions_show_is_found_once(tag_views: ModuleType) -> None:
    view = tag_views.at_range(8, 0.8, 0.1, np.random.default_rng(4), background="bricks")
    engine = tags.make_engine("apriltag")
    for decimation in engine.decimations:
        assert [tag_id for tag_id, _, _ in engine.find(view.image, decimation)] == [8]
    assert [found.id for found in tags.detect(view.image, engine)] == [8]


def test_auto_falls_back_to_aruco_without_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    real_import = builtins.__import__

    def without_pyapriltags(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "pyapriltags":
            raise ImportError(name)
        return real_import(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without_pyapriltags)
    assert tags.make_engine("auto").name == "aruco"
    with pytest.raises(tags.EngineMissing, match="pip install pyapriltags"):
        tags.make_engine("apriltag")


def test_unknown_engine_error_lists_the_known_engines() -> None:
    with pytest.raises(ValueError, match="'sift'; known: auto, apriltag, aruco"):
        tags.make_engine("sift")
