"""What the mission needs of the world, as protocols: a node wires them to the graph, a test hands in fakes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.approach import TagPose

# Result codes of a ROS action (action_msgs/GoalStatus).
STATUS_UNKNOWN, STATUS_SUCCEEDED, STATUS_CANCELED, STATUS_ABORTED = 0, 4, 5, 6


@dataclass(frozen=True)
class Reading:
    """What the bridge said of a tag: `status` 0 is OK; `values` are (sensor, value), `sim_time_s` the time of day there."""

    status: int
    error: str = ""
    values: tuple[tuple[str, float], ...] = ()
    stamp_ns: int = 0
    sim_time_s: float = 0.0


@dataclass(frozen=True)
class Confirmation:
    """What the visual gate said of a tag."""

    detected: bool
    error: str = ""


@dataclass(frozen=True)
class ObservationRecord:
    """The end of one visit to a tag; `pose` is None where it is not known or not meant."""

    mission_id: str
    source: str
    tag_id: str
    status: int
    detail: str = ""
    reading: Reading | None = None
    pose: TagPose | None = None


@dataclass(frozen=True)
class MissionSnapshot:
    """What MissionState says, without its header."""

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


class Clock(Protocol):
    """Time."""

    def now_s(self) -> float:
        """Seconds of a clock for time-outs: it never jumps back while a mission runs."""

    def stamp_ns(self) -> int:
        """ROS time for stamps."""


class Navigation(Protocol):
    """The navigation action. What becomes of a goal is told to GoalRunner's `accepted`, `feedback`, `rejected`, `finished`."""

    def is_ready(self) -> bool:
        """Whether the action server is there."""

    def send(self, token: int, pose: Pose2) -> None:
        """Send a goal in the map frame; `token` names it from now on."""

    def cancel(self, token: int) -> None:
        """Ask for the end of an accepted goal. Asking twice, or for one that has ended, does nothing."""

    def cancel_all(self) -> None:
        """Ask for the end of every goal, whoever sent it."""


class Greenhouse(Protocol):
    """The climate bridge."""

    def is_ready(self) -> bool:
        """Whether the service is there."""

    def read(self, tag_id: str, done: Callable[[Reading], None]) -> None:
        """Ask for a tag's readings; `done` is called later, or never."""


class VisualGate(Protocol):
    """The service that says whether a tag is in view."""

    def is_ready(self) -> bool:
        """Whether the service is there."""

    def confirm(self, tag_id: str, done: Callable[[Confirmation], None]) -> None:
        """Ask for a tag; `done` is called later, or never."""


class Arm(Protocol):
    """The arm's presets."""

    def strike(self, preset: str) -> bool:
        """Send the arm to a preset; False if nobody is there to do it."""


class World(Protocol):
    """What the robot knows of where it is."""

    def robot_pose(self) -> Pose2 | None:
        """The robot in the map frame; None where the transforms do not tell."""

    def map(self) -> tuple[int, GridMap] | None:
        """The newest map and its running number, or None."""


class Outlet(Protocol):
    """Where the mission's words go."""

    def observe(self, record: ObservationRecord) -> None:
        """Publish an observation."""

    def changed(self) -> None:
        """The snapshot has changed in a way that should not wait for the next tick."""

    def log(self, text: str, warning: bool = False) -> None:
        """Say something to the log."""


@dataclass(frozen=True)
class Ports:
    """All of the world."""

    clock: Clock
    navigation: Navigation
    greenhouse: Greenhouse
    gate: VisualGate
    arm: Arm
    world: World
    outlet: Outlet


@dataclass
class Beliefs:
    """What the mission has been told, by topic."""

    discovered: dict[str, TagPose] = field(default_factory=dict)
    has_pose: bool = False
    pose: TagPose | None = None
    covariance: float | None = None
