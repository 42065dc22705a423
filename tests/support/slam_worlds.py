"""Logs with known truth, from flat worlds of line segments with a ray-cast lidar and drifting odometry.

Shared by the benchmarks and by `tests/lupin_runtime/slam`. There is no physics: poses follow waypoints at constant speeds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import GridMap

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Log:
    """A drive: stamps (N,) s, true and odometry poses (N, 3), ranges (N, B) m, beam angles (B,) rad."""

    stamps: Array
    truth: Array
    odom: Array
    ranges: Array
    angles: Array


class World:
    """Walls as segments (S, 4): x0, y0, x1, y1."""

    def __init__(self, segments: Array) -> None:
        self.segments = np.asarray(segments, dtype=float)

    def cast(self, pose: Array, angles: Array, range_max: float) -> Array:
        """Return the distance (B,) along each beam from `pose` (x, y, yaw), infinite beyond `range_max`."""
        dx, dy = np.cos(angles + pose[2])[:, None], np.sin(angles + pose[2])[:, None]
        near = self.segments
        ax, ay = near[:, 0] - pose[0], near[:, 1] - pose[1]
        ex, ey = near[:, 2] - near[:, 0], near[:, 3] - near[:, 1]
        across = dx * ey - dy * ex
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (ax * ey - ay * ex) / across
            share = (ax * dy - ay * dx) / across
        hit = (along > 0.0) & (share >= 0.0) & (share <= 1.0)
        ranges = np.where(hit, along, np.inf).min(axis=1)
        return np.where(ranges <= range_max, ranges, np.inf)


def box(x: float, y: float, width: float, depth: float, yaw: float = 0.0) -> Array:
    """Return the four sides of a rectangle, given by its center."""
    c, s = math.cos(yaw), math.sin(yaw)
    corners = [
        (c * u - s * v + x, s * u + c * v + y)
        for u, v in ((-width / 2, -depth / 2), (width / 2, -depth / 2), (width / 2, depth / 2), (-width / 2, depth / 2))
    ]
    return np.array([(*corners[k], *corners[(k + 1) % 4]) for k in range(4)])


def greenhouse() -> World:
    """Return a room of 9 x 7 m with tables along the walls, an island in the middle, and aisles of at least a meter."""
    parts = [box(4.5, 3.5, 9.0, 7.0)]
    parts += [box(x, y, 1.1, 0.25) for x in (2.0, 4.5, 7.0) for y in (1.4, 5.6)]
    parts += [box(x, y, 0.25, 1.1) for x in (2.6, 6.4) for y in (3.0, 4.2)]
    parts += [box(4.5, 3.5, 1.1, 0.25, 0.3)]
    return World(np.concatenate(parts))


def rasterized(world: World, cell_m: float = 0.05) -> GridMap:
    """Return a world's walls as cells of a saved map, with half a meter of free space around them."""
    ends = world.segments.reshape(-1, 2)
    low = ends.min(axis=0) - 0.5
    width, height = np.ceil((ends.max(axis=0) + 0.5 - low) / cell_m).astype(int)
    cells = np.zeros((height, width), np.int8)
    for x0, y0, x1, y1 in world.segments:
        steps = int(math.hypot(x1 - x0, y1 - y0) / 0.01) + 2
        x, y = np.linspace(x0, x1, steps), np.linspace(y0, y1, steps)
        cells[((y - low[1]) / cell_m).astype(int), ((x - low[0]) / cell_m).astype(int)] = 100
    return GridMap(cells, cell_m, float(low[0]), float(low[1]))


GREENHOUSE_TOUR = [
    (1.0, 0.7),
    (8.0, 0.7),
    (8.2, 3.5),
    (8.0, 6.3),
    (1.0, 6.3),
    (0.9, 3.5),
    (1.6, 2.2),
    (3.5, 2.2),
    (5.5, 2.2),
    (7.6, 2.3),
    (7.5, 4.8),
    (4.5, 4.9),
    (1.5, 4.8),
    (1.2, 2.0),
    (1.0, 0.7),
]


