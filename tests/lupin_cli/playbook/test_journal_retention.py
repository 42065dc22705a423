"""Old journals are removed, but never one that can be resumed or is in use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lupin_cli.playbook.journal import Journal, Mask, remove_old_journals


def test_only_old_journals_of_completed_runs_are_removed(tmp_path: Path) -> None:
    ends: list[dict[str, Any] | None] = [
        {"state": "done"},
        {"state": "failed", "closed": False},
        {"state": "failed", "closed": True},
        None,
        {"state": "done"},
    ]
    paths = []
    for number, end in enumerate(ends):
        journal = Journal.begin(tmp_path, f"play{number}", "", Mask(), {"playbook": "p"})
        if end is not None:
            journal.write("end", **end)
        paths.append(journal.path)
        if number != 4:
            journal.close()
    (tmp_path / "00000000-000000-damaged.jsonl").write_bytes(b"\xff{")
    assert remove_old_journals(tmp_path, newest=5) == []
    removed = remove_old_journals(tmp_path, newest=1)
    assert removed == [paths[0], paths[2]] and not paths[0].exists()
    assert all(path.exists() for path in (paths[1], paths[3], paths[4]))
