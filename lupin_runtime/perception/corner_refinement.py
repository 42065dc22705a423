"""Refines a detected tag's corners by fitting a template of the whole tag, which is far more exact than fitting its outline.

A detector finds corners from four edges; the code inside the tag has some eighty more. The id gives
the whole template, so Gauss-Newton finds the homography, gain, offset and shading that make it equal the image, with the
gradient of the (noise-free) template. Lucas & Kanade 1981; Baker & Matthews, "Lucas-Kanade 20 years on", 2004.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.apriltag import MODULES, modules

Array = NDArray[np.float64]

# Corners of the black square in its own plane, top-left first and clockwise, x right and y down, half an edge = 1.
UNIT_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])

PICTURE_PX_PER_MODULE = 12
QUIET_MODULES = 2  # how far the template reaches beyond the black square; official prints have one white module
REACH = 1.0 + 1.4 / MODULES  # samples end inside the white quiet module, so that they exclude the background
SAMPLES = 1936
# Lens, pixel area and interpolation together, as a standard deviation; guessed first, then measured on the tag itself.
FIRST_BLUR_PX = 0.8
BLUR_PX = (0.45, 1.6)
BLUR_RATIO = 1.4  # factor between the three widths that are compared
MAX_ITERATIONS = 6
CONVERGED_PX = 0.005
# A module narrower than this has no usable gradient: the outline is as exact then as a fit.
MIN_MODULE_PX = 1.0
MIN_CORRELATION = 0.6
LEAK_BLURS = 1.5
MIN_INSIDE = 0.6  # minimum share of the samples inside the image
MAX_CORNER_SHIFT_MODULES = 1.0

# Points of an R2 lattice (Roberts 2018), not of a grid: a grid's rows keep one distance from the tag's edges, and a blur
# that differs from the assumed one then pulls all four edges inward.
_INDEX = np.arange(1, SAMPLES + 1)
_U, _V = (REACH * (2.0 * (_INDEX * ratio % 1.0) - 1.0) for ratio in (0.7548776662466927, 0.5698402909980532))
_PLANE = np.stack([_U, _V, np.ones_like(_U)])
_UNIT_POINTS = np.vstack([UNIT_CORNERS.T, np.ones(4)])


@dataclass(frozen=True)
class Alignment:
    """Corners (4, 2), top-left first and clockwise, in pixels; `correlation` of image and template, 1 if equal."""

    corners: Array
    correlation: float


@dataclass(frozen=True)
class _Template:
    """Values and gradient per unit of the tag's plane at the sample points; `trusted` marks those that are used."""

    value: Array
    du: Array
    dv: Array
    trusted: NDArray[np.bool_]


# Widths of blur in modules, geometric, so that few templates serve every distance.
_BLUR_GRID = tuple(0.04 * 1.12**step for step in range(40))


@lru_cache(maxsize=128)  # 46 KB each
def _template(tag_id: int, blur_u: int, blur_v: int) -> _Template:
    """Create the upright template in [0, 1], blurred along u and v by widths of the table, at the sample points."""
    padded = np.pad(modules(tag_id), QUIET_MODULES, constant_values=1).astype(np.float32)
    fine = np.kron(padded, np.ones((PICTURE_PX_PER_MODULE, PICTURE_PX_PER_MODULE), np.float32))
    sigma_u, sigma_v = (_BLUR_GRID[step] * PICTURE_PX_PER_MODULE for step in (blur_u, blur_v))
    fine = cv2.GaussianBlur(fine, (0, 0), sigma_u, sigmaY=sigma_v, borderType=cv2.BORDER_REPLICATE)
    px_per_unit = PICTURE_PX_PER_MODULE * MODULES / 2.0
    center = (fine.shape[0] - 1) / 2.0
    x, y = ((center + px_per_unit * axis).astype(np.float32) for axis in (_U, _V))
    gradient_u = cv2.Sobel(fine, cv2.CV_32F, 1, 0, ksize=1) * (px_per_unit / 2.0)
    gradient_v = cv2.Sobel(fine, cv2.CV_32F, 0, 1, ksize=1) * (px_per_unit / 2.0)
    value, du, dv = (
        cv2.remap(layer, x, y, cv2.INTER_LINEAR).ravel().astype(np.float64) for layer in (fine, gradient_u, gradient_v)
    )
    # The background blurs over the plate's edge, one white module away from the black square, as far as the blur reaches.
    reach_u, reach_v = (
        1.0 + 2.0 / MODULES * min(0.7, max(0.15, 1.0 - LEAK_BLURS * _BLUR_GRID[step])) for step in (blur_u, blur_v)
    )
    return _Template(value, du, dv, (np.abs(_U) <= reach_u) & (np.abs(_V) <= reach_v))