def office(seed: int = 0, size: float = 1.0) -> tuple[World, list[tuple[float, float]]]:
    """Return a floor of 44 x 32 m times `size`, and a tour: a corridor around a core, with furnished rooms on both sides.

    The tour follows the corridor twice, once in each direction, and enters most rooms.
    """
    rng = np.random.default_rng(seed)
    segments: list[Array] = []

    def wall(x0: float, y0: float, x1: float, y1: float) -> None:
        segments.append(np.array([[x0, y0, x1, y1]]))

    width, height, room, corridor = 44.0 * size, 32.0 * size, 6.0, 2.0
    for outer in ((0, 0, width, 0), (width, 0, width, height), (width, height, 0, height), (0, height, 0, 0)):
        wall(*outer)
    doors: list[tuple[float, float, float, float]] = []  # corridor point, room point

    def add_rooms(start: float, end: float, at: float, horizontal: bool, outwards: float, depth: float) -> None:
        """Add a row of rooms along one corridor wall."""
        edges = [start]
        while edges[-1] < end - 5.5:
            edges.append(edges[-1] + rng.uniform(3.0, 5.5))
        edges[-1] = end
        for a, b in pairwise(edges):
            door = rng.uniform(a + 0.8, b - 0.8)
            for lo, hi in ((a, door - 0.5), (door + 0.5, b)):
                if horizontal:
                    wall(lo, at, hi, at)
                else:
                    wall(at, lo, at, hi)
            far = at + outwards * depth
            if horizontal:
                wall(b, at, b, far)
                doors.append((door, at - outwards * 1.0, door, at + outwards * rng.uniform(1.5, 3.0)))
            else:
                wall(at, b, far, b)
                doors.append((at - outwards * 1.0, door, at + outwards * rng.uniform(1.5, 3.0), door))
            for _ in range(rng.integers(1, 5)):
                u, v = rng.uniform(a + 0.5, b - 0.5), at + outwards * rng.uniform(1.0, depth - 0.6)
                if abs(u - door) > 0.9 or abs(v - at) > 3.6:
                    x, y = (u, v) if horizontal else (v, u)
                    segments.append(
                        box(x, y, rng.uniform(0.3, 1.2), rng.uniform(0.3, 0.9), rng.choice([0.0, rng.uniform(0, 3)]))
                    )

    inner = room + corridor
    add_rooms(room, width - room, room, True, -1.0, room)
    add_rooms(room, height - room, width - room, False, 1.0, room)
    add_rooms(room, width - room, height - room, True, 1.0, room)
    add_rooms(room, height - room, room, False, -1.0, room)
    add_rooms(inner, width - inner, inner, True, 1.0, room)
    add_rooms(inner, width - inner, height - inner, True, -1.0, room)
    wall(inner, inner, inner, height - inner)
    wall(width - inner, inner, width - inner, height - inner)
    wall(inner, height / 2, width - inner, height / 2)

    m = room + corridor / 2
    ring = [(m, m), (width - m, m), (width - m, height - m), (m, height - m)]
    perimeter = [2 * (width - 2 * m), 2 * (height - 2 * m)]

    def along(x: float, y: float) -> float:
        """Return the distance along the ring from its first corner, counter-clockwise, to the point nearest to (x, y)."""
        w, h = perimeter[0] / 2, perimeter[1] / 2
        sides = {
            y - m: x - m,
            width - m - x: w + y - m,
            height - m - y: w + h + width - m - x,
            x - m: 2 * w + h + height - m - y,
        }
        key = min(sides, key=abs)
        return sides[key] % (2 * (w + h))

    total = sum(perimeter)
    stops = sorted([(along(d[0], d[1]), d) for d in doors], key=lambda item: item[0])
    corners = sorted((along(*corner), (*corner, *corner)) for corner in ring[1:])
    tour: list[tuple[float, float]] = [ring[0]]
    for lap in range(2):
        events = sorted([*stops, *corners], key=lambda item: item[0], reverse=lap == 1)
        for _, (cx, cy, rx, ry) in events:
            tour.append((cx, cy))
            if (rx, ry) != (cx, cy) and rng.random() < (0.55 if lap == 0 else 0.25):
                tour += [(rx, ry), (cx, cy)]
        tour.append(ring[0])
    del total
    return World(np.concatenate(segments)), tour


