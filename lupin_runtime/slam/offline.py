"""Builds a map from a whole log: maps every scan, refines the graph, and takes each scan's pose from the finished graph."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.scan_health import ScanHealth
from lupin_runtime.slam.carmen import CarmenLog
from lupin_runtime.slam.g2o import GraphFile
from lupin_runtime.slam.graph_refinement import refine_graph
from lupin_runtime.slam.local_map import FieldShape
from lupin_runtime.slam.loop_closure import LoopSettings
from lupin_runtime.slam.mapper import AnchoredPose, Mapper, MapperSettings, MotionNoise
from lupin_runtime.slam.occupancy import MAX_CELLS, OccupancyMap, OccupancySettings
from lupin_runtime.slam.scan import Beams
from lupin_runtime.slam.scan_matching import Window

Array = NDArray[np.floating]

# Beyond this range a laser's points are too far apart to match well: one degree is most of a meter.
USABLE_RANGE_M = 40.0


@dataclass(frozen=True)
class OfflineScan:
    """One scan of a log: stamp as text and in seconds, odometry, ranges (N,), beams; twist and time per beam if known."""

    stamp: str
    stamp_s: float
    odom: Pose2
    ranges: Array
    beams: Beams
    twist: tuple[float, float, float] | None = None
    beam_s: float = 0.0


@dataclass(frozen=True)
class BuiltMap:
    """The result of a log: the grid, a pose per scan with the log's stamp, the graph, and counts for the summary."""

    grid: GridMap
    stamps: list[str]
    poses: list[Pose2]
    graph: GraphFile
    keyframes: int
    closures: int
    unmatched: int
    unusable: int
    odometry_jumps: int
    left_out: int  # keyframes too far away to be drawn


class NothingToMap(ValueError):
    """A log without a single usable scan."""


def settings_for_logs(range_max_m: float) -> MapperSettings:
    """Settings for logs of unknown robots: little trust in odometry, all keyframes kept, loops may need large corrections."""
    reach = min(range_max_m, 25.0)
    return MapperSettings(
        keyframe_interval_s=0.0,
        revisit_m=0.0,
        lost_m=0.0,
        lost_is_far=True,
        leap_window=Window(2.0, math.pi / 2.0),
        local_radius_m=20.0,
        noise=MotionNoise(floor_m=0.01, floor_rad=0.006, travel=0.15, turn=0.12, turn_per_m=0.06),
        field_shape=FieldShape(reach_m=reach),
        loops=LoopSettings(max_window=Window(12.0, 0.6), tries=3, chain=6),
        occupancy=None,
    )


def scans_from_carmen(log: CarmenLog, range_max_m: float = USABLE_RANGE_M) -> list[OfflineScan]:
    """Convert the scans of a CARMEN log. Readings at the laser's maximum, which mean "no return", are dropped."""
    ceiling = no_return_limit_m([scan.ranges for scan in log.scans])
    limit = min(range_max_m, ceiling - 1e-6)
    result = []
    for scan in log.scans:
        beams = Beams(scan.angle_min, scan.angle_step, len(scan.ranges), log.mount, 0.1, limit)
        result.append(OfflineScan(scan.stamp, float(scan.stamp), scan.odom, scan.ranges, beams))
    return result


def no_return_limit_m(ranges: Sequence[Array]) -> float:
    """Find the smallest range reading, in meters, that means "no return" in a log; inf if there is none.

    Such a reading is far more frequent than its neighbors, and hardly any reading is larger. A laser may have several
    (dazzled, no echo, too far), a few centimeters apart: the smallest is returned.
    """
    readings = np.concatenate([np.zeros(0), *ranges])
    values = np.sort(np.round(readings[np.isfinite(readings)], 3))
    if not len(values):
        return math.inf
    total = len(values)
    distinct, first, counts = np.unique(values, return_index=True, return_counts=True)
    beyond = total - first - counts
    # The average number of readings per centimeter in the range just below.
    below = np.searchsorted(values, 0.9 * distinct) - np.searchsorted(values, 0.5 * distinct)
    usual = below / np.maximum(40.0 * distinct, 1.0)
    stands_out = (counts >= max(10.0, 0.0005 * total)) & (counts >= 20.0 * usual)
    last = stands_out & (beyond <= 0.005 * total)
    if not last.any():
        return math.inf
    top = distinct[last][-1]
    return float(distinct[stands_out & (distinct >= 0.95 * top)][0])


