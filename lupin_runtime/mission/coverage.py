"""Which surfaces of the map the body camera has looked at, and where to stand to look at the others.

A lidar has seen a room long before the camera has seen every side of every box in it, and tags hang on those sides. So a
search for all tags ends only when neither frontiers nor unseen surfaces are left.
"""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.gridmap import UNKNOWN, GridMap
from lupin_runtime.mission.approach import Clearance
from lupin_runtime.mission.tour import covering, short_order
from lupin_runtime.native import load_kernels

Floats = NDArray[np.float64]

MAX_SAMPLES = 4000  # bounds what a new map costs: 4000 poses against 3000 surfaces take about 30 ms
MAX_STOPS = 40  # of a tour; more are planned when these are done
_STILL_M, _STILL_RAD = 0.03, math.radians(3.0)


@dataclass(frozen=True)
class CameraModel:
    """What the body camera can make out: metres and radians, the camera `x_m` ahead of the base, looking along +x.

    A tag of `tag_edge_m` is read where it is at least `min_tag_px` wide as it appears, foreshortening included
    (36h11 is found without a miss at 20 px); the field of view is narrowed by a margin, so that a tag on its edge counts
    only when all of it was in the picture.
    """

    x_m: float = 0.147
    min_range_m: float = 0.30
    max_range_m: float = 1.8
    half_fov_rad: float = math.radians(27.0)
    max_incidence_rad: float = math.radians(66.0)
    focal_px: float = 554.25
    tag_edge_m: float = 0.1
    min_tag_px: float = 23.0


class _View(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_double) for name in ("resolution", "origin_x", "origin_y")),
        *((name, ctypes.c_double) for name in ("camera_x", "min_range", "max_range")),
        *((name, ctypes.c_double) for name in ("cos_half_fov", "cos_incidence", "min_facing")),
        *((name, ctypes.c_int32) for name in ("height", "width", "occupied_thresh")),
    ]


@cache
def _kernels() -> ctypes.CDLL:
    library = load_kernels(Path(__file__).parent)
    grid = np.ctypeslib.ndpointer(np.int8, 2, flags="C_CONTIGUOUS")
    rows = np.ctypeslib.ndpointer(np.float64, 2, flags="C_CONTIGUOUS")
    vector = np.ctypeslib.ndpointer(np.float64, 1, flags="C_CONTIGUOUS")
    view, count = ctypes.POINTER(_View), ctypes.c_int64
    library.add_view_time.argtypes = [grid, view, rows, count, rows, count, vector]
    library.add_view_time.restype = None
    library.view_gain.argtypes = [grid, view, rows, vector, count, rows, count, vector]
    library.view_gain.restype = None
    library.view_matrix.argtypes = [
        grid,
        view,
        rows,
        count,
        rows,
        count,
        np.ctypeslib.ndpointer(np.uint8, 2, flags="C_CONTIGUOUS"),
    ]
    library.view_matrix.restype = None
    library.travel_distance.argtypes = [
        np.ctypeslib.ndpointer(np.uint8, 2, flags="C_CONTIGUOUS"),
        *[ctypes.c_int32] * 4,
        np.ctypeslib.ndpointer(np.float32, 2, flags="C_CONTIGUOUS"),
    ]
    library.travel_distance.restype = ctypes.c_int32
    return library


def travel_distances(clearance: Clearance, robot: Pose2, room_m: float) -> NDArray[np.float32] | None:
    """Metres by road from the robot to every cell (height, width) with `room_m` around it, infinite where none leads.

    None where the robot is not within 0.5 m of such a cell.
    """
    grid = clearance.grid
    passable = np.ascontiguousarray(clearance.free & (clearance.distance_m >= room_m), np.uint8)
    row, column = grid.cell_of(robot.x, robot.y)
    reach = math.ceil(0.5 / grid.resolution_m)
    r0, c0 = max(0, row - reach), max(0, column - reach)
    near_rows, near_columns = np.nonzero(passable[r0 : max(0, row + reach + 1), c0 : max(0, column + reach + 1)])
    if near_rows.size == 0:
        return None
    nearest = np.argmin((near_rows + r0 - row) ** 2 + (near_columns + c0 - column) ** 2)
    distance = np.empty(passable.shape, np.float32)
    start = (int(near_rows[nearest]) + r0, int(near_columns[nearest]) + c0)
    if _kernels().travel_distance(passable, grid.height, grid.width, *start, distance) != 0:
        raise MemoryError("no memory for the distances of the map")
    return distance * np.float32(grid.resolution_m)


