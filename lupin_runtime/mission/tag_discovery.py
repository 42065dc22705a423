"""Updates the world model's discovered tags, and the counts that depend on them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from lupin_runtime.mission.context import Context
from lupin_runtime.mission.hsm import MissionHsm
from lupin_runtime.mission.hsm_spec import MONITORING
from lupin_runtime.mission.missions import MonitoringMission, tag_order
from lupin_runtime.mission.records import MapPose


class TagDiscovery:
    """`newest` is perception's newest list of tags. The world model also keeps tags that are missing from it."""

    def __init__(self, context: Context, hsm: MissionHsm) -> None:
        self._context, self._hsm = context, hsm
        self.newest: dict[str, MapPose] = {}

    def update(self, tags: Mapping[str, MapPose]) -> None:
        """Handle a list of tags. Tags without an id or with a position that is not finite are ignored."""
        self.newest = {tag: pose for tag, pose in tags.items() if tag and all(map(math.isfinite, (pose.x, pose.y, pose.z)))}
        self._context.world_model.discovered.update(self.newest)
        self._update_mission()

    def restart(self) -> None:
        """Forget tags that are missing from the newest list: a new mission starts, perhaps on a new map."""
        self._context.world_model.discovered = dict(self.newest)
        self._update_mission()

    def _update_mission(self) -> None:
        mission, discovered = self._context.mission, self._context.world_model.discovered
        if mission is None or mission.exploration is None:
            return
        mission.exploration.discovered = len(discovered)
        if isinstance(mission.visits, MonitoringMission) and self._hsm.top_level_state == MONITORING:
            for tag_id in sorted(discovered, key=tag_order):
                mission.visits.add(tag_id)
