"""`lupin runs` lists, keeps and removes runs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lupin_cli.app import app
from lupin_runtime.stack.runs import Run


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    runs = tmp_path / "lupin" / "runs"
    for number in range(8):
        run = Run(runs / f"2026010{number + 1}-000000-abcd")
        run.logs.mkdir(parents=True)
        run.write_state({"outcome": {"state": "DONE"}} if number else {"outcome": 3})
    return runs


def lupin(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["runs", *arguments])
    return result.exit_code, result.output


def test_old_runs_are_removed_but_kept_ones_are_not(folder: Path) -> None:
    rows = json.loads(lupin("list", "--json")[1])
    assert [row["state"] for row in rows] == ["DONE"] * 7 + ["NO_RESULT"]
    assert lupin("keep", "20260102")[0] == 0
    assert lupin("prune", "--count", "3", "--dry-run")[1].count("would remove") == 4
    assert len(list(folder.iterdir())) == 8
    status, out = lupin("prune", "--count", "3", "--json")
    assert status == 0 and [row["id"][:8] for row in json.loads(out)["removed"]] == [f"2026010{n}" for n in (1, 3, 4, 5)]
    assert sorted(path.name[:8] for path in folder.iterdir()) == ["20260102", "20260106", "20260107", "20260108"]
    assert "kept" in lupin("list")[1]
    assert lupin("keep", "20260102", "--off")[0] == 0
    assert lupin("prune", "--count", "2")[0] == 0
    assert len(list(folder.iterdir())) == 2
    assert lupin("prune")[1] == "nothing to remove\n"


def test_unknown_run_exits_with_3(folder: Path) -> None:
    assert folder.is_dir()
    assert lupin("keep", "1999")[0] == 3