@dataclass(frozen=True)
class Surfaces:
    """The sides of what is not free, where free space begins.

    `rows` is float64 (n, 4): x, y of the free cell in front, unit outward normal. `wall` (n,) marks those of the room's
    outer walls, `unknown` (n,) those of which only is known that no beam has shown what they are.
    """

    rows: NDArray[np.float64]
    wall: NDArray[np.bool_]
    unknown: NDArray[np.bool_]


def find_surfaces(grid: GridMap, free_thresh: int = 20, occupied_thresh: int = 65) -> Surfaces:
    """Every side of a cell that is not free towards one that is, with normals fitted over 0.15 m.

    Unknown cells count, since a lidar passes a box's end at a flat angle without touching it; specks of one or two cells
    of a kind do not.
    """
    occupied = grid.cells >= occupied_thresh
    free = (grid.cells >= 0) & (grid.cells <= free_thresh)
    labels, stats = _components(occupied)
    unknown_labels, unknown_stats = _components(grid.cells == UNKNOWN)
    seen = (stats[:, cv2.CC_STAT_AREA] >= 3)[labels] & occupied
    hidden = (unknown_stats[:, cv2.CC_STAT_AREA] >= 3)[unknown_labels] & (grid.cells == UNKNOWN)
    steps = ((0, 1), (0, -1), (1, 0), (-1, 0))  # (row, column): east, west, north, south
    faces = [(seen | hidden) & _shifted(free, row, column) for row, column in steps]
    reach = max(1, round(0.15 / grid.resolution_m))
    rows, unknown = [], []
    for index, (step_row, step_column) in enumerate(steps):
        r, c = np.nonzero(faces[index])
        near = [_around(face, r, c, reach) for face in faces]
        # Single steps of a side that faces elsewhere fix no line: there the neighbours' directions are averaged.
        count = near[index].sum(axis=1)
        first, second = (2, 3) if index < 2 else (0, 1)
        mixed = (near[first].sum(axis=1) - near[second].sum(axis=1)) / count
        slope = _slope(near[index], reach, across_columns=index < 2)
        tilt = np.where(count >= 3.0, slope * -(step_row + step_column), mixed)
        nx, ny = (np.full(len(r), float(step_column)), tilt) if index < 2 else (tilt, np.full(len(r), float(step_row)))
        length = np.hypot(nx, ny)
        x = grid.origin_x + (c + step_column + 0.5) * grid.resolution_m
        y = grid.origin_y + (r + step_row + 0.5) * grid.resolution_m
        rows.append(np.stack((x, y, nx / length, ny / length), axis=1))
        unknown.append(hidden[r, c])
    table = np.ascontiguousarray(np.concatenate(rows), np.float64)
    return Surfaces(table, _outer_walls(grid, table, labels, stats), np.concatenate(unknown))


