"""Scores a run against the ground truth: the error of its trajectory, and the tags and flowers that it found.

Input is what `truth.py` writes. The robot's map starts at its start pose and is rotated by its first errors, so the
trajectories are first aligned by the best rigid motion; tags are compared after the same motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.bounded_file import MAX_TRAJECTORY_BYTES, read_bounded_text
from lupin_runtime.geometry import Pose2

Array = NDArray[np.float64]
# On a shorter path the rotation of an alignment is noise, so the start pose is used instead.
MIN_PATH_M = 0.5


@dataclass(frozen=True)
class EstimatedTag:
    """A tag in the result of a run: meters in the map frame. Without a flower, `species` is "" and `anomaly` False."""

    id: int
    x: float
    y: float
    read: bool = False
    species: str = ""
    anomaly: bool = False


@dataclass(frozen=True)
class Score:
    """The score of a run; None for a value without data. Errors are in meters, after alignment."""

    tags_total: int
    tags_reachable: int
    tags_found: int
    tags_read: int
    tags_unknown: tuple[int, ...]
    tags_missed: tuple[int, ...]
    tag_errors_m: dict[int, float]
    tag_error_median_m: float | None
    trajectory_rmse_m: float | None
    trajectory_max_m: float | None
    flowers_total: int
    flowers_right: int
    bugs_total: int
    bugs_found: int
    bugs_imagined: int
    world_from_map: tuple[float, float, float]

    def as_json(self) -> dict[str, Any]:
        """Return the score as JSON values."""
        return asdict(self)


def read_tum(path: Path) -> Array:
    """Return the trajectory in a TUM file, shape (n, 8): stamp, x, y, z, qx, qy, qz, qw. Raises ValueError naming both."""
    rows = []
    for number, line in enumerate(read_bounded_text(path, MAX_TRAJECTORY_BYTES, errors="replace").splitlines(), 1):
        text = line.split("#", 1)[0].split()
        if not text:
            continue
        try:
            row = [float(word) for word in text]
        except ValueError:
            row = []
        if len(row) != 8 or not all(map(math.isfinite, row)):
            raise ValueError(f"{path}:{number}: expected 8 numbers (stamp x y z qx qy qz qw), found {line.strip()!r:.60}")
        rows.append(row)
    return np.array(rows, float).reshape(-1, 8)


def positions_at(trajectory: Array, stamps: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Interpolate positions, shape (n, 2), at stamps of shape (n,); also returns which stamps are within the trajectory."""
    if len(trajectory) == 0:
        return np.zeros((len(stamps), 2)), np.zeros(len(stamps), bool)
    order = np.argsort(trajectory[:, 0], kind="stable")
    t = trajectory[order, 0]
    positions = np.stack([np.interp(stamps, t, trajectory[order, axis]) for axis in (1, 2)], 1)
    return positions, (stamps >= t[0]) & (stamps <= t[-1])


def align(estimated: Array, true: Array) -> Pose2:
    """Return the rigid motion `true_from_estimated` with the smallest squared error, for points of shape (n, 2).

    After Umeyama (1991), without scale. Raises ValueError for fewer than 2 pairs, or if all points coincide.
    """
    if len(estimated) < 2 or estimated.shape != true.shape:
        raise ValueError(f"cannot align {len(estimated)} estimated with {len(true)} true positions")
    mean_e, mean_t = estimated.mean(0), true.mean(0)
    e, t = estimated - mean_e, true - mean_t
    if float((e**2).sum()) == 0.0:
        raise ValueError("cannot align positions that all coincide")
    # In the plane, the rotation of the SVD solution has this closed form.
    yaw = math.atan2(float((e[:, 0] * t[:, 1] - e[:, 1] * t[:, 0]).sum()), float((e * t).sum()))
    rotated = Pose2(yaw=yaw).apply(float(mean_e[0]), float(mean_e[1]))
    return Pose2(float(mean_t[0]) - rotated[0], float(mean_t[1]) - rotated[1], yaw)


def score(truth: Mapping[str, Any], true_trajectory: Array, estimated_trajectory: Array, tags: Iterable[EstimatedTag]) -> Score:
    """Score a run.

    `truth` is truth.json; trajectories are shape (n, 8) as `read_tum` gives them, the true one in the world frame, the
    estimated one in the map frame, both stamped in simulated time.
    """
    start = Pose2(**truth["start"])
    world_from_map, errors = start, None
    stamps = estimated_trajectory[:, 0]
    true, within = positions_at(true_trajectory, stamps)
    estimated, true = estimated_trajectory[within, 1:3], true[within]
    if len(estimated) >= 2:
        path_m = float(np.linalg.norm(np.diff(true, axis=0), axis=1).sum())
        if path_m >= MIN_PATH_M:
            world_from_map = align(estimated, true)
        errors = np.linalg.norm(_apply(world_from_map, estimated) - true, axis=1)
    by_id = {tag.id: tag for tag in tags}
    known = {int(row["id"]): row for row in truth["tags"]}
    tag_errors = {}
    for tag_id in sorted(by_id.keys() & known.keys()):
        x, y = world_from_map.apply(by_id[tag_id].x, by_id[tag_id].y)
        tag_errors[tag_id] = math.hypot(x - known[tag_id]["x"], y - known[tag_id]["y"])
    reachable = {tag_id for tag_id, row in known.items() if row["reachable"]}
    return Score(
        tags_total=len(known),
        tags_reachable=len(reachable),
        tags_found=len(tag_errors),
        tags_read=sum(by_id[tag_id].read for tag_id in tag_errors),
        tags_unknown=tuple(sorted(by_id.keys() - known.keys())),
        tags_missed=tuple(sorted(i for i in reachable if i not in by_id or not by_id[i].read)),
        tag_errors_m=tag_errors,
        tag_error_median_m=float(np.median(list(tag_errors.values()))) if tag_errors else None,
        trajectory_rmse_m=None if errors is None else float(np.sqrt(np.mean(errors**2))),
        trajectory_max_m=None if errors is None else float(errors.max()),
        world_from_map=(world_from_map.x, world_from_map.y, world_from_map.yaw),
        **_flowers(known, by_id),
    )


def _apply(pose: Pose2, points: Array) -> Array:
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y))


def _flowers(known: Mapping[int, Any], tags: Mapping[int, EstimatedTag]) -> dict[str, int]:
    """Count the tags whose species was named correctly, and those whose bugs were reported."""
    planted = {tag_id: _species(row["flowers"]) for tag_id, row in known.items() if row["flowers"]}
    bugs = {tag_id for tag_id, row in known.items() if any(flower["bug"] for flower in row["flowers"])}
    reported = {tag_id for tag_id, tag in tags.items() if tag.anomaly and tag_id in known}
    return {
        "flowers_total": len(planted),
        "flowers_right": sum(tag_id in tags and tags[tag_id].species == kind for tag_id, kind in planted.items()),
        "bugs_total": len(bugs),
        "bugs_found": len(bugs & reported),
        "bugs_imagined": len(reported - bugs),
    }


def _species(flowers: Sequence[Mapping[str, Any]]) -> str:
    """Return the most frequent species; of equally frequent ones, the first by name."""
    kinds = [str(flower["species"]) for flower in flowers]
    return min(set(kinds), key=lambda kind: (-kinds.count(kind), kind))
