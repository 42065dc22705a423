"""The run's history for pages that are opened later."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from lupin_runtime.console.run_history import MAX_LINES, MAX_STATES, MAX_WARNINGS, LogLines, MissionStates


def state(sec: int, **changes: Any) -> Any:
    fields = {"lifecycle_state": "READY", "mission_phase": "", "current_target": "", "last_error": "", "last_event": ""}
    rest = {"estop_engaged": False, "paused": False, "last_event_severity": 0}
    header = SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=0))
    return SimpleNamespace(header=header, **{**fields, **rest, **changes})


def line(number: int, level: int = 20) -> Any:
    stamp = SimpleNamespace(sec=number, nanosec=0)
    return SimpleNamespace(stamp=stamp, level=level, name="nav", msg=f"line {number}", file="a.py", function="f", line=3)


def test_only_changed_states_are_kept() -> None:
    states = MissionStates()
    for sec in range(10):
        states.add(state(sec))
    states.add(state(10, paused=True))
    assert [each["header"]["stamp"]["sec"] for each in states.all()] == [0, 10]
    for sec in range(1000):
        states.add(state(sec, current_target=str(sec)))
    assert len(states.all()) == MAX_STATES


def test_warnings_stay_in_order_through_a_flood() -> None:
    lines = LogLines()
    lines.add(line(0, level=30))
    for number in range(1, 2 * MAX_LINES):
        lines.add(line(number))
    kept = lines.all()
    assert len(kept) == MAX_LINES + 1 and kept[0]["msg"] == "line 0"
    assert [row["stamp"]["sec"] for row in kept] == sorted(row["stamp"]["sec"] for row in kept)
    for number in range(2 * MAX_WARNINGS):
        lines.add(line(number, level=50))
    assert len(lines.all()) == MAX_LINES + MAX_WARNINGS


def test_long_lines_are_cut() -> None:
    lines = LogLines()
    long = line(1)
    long.msg = "x" * 1_000_000
    lines.add(long)
    assert len(lines.all()[0]["msg"]) <= 2000
