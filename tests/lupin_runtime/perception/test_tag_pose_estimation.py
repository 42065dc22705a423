"""Poses from corners: accuracy, the choice between the two planar solutions, and missing intrinsics."""

from __future__ import annotations

import math
from types import ModuleType

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.perception import tags
from lupin_runtime.perception.tag_pose_estimation import Intrinsics, object_points, quaternion_from_matrix, tag_pose
from lupin_runtime.transforms import rotate
from tests.support.optional import present

CAMERA = np.array([[554.254691191187, 0.0, 319.5], [0.0, 554.254691191187, 239.5], [0.0, 0.0, 1.0]])
PLAIN = Intrinsics(CAMERA, np.zeros(0))
UP = np.array([0.0, -1.0, 0.0])


def project(rotation: np.ndarray, translation: np.ndarray, edge_m: float = 0.1) -> np.ndarray:
    points = (rotation @ object_points(edge_m).T).T + translation
    pixels = (CAMERA @ points.T).T
    result: np.ndarray = pixels[:, :2] / pixels[:, 2:]
    return result


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    return math.degrees(math.acos(np.clip(a @ b, -1.0, 1.0)))


@settings(max_examples=80)
@given(
    # Some are exactly symmetric, where closed forms and rotation vectors fail.
    azimuth=st.floats(-1.05, 1.05) | st.just(0.0),
    tilt=st.floats(-0.1, 0.1) | st.just(0.0),
    roll=st.floats(-math.pi, math.pi) | st.sampled_from([0.0, math.pi / 2, math.pi, -math.pi / 2, math.pi / 4]),
    x=st.floats(-0.5, 0.5) | st.just(0.0),
    y=st.floats(-0.3, 0.3) | st.just(0.0),
    z=st.floats(0.4, 2.5),
)
def test_exact_corners_give_the_exact_pose(
    tag_views: ModuleType, azimuth: float, tilt: float, roll: float, x: float, y: float, z: float
) -> None:
    rotation = tag_views.tag_rotation(azimuth - math.atan2(x, z), tilt, roll)
    translation = np.array([x, y, z])
    pose = tag_pose(project(rotation, translation), PLAIN, 0.1)
    assert pose is not None
    assert np.abs(pose.translation - translation).max() < 1e-4
    assert angle_between(pose.normal, rotation[:, 2]) < 0.01 or pose.other_error_px < 1e-3
    assert pose.error_px < 1e-6


@pytest.mark.parametrize("model", ["equidistant", "plumb_bob", "rational_polynomial", ""])
def test_pose_is_that_of_the_lens(tag_views: ModuleType, model: str) -> None:
    """OpenCV, which owns the models, projects the corners."""
    rotation, translation = tag_views.tag_rotation(0.3, 0.05, 0.2), np.array([0.35, -0.2, 0.7])
    coefficients = np.array([-0.02, 0.01, -0.004, 0.001] if model == "equidistant" else [-0.2, 0.05, 0.001, -0.002])
    place = (object_points(0.1).reshape(-1, 1, 3), cv2.Rodrigues(rotation)[0], translation.reshape(3, 1))
    project_lens = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
    corners = project_lens(*place, CAMERA, coefficients)[0].reshape(4, 2)
    pose = present(tag_pose(corners, Intrinsics.from_camera_info(CAMERA, coefficients, 640, model), 0.1))
    assert np.abs(pose.translation - translation).max() < 1e-3
    assert angle_between(pose.normal, rotation[:, 2]) < 0.1


@pytest.mark.parametrize(("model", "count"), [("fov", 4), ("equidistant", 5), ("plumb_bob", 3), ("", 6), ("", 15)])
def test_unknown_distortion_is_named(model: str, count: int) -> None:
    with pytest.raises(ValueError, match=r"^distortion_(model|coefficients): expected"):
        Intrinsics.from_camera_info(CAMERA, np.full(count, 0.01), 640, model)


def test_tag_axes_are_x_right_y_up_z_out_of_the_plate(tag_views: ModuleType) -> None:
    pose = tag_pose(project(tag_views.tag_rotation(0.0), np.array([0.0, 0.0, 1.0])), PLAIN, 0.1)
    assert pose is not None
    assert np.allclose(pose.rotation, np.diag([1.0, -1.0, -1.0]), atol=1e-6)
    assert np.allclose(rotate(pose.transform.rotation, (0.0, 0.0, 1.0)), (0.0, 0.0, -1.0), atol=1e-6)
    assert pose.transform.translation == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)