def _template_for(tag_id: int, corners: Array, blur_px: float) -> _Template:
    """Select the template for a blur in pixels at these corners: foreshortening blurs more modules along one axis."""
    top_left, top_right, bottom_right, bottom_left = corners
    along_u = (top_right - top_left + bottom_right - bottom_left) / (2 * MODULES)
    along_v = (bottom_left - top_left + bottom_right - top_right) / (2 * MODULES)
    # A round blur in the image is an ellipse in the plane, whose variances are those of the inverse Jacobian's rows.
    area = max(abs(along_u[0] * along_v[1] - along_u[1] * along_v[0]), 1e-9)
    widths = blur_px * np.array([np.linalg.norm(along_v), np.linalg.norm(along_u)]) / area
    u, v = (int(np.clip(round(np.log(w / _BLUR_GRID[0]) / np.log(1.12)), 0, len(_BLUR_GRID) - 1)) for w in widths)
    return _template(tag_id, u, v)


class _Fit:
    """One tag in one image, in coordinates centerd on it and scaled to its size: the equations are well conditioned there."""

    def __init__(self, gray: NDArray[np.uint8], corners: Array, size_px: float) -> None:
        self.gray = gray
        self.center, self.scale = corners.mean(axis=0), size_px / 2.0
        local = ((corners - self.center) / self.scale).astype(np.float32)
        self.h = np.asarray(cv2.getPerspectiveTransform(UNIT_CORNERS.astype(np.float32), local), np.float64)

    def corners(self) -> Array:
        w = self.h @ _UNIT_POINTS
        return np.asarray((w[:2] / w[2]).T * self.scale + self.center)

    def sample(self) -> tuple[Array, NDArray[np.bool_]]:
        """Sample the image at the sample points; returns the values, and which points lie inside it."""
        w = self.h @ _PLANE
        px = (w[0] / w[2] * self.scale + self.center[0]).astype(np.float32)
        py = (w[1] / w[2] * self.scale + self.center[1]).astype(np.float32)
        height, width = self.gray.shape
        inside = (px >= 0) & (px <= width - 1) & (py >= 0) & (py <= height - 1)
        seen = cv2.remap(self.gray, px, py, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return seen.ravel().astype(np.float64), inside

    def refine(self, template: _Template) -> bool:
        """Iterate until the corners converge; False if there is nothing to fit."""
        basis = np.vstack([template.value, np.ones_like(_U), _U, _V])
        for _ in range(MAX_ITERATIONS):
            image, inside = self.sample()
            if inside.mean() < MIN_INSIDE:
                return False
            weight = (inside & template.trusted).astype(np.float64)
            weighted = basis * weight
            try:
                light = np.linalg.solve(weighted @ basis.T, weighted @ image)
            except np.linalg.LinAlgError:
                return False
            residual = image - light @ basis
            clip = 0.25 * abs(float(light[0])) + 1.0
            weight *= np.minimum(1.0, clip / np.maximum(np.abs(residual), 1e-9))
            jacobian = np.vstack([self._motion(template, float(light[0])), basis])
            weighted = jacobian * weight
            normal = weighted @ jacobian.T
            normal[np.diag_indices(len(normal))] *= 1.0 + 1e-9
            try:
                step = np.linalg.solve(normal, weighted @ residual)
            except np.linalg.LinAlgError:
                return False
            before = self.corners()
            # The template moves opposite to the sample points.
            self.h = self.h - np.append(step[:8], 0.0).reshape(3, 3)
            if float(np.abs(self.corners() - before).max()) < CONVERGED_PX:
                break
        return bool(np.isfinite(self.h).all())

    def _motion(self, template: _Template, gain: float) -> Array:
        """Derivatives (8, samples) of the shaded template's values by the homography's entries except the last."""
        h = self.h
        w = h @ _PLANE
        x, y, depth = w[0] / w[2], w[1] / w[2], w[2]
        xu, xv = (h[0, 0] - x * h[2, 0]) / depth, (h[0, 1] - x * h[2, 1]) / depth
        yu, yv = (h[1, 0] - y * h[2, 0]) / depth, (h[1, 1] - y * h[2, 1]) / depth
        scaled = gain / ((xu * yv - xv * yu) * depth)
        gx = (yv * template.du - yu * template.dv) * scaled
        gy = (xu * template.dv - xv * template.du) * scaled
        radial = -(gx * x + gy * y)
        return np.stack([gx * _U, gx * _V, gx, gy * _U, gy * _V, gy, radial * _U, radial * _V])


def align(gray: NDArray[np.uint8], tag_id: int, corners: Array) -> Alignment:
    """Refine corners (4, 2), top-left first and clockwise in pixels (center of the first pixel = 0, 0), of a detection.

    Returns the corners unchanged if the template does not fit or the tag is too small.
    """
    given = np.asarray(corners, np.float64)
    size_px = float(np.sqrt(abs(_area(given))))
    module_px = size_px / MODULES
    if module_px < MIN_MODULE_PX:
        return Alignment(given, 0.0)
    fit = _Fit(gray, given, size_px)
    if not fit.refine(_template_for(tag_id, given, FIRST_BLUR_PX)):
        return Alignment(given, 0.0)
    image, inside = fit.sample()
    blur_px = _blur_px(tag_id, fit.corners(), image, inside)
    template = _template_for(tag_id, fit.corners(), blur_px)
    if not fit.refine(template):
        return Alignment(given, 0.0)
    image, inside = fit.sample()
    counted = inside & template.trusted
    correlation = _correlation(image[counted], template.value[counted])
    found = fit.corners()
    shift = float(np.linalg.norm(found - given, axis=1).max())
    if not np.isfinite(found).all() or shift > MAX_CORNER_SHIFT_MODULES * module_px or correlation < MIN_CORRELATION:
        return Alignment(given, correlation)
    return Alignment(found, correlation)


def _blur_px(tag_id: int, corners: Array, image: Array, inside: NDArray[np.bool_]) -> float:
    """The blur that correlates best: the vertex of a parabola through three widths, on a logarithmic axis."""
    templates = [_template_for(tag_id, corners, FIRST_BLUR_PX * r) for r in (1 / BLUR_RATIO, 1.0, BLUR_RATIO)]
    counted = inside & templates[-1].trusted
    low, middle, high = (_correlation(image[counted], template.value[counted]) for template in templates)
    bend = low - 2.0 * middle + high
    offset = 0.5 * (low - high) / bend if bend < -1e-9 else (1.5 if high > low else -1.5)
    return float(np.clip(FIRST_BLUR_PX * BLUR_RATIO ** np.clip(offset, -2.0, 2.0), *BLUR_PX))


def _area(corners: Array) -> float:
    """Signed area of a polygon (n, 2)."""
    x, y = corners[:, 0], corners[:, 1]
    return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    return float(a @ b / (np.sqrt((a @ a) * (b @ b)) + 1e-9))
