"""Options of `lupin up`: their defaults, and parts that are not available on this machine."""

from __future__ import annotations

import inspect
import os
import socket
from dataclasses import replace
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from lupin_cli.commands.up import _find_unavailable, _pose, _report_taken_port, command
from lupin_runtime.ports import CONSOLE_PORT
from lupin_runtime.stack import table
from lupin_runtime.stack.options import LAPTOP_TARGETS, ONBOARD, Options
from lupin_runtime.stack.readiness import Port
from lupin_runtime.stack.table import TABLE, launch, rows


@pytest.fixture
def program_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A PATH of one empty folder, and no display."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    return tmp_path


@pytest.mark.parametrize("target", ["sim", "robot", ONBOARD])
def test_gamepads_are_read_everywhere_unless_refused(target: str) -> None:
    found = [row for row in rows(Options(target=target)) if row.name == "joystick"]
    assert [row.optional for row in found] == [True]
    assert all(row.name != "joystick" for row in rows(Options(target=target, joystick=False)))


@pytest.mark.parametrize("flag", sorted({row.flag for row in TABLE if row.listens}))
def test_used_port_is_reported_with_its_owner(flag: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        monkeypatch.setattr(
            table, "TABLE", tuple(replace(row, ready=(Port(port),)) if row.flag == flag else row for row in TABLE)
        )
        assert f"port {port} is in use by process {os.getpid()} (" in _find_unavailable({flag}, Options())[flag]
        assert _find_unavailable(set(), Options()) == {}
    assert _find_unavailable({flag}, Options()) == {}


def test_used_console_port_names_its_owner_and_the_option() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        reason = _find_unavailable({"web"}, Options(port=port))["web"]
    assert reason.startswith(f"port {port} is in use by process {os.getpid()} (")
    assert reason.endswith("; choose another with --port")


def test_console_is_up_once_its_chosen_port_listens() -> None:
    options = Options(console=True, port=8123)
    row = next(row for row in rows(options) if row.name == "console")
    assert row.listens == (8123,)
    assert row.nodes[0].parameters(options)["port"] == 8123
    assert Options.from_json(options.as_json()).port == 8123


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--port", "8091"], "8091 is the port of the cameras' images"),
        (["--port", "9191", "--rosbridge-port", "9191"], "9191 is the port of rosbridge"),
        (["--port", "0"], "0 is not in the range"),
        (["--port", "65536"], "65536 is not in the range"),
        (["--port", "web"], "'web' is not a valid int"),
    ],
)
def test_unusable_console_port_is_refused(arguments: list[str], reason: str) -> None:
    program = typer.Typer()
    program.command()(command)
    done = CliRunner().invoke(program, arguments, env={"COLUMNS": "200", "TERM": "dumb"})
    assert done.exit_code == 2 and reason in " ".join(done.output.split()).replace("│ ", "")


def test_flag_of_every_row_is_an_option_of_up() -> None:
    options = {
        declared.removeprefix("--").split("/")[0]
        for name, each in inspect.signature(command).parameters.items()
        for declared in (each.default.param_decls or (f"--{name}",))
    }
    assert {row.flag for row in TABLE} - {""} <= options
    assert all(row.flag for row in TABLE if row.targets == LAPTOP_TARGETS)
    assert all(row.flag for row in TABLE if row.listens)


def test_simulated_cameras_are_served_with_the_console() -> None:
    def serves(**options: bool | str) -> bool:
        return any(row.name == "video" for row in rows(replace(Options(), **options)))  # type: ignore[arg-type]

    assert serves(console=True)
    assert not serves(console=False)
    for without in ("video", "cameras"):
        assert not serves(console=True, **{without: False})
    assert not serves(console=True, target="robot")


def test_mission_without_graphics_names_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from lupin_sim import graphics

    monkeypatch.setattr(graphics, "usable_backend", lambda: graphics.DISABLED)
    program = typer.Typer()
    program.command()(command)
    done = CliRunner().invoke(program, ["--mission"])
    assert done.exit_code == 2 and "apt-get install libegl1 libgl1" in done.output