def corridor(
    length: float = 40.0, depth: float = 25.0, width: float = 2.2, pitch: float = 5.0
) -> tuple[World, list[tuple[float, float]]]:
    """Return a corridor around a block, with an identical door niche every `pitch` meters, and a tour of two laps."""
    segments: list[tuple[float, float, float, float]] = []

    def wall(frm: tuple[float, float], to: tuple[float, float], outwards: float) -> None:
        a, b = np.array(frm), np.array(to)
        total = float(np.hypot(*(b - a)))
        along = (b - a) / total
        niche = np.array([-along[1], along[0]]) * outwards * 0.15
        at = 0.0
        for door in np.arange(pitch / 2, total - 1.5, pitch):
            near, far = a + along * (door - 0.45), a + along * (door + 0.45)
            corners = [a + along * at, near, near + niche, far + niche, far]
            segments.extend((*p, *q) for p, q in pairwise(corners))
            at = door + 0.45
        segments.append((*(a + along * at), *b))

    for inset, outwards in ((0.0, -1.0), (width, 1.0)):
        ends = [(inset, inset), (length - inset, inset), (length - inset, depth - inset), (inset, depth - inset)]
        for frm, to in zip(ends, [*ends[1:], ends[0]]):
            wall(frm, to, outwards)
    m = width / 2
    lap = [(length - m, m), (length - m, depth - m), (m, depth - m), (m, m)]
    return World(np.array(segments)), [(m, m), *lap, *lap]


def follow(points: list[tuple[float, float]], speed: float, turn_rate: float, step_s: float, hold_yaw: bool = False) -> Array:
    """Return poses (N, 3) every `step_s` along waypoints: turn on the spot, then straight on; with `hold_yaw`, never turn."""
    poses = [
        (points[0][0], points[0][1], 0.0 if hold_yaw else math.atan2(points[1][1] - points[0][1], points[1][0] - points[0][0]))
    ]
    for x1, y1 in points[1:]:
        x, y, yaw = poses[-1]
        distance = math.hypot(x1 - x, y1 - y)
        if distance < 1e-9:
            continue
        if not hold_yaw:
            change = (math.atan2(y1 - y, x1 - x) - yaw + math.pi) % (2 * math.pi) - math.pi
            turns = math.ceil(abs(change) / (turn_rate * step_s))
            poses += [(x, y, yaw + change * k / turns) for k in range(1, turns + 1)]
            yaw += change
        steps = math.ceil(distance / (speed * step_s))
        poses += [(x + (x1 - x) * k / steps, y + (y1 - y) * k / steps, yaw) for k in range(1, steps + 1)]
    return np.array(poses)


@dataclass(frozen=True)
class Drift:
    """Odometry errors: scale errors of travel and turning, turning per meter, and noise as shares of travel and turning."""

    travel_scale: float = 0.01
    turn_scale: float = 0.01
    turn_per_m: float = 0.004
    travel_noise: float = 0.05
    turn_noise: float = 0.03


def drifting(truth: Array, drift: Drift, rng: np.random.Generator) -> Array:
    """Return the odometry (N, 3) of a true path (N, 3): it starts at the origin and integrates steps with errors."""
    odom = np.zeros_like(truth)
    for k in range(1, len(truth)):
        c, s = math.cos(truth[k - 1, 2]), math.sin(truth[k - 1, 2])
        dx, dy = truth[k, :2] - truth[k - 1, :2]
        u, v = c * dx + s * dy, -s * dx + c * dy
        turn = (truth[k, 2] - truth[k - 1, 2] + math.pi) % (2 * math.pi) - math.pi
        travel = math.hypot(u, v)
        u, v = np.array([u, v]) * (1 + drift.travel_scale) + rng.normal(size=2) * drift.travel_noise * travel
        turn = (
            turn * (1 + drift.turn_scale)
            + drift.turn_per_m * travel
            + rng.normal() * (drift.turn_noise * abs(turn) + 0.005 * travel)
        )
        x, y, yaw = odom[k - 1]
        odom[k] = x + math.cos(yaw) * u - math.sin(yaw) * v, y + math.sin(yaw) * u + math.cos(yaw) * v, yaw + turn
    return odom


