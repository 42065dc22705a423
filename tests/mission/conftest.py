"""A world of fakes around the orchestrator: time moves only when a test says so."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

# Whole missions are run in the greenhouse of the benchmarks.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.approach import TagPose
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.layout import Layout, Table, TagLocation
from lupin_runtime.mission.orchestrator import Orchestrator
from lupin_runtime.mission.ports import (
    STATUS_ABORTED,
    STATUS_CANCELED,
    STATUS_SUCCEEDED,
    Confirmation,
    ObservationRecord,
    Ports,
    Reading,
)


class FakeClock:
    def __init__(self) -> None:
        self.s = 100.0

    def now_s(self) -> float:
        return self.s

    def stamp_ns(self) -> int:
        return int(self.s * 1e9)


@dataclass
class Goal:
    token: int
    pose: Pose2
    accepted: bool = False
    cancel_asked: int = 0
    ended: bool = False


class FakeNavigation:
    """Accepts at once and ends nothing by itself; `answers` False never accepts, `acknowledges` False loses cancels."""

    def __init__(self) -> None:
        self.ready = True
        self.answers = True
        self.acknowledges = True
        self.goals: list[Goal] = []
        self.cancelled_all = 0
        self.orchestrator: Any = None

    def is_ready(self) -> bool:
        return self.ready

    def send(self, token: int, pose: Pose2) -> None:
        self.goals.append(Goal(token, pose))
        if self.answers:
            self.accept(self.goals[-1])

    def accept(self, goal: Goal) -> None:
        goal.accepted = True
        self.orchestrator.goal_accepted(goal.token)

    def reject(self, goal: Goal) -> None:
        goal.ended = True
        self.orchestrator.goal_rejected(goal.token)

    def end(self, goal: Goal, status: int) -> None:
        goal.ended = True
        self.orchestrator.goal_finished(goal.token, status)

    def cancel(self, token: int) -> None:
        goal = next(goal for goal in self.goals if goal.token == token)
        goal.cancel_asked += 1
        if self.acknowledges and not goal.ended:
            self.end(goal, STATUS_CANCELED)

    def cancel_all(self) -> None:
        self.cancelled_all += 1

    @property
    def open(self) -> list[Goal]:
        return [goal for goal in self.goals if not goal.ended]

    @property
    def wanted(self) -> list[Goal]:
        """Goals that would drive the robot on, now or once they are accepted, without anyone having asked to stop."""
        return [goal for goal in self.open if not goal.cancel_asked]


@dataclass
class FakeGreenhouse:
    ready: bool = True
    answers: bool = True
    status: int = 0
    error: str = ""
    asked: list[str] = field(default_factory=list)
    pending: list[tuple[str, Callable[[Reading], None]]] = field(default_factory=list)

    def is_ready(self) -> bool:
        return self.ready

    def read(self, tag_id: str, done: Callable[[Reading], None]) -> None:
        self.asked.append(tag_id)
        self.pending.append((tag_id, done))
        if self.answers:
            self.answer()

    def answer(self) -> None:
        while self.pending:
            _, done = self.pending.pop(0)
            done(Reading(self.status, self.error, (("co2", 400.0),)))


@dataclass
class FakeGate:
    ready: bool = True
    answers: bool = True
    detected: bool = True
    error: str = ""
    pending: list[Callable[[Confirmation], None]] = field(default_factory=list)

    def is_ready(self) -> bool:
        return self.ready

    def confirm(self, tag_id: str, done: Callable[[Confirmation], None]) -> None:
        self.pending.append(done)
        if self.answers:
            self.answer()

    def answer(self) -> None:
        while self.pending:
            self.pending.pop(0)(Confirmation(self.detected, self.error))


class FakeArm:
    def __init__(self, clock: FakeClock) -> None:
        self.clock = clock
        self.present = True
        self.struck: list[tuple[str, float]] = []

    def strike(self, preset: str) -> bool:
        if self.present:
            self.struck.append((preset, self.clock.s))
        return self.present


class FakeWorld:
    def __init__(self) -> None:
        self.pose: Pose2 | None = Pose2()
        self.newest: tuple[int, GridMap] | None = None

    def robot_pose(self) -> Pose2 | None:
        return self.pose

    def map(self) -> tuple[int, GridMap] | None:
        return self.newest


@dataclass
class FakeOutlet:
    records: list[ObservationRecord] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)

    def observe(self, record: ObservationRecord) -> None:
        self.records.append(record)

    def changed(self) -> None:
        pass

    def log(self, text: str, warning: bool = False) -> None:
        self.lines.append(text)


LAYOUT = Layout({"A": Table(2.0, 3.0, -0.2, 0.2)}, {tag: TagLocation(2.0 + 0.5 * int(tag), 0.2) for tag in "012"})


class Rig:
    """An orchestrator with its fakes; parameters go to MissionConfig."""

    def __init__(self, booted: bool = True, layout: Layout = LAYOUT, **parameters: Any) -> None:
        self.clock, self.navigation, self.greenhouse, self.gate = FakeClock(), FakeNavigation(), FakeGreenhouse(), FakeGate()
        self.arm, self.world, self.outlet = FakeArm(self.clock), FakeWorld(), FakeOutlet()
        self.orchestrator = Orchestrator(
            MissionConfig.from_parameters(parameters),
            Ports(self.clock, self.navigation, self.greenhouse, self.gate, self.arm, self.world, self.outlet),
            layout,
        )
        self.navigation.orchestrator = self.orchestrator
        if booted:
            self.localize()
            self.step()

    @property
    def state(self) -> str:
        return self.orchestrator.hsm.state

    @property
    def snapshot(self) -> Any:
        return self.orchestrator.snapshot()

    def localize(self, variance: float = 0.01) -> None:
        self.orchestrator.heard_pose(TagPose(0.0, 0.0), (variance, variance, variance))

    def step(self, seconds: float = 0.1) -> None:
        for _ in range(max(1, round(seconds / 0.1))):
            self.clock.s += 0.1
            self.orchestrator.tick()

    def arrive(self, status: int = STATUS_SUCCEEDED) -> None:
        """The goal that is under way ends: the newest, where older ones were never answered."""
        goal = self.navigation.wanted[-1]
        if status == STATUS_SUCCEEDED:
            self.world.pose = goal.pose
        self.navigation.end(goal, status)
        self.step()

    def fail(self) -> None:
        self.arrive(STATUS_ABORTED)

    def discover(self, *tags: str) -> None:
        self.orchestrator.heard_tags({tag: TagPose(1.0 + int(tag), 1.0, 0.15, *_facing(math.pi)) for tag in tags})

    def show_map(self, grid: GridMap | None = None) -> None:
        number = self.world.newest[0] + 1 if self.world.newest else 0
        self.world.newest = (number, grid if grid is not None else half_known())

    def inspect(self, *tags: str) -> None:
        assert self.orchestrator.start("InspectionMission", tags).success
        self.step()

    def explore(self, goal: int = 2) -> None:
        if self.world.newest is None:
            self.show_map()
        assert self.orchestrator.start("ExplorationMission", (), goal).success
        self.step()

    def monitor(self, *tags: str) -> None:
        """An exploration that has found its tags."""
        self.explore(len(tags))
        self.discover(*tags)
        self.step()
        assert self.state == "MONITORING.NAVIGATING"

    @property
    def last(self) -> ObservationRecord:
        return self.outlet.records[-1]

    def statuses(self) -> list[tuple[str, int, str]]:
        return [(record.tag_id, record.status, record.detail) for record in self.outlet.records]


def _facing(yaw: float) -> tuple[float, float, float, float]:
    """A quaternion whose +Z points along `yaw` in the plane: a turn by 90 degrees about y, then by `yaw` about z."""
    half, s = yaw / 2.0, math.sqrt(0.5)
    return -math.sin(half) * s, math.cos(half) * s, math.sin(half) * s, math.cos(half) * s


def half_known() -> GridMap:
    """10 x 10 m, free where x < 2 m, unknown beyond: one frontier, reachable from the origin."""
    cells = np.full((200, 200), -1, np.int8)
    cells[:, :140] = 0
    return GridMap(cells, 0.05, -5.0, -5.0)


def all_known() -> GridMap:
    """10 x 10 m of free floor: nothing to explore."""
    return GridMap(np.zeros((200, 200), np.int8), 0.05, -5.0, -5.0)


@pytest.fixture
def make_rig() -> type[Rig]:
    return Rig


@pytest.fixture
def maps() -> Any:
    class Maps:
        half = staticmethod(half_known)
        whole = staticmethod(all_known)

    return Maps
