"""What the mission needs from the outside, as protocols: the node implements them on the graph, tests with fakes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.records import ClimateReading, Confirmation, ObservationRecord

# Result codes of a ROS action (action_msgs/GoalStatus).
STATUS_UNKNOWN, STATUS_SUCCEEDED, STATUS_CANCELED, STATUS_ABORTED = 0, 4, 5, 6


class Clock(Protocol):
    """The mission's clocks."""

    def now_s(self) -> float:
        """Return seconds for timeouts, which never jump back while a mission runs."""

    def monotonic_s(self) -> float:
        """Return seconds of the monotonic clock, which the e-stop and operators follow also in a simulation."""

    def stamp_ns(self) -> int:
        """Return ROS time for message stamps, in nanoseconds."""


class Navigation(Protocol):
    """The navigation action. Results go to the Orchestrator: `goal_accepted`, `goal_feedback` and so on."""

    def is_ready(self) -> bool:
        """Return whether the action server is available."""

    def send(self, token: int, pose: Pose2) -> None:
        """Send a goal in the map frame; `token` identifies it in all later calls."""

    def cancel(self, token: int) -> None:
        """Request cancellation of a goal, accepted or not. Has no effect when repeated, or on a goal that has ended."""

    def cancel_all(self, on_answer: Callable[[], None]) -> bool:
        """Request cancellation of every goal of the server, including other clients' goals; return whether it was sent.

        `on_answer` is called later, or never. A goal that is sent before that may be cancelled with the others.
        """


class ClimateBridge(Protocol):
    """The climate bridge."""

    def is_ready(self) -> bool:
        """Return whether the service is available."""

    def read(self, tag_id: str, on_reading: Callable[[ClimateReading], None]) -> None:
        """Request the climate at a tag; `on_reading` is called later, or never."""


class TagConfirmer(Protocol):
    """The service that confirms visually that a tag is in view."""

    def is_ready(self) -> bool:
        """Return whether the service is available."""

    def confirm(self, tag_id: str, on_confirmation: Callable[[Confirmation], None]) -> None:
        """Request confirmation of a tag; `on_confirmation` is called later, or never."""


class Arm(Protocol):
    """The arm's presets."""

    def move_to_preset(self, preset: str) -> bool:
        """Send the arm to a preset; return False if no arm service is available."""


class MapSource(Protocol):
    """Localization and mapping."""

    def robot_pose(self) -> Pose2 | None:
        """Return the robot's pose in the map frame; None without current transforms."""

    def map(self) -> tuple[int, GridMap] | None:
        """Return the number of maps received so far and the newest map; None before the first."""


class MissionPublisher(Protocol):
    """The mission's output: observations, state and log lines."""

    def publish_observation(self, record: ObservationRecord) -> None:
        """Publish an observation."""

    def state_changed(self) -> None:
        """Publish the state soon: it changed in a way that must not wait for the next periodic message."""

    def log(self, text: str, warning: bool = False) -> None:
        """Write a log line."""


@dataclass(frozen=True)
class Ports:
    """All ports of a mission."""

    clock: Clock
    navigation: Navigation
    climate_bridge: ClimateBridge
    confirmer: TagConfirmer
    arm: Arm
    map_source: MapSource
    publisher: MissionPublisher
