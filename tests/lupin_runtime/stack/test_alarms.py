"""Alarms of a run, from its state."""

from __future__ import annotations

from lupin_runtime.stack.alarms import STALE_S, alarms


def test_healthy_run_has_no_alarm() -> None:
    assert alarms({"monotonic_s": 10.0, "stages": [{"name": "nav", "trouble": ""}], "alarms": []}, 10.0 + STALE_S) == []
    assert alarms({}, 0.0) == []


def test_each_trouble_gives_one_alarm() -> None:
    state = {"monotonic_s": 10.0, "stages": [{"name": "nav", "trouble": "does not respond"}], "alarms": ["/cmd_vel …"]}
    assert alarms(state, 14.0) == [
        "the supervisor has not responded for 4 s; stop the run with: lupin down",
        "nav does not respond",
        "/cmd_vel …",
    ]
