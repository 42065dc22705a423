"""`lupin map plan`: output and exit codes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from lupin_cli.commands.map import app
from lupin_runtime.gridmap import GridMap
from lupin_runtime.slam.map_io import save_map


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    cells = np.zeros((100, 120), np.int8)
    cells[30:, 60] = 100
    cells[50:80, 80:100] = 100
    path = tmp_path / "house.yaml"
    save_map(path, GridMap(cells, 0.05, -1.0, -2.0))
    return path


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["plan", *map(str, arguments)])


def test_json_output_is_the_path_alone(map_file: Path) -> None:
    result = run(map_file, "--from", "-0.5,2.0", "--to", "2.5,2.5", "--radius", 0.2, "--json")
    assert result.exit_code == 0
    answer = json.loads(result.stdout)
    assert answer["path"][0] == [-0.5, 2.0]
    assert answer["path"][-1] == [2.5, 2.5]
    legs = sum(math.dist(a, b) for a, b in zip(answer["path"], answer["path"][1:]))
    assert answer["length_m"] == pytest.approx(legs, abs=1e-3)
    # Around the wall's foot at (2.0 .. 2.05, -0.5), 0.2 m from it.
    assert 6.95 < answer["length_m"] < 7.15
    assert min(y for _, y in answer["path"]) < -0.65
    assert answer["planning_ms"] > 0.0


def test_text_output_lists_length_and_points(map_file: Path) -> None:
    result = run(map_file, "--from=-0.5,0", "--to=0.5,0")
    assert result.exit_code == 0
    assert "1.00 m" in result.stdout


@pytest.mark.parametrize(
    ("start", "goal", "why"),
    [
        ("-0.5,0", "3.5,1.2", "the goal (3.5, 1.2) is within 0.22 m"),
        ("-0.5,0", "50,0", "outside the map"),
        ("2.0,1.0", "0,0", "the start (2, 1) is within 0.22 m"),
    ],
)
def test_missing_path_exits_1_with_the_reason(map_file: Path, start: str, goal: str, why: str) -> None:
    result = run(map_file, f"--from={start}", f"--to={goal}", "--json")
    assert result.exit_code == 1
    answer = json.loads(result.stdout)
    assert answer["length_m"] is None
    assert answer["path"] == []
    assert why in answer["reason"]
    assert why in result.stderr


@pytest.mark.parametrize(
    ("start", "goal", "why"),
    [
        ("-0.5,0", "4.5,1", "the goal (4.5, 1) is in unknown space"),
        ("-0.5,0", "3.9,-1", "the goal (3.9, -1) is within 0.22 m of unknown space"),
        ("4.5,1", "-0.5,0", "the start (4.5, 1) is in unknown space"),
        ("-0.5,0", "3.5,1.2", "the goal (3.5, 1.2) is within 0.22 m of an obstacle"),
        ("-0.5,0", "5.5,1", "no path 0.44 m wide leads through known space from (-0.5, 0) to (5.5, 1)"),
    ],
)
def test_known_space_alone_is_named_as_the_reason(tmp_path: Path, start: str, goal: str, why: str) -> None:
    cells = np.zeros((100, 140), np.int8)
    cells[50:80, 80:100] = 100
    cells[:, 100:120] = -1
    save_map(tmp_path / "part.yaml", GridMap(cells, 0.05, -1.0, -2.0))
    result = run(tmp_path / "part.yaml", f"--from={start}", f"--to={goal}", "--no-unknown", "--json")
    assert result.exit_code == 1
    assert json.loads(result.stdout)["reason"] == why
    known = run(tmp_path / "part.yaml", f"--from={start}", f"--to={goal}", "--json")
    assert known.exit_code == (1 if "obstacle" in why else 0)


@pytest.mark.parametrize(
    "options",
    [
        ("--from=1", "--to=0,0"),
        ("--from=a,b", "--to=0,0"),
        ("--from=0,0", "--to=nan,0"),
        ("--from=0,0", "--to=0,inf"),
        ("--from=0,0", "--to=1,0", "--radius=-1"),
        ("--from=0,0", "--to=1,0", "--radius=nan"),
        ("--from=0,0", "--to=1,0", "--radius=30"),
        ("--from=0,0",),
    ],
)
def test_invalid_argument_is_a_usage_error(map_file: Path, options: tuple[Any, ...]) -> None:
    result = run(map_file, *options, "--json")
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr


def test_unreadable_map_is_named(tmp_path: Path) -> None:
    missing = run(tmp_path / "none.yaml", "--from=0,0", "--to=1,0")
    assert missing.exit_code == 2
    assert "none.yaml" in missing.stderr
    broken = tmp_path / "broken.yaml"
    broken.write_text("image: gone.pgm\nresolution: zero\n")
    result = run(broken, "--from=0,0", "--to=1,0")
    assert result.exit_code == 2
    assert "broken.yaml" in result.stderr
