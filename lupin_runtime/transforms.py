"""A transform tree with history: tf2's buffer without ROS.

Rotations are quaternions (x, y, z, w), translations meters, times integer nanoseconds. A lookup between two samples of
one edge interpolates linearly in translation and spherically in rotation; it never extrapolates.
"""

from __future__ import annotations

import math
import threading
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass

from lupin_runtime.geometry import Pose2, yaw_from_quaternion

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


def frame_name(frame: str) -> str:
    """Return the name of a frame without the leading slash, which tf2 dropped and old drivers still write."""
    return frame.removeprefix("/")


class TransformUnavailable(LookupError):
    """No chain of transforms connects the two frames, or not at that time; the message names the missing frame."""


@dataclass(frozen=True)
class Transform:
    """`parent_from_child`: maps coordinates of the child frame into the parent frame."""

    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    def __matmul__(self, other: Transform) -> Transform:
        """Compose two transforms: `a_from_b @ b_from_c` is `a_from_c`."""
        x, y, z = rotate(self.rotation, other.translation)
        tx, ty, tz = self.translation
        return Transform((tx + x, ty + y, tz + z), multiply(self.rotation, other.rotation))

    def inverse(self) -> Transform:
        """Return `child_from_parent`."""
        qx, qy, qz, qw = self.rotation
        back = (-qx, -qy, -qz, qw)
        x, y, z = rotate(back, self.translation)
        return Transform((-x, -y, -z), back)

    def apply(self, point: Vector) -> Vector:
        """Transform a point from the child frame to the parent frame."""
        x, y, z = rotate(self.rotation, point)
        tx, ty, tz = self.translation
        return tx + x, ty + y, tz + z

    def to_pose2(self) -> Pose2:
        """Return the transform as seen from above: its part in the xy plane."""
        return Pose2(self.translation[0], self.translation[1], yaw_from_quaternion(*self.rotation))


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the Hamilton product: the rotation by `b`, then by `a`."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Rotate `v` by the unit quaternion `q`."""
    qx, qy, qz, qw = q
    x, y, z = v
    tx, ty, tz = 2.0 * (qy * z - qz * y), 2.0 * (qz * x - qx * z), 2.0 * (qx * y - qy * x)
    return (
        x + qw * tx + qy * tz - qz * ty,
        y + qw * ty + qz * tx - qx * tz,
        z + qw * tz + qx * ty - qy * tx,
    )


def slerp(a: Quaternion, b: Quaternion, fraction: float) -> Quaternion:
    """Interpolate from `a` (fraction 0) to `b` (1) along the shorter arc (Shoemake 1985)."""
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign = -1.0 if dot < 0.0 else 1.0
    dot = min(1.0, abs(dot))
    angle = math.acos(dot)
    if angle < 1e-6:
        wa, wb = 1.0 - fraction, fraction
    else:
        wa, wb = math.sin((1.0 - fraction) * angle) / math.sin(angle), math.sin(fraction * angle) / math.sin(angle)
    wb *= sign
    x, y, z, w = (wa * p + wb * q for p, q in zip(a, b))
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    return x / norm, y / norm, z / norm, w / norm


_MAX_LATE_SAMPLES = 3  # this many consecutive samples older than the whole history mean that the clock has gone back


class _Edge:
    """The history of one child frame under its parent, oldest first."""

    def __init__(self, parent: str, static: bool) -> None:
        self.parent = parent
        self.static = static
        self.samples: deque[tuple[int, Transform]] = deque()
        self._late = 0

    def insert(self, stamp_ns: int, transform: Transform, keep_ns: int) -> None:
        late = bool(self.samples) and self.samples[-1][0] - stamp_ns > keep_ns
        self._late = self._late + 1 if late else 0
        if self.static or self._late == _MAX_LATE_SAMPLES:
            self.samples.clear()
            self._late = 0
        elif late:
            return
        if not self.samples or stamp_ns > self.samples[-1][0]:
            self.samples.append((stamp_ns, transform))
        else:
            at = bisect_left(self.samples, stamp_ns, key=lambda sample: sample[0])
            if self.samples[at][0] == stamp_ns:
                self.samples[at] = (stamp_ns, transform)
            else:
                self.samples.insert(at, (stamp_ns, transform))
        while self.samples[-1][0] - self.samples[0][0] > keep_ns:
            self.samples.popleft()

    def at(self, stamp_ns: int | None) -> Transform | None:
        newest_ns, newest = self.samples[-1]
        if self.static or stamp_ns is None or stamp_ns == newest_ns:
            return newest
        if stamp_ns > newest_ns or stamp_ns < self.samples[0][0]:
            return None
        high = bisect_left(self.samples, stamp_ns, key=lambda sample: sample[0])
        high_ns, after = self.samples[high]
        if high_ns == stamp_ns:
            return after
        low_ns, before = self.samples[high - 1]
        f = (stamp_ns - low_ns) / (high_ns - low_ns)
        x, y, z = (p + f * (q - p) for p, q in zip(before.translation, after.translation))
        return Transform((x, y, z), slerp(before.rotation, after.rotation, f))


