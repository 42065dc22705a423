"""The order of a tag's corners, both engines, and how well the fitted corners sit."""

from __future__ import annotations

import builtins
import math

import cv2
import numpy as np
import pytest

from lupin_runtime.perception import alignment, tag_family, tags

ENGINES = ("apriltag", "aruco")


@pytest.fixture(scope="module", params=ENGINES)
def engine(request):
    return tags.make_engine(request.param)


def official_picture(module_px: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """The official id 0 typed from its published bits - not drawn by any library - upright on white, and its corners."""
    inner = np.array([[int(bit) for bit in row] for row in tag_family.ID0_ROWS])
    square = np.zeros((8, 8))
    square[1:-1, 1:-1] = inner
    image = np.full((480, 640), 255, np.uint8)
    size = 8 * module_px
    left, top = 200, 120
    image[top : top + size, left : left + size] = np.kron(square, np.ones((module_px, module_px))) * 255
    low_x, low_y, high_x, high_y = left - 0.5, top - 0.5, left + size - 0.5, top + size - 0.5
    return image, np.array([[low_x, low_y], [high_x, low_y], [high_x, high_y], [low_x, high_y]])


def test_the_family_draws_the_official_id_0():
    inner = tag_family.modules(0)[1:-1, 1:-1]
    assert ["".join(str(bit) for bit in row) for row in inner] == list(tag_family.ID0_ROWS)


def test_an_upright_official_tag_has_its_corners_from_the_top_left_clockwise(engine):
    image, corners = official_picture()
    (found,) = tags.detect(image, engine)
    assert found.id == 0 and found.hamming == 0
    assert np.abs(found.corners - corners).max() < 0.1


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_turned_tag_takes_its_first_corner_along(engine, turns):
    image, corners = official_picture()
    turned = np.ascontiguousarray(np.rot90(image, turns))
    h, w = image.shape
    for _ in range(turns):  # np.rot90 is counter-clockwise: (x, y) of a w-wide image goes to (y, w - 1 - x)
        corners = np.stack([corners[:, 1], w - 1 - corners[:, 0]], axis=1)
        h, w = w, h
    (found,) = tags.detect(turned, engine)
    assert np.abs(found.corners - corners).max() < 0.1


def test_the_aruco_engine_learns_the_first_corner_from_an_official_tag():
    """Whatever corner this version of OpenCV calls the first, the engine's first is the top left one."""
    engine = tags.ArucoEngine()
    image, corners = official_picture()
    raw = dict(engine._detect(image))[0]
    assert np.argmin(np.linalg.norm(raw - corners[0], axis=1)) == engine._first_corner


def test_the_aruco_engine_works_with_the_interface_of_opencv_4_6(monkeypatch):
    """There, a function takes the dictionary and the parameters, and parameters are made by another function."""
    aruco = cv2.aruco
    new_detector, new_parameters = aruco.ArucoDetector, aruco.DetectorParameters

    def detect_markers(grey, dictionary, parameters):
        return new_detector(dictionary, parameters).detectMarkers(grey)

    class Old:
        DICT_APRILTAG_36h11 = aruco.DICT_APRILTAG_36h11
        CORNER_REFINE_SUBPIX = aruco.CORNER_REFINE_SUBPIX
        getPredefinedDictionary = staticmethod(aruco.getPredefinedDictionary)
        DetectorParameters_create = staticmethod(new_parameters)
        detectMarkers = staticmethod(detect_markers)
        drawMarker = staticmethod(aruco.generateImageMarker)

    tag_family._family.cache_clear()
    tag_family.modules.cache_clear()
    monkeypatch.setattr(cv2, "aruco", Old)
    try:
        image, corners = official_picture()
        (found,) = tags.detect(image, tags.ArucoEngine())
        assert np.abs(found.corners - corners).max() < 0.1
    finally:
        tag_family._family.cache_clear()
        tag_family.modules.cache_clear()


def test_both_engines_agree_on_views_that_a_camera_has(tag_views):
    rng = np.random.default_rng(4)
    for range_m, degrees in ((0.5, 40), (0.8, -30), (1.2, 10), (1.6, -20)):
        view = tag_views.at_range(int(rng.integers(587)), range_m, math.radians(degrees), rng)
        found = [tags.detect(view.image, tags.make_engine(name)) for name in ENGINES]
        assert [[d.id for d in ds] for ds in found] == [[view.tag_id]] * 2
        assert np.abs(found[0][0].corners - found[1][0].corners).max() < 0.1


def test_fitted_corners_are_twice_as_good_as_the_outline(tag_views):
    """At 1 to 2 m the root mean square error is below that of the library's own corners, by a factor, in the median."""
    engine = tags.make_engine("apriltag")
    rng = np.random.default_rng(2)
    outline, fitted = [], []
    for range_m in (1.0, 1.4, 1.8):
        for degrees in (-50, -20, 0, 20, 50):
            view = tag_views.at_range(int(rng.integers(587)), range_m, math.radians(degrees), rng)
            raw = {tag_id: corners for tag_id, corners, _ in engine.find(view.image)}
            (found,) = tags.detect(view.image, engine)
            for corners, errors in ((raw[view.tag_id], outline), (found.corners, fitted)):
                errors.append(float(np.sqrt(np.mean(np.sum((corners - view.corners) ** 2, axis=1)))))
    assert np.median(fitted) < 0.5 * np.median(outline)
    assert max(fitted) < 0.25


def test_a_fit_that_does_not_hold_leaves_the_corners_as_they_were(tag_views):
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 255, (480, 640)).astype(np.uint8)
    corners = np.array([[100.0, 100.0], [160.0, 102.0], [158.0, 160.0], [98.0, 161.0]])
    aligned = alignment.align(noise, 7, corners)
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
def test_corners_that_are_no_square_in_the_image_do_not_break_the_fit(corners):
    given = np.array(corners, float)
    aligned = alignment.align(np.zeros((480, 640), np.uint8), 3, given)
    assert np.array_equal(aligned.corners, given) and aligned.correlation < 0.45


