"""Where to park in front of a tag: its position is not enough, since the camera must face it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import wrap_angle
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.layout import Layout, Override, Table

MIN_STANDOFF_M, MAX_STANDOFF_M = 0.2, 1.5  # a 100 mm tag is no longer detected reliably beyond 1.5 m
GUARD_STEP_M = 0.1


@dataclass(frozen=True)
class Approach:
    """A goal in front of a tag: metres and radians in the map frame; `derived_from` tells how it came about."""

    tag_id: str
    goal_x: float
    goal_y: float
    goal_yaw: float
    standoff_m: float
    derived_from: str
    table_id: str | None = None


@dataclass(frozen=True)
class TagPose:
    """A discovered tag: its position, and its orientation as a quaternion whose +Z points out of the marker."""

    x: float
    y: float
    z: float = 0.0
    qx: float = 0.0
    qy: float = 0.0
    qz: float = 0.0
    qw: float = 1.0

    def normal_xy(self) -> tuple[float, float] | None:
        """Unit vector of the tag's +Z in the plane; None where it points straight up or down."""
        nx = 2.0 * (self.qx * self.qz + self.qw * self.qy)
        ny = 2.0 * (self.qy * self.qz - self.qw * self.qx)
        length = math.hypot(nx, ny)
        return (nx / length, ny / length) if length >= 1e-6 else None


def clamp_standoff(standoff_m: float) -> float:
    """Within [0.2, 1.5] m; the least where it is not a number."""
    return min(MAX_STANDOFF_M, max(MIN_STANDOFF_M, standoff_m)) if math.isfinite(standoff_m) else MIN_STANDOFF_M


def compute_approach(
    tag_id: str, layout: Layout, standoff_m: float, fallback_yaw: float, override: Override | None = None
) -> Approach:
    """The approach to a tag of the layout, along the line from its table's centre through the tag.

    Raises KeyError for a tag that the layout does not have.
    """
    tag = layout.tags[tag_id]
    override = override or Override()
    pinned = _pinned(tag_id, override, standoff_m)
    if pinned is not None:
        return pinned
    wanted = clamp_standoff(standoff_m if override.standoff is None else override.standoff)
    geometric = _from_table(tag_id, (tag.x, tag.y), layout, wanted) or Approach(
        tag_id, tag.x, tag.y, fallback_yaw, 0.0, "fallback"
    )
    return _overridden(geometric, override)


def compute_discovered_approach(
    tag_id: str,
    tag: TagPose,
    robot_xy: tuple[float, float] | None,
    standoff_m: float,
    fallback_yaw: float,
    override: Override | None = None,
) -> Approach:
    """The approach to a tag that was seen: along its own normal, else from where the robot is, else at the tag."""
    override = override or Override()
    pinned = _pinned(tag_id, override, standoff_m)
    if pinned is not None:
        return pinned
    wanted = clamp_standoff(standoff_m if override.standoff is None else override.standoff)
    normal, source = tag.normal_xy(), "discovered_normal"
    if normal is None and robot_xy is not None:
        dx, dy = robot_xy[0] - tag.x, robot_xy[1] - tag.y
        distance = math.hypot(dx, dy)
        if distance >= 1e-6:
            normal, source = (dx / distance, dy / distance), "discovered_robot"
    if normal is None:
        geometric = Approach(tag_id, tag.x, tag.y, fallback_yaw, 0.0, "fallback")
    else:
        geometric = _in_front(tag_id, (tag.x, tag.y), normal, wanted, source)
    return _overridden(geometric, override)


def _pinned(tag_id: str, override: Override, standoff_m: float) -> Approach | None:
    if override.goal_x is None or override.goal_y is None or override.yaw is None:
        return None
    standoff = clamp_standoff(standoff_m if override.standoff is None else override.standoff)
    return Approach(tag_id, override.goal_x, override.goal_y, override.yaw, standoff, "override")


def _overridden(approach: Approach, override: Override) -> Approach:
    changes: dict[str, float] = {}
    if override.goal_x is not None:
        changes["goal_x"] = override.goal_x
    if override.goal_y is not None:
        changes["goal_y"] = override.goal_y
    if override.yaw is not None:
        changes["goal_yaw"] = override.yaw
    if override.standoff is not None:
        changes["standoff_m"] = clamp_standoff(override.standoff)
    return replace(approach, derived_from="override", **changes) if changes else approach  # type: ignore[arg-type]


def _in_front(tag_id: str, tag: tuple[float, float], normal: tuple[float, float], standoff_m: float, source: str) -> Approach:
    return Approach(
        tag_id,
        tag[0] + standoff_m * normal[0],
        tag[1] + standoff_m * normal[1],
        math.atan2(-normal[1], -normal[0]),
        standoff_m,
        source,
    )


def _from_table(tag_id: str, tag: tuple[float, float], layout: Layout, standoff_m: float) -> Approach | None:
    if not layout.tables:
        return None
    table_id, table = min(
        layout.tables.items(),
        key=lambda item: (math.hypot(tag[0] - item[1].centre[0], tag[1] - item[1].centre[1]), item[0]),
    )
    dx, dy = tag[0] - table.centre[0], tag[1] - table.centre[1]
    distance = math.hypot(dx, dy)
    if distance < 1e-6:
        return None
    normal = (dx / distance, dy / distance)
    for standoff in _shortened(standoff_m):
        approach = _in_front(tag_id, tag, normal, standoff, "geometry")
        if not _inside_any(layout.tables, approach.goal_x, approach.goal_y):
            return replace(approach, table_id=table_id)
    return None


