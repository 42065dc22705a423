"""State that the mission's activities share: ports, world model, flags and the mission in progress."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from lupin_runtime.geometry import Pose2
from lupin_runtime.layout import Layout
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.driving import Driver
from lupin_runtime.mission.hsm_spec import Trigger
from lupin_runtime.mission.missions import ExplorationMission, VisitPlan
from lupin_runtime.mission.overrides import Override
from lupin_runtime.mission.ports import Ports
from lupin_runtime.mission.records import ClimateReading, MapPose, ObservationRecord, WorldModel
from lupin_runtime.safety.battery_monitor import BatteryMonitor

INSPECTION, EXPLORATION = "InspectionMission", "ExplorationMission"


@dataclass
class ActiveMission:
    """One mission from its start to its end. `kind` is INSPECTION or EXPLORATION.

    `requested_tags` are the tags whose first reading was requested.
    """

    mission_id: str
    kind: str
    started_at_ns: int
    exploration: ExplorationMission | None = None
    visits: VisitPlan | None = None
    requested_tags: set[str] = field(default_factory=set)


@dataclass
class Context:
    """What every activity receives. `fire` fires a trigger of the state machine.

    `estop_engaged` is the last state received, and low battery is read from its monitor, so no request can clear a flag whose
    cause persists. `estop_released_s` is the real time of the last release.
    """

    config: MissionConfig
    ports: Ports
    driver: Driver
    layout: Layout
    overrides: Mapping[str, Override]
    fire: Callable[[Trigger], bool]
    battery: BatteryMonitor
    dock: Pose2
    world_model: WorldModel = field(default_factory=WorldModel)
    mission: ActiveMission | None = None
    paused: bool = False
    estop_engaged: bool = False
    estop_released_s: float | None = None
    last_error: str = ""

    @property
    def now_s(self) -> float:
        """Seconds of the clock for timeouts."""
        return self.ports.clock.now_s()

    def pause(self) -> None:
        """Set the pause flag and publish it."""
        self.paused = True
        self.ports.publisher.state_changed()

    def publish_observation(
        self, source: str, tag_id: str, status: int, detail: str = "", reading: ClimateReading | None = None
    ) -> None:
        """Publish the result of a visit. With a reading it carries the tag's pose, or the robot's if the tag has none."""
        if self.mission is None:
            return
        pose: MapPose | None = None
        if reading is not None:
            pose = self.world_model.discovered.get(tag_id) or self.world_model.pose
        self.ports.publisher.publish_observation(
            ObservationRecord(self.mission.mission_id, source, tag_id, status, detail, reading, pose)
        )