def test_pictures_without_a_tag_have_none(engine):
    rng = np.random.default_rng(0)
    for image in (
        np.zeros((480, 640), np.uint8),
        np.full((480, 640), 255, np.uint8),
        rng.integers(0, 255, (480, 640)).astype(np.uint8),
        cv2.GaussianBlur(rng.integers(0, 255, (480, 640)).astype(np.uint8), (0, 0), 3),
    ):
        assert tags.detect(image, engine) == []


@pytest.mark.parametrize("shape", [(1, 1), (3, 640), (480, 2)])
def test_tiny_pictures_are_no_error(shape):
    assert tags.detect(np.zeros(shape, np.uint8), tags.make_engine("apriltag")) == []


def test_an_image_that_is_not_grey_is_refused(engine):
    with pytest.raises(ValueError, match="grey image"):
        tags.detect(np.zeros((480, 640, 3), np.uint8), engine)
    with pytest.raises(ValueError, match="uint8"):
        tags.detect(np.zeros((480, 640), np.float32), engine)


def test_smoothing_leaves_a_tag_and_takes_the_noise(tag_views):
    view = tag_views.at_range(11, 1.0, 0.2, np.random.default_rng(3), noise=5.0)
    smoothed, busy = tags.smooth_dull_parts(view.image)
    x0, y0 = view.corners.min(axis=0).astype(int)
    x1, y1 = view.corners.max(axis=0).astype(int)
    assert smoothed[y0:y1, x0:x1].std() > 0.95 * view.image[y0:y1, x0:x1].std()
    corner = slice(2, 30), slice(2, 30)
    assert smoothed[corner].std() < 0.4 * view.image[corner].std()
    assert busy < 0.15


def test_without_the_library_auto_falls_back_to_aruco(monkeypatch):
    real_import = builtins.__import__

    def without_pyapriltags(name, *args, **kwargs):
        if name == "pyapriltags":
            raise ImportError(name)
        return real_import(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without_pyapriltags)
    assert tags.make_engine("auto").name == "aruco"
    with pytest.raises(tags.EngineMissing, match="pip install pyapriltags"):
        tags.make_engine("apriltag")


def test_an_unknown_engine_is_named_with_the_known_ones():
    with pytest.raises(ValueError, match="'sift'; known: auto, apriltag, aruco"):
        tags.make_engine("sift")


@pytest.mark.parametrize("tag_id", [-1, 587])
def test_ids_outside_the_family_are_refused(tag_id):
    with pytest.raises(ValueError, match="0 to 586"):
        tag_family.modules(tag_id)
