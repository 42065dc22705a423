"""A tag's pose from its four corners: both planar solutions, and a choice between them that knows which way is up."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.transforms import Quaternion, Transform

Array = NDArray[np.float64]

# Used where a camera publishes an empty calibration: the values of the simulated body camera at 640 x 480.
FALLBACK_FOCAL_PX = 554.254691191187
FALLBACK_CENTRE_PX = (320.5, 240.5)
FALLBACK_WIDTH_PX = 640

# Corner noise after fitting the whole picture, and how far from vertical a plate hangs. A plate that lies flat is met with a
# bounded disbelief, so that it can still be measured.
CORNER_NOISE_PX = 0.12
TILT_NOISE_RAD = math.radians(8.0)
MAX_TILT_SIGMAS = 3.0
IPPE_FAILED_PX = 2.0

_Candidate = tuple[Array, Array, float]


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A pinhole camera: the 3 x 3 matrix and OpenCV's distortion coefficients (empty: none); pixel centres at whole numbers."""

    matrix: Array
    distortion: Array

    @staticmethod
    def from_camera_info(k: Array, d: Array, width_px: int) -> Intrinsics:
        """Of a CameraInfo's `k` (9) and `d`; where `k` is zero or not finite, the fallback for images `width_px` wide."""
        matrix = np.asarray(k, np.float64).reshape(3, 3)
        coefficients = np.asarray(d, np.float64).ravel()
        if np.isfinite(matrix).all() and matrix[0, 0] > 0.0 and matrix[1, 1] > 0.0:
            usable = np.isfinite(coefficients).all() and np.any(coefficients)
            return Intrinsics(matrix, coefficients if usable else np.zeros(0))
        return Intrinsics.fallback(width_px)

    @staticmethod
    def fallback(width_px: int) -> Intrinsics:
        """The assumed camera, for images of its shape at any size."""
        scale = (width_px or FALLBACK_WIDTH_PX) / FALLBACK_WIDTH_PX
        cx, cy = FALLBACK_CENTRE_PX
        f = FALLBACK_FOCAL_PX * scale
        return Intrinsics(np.array([[f, 0.0, cx * scale], [0.0, f, cy * scale], [0.0, 0.0, 1.0]]), np.zeros(0))


@dataclass(frozen=True, eq=False)
class TagPose:
    """camera_from_tag: x of the tag to the right as one reads it, y up, z out of the plate; metres.

    `error_px` is the root mean square distance of the projected corners, `other_error_px` that of the mirrored solution.
    """

    rotation: Array
    translation: Array
    error_px: float
    other_error_px: float

    @property
    def normal(self) -> Array:
        """The plate's outward normal in the camera frame."""
        return np.asarray(self.rotation[:, 2])

    @property
    def transform(self) -> Transform:
        """As a transform of the tag's frame under the camera's."""
        x, y, z = (float(value) for value in self.translation)
        return Transform((x, y, z), quaternion_from_matrix(self.rotation))


def object_points(edge_m: float) -> Array:
    """(4, 3) corners of a tag in its own frame, top-left, top-right, bottom-right, bottom-left."""
    half = edge_m / 2.0
    return np.array([[-half, half, 0.0], [half, half, 0.0], [half, -half, 0.0], [-half, -half, 0.0]])


def tag_pose(corners: Array, intrinsics: Intrinsics, edge_m: float, up: Array | None = None) -> TagPose | None:
    """The pose of a tag with corners (4, 2) in pixels; None where they are no view of a square in front of the camera.

    A plane seen through four noisy points has two poses, mirrored about the line of sight (Collins & Bartoli,
    "Infinitesimal plane-based pose estimation", IJCV 2014). The likelier one is returned, by its reprojection and, with
    `up` (unit, camera frame), by how vertically the plate would hang.
    """
    points = object_points(edge_m)
    pixels = np.asarray(corners, np.float64)
    if not np.isfinite(pixels).all():
        return None
    if intrinsics.distortion.size:
        pixels = cv2.undistortPoints(
            pixels.reshape(4, 1, 2), intrinsics.matrix, intrinsics.distortion, P=intrinsics.matrix
        ).reshape(4, 2)
    try:
        _, rotations, translations, _ = cv2.solvePnPGeneric(
            points, pixels.reshape(4, 1, 2), intrinsics.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
    except cv2.error:  # four corners on a line: no plane to speak of
        return None
    guesses = [*zip(rotations, translations), *_frontal_guess(pixels, intrinsics, edge_m)]
    candidates: list[_Candidate] = []
    for guess in guesses[:2]:
        candidates += _refined(points, pixels, intrinsics, *guess)
    if min((error_px for *_, error_px in candidates), default=math.inf) > IPPE_FAILED_PX:
        # OpenCV's closed form breaks down where the tag is seen exactly head-on.
        candidates = [c for guess in guesses[2:] for c in _refined(points, pixels, intrinsics, *guess)]
    if not candidates:
        return None
    best, *others = sorted(candidates, key=lambda c: _disbelief(c[0], c[2], up))
    return TagPose(*best, other_error_px=others[0][2] if others else math.inf)


def _refined(
    points: Array, pixels: Array, intrinsics: Intrinsics, rotation_vector: Array, translation_vector: Array
) -> list[_Candidate]:
    """The pose near a guess that projects best, with its error; none where that is no view from in front of the plate."""
    r, t = cv2.solvePnPRefineLM(points, pixels, intrinsics.matrix, None, rotation_vector, translation_vector)
    rotation, translation = cv2.Rodrigues(r)[0], np.asarray(t, np.float64).ravel()
    facing = float(rotation[:, 2] @ translation) < 0.0
    if not (np.isfinite(rotation).all() and np.isfinite(translation).all() and translation[2] > 0.0 and facing):
        return []
    return [(rotation, translation, _error_px(points, pixels, rotation, translation, intrinsics))]


def _frontal_guess(pixels: Array, intrinsics: Intrinsics, edge_m: float) -> list[tuple[Array, Array]]:
    """The pose of a tag that is seen head-on, as large and as turned as this one; none for corners without an area."""
    x, y = pixels[:, 0], pixels[:, 1]
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    if area < 1.0:
        return []
    k = intrinsics.matrix
    depth = edge_m * math.sqrt(float(k[0, 0] * k[1, 1]) / area)
    centre = np.linalg.solve(k, np.array([x.mean(), y.mean(), 1.0])) * depth
    across = pixels[1] - pixels[0] + pixels[2] - pixels[3]
    roll = math.atan2(float(across[1]), float(across[0]))
    c, s = math.cos(roll), math.sin(roll)
    rotation = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
    return [(cv2.Rodrigues(rotation)[0], centre.reshape(3, 1))]


def _error_px(points: Array, pixels: Array, rotation: Array, translation: Array, intrinsics: Intrinsics) -> float:
    projected = intrinsics.matrix @ (rotation @ points.T + translation[:, None])
    return float(np.sqrt(np.mean(np.sum((projected[:2] / projected[2] - pixels.T) ** 2, axis=0))))


def _disbelief(rotation: Array, error_px: float, up: Array | None) -> float:
    """Twice the negative log likelihood of a solution: corners with Gaussian noise, a tilt with a bounded one."""
    reprojection = 4.0 * (error_px / CORNER_NOISE_PX) ** 2
    if up is None:
        return reprojection
    tilt_rad = math.asin(max(-1.0, min(1.0, float(rotation[:, 2] @ up))))
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