def test_pose_at_2_meters_is_within_1_cm_and_2_degrees(tag_views: ModuleType) -> None:
    engine, rng = tags.make_engine(), np.random.default_rng(6)
    distances, angles = [], []
    for degrees in (-50, -35, -20, -5, 10, 25, 40, 50):
        view = tag_views.at_range(int(rng.integers(587)), 2.0, math.radians(degrees), rng)
        (found,) = tags.detect(view.image, engine)
        pose = tag_pose(found.corners, PLAIN, 0.1, UP)
        distances.append(float(np.linalg.norm(present(pose).translation - present(view).translation)))
        assert pose is not None
        angles.append(angle_between(pose.normal, view.rotation[:, 2]))
    assert np.median(distances) < 0.005 and max(distances) < 0.02
    assert np.median(angles) < 1.0 and max(angles) < 5.0


def ambiguous_view(tag_views: ModuleType) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a tag 2 m away that fit the tilted mirror of a vertical tag a little better than the tag itself."""
    truth = tag_views.tag_rotation(0.1)
    translation = np.array([0.0, 0.35, 2.0])  # seen from above: its mirror image hangs tilted
    mirror = [p for p in _solutions(project(truth, translation)) if angle_between(p, truth[:, 2]) > 8.0]
    assert mirror, "this view was meant to have a mirrored solution"
    return truth, translation


def _solutions(corners: np.ndarray) -> list[np.ndarray]:
    import cv2

    _, rotations, _, _ = cv2.solvePnPGeneric(
        object_points(0.1), corners.reshape(4, 1, 2), CAMERA, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    return [cv2.Rodrigues(r)[0][:, 2] for r in rotations]


def test_known_up_direction_prefers_the_vertical_plate(tag_views: ModuleType) -> None:
    truth, translation = ambiguous_view(tag_views)
    rng = np.random.default_rng(8)
    wrong = {None: 0, "up": 0}
    for _ in range(60):
        corners = project(truth, translation) + rng.normal(0, 0.15, (4, 2))
        for key, up in ((None, None), ("up", UP)):
            wrong[key] += angle_between(present(tag_pose(corners, PLAIN, 0.1, up)).normal, truth[:, 2]) > 10.0
    assert wrong["up"] <= 3
    assert wrong[None] > 3 * max(1, wrong["up"])


def test_tag_on_the_floor_is_still_measured(tag_views: ModuleType) -> None:
    flat = tag_views.tag_rotation(0.3, -math.pi / 2 + 0.5)
    translation = np.array([0.1, 0.2, 0.7])
    pose = tag_pose(project(flat, translation), PLAIN, 0.1, UP)
    assert pose is not None
    assert angle_between(pose.normal, flat[:, 2]) < 1.0


@pytest.mark.parametrize(
    "corners",
    [
        [[10, 10], [20, 20], [30, 30], [40, 40]],
        [[10, 10]] * 4,
        [[float("nan"), 0], [1, 0], [1, 1], [0, 1]],
    ],
)
def test_non_square_corners_have_no_pose(corners: list[list[float] | list[int] | list[int]]) -> None:
    assert tag_pose(np.array(corners, float), PLAIN, 0.1) is None


def test_empty_calibration_gives_the_assumed_camera() -> None:
    full = Intrinsics.from_camera_info(np.zeros(9), np.zeros(5), 640)
    assert full.matrix[0, 0] == pytest.approx(554.254691191187)
    assert (full.matrix[0, 2], full.matrix[1, 2]) == (320.5, 240.5)
    half = Intrinsics.from_camera_info(np.full(9, np.nan), np.zeros(5), 320)
    assert half.matrix[0, 0] == pytest.approx(554.254691191187 / 2)


def test_lens_distortion_is_compensated(tag_views: ModuleType) -> None:
    import cv2

    distortion = np.array([-0.25, 0.08, 0.0, 0.0, 0.0])
    rotation, translation = tag_views.tag_rotation(0.3), np.array([0.25, 0.1, 0.8])
    pixels, _ = cv2.projectPoints(object_points(0.1), cv2.Rodrigues(rotation)[0], translation, CAMERA, distortion)
    lens = Intrinsics.from_camera_info(CAMERA.ravel(), distortion, 640)
    pose = tag_pose(pixels.reshape(4, 2), lens, 0.1)
    assert pose is not None
    assert np.abs(pose.translation - translation).max() < 1e-3
    assert np.abs(present(tag_pose(pixels.reshape(4, 2), PLAIN, 0.1)).translation - translation).max() > 0.01


@settings(max_examples=50)
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_quaternions_rotate_like_their_matrices(vector: list[float]) -> None:
    import cv2

    matrix = cv2.Rodrigues(np.array(vector))[0]
    q = quaternion_from_matrix(matrix)
    assert q[3] >= 0.0
    for axis in range(3):
        unit = tuple(float(axis == i) for i in range(3))
        assert np.allclose(rotate(q, unit), matrix[:, axis], atol=1e-9)  # type: ignore[arg-type]
