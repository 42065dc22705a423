"""The content of a run's recording, as plain values. Times `t_s` are seconds since the start of the recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.report.link import Link
from lupin_runtime.report.map_history import MapHistory
from lupin_runtime.report.trajectory import Trajectory, TrajectoryBuilder

Point = tuple[float, float]


@dataclass(frozen=True)
class TagPlacement:
    """Position of a tag in the map, meters, and the direction that its face points to (None for a tag that faces up)."""

    x: float
    y: float
    z: float
    facing_rad: float | None


@dataclass(frozen=True)
class LoggedFlower:
    """A flower with its position in the map."""

    x: float
    y: float
    species: str
    confidence: float
    anomaly: bool
    height_m: float


@dataclass(frozen=True)
class LoggedPot:
    """The flowers that perception found in one pot."""

    species: str
    confidence: float
    anomaly: bool
    flower_count: int
    bug_count: int
    placed: tuple[LoggedFlower, ...]
    footprint: tuple[Point, ...]


@dataclass(frozen=True)
class ObservationEntry:
    """One observation, published by the mission or by perception."""

    t_s: float
    kind: str
    status: str
    detail: str
    source: str
    tag_id: str
    readings: tuple[tuple[str, float], ...] = ()
    flower: LoggedPot | None = None
    pose: TagPlacement | None = None


@dataclass
class DiscoveryEntry:
    """Perception's last data of a tag, and the time when it was first discovered."""

    first_t_s: float
    pose: TagPlacement | None
    sightings: int
    species: str
    confidence: float
    anomaly: bool


@dataclass(frozen=True)
class TwinTag:
    """A tag in the twin's last state; `readings` are (sensor, value)."""

    pose: TagPlacement | None = None
    flower: LoggedPot | None = None
    readings: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class MissionSample:
    """The mission's state at a time when it changed."""

    t_s: float
    state: str
    phase: str
    target: str
    paused: bool
    estop: bool
    battery_low: bool
    last_error: str
    last_event: str
    severity: int


@dataclass(frozen=True)
class LogLine:
    """A warning or an error in a node's log."""

    t_s: float
    level: int
    node: str
    text: str


@dataclass(frozen=True)
class ClockSample:
    """The two clocks of the recorder at one moment: ROS time, which is simulated in a simulated run, and the wall clock."""

    t_s: float
    ros_s: float
    wall_s: float


class TimedPosition(NamedTuple):
    """A position at a time: the stamp is in ROS time, the position in meters."""

    stamp_s: float
    x: float
    y: float


@dataclass(frozen=True)
class CameraImage:
    """A camera's image."""

    t_s: float
    jpeg: bytes


@dataclass(frozen=True)
class LidarScan:
    """A lidar scan: ranges in meters (NaN for none), the first beam at `angle_min` in the laser frame."""

    t_s: float
    angle_min: float
    angle_step: float
    ranges: NDArray[np.float32]


@dataclass
class RunLog:
    """Everything that the report needs from a recording. Times are ROS time, counted from the start of the recording."""

    start_ns: int = 0
    end_s: float = 0.0
    trajectory: Trajectory = field(default_factory=lambda: TrajectoryBuilder().build())
    mission: list[MissionSample] = field(default_factory=list)
    mission_id: str = ""
    mission_type: str = ""
    totals: dict[str, int] = field(default_factory=dict)
    observations: list[ObservationEntry] = field(default_factory=list)
    discovered: dict[str, DiscoveryEntry] = field(default_factory=dict)
    twin: dict[str, TwinTag] = field(default_factory=dict)
    map: GridMap | None = None
    map_history: MapHistory = field(default_factory=MapHistory)
    known_area: list[tuple[float, float]] = field(default_factory=list)
    battery: list[tuple[float, float]] = field(default_factory=list)
    speed: list[tuple[float, float, float]] = field(default_factory=list)
    command: list[tuple[float, float, float]] = field(default_factory=list)
    lines: list[LogLine] = field(default_factory=list)
    body_images: list[CameraImage] = field(default_factory=list)
    gripper_images: list[CameraImage] = field(default_factory=list)
    scans: list[LidarScan] = field(default_factory=list)
    base_from_laser: Pose2 | None = None
    clearance: list[tuple[float, float]] = field(default_factory=list)
    clocks: list[ClockSample] = field(default_factory=list)
    link: Link = field(default_factory=Link)
    boxes: dict[str, tuple[Point, ...]] = field(default_factory=dict)
    first_box_s: dict[str, float] = field(default_factory=dict)
    first_flower_s: dict[str, float] = field(default_factory=dict)
