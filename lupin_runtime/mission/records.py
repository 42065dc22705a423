"""Values that the mission exchanges with its ports: poses, answers, observations and the published state."""

from __future__ import annotations

import math
from dataclasses import dataclass, field


@dataclass(frozen=True)
class MapPose:
    """Position in meters and orientation as a quaternion, in the map frame.

    For a tag, +Z of the orientation points out of the marker.
    """

    x: float
    y: float
    z: float = 0.0
    qx: float = 0.0
    qy: float = 0.0
    qz: float = 0.0
    qw: float = 1.0

    def normal_xy(self) -> tuple[float, float] | None:
        """Return the unit vector of +Z projected on the floor; None if +Z points straight up or down."""
        nx = 2.0 * (self.qx * self.qz + self.qw * self.qy)
        ny = 2.0 * (self.qy * self.qz - self.qw * self.qx)
        length = math.hypot(nx, ny)
        return (nx / length, ny / length) if length >= 1e-6 else None


@dataclass(frozen=True)
class ClimateReading:
    """The climate bridge's answer for one tag.

    `status` 0 is OK; `values` are (sensor name, value); `sim_time_s` is the greenhouse's time of day in seconds.
    """

    status: int
    error: str = ""
    values: tuple[tuple[str, float], ...] = ()
    stamp_ns: int = 0
    sim_time_s: float = 0.0


@dataclass(frozen=True)
class Confirmation:
    """The visual confirmation service's answer: whether the tag is in view."""

    detected: bool
    error: str = ""


@dataclass(frozen=True)
class ObservationRecord:
    """The result of one visit to a tag. `pose` is None if it is unknown or does not apply."""

    mission_id: str
    source: str
    tag_id: str
    status: int
    detail: str = ""
    reading: ClimateReading | None = None
    pose: MapPose | None = None


@dataclass(frozen=True)
class MissionSnapshot:
    """The fields of a MissionState message, without its header."""

    mission_id: str = ""
    mission_type: str = ""
    lifecycle_state: str = "BOOT"
    mission_phase: str = ""
    current_target: str = ""
    targets_total: int = 0
    targets_completed: int = 0
    targets_failed: int = 0
    targets_unreachable: int = 0
    targets_skipped: int = 0
    last_error: str = ""
    last_event: str = ""
    last_event_severity: int = 0
    tags_discovered: int = 0
    discovery_goal: int = 0
    estop_engaged: bool = False
    paused: bool = False
    battery_percentage: float = 1.0
    battery_low: bool = False
    started_at_ns: int = 0


@dataclass
class WorldModel:
    """What the mission knows about the world: the newest data of each topic that it subscribes to.

    `largest_variance` is the largest of the pose's variances (m², rad²); None while it is unknown. `lost`: the localization
    has lost the robot.
    """

    discovered: dict[str, MapPose] = field(default_factory=dict)
    has_pose: bool = False
    pose: MapPose | None = None
    largest_variance: float | None = None
    lost: bool = False