@pytest.mark.parametrize("target", ["sim", "robot", ONBOARD])
def test_foxglove_runs_only_if_requested_and_restarts(target: str) -> None:
    assert all(row.name != "foxglove" for row in rows(Options(target=target)))
    found = [row for row in rows(Options(target=target, foxglove=True)) if row.name == "foxglove"]
    assert [row.on_death for row in found] == ([] if target == ONBOARD else ["restart"])


def test_missing_rviz_or_display_is_reported_with_advice(program_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "rviz2 is not on PATH" in _find_unavailable({"rviz"}, Options())["rviz"]
    program = program_path / "rviz2"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    assert "needs a display" in _find_unavailable({"rviz"}, Options())["rviz"]
    monkeypatch.setenv("DISPLAY", ":0")
    assert _find_unavailable({"rviz"}, Options()) == {}


def test_initial_pose_reaches_amcl_with_a_simulator_default() -> None:
    def given(options: Options) -> dict[str, object]:
        row = next(row for row in rows(options) if row.name == "localization")
        amcl = next(node for node in row.nodes if node.path.endswith(":AmclNode"))
        return {name: value for name, value in amcl.parameters(options).items() if name.startswith("initial_pose.")}

    house = Path("house.yaml")
    assert given(Options(map_file=house)) == {"initial_pose.x": 0.0, "initial_pose.y": 0.0, "initial_pose.yaw": 0.0}
    assert given(Options(map_file=house, target="robot")) == {}
    stated = given(Options(map_file=house, target="robot", initial_pose=_pose("1.5,-2,0.5", house)))
    assert stated == {"initial_pose.x": 1.5, "initial_pose.y": -2.0, "initial_pose.yaw": 0.5}


@pytest.mark.parametrize("text", ["1,2", "1,2,east", "nan,0,0", "1,2,3,4", ""])
def test_malformed_initial_pose_is_refused(text: str) -> None:
    with pytest.raises(typer.BadParameter, match="expected X,Y,YAW"):
        _pose(text, Path("house.yaml"))


def test_initial_pose_without_a_map_is_refused() -> None:
    with pytest.raises(typer.BadParameter, match="--map"):
        _pose("1,2,3", None)


@pytest.mark.parametrize(("target", "simulated"), [("sim", "true"), ("robot", "false")])
def test_rviz_row_uses_the_clock_of_the_target(target: str, simulated: str) -> None:
    options = Options(target=target, rviz=True)
    row = next(row for row in rows(options) if row.name == "rviz")
    assert row.on_death == "restart"
    arguments = launch(row, options).arguments
    assert arguments[:3] == ["-m", "lupin_runtime.stack.external", "rviz2"]
    assert f"use_sim_time:={simulated}" in arguments
    assert all(row.name != "rviz" for row in rows(Options(target=target)))


def test_option_defaults_equal_those_of_a_run() -> None:
    """The defaults in `lupin up --help` are those of Options, except those that depend on the target."""
    defaults = {name: each.default.default for name, each in inspect.signature(command).parameters.items()}
    fields = {name: value for name, value in vars(Options()).items() if name in defaults}
    by_target = {"discovery_goal", "monitoring_rounds", "rviz"}
    assert {name: defaults[name] for name in fields.keys() - by_target} == {
        name: fields[name] for name in fields.keys() - by_target
    }
    assert len(fields) >= 15


def test_used_rosbridge_port_leaves_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        _report_taken_port(port)
    said = capsys.readouterr()
    assert f"no rosbridge for programs: port {port} is in use by process {os.getpid()} (" in said.err
    assert "--rosbridge-port" in said.err and not said.out
    _report_taken_port(port)
    _report_taken_port(0)
    assert capsys.readouterr().err == ""
    row = next(row for row in TABLE if row.name == "console")
    assert row.listens == (CONSOLE_PORT,), "the console is up without the other port"
    assert row.nodes[0].parameters(Options(rosbridge_port=7))["rosbridge_port"] == 7
