"""What a mission's state messages tell of its events."""

from __future__ import annotations

from typing import Any

from lupin_msgs.msg import MissionState

from lupin_runtime.stack.mission_events import MAX_EVENTS, MissionEvents, mission_clock_s


def state(second: int, **fields: Any) -> MissionState:
    message = MissionState(**{"mission_id": "m1", "lifecycle_state": "EXPLORING", **fields})
    message.started_at.sec, message.header.stamp.sec = 100, 100 + second
    return message


def test_changes_are_noted_once_with_the_missions_clock() -> None:
    events = MissionEvents()
    for message in (
        MissionState(),
        state(0),
        state(5, tags_discovered=1),
        state(6, tags_discovered=1, current_target="7"),
        state(9, tags_discovered=1, targets_completed=1),
        state(9, tags_discovered=1, targets_completed=1),
        state(12, tags_discovered=2, targets_completed=1, estop_engaged=True),
        state(20, tags_discovered=2, targets_completed=1, lifecycle_state="RETURNING"),
    ):
        events.note(message)
    assert [(entry["clock_s"], entry["text"]) for entry in events.entries] == [
        (0.0, "mission started"),
        (5.0, "1 tag discovered"),
        (9.0, "tag 7 read"),
        (12.0, "2 tags discovered"),
        (12.0, "e-stop engaged"),
        (20.0, "e-stop released"),
        (20.0, "returning"),
    ]


def test_failed_visit_and_fault_have_their_reason() -> None:
    events = MissionEvents()
    events.note(state(1, current_target="4"))
    events.note(state(2, targets_failed=1, last_event="no reading"))
    events.note(state(3, targets_failed=1, last_event="the robot does not move", lifecycle_state="FAULT"))
    texts = [entry["text"] for entry in events.entries]
    assert texts == ["mission started", "tag 4 not read: no reading", "fault: the robot does not move"]


def test_events_are_bounded_and_end_with_their_mission() -> None:
    events = MissionEvents()
    for second in range(50):
        events.note(state(second, paused=second % 2 == 1))
    assert len(events.entries) == MAX_EVENTS
    events.note(state(60, mission_id="m2"))
    assert [entry["text"] for entry in events.entries] == ["mission started"]


def test_clock_is_none_before_the_first_mission() -> None:
    assert mission_clock_s(MissionState()) is None
    assert mission_clock_s(state(7)) == 7.0
