"""Finds what is wrong with a running run from its `state.json`, for `lupin status` and the live view."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

# The supervisor writes its state once a second.
STALE_S = 2.5


def supervisor_silent_s(state: Mapping[str, Any], now_s: float | None = None) -> float:
    """Return for how many seconds the supervisor has not written its state; 0 if that is no longer than usual."""
    written_s = state.get("monotonic_s")
    if not isinstance(written_s, (int, float)):
        return 0.0  # an earlier version, or a damaged file
    silent_s = (time.monotonic() if now_s is None else now_s) - written_s
    return silent_s if silent_s > STALE_S else 0.0


def alarms(state: Mapping[str, Any], now_s: float | None = None) -> list[str]:
    """Return one sentence per alarm.

    Alarms name processes that do not respond or are being replaced, and nodes that bypass the drive bus or could forge the
    e-stop. `now_s` is seconds of CLOCK_MONOTONIC; now by default.
    """
    found = []
    silent_s = supervisor_silent_s(state, now_s)
    if silent_s:
        found.append(f"the supervisor has not responded for {silent_s:.0f} s; stop the run with: lupin down")
    found += [f"{stage['name']} {stage['trouble']}" for stage in state.get("stages", []) if stage.get("trouble")]
    return found + list(state.get("alarms", []))