def _shortened(standoff_m: float) -> Iterator[float]:
    steps = int((standoff_m - MIN_STANDOFF_M) / GUARD_STEP_M + 1e-9)
    for step in range(steps + 1):
        yield standoff_m - step * GUARD_STEP_M
    if standoff_m - steps * GUARD_STEP_M > MIN_STANDOFF_M + 1e-9:
        yield MIN_STANDOFF_M


def _inside_any(tables: Mapping[str, Table], x: float, y: float) -> bool:
    return any(table.contains(x, y) for table in tables.values())


# -- fitting a goal into the map ---------------------------------------------------------------------------------------

# Turning round the tag costs view angle, stepping back costs resolution: the tag is read within 60 degrees and 2 m.
_TURNS_RAD = tuple(math.radians(degrees) for degrees in (0, 15, -15, 30, -30, 45, -45))
_STEP_M, _LONGEST_M = 0.05, 0.8
_TURN_COST_M = 0.4  # metres of standoff that a radian of turn is worth
_TAG_MARGIN_M = 0.15  # the line of sight ends here: the tag hangs on something occupied


@dataclass(frozen=True)
class Clearance:
    """How much room a map leaves: metres from each cell to the nearest obstacle, and which cells are known to be free."""

    grid: GridMap
    distance_m: NDArray[np.float32]
    free: NDArray[np.bool_]

    @staticmethod
    def of(grid: GridMap, free_thresh: int = 20, occupied_thresh: int = 65) -> Clearance:
        """Measure a map; cells (height, width)."""
        clear = (grid.cells < occupied_thresh).astype(np.uint8)
        distance = cv2.distanceTransform(clear, cv2.DIST_L2, 5) * grid.resolution_m
        return Clearance(grid, distance.astype(np.float32), (grid.cells >= 0) & (grid.cells <= free_thresh))

    def at(self, x: float, y: float) -> float:
        """Metres of room at a point that is known to be free; 0 anywhere else."""
        row, column = self.grid.cell_of(x, y)
        if not self.grid.contains(row, column) or not self.free[row, column]:
            return 0.0
        return float(self.distance_m[row, column])

    def sees(self, x: float, y: float, to_x: float, to_y: float, margin_m: float) -> bool:
        """Whether no obstacle stands on the line, the last `margin_m` of it left out."""
        length = math.hypot(to_x - x, to_y - y) - margin_m
        if length <= 0.0:
            return True
        steps = max(2, math.ceil(2.0 * length / self.grid.resolution_m))
        f = np.linspace(0.0, length / (length + margin_m), steps)
        rows = np.floor((y + f * (to_y - y) - self.grid.origin_y) / self.grid.resolution_m).astype(int)
        columns = np.floor((x + f * (to_x - x) - self.grid.origin_x) / self.grid.resolution_m).astype(int)
        inside = (rows >= 0) & (rows < self.grid.height) & (columns >= 0) & (columns < self.grid.width)
        return bool(np.all(self.distance_m[rows[inside], columns[inside]] > 0.0))


def fit_approach(
    approach: Approach,
    tag_xy: tuple[float, float],
    clearance: Clearance,
    room_m: float,
    avoid: tuple[tuple[float, float], ...] = (),
) -> Approach:
    """The approach itself where the map leaves `room_m` around it, else the nearest pose that does, still facing the tag.

    Tried are turns round the tag up to 45 degrees and standoffs up to 0.8 m. Goals within 0.1 m of a point of `avoid`,
    where the robot could not get to before, count as taken. A moved goal says so behind a plus sign in `derived_from`.
    An operator's override is never moved; where nothing fits, the approach comes back as it is.
    """
    if approach.derived_from == "override":
        return approach
    if approach.derived_from == "fallback":  # the goal is the tag itself: any side that can be reached will do
        turns: tuple[float, ...] = tuple(wrap_angle(math.radians(30 * k)) for k in range(12))
        normal, nominal = approach.goal_yaw + math.pi, 0.5
    else:
        turns = _TURNS_RAD
        normal, nominal = math.atan2(approach.goal_y - tag_xy[1], approach.goal_x - tag_xy[0]), approach.standoff_m
    longest = max(nominal, _LONGEST_M)
    standoffs = [nominal + k * _STEP_M for k in range(-20, 31) if 0.3 <= nominal + k * _STEP_M <= longest + 1e-9]
    options = sorted(
        ((turn, standoff) for turn in turns for standoff in {nominal, *standoffs}),
        key=lambda o: (_TURN_COST_M * abs(o[0]) + abs(o[1] - nominal), abs(o[0]), o[1]),
    )
    for turn, standoff in options:
        x = tag_xy[0] + standoff * math.cos(normal + turn)
        y = tag_xy[1] + standoff * math.sin(normal + turn)
        if any(math.hypot(x - ax, y - ay) < 0.1 for ax, ay in avoid):
            continue
        if clearance.at(x, y) < room_m or not clearance.sees(x, y, *tag_xy, _TAG_MARGIN_M):
            continue
        if turn == 0.0 and standoff == nominal and approach.derived_from != "fallback":
            return approach
        return replace(
            approach,
            goal_x=x,
            goal_y=y,
            goal_yaw=math.atan2(tag_xy[1] - y, tag_xy[0] - x),
            standoff_m=standoff,
            derived_from=f"{approach.derived_from}+{standoff:.2f}m{math.degrees(turn):+.0f}deg",
        )
    return approach
