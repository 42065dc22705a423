"""Old runs are removed, but never one that is up, kept, or among the newest."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.stack.retention import NEWEST_KEPT, StoredRun, removable, remove, stored_runs
from lupin_runtime.stack.runs import Run, create_run

STORED = st.lists(
    st.builds(lambda size, alive, kept: (size, alive, kept), st.integers(0, 100), st.booleans(), st.booleans()), max_size=30
).map(lambda rows: [StoredRun(Run(Path(f"/runs/{i:02d}")), *row) for i, row in enumerate(rows)])


@given(STORED, st.integers(0, 20), st.integers(0, 1500))
def test_oldest_unprotected_runs_beyond_a_limit_are_removed(stored: list[StoredRun], count: int, size: int) -> None:
    removed = removable(stored, count, size)
    assert not any(one.is_live or one.is_kept for one in removed)
    assert not set(removed) & set(stored[len(stored) - min(NEWEST_KEPT, count) :])
    left = [one for one in stored if one not in removed]
    if removed:  # one fewer would not have been enough
        assert len(left) + 1 > count or sum(one.size_bytes for one in left) + removed[-1].size_bytes > size
        older = stored[: stored.index(removed[-1])]
        assert all(one in removed or one.is_live or one.is_kept for one in older)
    protected = [one for one in stored[: len(stored) - min(NEWEST_KEPT, count)] if one.is_live or one.is_kept]
    if not protected and count >= NEWEST_KEPT:
        assert len(left) <= count


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Run]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    made = []
    for number in range(3):
        run = Run(tmp_path / "lupin" / "runs" / f"2026010{number}-000000-abcd")
        (run.logs / "deep").mkdir(parents=True)
        (run.logs / "deep" / "nav.log").write_bytes(b"x" * 8192)
        made.append(run)
    return made


def test_removal_deletes_the_directory_but_no_link_target(runs: list[Run], tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "file").touch()
    (runs[0].path / "link").symlink_to(precious)
    (tmp_path / "lupin" / "runs" / "20250101-000000-link").symlink_to(precious)
    runs[1].set_kept(True)
    _run, lock = create_run()
    assert [one.run for one in removable(stored_runs(), max_runs=0)] == [runs[0], runs[2]]
    assert all(one.size_bytes >= 8192 for one in stored_runs()[:3])
    assert remove(stored_runs()[0])
    assert not runs[0].path.exists() and (precious / "file").exists() and runs[1].path.exists()
    os.close(lock)
