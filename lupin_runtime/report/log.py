"""What a recording says of a run, as plain values."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.report.trajectory import Trajectory, TrajectoryBuilder

Point = tuple[float, float]


@dataclass(frozen=True)
class TagPose:
    """Where a tag hangs: metres in the map, and the direction that its face looks (None for a tag that looks up)."""

    x: float
    y: float
    z: float
    facing_rad: float | None


@dataclass(frozen=True)
class Bloom:
    """One placed flower."""

    x: float
    y: float
    species: str
    confidence: float
    anomaly: bool
    height_m: float


@dataclass(frozen=True)
class FlowerLook:
    """What one look at a pot found."""

    species: str
    confidence: float
    anomaly: bool
    flower_count: int
    bug_count: int
    blooms: tuple[Bloom, ...]
    footprint: tuple[Point, ...]


@dataclass(frozen=True)
class Seen:
    """One observation of the mission or of perception."""

    t_s: float
    kind: str
    status: str
    detail: str
    source: str
    tag_id: str
    readings: tuple[tuple[str, float], ...] = ()
    flower: FlowerLook | None = None
    pose: TagPose | None = None


@dataclass
class Discovered:
    """A tag as perception knew it last, and when it first did."""

    first_t_s: float
    pose: TagPose | None
    sightings: int
    species: str
    confidence: float
    anomaly: bool


@dataclass(frozen=True)
class MissionSample:
    """The mission's state wherever it changed."""

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
    """A warning or an error that a node logged."""

    t_s: float
    level: int
    node: str
    text: str


@dataclass(frozen=True)
class Picture:
    """A camera's JPEG."""

    t_s: float
    jpeg: bytes


@dataclass(frozen=True)
class Scan:
    """A lidar scan: ranges in metres (NaN for none), the first beam at `angle_min` in the laser frame."""

    t_s: float
    angle_min: float
    angle_step: float
    ranges: NDArray[np.float32]


@dataclass
class RunLog:
    """A run as its recording tells it. Times count from the start of the recording, in its own (ROS) time."""

    start_ns: int = 0
    end_s: float = 0.0
    trajectory: Trajectory = field(default_factory=lambda: TrajectoryBuilder().build())
    mission: list[MissionSample] = field(default_factory=list)
    mission_id: str = ""
    mission_type: str = ""
    totals: dict[str, int] = field(default_factory=dict)
    seen: list[Seen] = field(default_factory=list)
    discovered: dict[str, Discovered] = field(default_factory=dict)
    twin: dict[str, tuple[TagPose | None, FlowerLook | None, tuple[tuple[str, float], ...]]] = field(default_factory=dict)
    map: GridMap | None = None
    known_area: list[tuple[float, float]] = field(default_factory=list)
    battery: list[tuple[float, float]] = field(default_factory=list)
    speed: list[tuple[float, float, float]] = field(default_factory=list)
    command: list[tuple[float, float, float]] = field(default_factory=list)
    lines: list[LogLine] = field(default_factory=list)
    body_pictures: list[Picture] = field(default_factory=list)
    gripper_pictures: list[Picture] = field(default_factory=list)
    scans: list[Scan] = field(default_factory=list)
    laser_in_base: Pose2 = field(default_factory=Pose2)
    boxes: dict[str, tuple[Point, ...]] = field(default_factory=dict)
