"""Changes of stops and of control: their sentences, their numbers, and what a later console reads of them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lupin_runtime.console.command_journal import CommandJournal
from lupin_runtime.console.console_events import MAX_EVENTS, ConsoleEvent, EventKind, RecentEvents
from lupin_runtime.console.run_files import last_commands
from lupin_runtime.console.stop_registry import HoldKind

PRESSED = ConsoleEvent(EventKind.STOP_PRESSED, "phone-1")


def test_every_kind_has_a_sentence() -> None:
    for kind in EventKind:
        assert "anne" in ConsoleEvent(kind, "anne", "ben").text


def test_every_kind_of_stop_is_an_event() -> None:
    for kind in HoldKind:
        assert EventKind(f"stop_{kind.value}")


def test_events_are_numbered_and_bounded() -> None:
    recent = RecentEvents()
    for index in range(MAX_EVENTS + 5):
        recent.add(PRESSED, index)
    assert [row["number"] for row in recent.all()] == list(range(6, MAX_EVENTS + 6))


def test_events_of_the_journal_are_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "commands.jsonl"
    journal = CommandJournal(path, pytest.fail)
    first = RecentEvents()
    journal.record("phone-1", "goal /navigate_to_pose")
    for event in (PRESSED, ConsoleEvent(EventKind.STOP_RELEASED, "laptop-1", "phone-1")):
        journal.record_event(event, first.add(event, 12.5))
    journal.close()
    second = RecentEvents(last_commands(path))
    assert second.all() == first.all()
    assert second.add(PRESSED, 13.0).number == 3


def test_malformed_events_of_a_journal_are_left_out() -> None:
    good = {"number": 1, "robot_s": 2.0, "kind": "stop_pressed", "name": "a", "other": ""}
    rows = [
        1,
        {},
        {"event": 3},
        {"event": {}},
        {"event": {**good, "robot_s": "x"}},
        {"event": {**good, "x": 1}},
        {"event": good},
    ]
    assert RecentEvents(rows).all() == [good]


def test_equal_events_within_a_second_are_all_written(tmp_path: Path) -> None:
    path = tmp_path / "commands.jsonl"
    journal, recent = CommandJournal(path, pytest.fail), RecentEvents()
    for _ in range(10):
        journal.record_event(PRESSED, recent.add(PRESSED, 1.0))
    for _ in range(1000):
        journal.record_event(PRESSED, recent.add(PRESSED, 1.0))
    journal.close()
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    assert [row["event"]["number"] for row in rows[:10]] == list(range(1, 11))
    assert rows[0]["session"] == "phone-1" and rows[0]["what"] == "phone-1 stopped the robot"
    assert len(rows) < 500, "a flood is counted"


def test_full_disk_does_not_keep_an_event_from_browsers() -> None:
    warnings: list[str] = []
    journal, recent = CommandJournal(Path("/dev/full"), warnings.append), RecentEvents()
    journal.record_event(PRESSED, recent.add(PRESSED, 1.0))
    assert len(recent.all()) == 1 and len(warnings) == 1
