"""`lupin sim`: the list of worlds, and errors of pictures and films."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lupin_cli.commands.sim import app

runner = CliRunner()


def test_worlds_are_listed_as_table_and_json() -> None:
    table = runner.invoke(app, ["worlds"])
    assert table.exit_code == 0
    for word in ("demo", "course:STRETCH", "random:SEED", "walled", "layout.json"):
        assert word in table.stdout
    rows = json.loads(runner.invoke(app, ["worlds", "--json"]).stdout)
    demo = rows[0]
    assert (demo["name"], demo["tags"], demo["tags_reachable"]) == ("demo", 12, 12)
    assert rows[-1]["tags_reachable"] == rows[-1]["tags"] - 1


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["picture", "--world", "atlantis"], "unknown world 'atlantis'"),
        (["picture", "--camera", "side"], "overview, top, follow, front, gripper"),
        (["picture", "--out", "picture.pdf"], ".png or .jpg"),
        (["video", "--out", "film.avi"], ".mp4 or .gif"),
        (["picture", "--trajectory", "missing.tum"], "missing.tum"),
    ],
)
def test_invalid_picture_arguments_are_usage_errors(
    arguments: list[str], text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = runner.invoke(app, arguments)
    assert result.exit_code == 2
    assert text in result.stderr
    assert result.stdout == ""
    assert not list(tmp_path.iterdir())


def test_trajectory_without_poses_is_refused(tmp_path: Path) -> None:
    empty = tmp_path / "empty.tum"
    empty.write_text("# nothing\n")
    result = runner.invoke(app, ["picture", "--trajectory", str(empty)])
    assert result.exit_code == 2
    assert "contains no poses" in result.stderr


def test_missing_graphics_error_names_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    result = runner.invoke(app, ["picture", "--world", "walled", "--out", str(tmp_path / "a.png")])
    assert result.exit_code == 1
    assert "apt-get install libegl1 libgl1" in result.stderr