class TransformTree:
    """Thread-safe history of all frames over `keep_s` seconds; it is cleared if the clock goes back by more."""

    def __init__(self, keep_s: float = 10.0) -> None:
        self._keep_ns = int(keep_s * 1e9)
        self._edges: dict[str, _Edge] = {}
        self._lock = threading.Lock()

    def clear(self) -> None:
        """Clear the moving frames, whose stamps are invalid after a clock jump."""
        with self._lock:
            self._edges = {child: edge for child, edge in self._edges.items() if edge.static}

    def insert(self, parent: str, child: str, stamp_ns: int, transform: Transform, static: bool = False) -> None:
        """Add a sample. Raises ValueError for a non-finite one, which would spoil every chain through it."""
        if not all(map(math.isfinite, (*transform.translation, *transform.rotation))):
            raise ValueError(f"transform {parent} -> {child} is not finite")
        parent, child = frame_name(parent), frame_name(child)
        with self._lock:
            edge = self._edges.get(child)
            if edge is None or edge.parent != parent or edge.static != static:
                edge = self._edges[child] = _Edge(parent, static)
            edge.insert(stamp_ns, transform, self._keep_ns)

    def lookup(self, target: str, source: str, stamp_ns: int | None = None) -> Transform:
        """Return `target_from_source` at a time, or at the newest common time for None.

        Raises TransformUnavailable, naming what is missing.
        """
        target, source = frame_name(target), frame_name(source)
        with self._lock:
            up, down = self._chain(source), self._chain(target)
            common = next((frame for frame in up if frame in down), None)
            if common is None:
                raise TransformUnavailable(f"no chain of transforms from {source!r} to {target!r}")
            if stamp_ns is None:
                stamp_ns = self._newest_common_ns(up[: up.index(common)] + down[: down.index(common)])
            return self._to_ancestor(target, common, stamp_ns).inverse() @ self._to_ancestor(source, common, stamp_ns)

    def newest_ns(self, target: str, source: str) -> int | None:
        """Return the newest time at which `lookup` succeeds; None if every edge is static; raises as `lookup` does."""
        target, source = frame_name(target), frame_name(source)
        with self._lock:
            up, down = self._chain(source), self._chain(target)
            common = next((frame for frame in up if frame in down), None)
            if common is None:
                raise TransformUnavailable(f"no chain of transforms from {source!r} to {target!r}")
            return self._newest_common_ns(up[: up.index(common)] + down[: down.index(common)])

    def _chain(self, frame: str) -> list[str]:
        chain = [frame]
        while (edge := self._edges.get(chain[-1])) is not None:
            if edge.parent in chain:
                raise TransformUnavailable(f"the frames {' -> '.join(chain)} form a loop")
            chain.append(edge.parent)
        return chain

    def _newest_common_ns(self, frames: list[str]) -> int | None:
        stamps = [edge.samples[-1][0] for frame in frames if not (edge := self._edges[frame]).static]
        return min(stamps, default=None)

    def _to_ancestor(self, frame: str, ancestor: str, stamp_ns: int | None) -> Transform:
        result = Transform()
        while frame != ancestor:
            edge = self._edges[frame]
            step = edge.at(stamp_ns)
            if step is None:
                oldest, newest = edge.samples[0][0] / 1e9, edge.samples[-1][0] / 1e9
                raise TransformUnavailable(
                    f"{edge.parent} -> {frame} is known from {oldest:.3f} s to {newest:.3f} s, "
                    f"not at {(stamp_ns or 0) / 1e9:.3f} s"
                )
            result = step @ result
            frame = edge.parent
        return result
