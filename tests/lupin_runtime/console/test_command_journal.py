"""The command journal: who asked for what, and when."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime.console import command_journal
from lupin_runtime.console.command_journal import CommandJournal


def rows(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_command_is_logged_with_session_time_and_detail(tmp_path: Path) -> None:
    path = tmp_path / "commands.jsonl"
    journal = CommandJournal(path, pytest.fail)
    journal.record("phone-1", "call /mission/start", {"mission_type": "x"})
    journal.record("phone-2", "publish /cmd_vel_manual", refused="phone-1 has control")
    journal.close()
    first, second = rows(path)
    assert datetime.fromisoformat(first.pop("time")).tzinfo is not None
    assert first == {"session": "phone-1", "what": "call /mission/start", "detail": "{'mission_type': 'x'}"}
    assert second["refused"] == "phone-1 has control"
    assert path.stat().st_mode & 0o777 == 0o600


def test_repeats_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr("lupin_runtime.console.command_journal.time.monotonic", lambda: now_s)
    path = tmp_path / "commands.jsonl"
    journal = CommandJournal(path, pytest.fail)
    for _ in range(33):
        journal.record("phone-1", "publish /cmd_vel_manual", refused="no control")
        now_s += 0.0625
    journal.record("phone-1", "stop")
    journal.close()
    assert [(row["what"], row.get("repeats", 0)) for row in rows(path)] == [
        ("publish /cmd_vel_manual", 0),
        ("publish /cmd_vel_manual", 15),
        ("publish /cmd_vel_manual", 15),
        ("stop", 0),
    ]


def test_large_or_hostile_request_gives_one_short_line(tmp_path: Path) -> None:
    path = tmp_path / "commands.jsonl"
    journal = CommandJournal(path, pytest.fail)
    deep: Any = []
    for _ in range(900):
        deep = [deep]
    for number, detail in enumerate((["x" * 10**6] * 1000, {str(i): i for i in range(10**5)}, deep, "\n\r\0\u2028")):
        journal.record("client", f"request {number}", detail, refused="\n" * 10**6)
    journal.close()
    assert len(rows(path)) == 4
    assert all(len(line) < 20_000 for line in path.read_text().splitlines())


def test_journal_size_is_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command_journal, "MAX_BYTES", 2000)
    path = tmp_path / "commands.jsonl"
    journal = CommandJournal(path, pytest.fail)
    for number in range(100):
        journal.record("phone-1", f"request {number}")
    journal.close()
    files = sorted(tmp_path.iterdir())
    assert [file.name for file in files] == ["commands.jsonl", "commands.jsonl.1"]
    assert all(file.stat().st_size < 2200 for file in files)
    assert rows(path)[-1]["what"] == "request 99" or rows(tmp_path / "commands.jsonl.1")[-1]["what"] == "request 99"


def test_full_disk_is_reported_once_and_raises_nothing() -> None:
    warnings: list[str] = []
    journal = CommandJournal(Path("/dev/full"), warnings.append)
    for number in range(3):
        journal.record("phone-1", f"stop {number}")
    journal.close()
    assert warnings == ["the command journal is not written: [Errno 28] No space left on device"]


def test_journal_is_written_again_when_the_disk_has_space(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr("lupin_runtime.console.command_journal.time.monotonic", lambda: now_s)
    path, warnings = tmp_path / "commands.jsonl", list[str]()
    path.symlink_to("/dev/full")
    journal = CommandJournal(path, warnings.append)
    journal.record("phone-1", "stop")
    path.unlink()
    journal.record("phone-1", "release")
    assert not path.exists(), "an attempt for every command would cost time"
    now_s += 10.0
    journal.record("phone-1", "drive")
    journal.close()
    assert [json.loads(line)["what"] for line in path.read_text().splitlines() if line] == ["drive"]
    assert len(warnings) == 1


def test_journal_in_a_missing_folder_raises_nothing(tmp_path: Path) -> None:
    warnings: list[str] = []
    CommandJournal(tmp_path / "gone" / "commands.jsonl", warnings.append).record("phone-1", "stop")
    assert len(warnings) == 1
