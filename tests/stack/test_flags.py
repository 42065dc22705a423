"""Flags of `lupin up` for what may not be there: said, never silent."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer

from lupin_cli.commands.up import _absent, _pose
from lupin_runtime.stack.table import Options, launch, rows


@pytest.fixture
def program_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A PATH of one empty folder, and no display."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    return tmp_path


def test_what_is_not_in_this_release_is_said(program_path: Path) -> None:
    absent = _absent(web=True, joystick=True, rviz=False)
    assert set(absent) == {"web", "joystick"}
    assert all("not in this release" in reason for reason in absent.values())
    assert _absent(web=False, joystick=False, rviz=False) == {}


def test_rviz_is_looked_for_and_its_absence_says_what_to_do(program_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "rviz2 on PATH" in _absent(False, False, rviz=True)["rviz"]
    program = program_path / "rviz2"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    assert "no display" in _absent(False, False, rviz=True)["rviz"]
    monkeypatch.setenv("DISPLAY", ":0")
    assert _absent(False, False, rviz=True) == {}


def test_the_initial_pose_goes_to_the_localisation_and_the_simulator_has_one_of_its_own() -> None:
    def given(options: Options) -> dict[str, object]:
        row = next(row for row in rows(options) if row.name == "localization")
        amcl = next(node for node in row.nodes if node.path.endswith(":AmclNode"))
        return dict(amcl.parameters(options))

    house = Path("house.yaml")
    assert given(Options(map_file=house)) == {"initial_pose.x": 0.0, "initial_pose.y": 0.0, "initial_pose.yaw": 0.0}
    assert given(Options(map_file=house, target="robot")) == {}
    stated = given(Options(map_file=house, target="robot", initial_pose=_pose("1.5,-2,0.5", house)))
    assert stated == {"initial_pose.x": 1.5, "initial_pose.y": -2.0, "initial_pose.yaw": 0.5}


@pytest.mark.parametrize("text", ["1,2", "1,2,east", "nan,0,0", "1,2,3,4", ""])
def test_an_initial_pose_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(typer.BadParameter, match="expected X,Y,YAW"):
        _pose(text, Path("house.yaml"))


def test_an_initial_pose_without_a_map_is_refused() -> None:
    with pytest.raises(typer.BadParameter, match="--map"):
        _pose("1,2,3", None)


@pytest.mark.parametrize(("target", "simulated"), [("sim", "true"), ("robot", "false")])
def test_rviz_is_a_row_of_the_table_on_the_time_of_the_target(target: str, simulated: str) -> None:
    options = Options(target=target, rviz=True)
    row = next(row for row in rows(options) if row.name == "rviz")
    assert row.on_death == "restart"
    arguments = launch(row, options).arguments
    assert arguments[:3] == ["-m", "lupin_runtime.stack.external", "rviz2"]
    assert f"use_sim_time:={simulated}" in arguments
    assert all(row.name != "rviz" for row in rows(Options(target=target)))
