"""Estimates a tag's pose from its four corners: both planar solutions, and a choice between them by the up direction."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.transforms import Quaternion, Transform

Array = NDArray[np.float64]

# Used where a camera publishes an empty calibration: the values of the simulated body camera at 640 x 480.
FALLBACK_FOCAL_PX = 554.254691191187
FALLBACK_CENTER_PX = (320.5, 240.5)
FALLBACK_WIDTH_PX = 640

# Noise of corners that corner_refinement.py has fitted to the image of the whole tag, and how far from vertical a tag hangs.
# The penalty for tilt is bounded, so that the pose of a tag that lies flat can still be estimated.
CORNER_NOISE_PX = 0.12
TILT_NOISE_RAD = math.radians(8.0)
MAX_TILT_SIGMAS = 3.0

# The models of sensor_msgs (`distortion_models.hpp`), with the numbers of coefficients that OpenCV's functions take. Without a
# name it is the first. Drivers name the first two alike.
_POLYNOMIAL = (0, 4, 5, 8, 12, 14)
DISTORTIONS = {"plumb_bob": _POLYNOMIAL, "rational_polynomial": _POLYNOMIAL, "equidistant": (0, 4)}

MIN_AREA_PX2 = 1.0
SAME_NORMAL_RAD = math.radians(0.3)
MAX_STEPS = 30


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A camera: the 3 x 3 matrix and OpenCV's distortion coefficients (empty: none); pixel centers at whole numbers.

    `is_fisheye`: the coefficients are those of the equidistant model.
    """

    matrix: Array
    distortion: Array
    is_fisheye: bool = False

    @staticmethod
    def from_camera_info(k: Array, d: Array, width_px: int, model: str = "") -> Intrinsics:
        """Build from a CameraInfo's `k` (9), `d` and distortion model.

        If `k` is zero or not finite, it is the fallback for images `width_px` wide. Raises ValueError for another model, or a
        number of coefficients that the model does not have.
        """
        if problem := distortion_problem(model, len(d)):
            raise ValueError(problem)
        matrix = np.asarray(k, np.float64).reshape(3, 3)
        coefficients = np.asarray(d, np.float64).ravel()
        if np.isfinite(matrix).all() and matrix[0, 0] > 0.0 and matrix[1, 1] > 0.0:
            usable = np.isfinite(coefficients).all() and np.any(coefficients)
            # An equidistant camera is none without a lens: its coefficients may be zero.
            is_fisheye = model == "equidistant" and coefficients.size > 0
            return Intrinsics(matrix, coefficients if usable or is_fisheye else np.zeros(0), is_fisheye)
        return Intrinsics.fallback(width_px)

    def scaled(self, factor: float) -> Intrinsics:
        """The same camera with images `factor` times as wide."""
        return replace(self, matrix=self.matrix * np.array([[factor], [factor], [1.0]]))

    def undistorted(self, pixels: Array) -> Array:
        """Return where pixels (n, 2) would be without a distortion."""
        if not self.distortion.size:
            return pixels
        undistort = cv2.fisheye.undistortPoints if self.is_fisheye else cv2.undistortPoints
        found: Array = undistort(pixels.reshape(-1, 1, 2), self.matrix, self.distortion, P=self.matrix)
        return found.reshape(-1, 2)

    @staticmethod
    def fallback(width_px: int) -> Intrinsics:
        """The simulated body camera, scaled to images `width_px` wide (0: unknown); their aspect ratio is assumed to be 4:3."""
        scale = (width_px or FALLBACK_WIDTH_PX) / FALLBACK_WIDTH_PX
        cx, cy = FALLBACK_CENTER_PX
        f = FALLBACK_FOCAL_PX * scale
        return Intrinsics(np.array([[f, 0.0, cx * scale], [0.0, f, cy * scale], [0.0, 0.0, 1.0]]), np.zeros(0))


def distortion_problem(model: str, count: int) -> str:
    """Return why a distortion model with so many coefficients cannot be used; empty if it can be."""
    counts = DISTORTIONS.get(model or "plumb_bob")
    if counts is None:
        return f"distortion_model: expected {', '.join(DISTORTIONS)}, found {model[:40]!r}"
    if count in counts:
        return ""
    return f"distortion_coefficients: expected {' or '.join(str(each) for each in counts)} numbers, found {count}"