@dataclass(frozen=True)
class Disturbances:
    """Disturbances other than drift."""

    people: int = 0  # around the robot in every scan
    wrong_readings: float = 0.0  # share
    missing_readings: float = 0.0  # share without a return, as from glass or black surfaces
    slip: float = 0.0  # chance of a wheel slip per step; the next two are its standard deviations
    slip_m: float = 0.3
    slip_rad: float = 0.15


def record(
    world: World,
    truth: Array,
    step_s: float,
    angles: Array,
    range_max: float,
    drift: Drift,
    seed: int,
    noise_m: float = 0.005,
    noise_share: float = 0.003,
    keep_every: int = 1,
    disturbances: Disturbances = Disturbances(),
) -> Log:
    """Drive along `truth` through `world`; return a log of every `keep_every`-th scan. Odometry is integrated at every step."""
    rng = np.random.default_rng(seed)
    odom = drifting(truth, drift, rng)
    for k in np.flatnonzero(rng.random(len(odom)) < disturbances.slip):
        odom[k:] = _moved(
            odom[k:], odom[k], rng.normal(size=3) * [disturbances.slip_m, disturbances.slip_m, disturbances.slip_rad]
        )
    indices = np.arange(0, len(truth), keep_every)
    scans = []
    for k in indices:
        visible = world
        if disturbances.people:
            away, bearing = rng.uniform(0.7, 6.0, disturbances.people), rng.uniform(-math.pi, math.pi, disturbances.people)
            legs = [
                box(truth[k, 0] + d * math.cos(b), truth[k, 1] + d * math.sin(b), 0.3, 0.2, b) for d, b in zip(away, bearing)
            ]
            visible = World(np.concatenate((world.segments, *legs)))
        scans.append(visible.cast(truth[k], angles, range_max))
    ranges = np.stack(scans)
    wrong = rng.random(ranges.shape) < disturbances.wrong_readings
    ranges = np.where(wrong, rng.uniform(0.3, 20.0, ranges.shape), ranges)
    ranges[rng.random(ranges.shape) < disturbances.missing_readings] = np.inf
    ranges = ranges + rng.normal(size=ranges.shape) * (noise_m + noise_share * np.where(np.isfinite(ranges), ranges, 0.0))
    return Log(np.asarray(indices * step_s, np.float64), truth[indices], odom[indices], ranges, angles)


def _moved(poses: Array, about: Array, change: Array) -> Array:
    """Turn and shift poses (n, 3) about the frame at `about`."""
    c, s = math.cos(change[2]), math.sin(change[2])
    offset = poses[:, :2] - about[:2]
    result = poses.copy()
    result[:, :2] = offset @ np.array([[c, s], [-s, c]]) + about[:2] + change[:2]
    result[:, 2] += change[2]
    return result


def greenhouse_log(minutes: float = 4.0, seed: int = 0, beams: int = 360, drift: Drift | None = None) -> Log:
    """Return a log of the project's robot in `greenhouse()`: 360 degrees, 10 Hz, 5 mm + 0.3 % noise, about 1 % drift."""
    legs: list[tuple[float, float]] = list(GREENHOUSE_TOUR)
    truth = follow(legs, 0.3, 0.8, 0.1)
    while len(truth) * 0.1 < minutes * 60.0:
        legs = legs[::-1]
        truth = np.concatenate((truth, _turned_to(truth[-1], follow(legs, 0.3, 0.8, 0.1))))
    truth = truth[: int(minutes * 600)]
    angles = np.linspace(-math.pi, math.pi, beams, endpoint=False)
    return record(greenhouse(), truth, 0.1, angles, 12.0, drift or Drift(), seed)


