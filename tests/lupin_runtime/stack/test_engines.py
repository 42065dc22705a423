"""Nav2 and slam_toolbox instead of Lupin's own engines: plan, parameters, refusals, and a run with stand-ins."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest
import typer
import yaml
from typer.testing import CliRunner

from lupin_cli.commands.up import command
from lupin_runtime import ament, graph
from lupin_runtime.environment import without_ros_wheels
from lupin_runtime.navigation.mppi import MppiParameters
from lupin_runtime.navigation.nav2_parameters import nav2_parameters
from lupin_runtime.slam.toolbox_engine import toolbox_parameters
from lupin_runtime.stack.engines import NAV2, SLAM_TOOLBOX, find_problem
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.table import TABLE, launch, rows
from tests.support.stand_in_engines import EVERYWHERE, install, parameter_mistakes
from tests.support.waiting import wait_until

BOTH = Options(system_engines=("nav2", "slam"))


def test_system_engines_replace_nodes_and_keep_conditions() -> None:
    plans = [{row.name: row for row in rows(options)} for options in (Options(), BOTH)]
    assert plans[0].keys() == plans[1].keys()
    assert {name: row.engine for name, row in plans[1].items() if row.engine} == {"slam": "slam_toolbox", "nav": "Nav2"}
    for name in ("slam", "nav"):
        own, system = (plan[name] for plan in plans)
        assert (own.needs, own.ready, own.commands_motion) == (system.needs, system.ready, system.commands_motion)
    names = [node.path.split(":")[1] for node in plans[1]["nav"].nodes]
    assert names == ["Nav2Gate", "VelocitySmoother", "Nav2Engine"], "the last is on no path between the gate and the drive bus"
    assert all(row.system is None for row in TABLE if row.name in ("drive", "estop"))


def test_engines_of_a_run_survive_its_record() -> None:
    assert Options.from_json(json.loads(json.dumps(BOTH.as_json()))).system_engines == ("nav2", "slam")
    assert Options.from_json({"system_engines": ["slam", 7]}).system_engines == ("slam",)


def flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        yield from flat(value, f"{prefix}{name}.") if isinstance(value, dict) else [(prefix + name, value)]


def test_generated_parameters_are_those_of_the_real_nodes() -> None:
    found = yaml.safe_load(yaml.safe_dump({**nav2_parameters(True), **toolbox_parameters(True, 1.0)}))
    assert found.pop("/**")["ros__parameters"].keys() == EVERYWHERE.keys()
    for name, content in found.items():
        values = dict(flat(content.get(name, content)["ros__parameters"]))
        assert values and parameter_mistakes(name, values) == []


def test_limits_of_nav2_are_those_of_the_table() -> None:
    nodes, own = nav2_parameters(False), MppiParameters()
    follow = nodes["controller_server"]["ros__parameters"]["FollowPath"]
    assert (follow["vx_max"], follow["vx_min"], follow["wz_max"]) == (own.vx_max, own.vx_min, own.wz_max)
    assert follow["motion_model"] == "Omni" and len(follow["critics"]) == 8
    for costmap in ("local_costmap", "global_costmap"):
        assert nodes[costmap][costmap]["ros__parameters"]["robot_radius"] == own.robot_radius


def test_missing_package_names_what_to_install(tmp_path: Path) -> None:
    install(tmp_path, [NAV2])
    environment = {"AMENT_PREFIX_PATH": f"/nowhere:{tmp_path}"}
    assert find_problem(NAV2, environment) == ""
    assert "install it with: sudo apt-get install ros-jazzy-slam-toolbox" in find_problem(SLAM_TOOLBOX, environment)
    assert "no controller_server of nav2_controller" in find_problem(NAV2, {})
    (tmp_path / "lib/nav2_planner/planner_server").chmod(0o644)
    assert "no planner_server of nav2_planner" in find_problem(NAV2, environment)


def test_engine_of_another_distribution_is_refused(tmp_path: Path) -> None:
    install(tmp_path, versions={"nav2_behaviors": "1.1.18"})
    problem = find_problem(NAV2, {"AMENT_PREFIX_PATH": str(tmp_path)})
    assert f"nav2_behaviors in {tmp_path} has version 1.1.18, expected 1.3" in problem


def test_distribution_that_was_not_sourced_is_sourced_for_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ament, "SYSTEM_PREFIX", install(tmp_path, [SLAM_TOOLBOX]))
    (tmp_path / "setup.sh").write_text("export SOURCED=yes\n")
    (tmp_path / "lib/slam_toolbox/async_slam_toolbox_node").write_text('#!/bin/sh\necho "$SOURCED $*"\n')
    found = ament.find_package("slam_toolbox", {})
    assert found is not None
    for is_sourced, printed in ((False, "yes --ros-args x\n"), (True, " --ros-args x\n")):
        command = replace(found, is_sourced=is_sourced).command("async_slam_toolbox_node")
        assert subprocess.run([*command, "--ros-args", "x"], capture_output=True, text=True, check=True).stdout == printed
    assert found.command("sync_slam_toolbox_node") == []


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--engine", "mux=system"], "expected slam=lupin|system or nav2=lupin|system, found 'mux=system'"),
        (["--engine", "nav2=best"], "found 'nav2=best'"),
        (["--engine", "nav2=system", "--engine", "nav2=lupin"], "nav2 is given twice: system and lupin"),
        (["--engine", "nav2=system", "--no-nav2"], "nav2=system does not go with --no-nav2"),
        (["--engine", "nav2=system"], "sudo apt-get install ros-jazzy-navigation2"),
    ],
)
def test_unusable_engine_is_refused(arguments: list[str], reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    program = typer.Typer()
    program.command()(command)
    done = CliRunner().invoke(program, arguments, env={"COLUMNS": "300", "TERM": "dumb"})
    assert done.exit_code == 2 and reason in " ".join(done.output.split())


def test_foreign_programs_get_no_library_of_the_wheels(tmp_path: Path) -> None:
    own = f"{sys.prefix}/lib"
    given = {"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1", "LD_LIBRARY_PATH": f"{own}:{tmp_path}", "HOME": "/h"}
    assert without_ros_wheels(given) == {"LD_LIBRARY_PATH": str(tmp_path), "HOME": "/h"}
    assert without_ros_wheels({**given, "LD_LIBRARY_PATH": own}) == {"HOME": "/h"}


def test_programs_and_their_parameters_are_in_the_run(tmp_path: Path) -> None:
    options = BOTH.in_folder(tmp_path)
    config = next(launch(row, options).config for row in rows(options) if row.name == "nav")
    assert config is not None
    given = config["nodes"][-1]["parameters"]
    assert given["programs"][0] == "nav2_controller/controller_server/controller_server"
    assert given["parameter_file"] == str(tmp_path / "processes/nav2.yaml")


def has_ended(process: psutil.Process) -> bool:
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


@pytest.mark.sim
@pytest.mark.graph
@pytest.mark.xdist_group("stack")
def test_goal_reaches_nav2_and_its_death_is_named(
    launch: Callable[..., Any], join: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from action_msgs.msg import GoalStatus
    from nav2_msgs.action import NavigateToPose

    monkeypatch.setenv("AMENT_PREFIX_PATH", str(install(tmp_path / "ros")))
    without = ("--no-twin", "--no-perception", "--no-record", "--no-cameras")
    run = launch("--json", *without, "--engine", "nav2=system", "--engine", "slam=system")
    state = run.wait_up()
    assert {stage["name"]: stage["engine"] for stage in state["stages"] if stage["engine"]} == {
        "slam": "slam_toolbox",
        "nav": "Nav2",
    }
    client = join(run)
    client.until(lambda: client.call(graph.BT_NAVIGATOR_STATE).current_state.label == "active", "active Nav2")

    def send(x: float) -> Any:
        goal = NavigateToPose.Goal()
        goal.pose.header.frame_id, goal.pose.pose.position.x, goal.pose.pose.orientation.w = graph.MAP_FRAME, x, 1.0
        handle = client.send(graph.NAVIGATE_TO_POSE, goal)
        return client.within(handle.get_result_async)

    # All that moves is canceled: Nav2's goal ends as aborted if the path that it follows was canceled first.
    ended_early = (GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED)

    def status(result: Any) -> int:
        return int(wait_until(result.done, lambda: f"the goal's end: {run.log('nav')[-3000:]}") and result.result().status)

    assert status(send(1.0)) == GoalStatus.STATUS_SUCCEEDED
    in_lost_map = send(100.0)
    run.wait(lambda: run.speed_m_s() > 0.1, "a robot that Nav2 drives")
    psutil.Process(run.stage("slam")["pid"]).children()[0].kill()
    assert status(in_lost_map) in ended_early
    run.wait(lambda: run.speed_m_s() < 0.01, "a robot at rest")
    run.wait(lambda: run.stage("slam")["phase"] == "up", "a new map")
    assert status(send(1.0)) == GoalStatus.STATUS_SUCCEEDED
    far = send(100.0)
    run.wait(lambda: run.speed_m_s() > 0.1, "a robot that Nav2 drives")
    client.call(graph.SIM_PRESS_ESTOP, data=True)
    assert status(far) in ended_early
    run.wait(lambda: run.speed_m_s() < 0.01, "a robot at rest")
    assert run.state()["alarms"] == [] and "Nav2" in run.lupin("status").stdout
    nav = psutil.Process(run.stage("nav")["pid"])
    programs = nav.children()
    known = len(run.state()["deaths"])
    next(each for each in programs if "controller_server" in each.cmdline()).kill()
    death = run.until(lambda state: len(state["deaths"]) > known, "another death")["deaths"][known]
    assert "controller_server was killed by SIGKILL" in death["status"]
    assert (death["stage"], death["consequence"]) == ("nav", "restarted")
    run.wait(lambda: all(map(has_ended, programs)), "the end of every program of the old process, beside which none may run")