@dataclass(frozen=True, eq=False)
class TagPose:
    """camera_from_tag: x of the upright tag to the right, y up, z out of its printed face; meters.

    `error_px` is the root mean square distance of the projected corners, `other_error_px` that of the mirrored solution
    (infinite if there is none).
    """

    rotation: Array
    translation: Array
    error_px: float
    other_error_px: float

    @property
    def normal(self) -> Array:
        """The tag's outward normal in the camera frame."""
        return np.asarray(self.rotation[:, 2])

    @property
    def transform(self) -> Transform:
        """The pose as a transform: parent the camera frame, child the tag frame (camera_from_tag)."""
        x, y, z = (float(value) for value in self.translation)
        return Transform((x, y, z), quaternion_from_matrix(self.rotation))


def object_points(edge_m: float) -> Array:
    """(4, 3) corners of a tag in its own frame, top-left, top-right, bottom-right, bottom-left."""
    half = edge_m / 2.0
    return np.array([[-half, half, 0.0], [half, half, 0.0], [half, -half, 0.0], [-half, -half, 0.0]])


def tag_pose(corners: Array, intrinsics: Intrinsics, edge_m: float, up: Array | None = None) -> TagPose | None:
    """The pose of a tag with corners (4, 2) in pixels; None if they cannot be a square in front of the camera.

    A plane seen through four noisy points has two poses, mirrored about the line of sight (Collins & Bartoli,
    "Infinitesimal plane-based pose estimation", IJCV 2014). The likelier one is returned, by its reprojection and, with
    `up` (unit, camera frame), by how vertically the tag would hang.
    """
    pixels = np.asarray(corners, np.float64)
    if not np.isfinite(pixels).all():
        return None
    pixels = intrinsics.undistorted(pixels)
    if not np.isfinite(pixels).all():
        return None  # beyond what the camera's model describes
    candidates = _solutions(pixels, intrinsics, edge_m)
    if not candidates:
        return None
    best, *others = sorted(candidates, key=lambda candidate: _neg_log_likelihood(candidate, up))
    return TagPose(*best, other_error_px=others[0].error_px if others else math.inf)


class _Candidate(NamedTuple):
    """A solution: camera_from_tag, and the root mean square distance of the projected corners."""

    rotation: Array
    translation: Array
    error_px: float


def _solutions(pixels: Array, intrinsics: Intrinsics, edge_m: float) -> list[_Candidate]:
    """Both poses of a tag in front of the camera, refined, with their errors; one if they coincide, none for corners
    that cannot be a square.

    OpenCV's IPPE is not used: for tags exactly ahead or exactly upright, 5.0 returns NaN or rotation vectors of length 8.
    """
    points = object_points(edge_m)
    x, y = pixels[:, 0], pixels[:, 1]
    # The signed area is negative for corners in mirrored order.
    if 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < MIN_AREA_PX2:
        return []
    start = _from_homography(points, pixels, intrinsics.matrix)
    if start is None:
        return []
    first = _refined(points, pixels, intrinsics.matrix, *start)
    # The mirrored pose: rotated by 180 degrees about the line of sight, then by 180 degrees about the tag's own normal.
    sight = first.translation / np.linalg.norm(first.translation)
    half_turn = 2.0 * np.outer(sight, sight) - np.eye(3)
    mirrored = half_turn @ first.rotation @ np.diag([-1.0, -1.0, 1.0])
    second = _refined(points, pixels, intrinsics.matrix, mirrored, first.translation)
    same = float(first.rotation[:, 2] @ second.rotation[:, 2]) > math.cos(SAME_NORMAL_RAD)
    return [candidate for candidate in ((first,) if same else (first, second)) if _is_usable(candidate)]


def _is_usable(candidate: _Candidate) -> bool:
    rotation, translation, error_px = candidate
    finite = np.isfinite(rotation).all() and np.isfinite(translation).all() and math.isfinite(error_px)
    return bool(finite) and translation[2] > 0.0 and float(rotation[:, 2] @ translation) < 0.0


def _from_homography(points: Array, pixels: Array, matrix: Array) -> tuple[Array, Array] | None:
    """An initial pose: the columns of the homography, orthonormalized (Zhang 2000)."""
    rays = np.linalg.solve(matrix, np.vstack([pixels.T, np.ones(4)]))
    rows = []
    for (u, v, _), (x, y, w) in zip(points, rays.T):
        x, y = x / w, y / w
        rows += [[u, v, 1.0, 0.0, 0.0, 0.0, -x * u, -x * v, -x], [0.0, 0.0, 0.0, u, v, 1.0, -y * u, -y * v, -y]]
    system = np.array(rows)
    try:
        h = np.append(np.linalg.solve(system[:, :8], -system[:, 8]), 1.0).reshape(3, 3)
    except np.linalg.LinAlgError:
        return None
    # The last entry is 1: the tag's center is in front of the camera by construction.
    scale = 2.0 / (np.linalg.norm(h[:, 0]) + np.linalg.norm(h[:, 1]))
    columns = np.column_stack([h[:, 0], h[:, 1], np.cross(h[:, 0], h[:, 1]) * scale]) * scale
    if not np.isfinite(columns).all():
        return None
    u, _, vt = np.linalg.svd(columns)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt), np.asarray(h[:, 2] * scale)