def _turned_to(last: Array, path: Array) -> Array:
    change = (path[0, 2] - last[2] + math.pi) % (2 * math.pi) - math.pi
    steps = max(1, math.ceil(abs(change) / 0.08))
    turn = np.tile(last, (steps, 1))
    turn[:, 2] += change * np.arange(1, steps + 1) / steps
    path = path.copy()
    path[:, 2] = np.unwrap(np.concatenate(([turn[-1, 2]], path[:, 2])))[1:]
    return np.concatenate((turn, path))


def office_log(
    seed: int = 0,
    period_s: float = 3.0,
    drift: Drift | None = None,
    beams: int = 180,
    size: float = 1.0,
    disturbances: Disturbances = Disturbances(),
    speed: float = 0.3,
    turn_rate: float = 0.5,
    range_max: float = 81.0,
) -> Log:
    """Return a log like public ones: a 180 degree laser, a scan every few seconds, odometry errors of tens of meters."""
    world, tour = office(seed, size)
    truth = follow(tour, speed, turn_rate, 0.1)
    angles = -math.pi / 2 + np.arange(beams) * math.pi / (180 if beams == 180 else beams - 1)
    large_drift = drift or Drift(travel_scale=0.03, turn_scale=0.03, turn_per_m=0.012, travel_noise=0.1, turn_noise=0.05)
    return record(
        world,
        truth,
        0.1,
        angles,
        range_max,
        large_drift,
        seed,
        0.01,
        0.002,
        keep_every=round(period_s / 0.1),
        disturbances=disturbances,
    )


def corridor_log(
    seed: int = 0, drift: Drift | None = None, disturbances: Disturbances = Disturbances(), period_s: float = 3.0
) -> Log:
    """Return a log of two laps of `corridor()` with a 180 degree laser and a scan every few seconds."""
    world, tour = corridor()
    truth = follow(tour, 0.3, 0.5, 0.1)
    angles = -math.pi / 2 + np.arange(180) * math.pi / 180
    return record(
        world, truth, 0.1, angles, 81.0, drift or Drift(), seed, 0.01, 0.002, round(period_s / 0.1), disturbances=disturbances
    )


def carmen_text(log: Log, start: float = 976052857.337534, no_return: float = 81.83) -> str:
    """Return a log in the CARMEN format, as ODOM and FLASER lines."""
    lines = ["# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp"]
    for k, (stamp, odom) in enumerate(zip(log.stamps, log.odom)):
        readings = " ".join(f"{r:.2f}" if np.isfinite(r) else f"{no_return:.2f}" for r in log.ranges[k])
        pose = f"{odom[0]:.6f} {odom[1]:.6f} {odom[2]:.6f}"
        lines.append(f"ODOM {pose} 0.300000 0.000000 0.000000 {start + stamp:.6f} nohost {stamp:.6f}")
        lines.append(f"FLASER {len(log.angles)} {readings} {pose} {pose} {start + stamp:.6f} nohost {stamp:.6f}")
    return "\n".join(lines) + "\n"


def aligned_errors(estimate: NDArray[np.floating], truth: Array) -> tuple[Array, Array]:
    """Return position (N,) m and yaw (N,) rad errors after the best rigid alignment of the trajectories (Umeyama 1991)."""
    a, b = estimate[:, :2], truth[:, :2]
    ma, mb = a.mean(axis=0), b.mean(axis=0)
    cross = (a - ma).T @ (b - mb)
    yaw = math.atan2(cross[0, 1] - cross[1, 0], cross[0, 0] + cross[1, 1])
    c, s = math.cos(yaw), math.sin(yaw)
    moved = (a - ma) @ np.array([[c, s], [-s, c]]) + mb
    turn = (estimate[:, 2] + yaw - truth[:, 2] + math.pi) % (2 * math.pi) - math.pi
    return np.hypot(*(moved - b).T), turn
