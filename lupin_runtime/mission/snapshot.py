"""Builds the published mission state."""

from __future__ import annotations

from lupin_runtime.mission.context import Context
from lupin_runtime.mission.events import label_event
from lupin_runtime.mission.hsm import MissionHsm
from lupin_runtime.mission.hsm_spec import INSPECTING, MONITORING
from lupin_runtime.mission.inspecting import Inspecting
from lupin_runtime.mission.missions import Counters
from lupin_runtime.mission.records import MissionSnapshot

_MAX_UINT16 = 65535


def take_snapshot(context: Context, hsm: MissionHsm, inspecting: Inspecting) -> MissionSnapshot:
    """Return the current values of the MissionState message's fields."""
    mission = context.mission
    event = label_event(context.last_error)
    exploration = mission.exploration if mission is not None else None
    visiting = hsm.top_level_state in (INSPECTING, MONITORING)
    counters = Counters()
    if mission is not None and mission.visits is not None:
        counters = mission.visits.counters
    elif exploration is not None:
        counters = exploration.counters
    return MissionSnapshot(
        mission_id=mission.mission_id if mission is not None else "",
        mission_type=mission.kind if mission is not None else "",
        lifecycle_state=hsm.top_level_state,
        mission_phase="CONFIRMING" if visiting and inspecting.confirming else hsm.substate,
        current_target=inspecting.target if visiting else "",
        targets_total=_uint16(counters.total),
        targets_completed=_uint16(counters.completed),
        targets_failed=_uint16(counters.failed),
        targets_unreachable=_uint16(counters.unreachable),
        targets_skipped=_uint16(counters.skipped),
        last_error=event.code,
        last_event=event.label,
        last_event_severity=event.severity,
        tags_discovered=_uint16(exploration.discovered) if exploration is not None else 0,
        discovery_goal=_uint16(exploration.goal) if exploration is not None else 0,
        estop_engaged=context.estop_engaged,
        paused=context.paused,
        battery_percentage=context.battery.percentage,
        battery_low=context.battery.low,
        started_at_ns=mission.started_at_ns if mission is not None else 0,
    )


def _uint16(count: int) -> int:
    """Clip a count to the message's uint16 field: monitoring that runs for weeks exceeds it."""
    return min(_MAX_UINT16, count)