def _components(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Labels (height, width) of 8-connected components, 0 for none, and OpenCV's statistics of each."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return np.asarray(labels, np.int32), np.asarray(stats, np.int32)


def _around(mask: NDArray[np.bool_], r: NDArray[np.intp], c: NDArray[np.intp], reach: int) -> NDArray[np.float64]:
    """The mask in the square around each of n cells: (n, (2 reach + 1)^2), row-major, 0 outside the grid."""
    padded = np.pad(mask, reach)
    dr, dc = (d.ravel() for d in np.mgrid[0 : 2 * reach + 1, 0 : 2 * reach + 1])
    found: NDArray[np.float64] = padded[r[:, None] + dr, c[:, None] + dc].astype(np.float64)
    return found


def _slope(near: NDArray[np.float64], reach: int, across_columns: bool) -> NDArray[np.float64]:
    """Slope of the line through the cells that `_around` found: columns per row, or rows per column.

    Only cells that face the same way are fitted, so that neither a corner nor the back of a thin wall bends a normal.
    """
    t, u = (d.ravel() for d in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    if not across_columns:
        t, u = u, t
    n, st, su, stt, stu = (near @ m for m in (np.ones(len(t)), t, u, t * t, t * u))
    spread = stt - st * st / n
    return np.where(spread > 0.5, (stu - st * su / n) / np.maximum(spread, 0.5), 0.0)


def _shifted(mask: NDArray[np.bool_], row: int, column: int) -> NDArray[np.bool_]:
    """`mask` of the neighbour: result[r, c] = mask[r + row, c + column], False outside."""
    result = np.zeros_like(mask)
    height, width = mask.shape
    result[max(0, -row) : height - max(0, row), max(0, -column) : width - max(0, column)] = mask[
        max(0, row) : height - max(0, -row), max(0, column) : width - max(0, -column)
    ]
    return result


WALL_BAND_M = 0.2  # outer walls of a SLAM map are this straight; no box is this shallow


def _outer_walls(
    grid: GridMap, rows: NDArray[np.float64], labels: NDArray[np.int32], stats: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """Which surfaces are a room's outer walls: those along the rim of all that is occupied, facing inwards.

    Boxes that stand against a wall stick out of the rim, and their sides face along it. Where nothing encloses the place,
    only what is long and lies along the rim as a whole is a wall: boxes in the open are none.
    """
    walls = np.zeros(len(rows), bool)
    occupied_rows, occupied_columns = np.nonzero(labels)
    if occupied_rows.size < 3 or not len(rows):
        return walls
    points = np.stack((occupied_columns, occupied_rows), axis=1).astype(np.float32)
    (cx, cy), (width, height), angle = cv2.minAreaRect(points)
    if min(width, height) * grid.resolution_m < 1.0:
        return walls
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))

    def inside(columns: Floats, rows_: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Metres inside the two nearer edges of the rim, and which way, +1 or -1, is inwards along either axis."""
        u, v = c * (columns - cx) + s * (rows_ - cy), -s * (columns - cx) + c * (rows_ - cy)
        du, dv = (width / 2 - np.abs(u)) * grid.resolution_m, (height / 2 - np.abs(v)) * grid.resolution_m
        return du, dv, -np.sign(u), -np.sign(v)

    spans = stats[:, cv2.CC_STAT_WIDTH].astype(float) * stats[:, cv2.CC_STAT_HEIGHT]
    spans[0] = 0.0
    columns, rows_ = (rows[:, 0] - grid.origin_x) / grid.resolution_m, (rows[:, 1] - grid.origin_y) / grid.resolution_m
    du, dv, towards_u, towards_v = inside(columns - 0.5, rows_ - 0.5)
    facing_u = towards_u * (c * rows[:, 2] + s * rows[:, 3])
    facing_v = towards_v * (-s * rows[:, 2] + c * rows[:, 3])
    along: NDArray[np.bool_] = ((du <= WALL_BAND_M) & (facing_u >= 0.7)) | ((dv <= WALL_BAND_M) & (facing_v >= 0.7))
    if spans.max() >= 0.5 * (np.ptp(occupied_rows) + 1.0) * (np.ptp(occupied_columns) + 1.0):
        return along
    deepest = np.zeros(len(stats))
    du, dv, _, _ = inside(occupied_columns.astype(float), occupied_rows.astype(float))
    np.maximum.at(deepest, labels[occupied_rows, occupied_columns], np.minimum(du, dv))
    longest = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) * grid.resolution_m
    is_wall = (deepest <= WALL_BAND_M) & (longest >= 2.5)
    # The cell behind a surface is the one its normal points away from.
    behind_rows = np.clip(np.floor(rows_ - np.sign(np.round(rows[:, 3]))).astype(int), 0, grid.height - 1)
    behind_columns = np.clip(np.floor(columns - np.sign(np.round(rows[:, 2]))).astype(int), 0, grid.width - 1)
    behind = labels[behind_rows, behind_columns]
    result: NDArray[np.bool_] = along & is_wall[behind] & (behind > 0)
    return result


@dataclass(frozen=True)
class Viewpoint:
    """Where to stand and look: `gain_m` metres of unseen surface come into view, `travel_m` metres of road away."""

    pose: Pose2
    gain_m: float
    travel_m: float


class Coverage:
    """Remembers from where the camera looked, and works out on the newest map what it has seen from there.

    Poses are kept, not seen cells: SLAM maps grow, shift and close loops, and what was seen is computed anew on each.
    """

    def __init__(
        self,
        camera: CameraModel | None = None,
        min_view_s: float = 0.5,
        wall_weight: float = 0.0,
        min_gain_m: float = 0.15,
        max_tries: int = 2,
        occupied_thresh: int = 65,
        free_thresh: int = 20,
    ) -> None:
        self._camera = camera or CameraModel()
        self._min_view_s = min_view_s
        self._wall_weight = wall_weight
        self._min_gain_m = min_gain_m
        self._max_tries = max_tries
        self._occupied_thresh, self._free_thresh = occupied_thresh, free_thresh
        self._samples: list[tuple[float, float, float, float]] = []
        self._counted = 0
        self._tries: dict[tuple[int, int, int], int] = {}
        self._grid: GridMap | None = None
        self._surfaces = Surfaces(np.empty((0, 4)), np.empty(0, bool), np.empty(0, bool))
        self._seen_s = np.empty(0)

    def note_pose(self, pose: Pose2, elapsed_s: float) -> None:
        """The camera looked from here for `elapsed_s`."""
        if not all(map(math.isfinite, (pose.x, pose.y, pose.yaw))) or elapsed_s <= 0.0:
            return
        if self._samples:
            x, y, yaw, weight = self._samples[-1]
            if math.hypot(pose.x - x, pose.y - y) < _STILL_M and abs(wrap_angle(pose.yaw - yaw)) < _STILL_RAD:
                if weight >= 2.0 * self._min_view_s:
                    return  # standing on adds nothing
                if self._counted < len(self._samples):
                    self._samples[-1] = (x, y, yaw, weight + elapsed_s)
                    return
        self._samples.append((pose.x, pose.y, pose.yaw, elapsed_s))
        if len(self._samples) > MAX_SAMPLES:
            self._thin()

    def _thin(self) -> None:
        """Merge neighbouring samples of the older half; what they have shown on this map is already counted."""
        half = len(self._samples) // 2
        old = self._samples[:half]
        merged = [(*a[:3], a[3] + b[3]) for a, b in zip(old[::2], old[1::2])]
        self._counted = max(0, self._counted - (half - len(merged)))
        self._samples = merged + self._samples[2 * len(merged) :]

    def update(self, grid: GridMap) -> None:
        """Bring what is known to be seen up to date on this map."""
        if grid is not self._grid:
            self._grid = grid
            self._surfaces = find_surfaces(grid, self._free_thresh, self._occupied_thresh)
            self._seen_s = np.zeros(len(self._surfaces.rows))
            self._counted = 0
        fresh = self._samples[self._counted :]
        self._counted = len(self._samples)
        if fresh and len(self._surfaces.rows):
            poses = np.array(fresh, np.float64)
            _kernels().add_view_time(
                *self._view(grid), self._surfaces.rows, len(self._surfaces.rows), poses, len(poses), self._seen_s
            )

    def seen_fraction(self) -> float:
        """The part of the surfaces that count which the camera has seen, 1 where there are none."""
        counts = self._weights_of_all() > 0.0
        return float(np.mean(self._seen_s[counts] >= self._min_view_s)) if counts.any() else 1.0

    def _weights_of_all(self) -> NDArray[np.float64]:
        return np.where(self._surfaces.wall, self._wall_weight, 1.0)

    def _wanted(self, unknown: bool = True) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Rows and weights of the surfaces still to be seen, with or without those that no beam has touched."""
        weights = self._weights_of_all()
        if not unknown:
            weights[self._surfaces.unknown] = 0.0
        weights[self._seen_s >= self._min_view_s] = 0.0
        if self._tries:
            for index in np.flatnonzero(weights):
                if self._tries.get(_key(self._surfaces.rows[index]), 0) >= self._max_tries:
                    weights[index] = 0.0
        wanted = weights > 0.0
        return np.ascontiguousarray(self._surfaces.rows[wanted]), np.ascontiguousarray(weights[wanted])

    def worth_going(self, pose: Pose2) -> bool:
        """Whether enough unseen surface comes into view at a pose, on the map of the last update."""
        rows, weights = self._wanted()
        gains = self._gains(rows, weights, np.array([[pose.x, pose.y, pose.yaw, 1.0]]))
        return float(gains[0]) >= self._min_gain_m

    def give_up_slowly(self, pose: Pose2) -> None:
        """A visit to this pose is over: what it should have shown and didn't gets fewer tries."""
        rows, _ = self._wanted()
        if self._grid is None or not len(rows):
            return
        seen = np.zeros(len(rows))
        _kernels().add_view_time(*self._view(self._grid), rows, len(rows), np.array([[pose.x, pose.y, pose.yaw, 1.0]]), 1, seen)
        for key in {_key(row) for row in rows[seen > 0.0]}:
            self._tries[key] = self._tries.get(key, 0) + 1

    def viewpoints(
        self, clearance: Clearance, travel_m: NDArray[np.float32], robot: Pose2, room_m: float, unknown: bool = True
    ) -> list[Viewpoint]:
        """Poses worth going to, best first: free, with `room_m` around them, on a road from the robot, facing something
        unseen from 0.6 to 1.4 m. The score is gain / (1 + travel), a turn of the robot counted as travel too. `unknown`
        False leaves out what may be free space still to be explored."""
        rows, weights = self._wanted(unknown)
        poses, road = self._stands(rows, clearance, travel_m, room_m)
        if not len(poses):
            return []
        gains = self._gains(rows, weights, poses)
        turns = np.abs((poses[:, 2] - robot.yaw + math.pi) % (2.0 * math.pi) - math.pi)
        scores = gains / (1.0 + road + 0.3 * turns)
        worth = np.flatnonzero(gains >= self._min_gain_m)
        order = worth[np.argsort(-scores[worth], kind="stable")]
        return [_viewpoint(poses[i], gains[i], road[i]) for i in order[:20]]

    def tour(
        self,
        clearance: Clearance,
        travel_m: NDArray[np.float32],
        room_m: float,
        travel_room_m: float,
    ) -> list[Viewpoint]:
        """Viewpoints that together show all that is still to be seen, in the order of a short way past them."""
        rows, weights = self._wanted()
        poses, road = self._stands(rows, clearance, travel_m, room_m)
        if not len(poses) or self._grid is None:
            return []
        visible = np.zeros((len(poses), len(rows)), np.uint8)
        _kernels().view_matrix(*self._view(self._grid), rows, len(rows), poses, len(poses), visible)
        sees = visible.astype(bool)
        chosen = covering(sees, weights, self._min_gain_m / self._grid.resolution_m, MAX_STOPS)
        roads = [travel_distances(clearance, Pose2(*poses[i, :3]), travel_room_m) for i in chosen]
        cells = [clearance.grid.cell_of(poses[i, 0], poses[i, 1]) for i in chosen]
        between = np.array([[field[cell] if field is not None else math.inf for cell in cells] for field in roads])
        gains = sees @ weights * self._grid.resolution_m
        return [_viewpoint(poses[chosen[k]], gains[chosen[k]], road[chosen[k]]) for k in short_order(road[chosen], between)]

    def _stands(
        self, rows: Floats, clearance: Clearance, travel_m: NDArray[np.float32], room_m: float
    ) -> tuple[Floats, Floats]:
        """Poses (n, 4) in front of surfaces where the robot may stand, and metres of road to each."""
        if not len(rows):
            return np.empty((0, 4)), np.empty(0)
        poses = _candidates(rows[:: max(1, len(rows) // 150)])
        grid = clearance.grid
        r = np.floor((poses[:, 1] - grid.origin_y) / grid.resolution_m).astype(int)
        c = np.floor((poses[:, 0] - grid.origin_x) / grid.resolution_m).astype(int)
        inside = (r >= 0) & (r < grid.height) & (c >= 0) & (c < grid.width)
        poses, r, c = poses[inside], r[inside], c[inside]
        good = clearance.free[r, c] & (clearance.distance_m[r, c] >= room_m) & np.isfinite(travel_m[r, c])
        return np.ascontiguousarray(poses[good]), travel_m[r[good], c[good]].astype(np.float64)

    def _gains(
        self, rows: NDArray[np.float64], weights: NDArray[np.float64], poses: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        gains = np.zeros(len(poses))
        if self._grid is not None and len(rows) and len(poses):
            _kernels().view_gain(*self._view(self._grid), rows, weights, len(rows), poses, len(poses), gains)
            gains *= self._grid.resolution_m
        return gains

    def _view(self, grid: GridMap) -> tuple[NDArray[np.int8], _View]:
        camera = self._camera
        view = _View(
            grid.resolution_m,
            grid.origin_x,
            grid.origin_y,
            camera.x_m,
            camera.min_range_m,
            camera.max_range_m,
            math.cos(camera.half_fov_rad),
            math.cos(camera.max_incidence_rad),
            camera.min_tag_px / (camera.focal_px * camera.tag_edge_m),
            grid.height,
            grid.width,
            self._occupied_thresh,
        )
        return np.ascontiguousarray(grid.cells), view


def _viewpoint(pose: Floats, gain_m: float, travel_m: float) -> Viewpoint:
    return Viewpoint(Pose2(float(pose[0]), float(pose[1]), float(pose[2])), float(gain_m), float(travel_m))


def _candidates(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 4) of the base in front of surfaces (m, 4), facing them."""
    options = []
    for distance in (1.0, 0.8, 1.2, 1.4, 0.6):
        for turn in (0.0, math.radians(30.0), math.radians(-30.0)):
            c, s = math.cos(turn), math.sin(turn)
            nx, ny = c * rows[:, 2] - s * rows[:, 3], s * rows[:, 2] + c * rows[:, 3]
            x, y = rows[:, 0] + distance * nx, rows[:, 1] + distance * ny
            options.append(np.stack((x, y, np.arctan2(-ny, -nx), np.ones(len(rows))), axis=1))
    return np.concatenate(options)


def _key(row: NDArray[np.float64]) -> tuple[int, int, int]:
    """A surface's name that survives a map that grows or shifts a little: its place on 0.2 m, its side."""
    side = round(math.atan2(row[3], row[2]) / (math.pi / 2)) % 4
    return round(row[0] / 0.2), round(row[1] / 0.2), side
