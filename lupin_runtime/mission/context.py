"""What the activities of a mission share: the world, what is believed of it, and the run that is under way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.approach import TagPose
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.driving import Driver
from lupin_runtime.mission.hsm import Trigger
from lupin_runtime.mission.layout import Layout, Override
from lupin_runtime.mission.missions import ExplorationMission, TagWalk
from lupin_runtime.mission.ports import Beliefs, ObservationRecord, Ports, Reading

INSPECTION, EXPLORATION = "InspectionMission", "ExplorationMission"


@dataclass
class Run:
    """One mission from its start to its end."""

    mission_id: str
    kind: str
    started_at_ns: int
    exploration: ExplorationMission | None = None
    walk: TagWalk | None = None
    seeded: set[str] = field(default_factory=set)


@dataclass
class Context:
    """Handed to every activity. `fire` fires a trigger, `note` sets the last event, `pause` sets the flag."""

    config: MissionConfig
    ports: Ports
    driver: Driver
    beliefs: Beliefs
    layout: Layout
    overrides: Mapping[str, Override]
    fire: Callable[[Trigger], bool]
    note: Callable[[str], None]
    pause: Callable[[], None]
    battery_low: Callable[[], bool]
    run: Run | None = None
    dock: Pose2 | None = None

    @property
    def now_s(self) -> float:
        """Seconds of the clock for time-outs."""
        return self.ports.clock.now_s()

    def observe(self, source: str, tag_id: str, status: int, detail: str = "", reading: Reading | None = None) -> None:
        """Publish the end of a visit; an OK one carries the tag's own pose, else where the robot believes to be."""
        if self.run is None:
            return
        pose: TagPose | None = None
        if reading is not None:
            pose = self.beliefs.discovered.get(tag_id) or self.beliefs.pose
        self.ports.outlet.observe(ObservationRecord(self.run.mission_id, source, tag_id, status, detail, reading, pose))