def time_order(scans: Sequence[OfflineScan]) -> list[int]:
    """Return the scans' numbers in the order they were taken: that of the file or of the stamps, whichever path is shorter.

    Loggers write scans as they arrive, and stamps may be rounded, repeated or wrong; a robot does not jump back and forth.
    """
    written = list(range(len(scans)))
    stamped = sorted(written, key=lambda number: scans[number].stamp_s)
    if stamped == written:
        return written

    def path_length(order: list[int]) -> float:
        steps = (scans[a].odom.inverse() @ scans[b].odom for a, b in pairwise(order))
        return sum(math.hypot(step.x, step.y) + abs(step.yaw) for step in steps)

    return stamped if path_length(stamped) < 0.99 * path_length(written) else written


def usual_interval_s(scans: Sequence[OfflineScan]) -> float:
    """The median time between scans with different stamps; 1.0 if there are none."""
    stamps = np.sort([scan.stamp_s for scan in scans])
    between = np.diff(stamps)
    between = between[between > 0.0]
    return float(np.median(between)) if len(between) else 1.0


def build_map(
    scans: Sequence[OfflineScan],
    resolution_m: float = 0.05,
    settings: MapperSettings | None = None,
    refine: bool = True,
    progress: Callable[[str, float], None] = lambda _stage, _share: None,
) -> BuiltMap:
    """Map a log; poses are in the order of `scans`. `progress` receives a stage's name and its finished share.

    Raises NothingToMap if no scan has enough returns."""
    farthest = max((scan.beams.range_max_m for scan in scans), default=0.0)
    settings = settings or replace(settings_for_logs(farthest), min_interval_s=usual_interval_s(scans))
    mapper = Mapper(replace(settings, occupancy=None))
    anchored: list[AnchoredPose | None] = []
    unmatched = unusable = jumps = 0
    order = time_order(scans)
    for index, number in enumerate(order):
        scan = scans[number]
        step = mapper.process(scan.stamp_s, scan.odom, scan.ranges, scan.beams, scan.twist, scan.beam_s)
        anchored.append(mapper.anchored_pose)
        unusable += step.health not in (ScanHealth.GOOD, ScanHealth.REPEATED)
        unmatched += step.health is ScanHealth.GOOD and not step.matched
        jumps += step.odometry_jumped
        if index % 20 == 0:
            progress("match", index / len(scans))
    if mapper.anchored_pose is None:
        raise NothingToMap(f"none of {len(scans)} scans has enough returns within its range limits")
    mapper.optimize()
    closures = sum(edge.closure for edge in mapper.graph.edges)
    if refine and len(mapper.graph) > 2:
        refine_graph(mapper.graph, shape=settings.field_shape, progress=lambda share: progress("refine", share))
    occupancy = OccupancyMap(OccupancySettings(resolution_m=resolution_m))
    for number, pose in enumerate(mapper.graph.poses):
        occupancy.draw(number, mapper.graph.pool.scan(number), pose)
        progress("draw", number / len(mapper.graph))
    grid = occupancy.grid()
    if grid is None:
        raise NothingToMap(f"no scan is close enough to the others for a map of at most {MAX_CELLS} cells; use larger cells")
    # Scans before the first usable one get the odometry, relative to the map's first pose.
    first = scans[order[next(at for at, pose in enumerate(anchored) if pose is not None)]]
    poses = [Pose2()] * len(scans)
    for number, place in zip(order, anchored):
        if place is None:
            poses[number] = _pose2(mapper.graph.poses[0]) @ (first.odom.inverse() @ scans[number].odom)
        else:
            poses[number] = _pose2(mapper.pose_of(place))
    edges, _ = mapper.graph.as_edges()
    count = len(mapper.graph)
    graph = GraphFile(np.arange(count), mapper.graph.poses.copy(), edges, np.zeros(1, np.int64))
    return BuiltMap(
        grid, [scan.stamp for scan in scans], poses, graph, count, closures, unmatched, unusable, jumps, occupancy.left_out
    )


def _pose2(pose: Array) -> Pose2:
    return Pose2(float(pose[0]), float(pose[1]), float(pose[2]))