def _refined(points: Array, pixels: Array, matrix: Array, rotation: Array, translation: Array) -> _Candidate:
    """Refine a pose by Levenberg-Marquardt over a small rotation and a translation."""
    error_px = _error_px(points, pixels, rotation, translation, matrix)
    damping = 1e-4
    for _ in range(MAX_STEPS):
        rotated = rotation @ points.T
        x, y, z = rotated + translation[:, None]
        u, v = matrix[0, 0] * x / z + matrix[0, 1] * y / z + matrix[0, 2], matrix[1, 1] * y / z + matrix[1, 2]
        residual = np.concatenate([pixels[:, 0] - u, pixels[:, 1] - v])
        zero = np.zeros(4)
        point_jacobian = np.vstack(
            [
                np.column_stack([matrix[0, 0] / z, matrix[0, 1] / z, -(matrix[0, 0] * x + matrix[0, 1] * y) / z**2]),
                np.column_stack([zero, matrix[1, 1] / z, -matrix[1, 1] * y / z**2]),
            ]
        )
        # A small rotation w moves a rotated point p by w x p, so the Jacobian by rotation is p x (the Jacobian by translation).
        jacobian = np.hstack([np.cross(np.tile(rotated.T, (2, 1)), point_jacobian), point_jacobian])
        normal_matrix = jacobian.T @ jacobian
        try:
            step = np.linalg.solve(normal_matrix + damping * np.diag(np.diag(normal_matrix)), jacobian.T @ residual)
        except np.linalg.LinAlgError:
            break
        new_rotation, new_translation = cv2.Rodrigues(step[:3])[0] @ rotation, translation + step[3:]
        new_error_px = _error_px(points, pixels, new_rotation, new_translation, matrix)
        if not new_error_px < error_px:
            if damping > 1e6 or float(np.abs(step).max()) < 1e-9:
                break
            damping *= 10.0
            continue
        settled = error_px - new_error_px < 1e-6
        rotation, translation, error_px = new_rotation, new_translation, new_error_px
        damping /= 10.0
        if settled:
            break
    return _Candidate(rotation, translation, error_px)


def _error_px(points: Array, pixels: Array, rotation: Array, translation: Array, matrix: Array) -> float:
    """Root mean square distance of the projected points; infinite behind the camera."""
    placed = rotation @ points.T + translation[:, None]
    if float(placed[2].min()) <= 1e-6:
        return math.inf
    projected = matrix @ placed
    return float(np.sqrt(np.mean(np.sum((projected[:2] / projected[2] - pixels.T) ** 2, axis=0))))


def _neg_log_likelihood(candidate: _Candidate, up: Array | None) -> float:
    """Twice the negative log likelihood of a solution: Gaussian corner noise, and a Gaussian tilt up to MAX_TILT_SIGMAS."""
    reprojection = 4.0 * (candidate.error_px / CORNER_NOISE_PX) ** 2
    if up is None:
        return reprojection
    tilt_rad = math.asin(max(-1.0, min(1.0, float(candidate.rotation[:, 2] @ up))))
    return reprojection + min(abs(tilt_rad) / TILT_NOISE_RAD, MAX_TILT_SIGMAS) ** 2


def quaternion_from_matrix(matrix: Array) -> Quaternion:
    """(x, y, z, w), w >= 0, of a rotation matrix (Shepperd 1978)."""
    m = matrix
    trace = float(m[0, 0] + m[1, 1] + m[2, 2])
    options = (float(m[0, 0]), float(m[1, 1]), float(m[2, 2]), trace)
    largest = options.index(max(options))
    if largest == 3:
        q = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1.0 + trace])
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q = np.zeros(4)
        q[i] = 1.0 + m[i, i] - m[j, j] - m[k, k]
        q[j], q[k], q[3] = m[j, i] + m[i, j], m[k, i] + m[i, k], m[k, j] - m[j, k]
    q = q / np.linalg.norm(q) * (-1.0 if q[3] < 0.0 else 1.0)
    return float(q[0]), float(q[1]), float(q[2]), float(q[3])
