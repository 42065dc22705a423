"""Files of mapping sessions: a mapper's graph, from which mapping resumes after a restart or on another day."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.atomic_file import MalformedFile, write_atomically
from lupin_runtime.bounded_file import open_regular
from lupin_runtime.slam.kernels import scan_normals
from lupin_runtime.slam.keyframes import KeyframeGraph
from lupin_runtime.slam.scan import SIGMA_FLOOR_M, SIGMA_SHARE, ScanPoints

Array = NDArray[np.floating]

_VERSION = 1


@dataclass(frozen=True)
class MappingSession:
    """A graph, and the pose (3,) of odom in the map when it was saved."""

    graph: KeyframeGraph
    map_from_odom: Array


def save_session(path: Path, graph: KeyframeGraph, map_from_odom: Array, step_rad: float) -> None:
    """Write a session atomically. `step_rad` is the angle between the laser's beams. Raises OSError."""
    pool = graph.pool
    points = int(pool.count[: len(pool)].sum())
    edges, closures = graph.as_edges()
    buffer = io.BytesIO()
    np.savez(
        buffer,
        version=np.array(_VERSION),
        xy=pool.xy[:points].astype(np.float32),
        count=pool.count[: len(pool)],
        sensor=np.array(pool.sensor).reshape(-1, 2),
        step_rad=np.array(step_rad),
        stamps=np.array(graph.stamps),
        poses=graph.poses,
        tail=edges.tail,
        head=edges.head,
        motion=edges.motion,
        information=edges.information,
        closures=closures,
        map_from_odom=map_from_odom,
    )
    # Not synced, since this runs between scans: a power cut may cost the newest session.
    write_atomically(path, buffer.getvalue())


def load_session(path: Path) -> MappingSession:
    """Read a session. Raises MalformedFile, OSError."""
    try:
        with open_regular(path) as stream, np.load(stream, allow_pickle=False) as stored:
            values: dict[str, Any] = {name: stored[name] for name in stored.files}
        if int(values["version"]) != _VERSION:
            raise MalformedFile(path, None, f"expected a session of version {_VERSION}, found {int(values['version'])}")
        graph = KeyframeGraph()
        start = 0
        step_rad = float(values["step_rad"])
        for count, sensor, stamp, pose in zip(values["count"], values["sensor"], values["stamps"], values["poses"]):
            xy = np.ascontiguousarray(values["xy"][start : start + count], float)
            start += int(count)
            at = (float(sensor[0]), float(sensor[1]))
            ranges = np.hypot(xy[:, 0] - at[0], xy[:, 1] - at[1])
            sigma = np.hypot(SIGMA_FLOOR_M, SIGMA_SHARE * ranges)
            graph.add(ScanPoints(xy, scan_normals(xy, at, step_rad), sigma, at), float(stamp), pose)
        for tail, head, motion, information, closure in zip(
            values["tail"], values["head"], values["motion"], values["information"], values["closures"]
        ):
            graph.join(int(tail), int(head), motion, information, bool(closure))
        if not len(graph) or not np.isfinite(graph.poses).all():
            raise MalformedFile(path, None, "the session has no usable keyframe")
        return MappingSession(graph, values["map_from_odom"])
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError, IndexError) as error:
        if isinstance(error, MalformedFile):
            raise
        raise MalformedFile(path, None, f"expected a mapping session: {error}") from None
