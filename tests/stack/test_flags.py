"""Flags of `lupin up` for what may not be there: said, never silent."""

from __future__ import annotations

from pathlib import Path

import pytest

from lupin_cli.commands.up import _absent
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


@pytest.mark.parametrize(("target", "simulated"), [("sim", "true"), ("robot", "false")])
def test_rviz_is_a_row_of_the_table_on_the_time_of_the_target(target: str, simulated: str) -> None:
    options = Options(target=target, rviz=True)
    row = next(row for row in rows(options) if row.name == "rviz")
    assert row.on_death == "restart"
    arguments = launch(row, options).arguments
    assert arguments[:3] == ["-m", "lupin_runtime.stack.external", "rviz2"]
    assert f"use_sim_time:={simulated}" in arguments
    assert all(row.name != "rviz" for row in rows(Options(target=target)))
