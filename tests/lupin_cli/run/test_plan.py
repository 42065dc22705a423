"""`lupin up --dry-run` says what it would start, and starts nothing."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lupin_cli.app import app
from lupin_runtime.stack.runs import runs_directory


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def names(*arguments: str) -> list[str]:
    done = CliRunner().invoke(app, ["up", "--dry-run", "--json", "--headless", *arguments])
    assert done.exit_code == 0, done.output
    return [process["name"] for process in json.loads(done.stdout)["processes"]]


def test_plan_has_the_parts_that_the_options_select() -> None:
    everything = names("--mission")
    assert everything[0] == "sim" and {"nav", "mission", "recorder"} <= set(everything)
    assert set(everything) - set(names("--no-mission")) == {"mission"}
    assert set(everything) - set(names("--mission", "--no-record", "--no-yolo")) >= {"recorder"}
    assert not runs_directory().exists()


def test_robot_s_own_part_is_waited_for() -> None:
    done = CliRunner().invoke(app, ["up", "--dry-run", "--target", "robot", "--headless", "--no-video"])
    assert done.exit_code == 0 and "would wait for " in done.output and "would start nav" in done.output


def test_dry_run_refuses_what_a_run_refuses() -> None:
    done = CliRunner().invoke(app, ["up", "--dry-run", "--world", "nowhere"])
    assert done.exit_code == 2 and "nowhere" in done.output
