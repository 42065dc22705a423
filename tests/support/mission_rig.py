"""An orchestrator with fakes for all of its ports. Time advances only in `Rig.step`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.layout import Layout, Table, TagLocation
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.missions import OK
from lupin_runtime.mission.orchestrator import Orchestrator
from lupin_runtime.mission.ports import STATUS_ABORTED, STATUS_CANCELED, STATUS_SUCCEEDED, Ports
from lupin_runtime.mission.records import ClimateReading, Confirmation, MapPose, MissionSnapshot, ObservationRecord
from lupin_runtime.mission.requests import OperatorRequests


class FakeClock:
    def __init__(self) -> None:
        self.s = 100.0

    def now_s(self) -> float:
        return self.s

    def monotonic_s(self) -> float:
        return self.s

    def stamp_ns(self) -> int:
        return int(self.s * 1e9)


@dataclass
class Goal:
    token: int
    pose: Pose2
    accepted: bool = False
    cancel_requests: int = 0
    ended: bool = False


class GoalListener(Protocol):
    """Receives the responses to goals: an Orchestrator, or an object of a test."""

    def goal_accepted(self, token: int) -> None: ...

    def goal_rejected(self, token: int) -> None: ...

    def goal_finished(self, token: int, status: int) -> None: ...


class FakeNavigation:
    """Accepts goals and cancel requests at once; tests end the goals.

    If `answers_goals` is False, a goal gets no response until the test calls `accept` or `reject`; its end cannot be received
    before that. If `answers_cancels` is False, a cancel request is only counted.
    """

    def __init__(self) -> None:
        self.ready = True
        self.answers_goals = True
        self.answers_cancels = True
        self.goals: list[Goal] = []
        self.cancel_all_count = 0
        self.goal_listener: GoalListener

    def is_ready(self) -> bool:
        return self.ready

    def send(self, token: int, pose: Pose2) -> None:
        self.goals.append(Goal(token, pose))
        if self.answers_goals:
            self.accept(self.goals[-1])

    def accept(self, goal: Goal) -> None:
        goal.accepted = True
        self.goal_listener.goal_accepted(goal.token)

    def reject(self, goal: Goal) -> None:
        goal.ended = True
        self.goal_listener.goal_rejected(goal.token)

    def end(self, goal: Goal, status: int) -> None:
        goal.ended = True
        self.goal_listener.goal_finished(goal.token, status)

    def cancel(self, token: int) -> None:
        goal = next(goal for goal in self.goals if goal.token == token)
        goal.cancel_requests += 1
        if self.answers_cancels and goal.accepted and not goal.ended:
            self.end(goal, STATUS_CANCELED)

    def cancel_all(self, on_answer: Callable[[], None]) -> bool:
        self.cancel_all_count += 1
        if self.answers_cancels:
            on_answer()
        return True

    @property
    def open(self) -> list[Goal]:
        return [goal for goal in self.goals if not goal.ended]

    @property
    def driving(self) -> list[Goal]:
        """Goals that drive the robot, now or once they are accepted: not ended, and without a cancel request."""
        return [goal for goal in self.open if not goal.cancel_requests]


@dataclass
class FakeClimateBridge:
    ready: bool = True
    replies: bool = True
    status: int = 0
    error: str = ""
    requested: list[str] = field(default_factory=list)
    pending: list[tuple[str, Callable[[ClimateReading], None]]] = field(default_factory=list)

    def is_ready(self) -> bool:
        return self.ready

    def read(self, tag_id: str, on_reading: Callable[[ClimateReading], None]) -> None:
        self.requested.append(tag_id)
        self.pending.append((tag_id, on_reading))
        if self.replies:
            self.reply()

    def reply(self) -> None:
        while self.pending:
            _, on_reading = self.pending.pop(0)
            on_reading(ClimateReading(self.status, self.error, (("co2", 400.0),)))


@dataclass
class FakeConfirmer:
    ready: bool = True
    replies: bool = True
    detected: bool = True
    error: str = ""
    pending: list[Callable[[Confirmation], None]] = field(default_factory=list)

    def is_ready(self) -> bool:
        return self.ready

    def confirm(self, tag_id: str, on_confirmation: Callable[[Confirmation], None]) -> None:
        self.pending.append(on_confirmation)
        if self.replies:
            self.reply()

    def reply(self) -> None:
        while self.pending:
            self.pending.pop(0)(Confirmation(self.detected, self.error))


class FakeArm:
    def __init__(self, clock: FakeClock) -> None:
        self.clock = clock
        self.present = True
        self.moves: list[tuple[str, float]] = []

    def move_to_preset(self, preset: str) -> bool:
        if self.present:
            self.moves.append((preset, self.clock.s))
        return self.present


class FakeMapSource:
    def __init__(self) -> None:
        self.pose: Pose2 | None = Pose2()
        self.newest: tuple[int, GridMap] | None = None

    def robot_pose(self) -> Pose2 | None:
        return self.pose

    def map(self) -> tuple[int, GridMap] | None:
        return self.newest


@dataclass
class FakePublisher:
    records: list[ObservationRecord] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)

    def publish_observation(self, record: ObservationRecord) -> None:
        self.records.append(record)

    def state_changed(self) -> None:
        pass

    def log(self, text: str, warning: bool = False) -> None:
        self.lines.append(text)


LAYOUT = Layout({"A": Table(2.0, 3.0, -0.2, 0.2)}, {tag: TagLocation(2.0 + 0.5 * int(tag), 0.2) for tag in "012"})


class Rig:
    """An orchestrator with its fakes. `ready`: it has left BOOT. Keyword arguments are parameters of MissionConfig."""

    def __init__(self, ready: bool = True, layout: Layout = LAYOUT, **parameters: Any) -> None:
        self.clock, self.navigation, self.climate_bridge, self.confirmer = (
            FakeClock(),
            FakeNavigation(),
            FakeClimateBridge(),
            FakeConfirmer(),
        )
        self.arm, self.map_source, self.publisher = FakeArm(self.clock), FakeMapSource(), FakePublisher()
        self.orchestrator = Orchestrator(
            MissionConfig.from_parameters(parameters),
            Ports(self.clock, self.navigation, self.climate_bridge, self.confirmer, self.arm, self.map_source, self.publisher),
            layout,
        )
        self.navigation.goal_listener = self.orchestrator
        if ready:
            self.localize()
            self.step()

    @property
    def state(self) -> str:
        return self.orchestrator.hsm.state

    @property
    def requests(self) -> OperatorRequests:
        return self.orchestrator.requests

    @property
    def snapshot(self) -> MissionSnapshot:
        return self.orchestrator.snapshot()

    def localize(self, variance: float = 0.01) -> None:
        self.orchestrator.on_pose(MapPose(0.0, 0.0), (variance, variance, variance))

    def step(self, seconds: float = 0.1) -> None:
        for _ in range(max(1, round(seconds / 0.1))):
            self.clock.s += 0.1
            self.orchestrator.tick()

    def arrive(self) -> None:
        """Let the newest driving goal succeed, at its pose."""
        self.end_drive(STATUS_SUCCEEDED)

    def end_drive(self, status: int) -> None:
        """End the newest driving goal with an action status."""
        goal = self.navigation.driving[-1]
        if status == STATUS_SUCCEEDED:
            self.map_source.pose = goal.pose
        self.navigation.end(goal, status)
        self.step()

    def fail(self) -> None:
        self.end_drive(STATUS_ABORTED)

    def discover(self, *tags: str) -> None:
        self.orchestrator.on_tags({tag: MapPose(1.0 + int(tag), 1.0, 0.15, *tag_orientation(math.pi)) for tag in tags})

    def show_map(self, grid: GridMap | None = None) -> None:
        number = self.map_source.newest[0] + 1 if self.map_source.newest else 0
        self.map_source.newest = (number, grid if grid is not None else half_known_map())

    def inspect(self, *tags: str) -> None:
        assert self.requests.start("InspectionMission", tags).success
        self.step()

    def explore(self, discovery_goal: int = 2) -> None:
        if self.map_source.newest is None:
            self.show_map()
        assert self.requests.start("ExplorationMission", (), discovery_goal).success
        self.step()

    def monitor(self, *tags: str) -> None:
        """Start an exploration, and discover these tags, which are all that it looks for: monitoring begins."""
        self.explore(len(tags))
        self.discover(*tags)
        self.step()
        assert self.state == "MONITORING.NAVIGATING"

    def bring_to(self, state: str) -> None:
        """Start a mission, and bring it into this leaf state."""
        if state == "PREPARE.LOCALIZING":
            self.localize(9.0)
            self.inspect("1", "2")
        elif state == "EXPLORING":
            self.explore(5)
        elif state == "RETURNING":
            self.inspect("1")
            self.arrive()
        elif state.startswith("INSPECTING"):
            self.inspect("1", "2")
        elif state.startswith("MONITORING"):
            self.monitor("1", "2")
        if state.endswith(("SCANNING", "PUBLISHING")):
            self.climate_bridge.replies = False
            self.arrive()
        if state.endswith("PUBLISHING"):
            self.pause_in_publishing()
        assert self.state == state

    def pause_in_publishing(self) -> None:
        """Pause, and finish the current tag: the mission stays in PUBLISHING, which it otherwise leaves in the same tick."""
        self.requests.pause()
        self.orchestrator.mission_runner.inspecting._close(OK, "")

    def end_mission(self) -> None:
        """Abort twice: the first abort makes the robot return to the dock, the second ends the mission where it is."""
        self.requests.abort()
        self.requests.abort()

    @property
    def last(self) -> ObservationRecord:
        return self.publisher.records[-1]

    def statuses(self) -> list[tuple[str, int, str]]:
        return [(record.tag_id, record.status, record.detail) for record in self.publisher.records]


def tag_orientation(yaw: float) -> tuple[float, float, float, float]:
    """Return a quaternion whose +Z points along `yaw`: a rotation by 90 degrees about y, then by `yaw` about z."""
    half, s = yaw / 2.0, math.sqrt(0.5)
    return -math.sin(half) * s, math.cos(half) * s, math.sin(half) * s, math.cos(half) * s


def half_known_map() -> GridMap:
    """Return a map of 10 x 10 m, free where x < 2 m and unknown beyond: one frontier, reachable from the origin."""
    cells = np.full((200, 200), -1, np.int8)
    cells[:, :140] = 0
    return GridMap(cells, 0.05, -5.0, -5.0)


def known_map() -> GridMap:
    """Return a map of 10 x 10 m of free floor: nothing to explore."""
    return GridMap(np.zeros((200, 200), np.int8), 0.05, -5.0, -5.0)
