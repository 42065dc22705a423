"""`lupin up`: the whole stack from nothing, and with `--mission` the whole job."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import typer

DEFAULT_GOAL = {"sim": "all", "robot": "5"}
DETACH_BOUND_S = 20.0


def command(
    mission: bool = typer.Option(False, "--mission/--no-mission", help="Run the exploration mission, then end."),
    target: str = typer.Option("sim", help="What to run against: sim or robot."),
    world: str = typer.Option("demo", help="Simulated world: demo, course[:STRETCH], random:SEED, or a layout file."),
    seed: int = typer.Option(0, help="Seed of the simulator's noise."),
    speed: float = typer.Option(1.0, help="Simulated seconds per second."),
    headless: bool = typer.Option(False, "--headless", help="No page, no window."),
    slam: bool = typer.Option(True, "--slam/--no-slam", help="Mapping."),
    map_file: Path = typer.Option(None, "--map", help="Localise on this saved map (YAML) instead of mapping."),
    initial_pose: str = typer.Option(
        None, metavar="X,Y,YAW", help="Where the robot stands on that map, m and rad [0,0,0 in the sim, else AMCL's own]."
    ),
    nav2: bool = typer.Option(True, "--nav2/--no-nav2", help="Navigation."),
    twin: bool = typer.Option(True, "--twin/--no-twin", help="Digital twin."),
    perception: bool = typer.Option(True, "--perception/--no-perception", help="Tags and the aggregator."),
    yolo: bool = typer.Option(True, "--yolo/--no-yolo", help="Flower detector."),
    cameras: bool = typer.Option(True, "--cameras/--no-cameras", help="The simulated cameras."),
    record: bool = typer.Option(True, "--record/--no-record", help="Record the graph to MCAP."),
    web: bool = typer.Option(True, "--web/--no-web", help="Web console; not in this release, which is said."),
    joystick: bool = typer.Option(True, "--joystick/--no-joystick", help="Xbox teleop; not in this release, which is said."),
    rviz: bool = typer.Option(True, "--rviz/--no-rviz", help="RViz, where the machine has it and a display."),
    discovery_goal: str = typer.Option(None, help="Tags to discover: a number, or all [5 on the robot, all in the sim]."),
    sweeps: int = typer.Option(None, min=0, help="Monitoring sweeps, 0 for ever [0 on the robot, 1 in the sim]."),
    dependency_timeout_s: float = typer.Option(120.0, min=1.0, help="How long the mission waits for what it needs."),
    overrides: Path = typer.Option(None, help="Approach overrides (YAML)."),
    detach: bool = typer.Option(False, "--detach", help="Return when the run has begun; see: lupin status."),
    as_json: bool = typer.Option(False, "--json", help="Print one JSON object at the end, alone on standard output."),
) -> None:
    """Bring the whole stack up; with --mission, explore, read every tag and report.

    Exit status: 0 the mission ended DONE, 1 it ended otherwise, 2 usage, 3 a stage never came up, 130 interrupted.
    """
    if target not in DEFAULT_GOAL:
        raise typer.BadParameter(f"{target!r} is neither sim nor robot", param_hint="--target")
    if speed <= 0.0:
        raise typer.BadParameter("must be positive", param_hint="--speed")
    _check_files(map_file, overrides)
    if detach:
        _detach()
        return

    from lupin_cli.mission_calls import goal_count
    from lupin_runtime.stack.table import Options

    absent = _absent(web and not headless, joystick, rviz and not headless)
    options = Options(
        target=target,
        world=world,
        layout=_layout(world, target),
        seed=seed,
        speed=speed,
        cameras=cameras,
        slam=slam,
        map_file=map_file.resolve() if map_file else None,
        initial_pose=_pose(initial_pose, map_file),
        nav2=nav2,
        twin=twin,
        perception=perception,
        yolo=yolo,
        mission=mission,
        record=record,
        rviz=rviz and not headless and "rviz" not in absent,
        discovery_goal=goal_count(discovery_goal or DEFAULT_GOAL[target]),
        sweeps=sweeps if sweeps is not None else int(target == "sim"),
        dependency_timeout_s=dependency_timeout_s,
        approach_overrides=overrides.resolve() if overrides else None,
    )
    raise typer.Exit(_run(options, absent, as_json))


def _pose(text: str | None, map_file: Path | None) -> tuple[float, float, float] | None:
    """Three finite numbers, or a usage error."""
    if text is None:
        return None
    if map_file is None:
        raise typer.BadParameter("is a pose on a saved map: give that as well, with --map", param_hint="--initial-pose")
    try:
        x, y, yaw = (float(part) for part in text.split(","))
    except ValueError:
        x = y = yaw = math.nan
    if not all(map(math.isfinite, (x, y, yaw))):
        raise typer.BadParameter(f"expected X,Y,YAW such as 1.5,-0.3,1.57, found {text!r}", param_hint="--initial-pose")
    return x, y, yaw


def _check_files(map_file: Path | None, overrides: Path | None) -> None:
    """Read what was given once before anything starts: a process that finds it broken later can only do without it."""
    for path, hint in ((map_file, "--map"), (overrides, "--overrides")):
        if path is not None and not path.is_file():
            raise typer.BadParameter(f"there is no file {path}", param_hint=hint)
    try:
        if overrides is not None:
            from lupin_runtime.mission.layout import load_overrides

            load_overrides(overrides)
        if map_file is not None:
            from lupin_runtime.slam.map_io import load_map

            load_map(map_file)
    except (ValueError, OSError) as error:
        typer.echo(f"lupin up: {error}", err=True)
        raise typer.Exit(2) from error


def _absent(web: bool, joystick: bool, rviz: bool) -> dict[str, str]:
    """What was asked for and cannot be started here, each with the reason."""
    absent = {}
    if web:
        absent["web"] = "the web console is not in this release"
    if joystick:
        absent["joystick"] = "the Xbox teleop is not in this release"
    if rviz and shutil.which("rviz2") is None:
        absent["rviz"] = "there is no rviz2 on PATH; install rviz2 of your ROS distribution and source its setup.bash"
    elif rviz and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        absent["rviz"] = "rviz2 has no display to open a window on"
    return absent


def _layout(world: str, target: str) -> Path | None:
    """The layout file behind a world name, checked before anything starts; the bridge reads the same file."""
    if target != "sim":
        return None
    from lupin_sim.worlds import WorldError, load_world

    try:
        load_world(world)
    except WorldError as error:
        raise typer.BadParameter(str(error), param_hint="--world") from error
    return Path(world).resolve() if world.endswith(".json") else None


def _run(options: Any, absent: dict[str, str], as_json: bool) -> int:
    from rich.console import Console

    from lupin_cli.live import LiveView
    from lupin_cli.results import conclude
    from lupin_runtime.stack.dds import NoFreeDomain, NoRobotEnvironment
    from lupin_runtime.stack.runs import RunError
    from lupin_runtime.stack.session import Session

    console = Console(stderr=as_json)
    try:
        view = LiveView(console)
        session = Session(options, view.show)
    except (NoFreeDomain, NoRobotEnvironment, RunError) as error:
        typer.echo(f"lupin up: {error}", err=True)
        return 2
    if session.applied:
        console.print(f"applied from ros-env.sh: {', '.join(session.applied)}", highlight=False)
    for flag, reason in absent.items():
        console.print(f"not started: {reason} (--no-{flag})", highlight=False, soft_wrap=True)
    with view:
        console.print(f"run {session.run.id}  logs: {session.run.logs}", highlight=False, soft_wrap=True)
        outcome = session.execute()
    result = conclude(session.run, options, outcome, console)
    if as_json:
        print(json.dumps(result))
    return outcome.exit_status


def _detach() -> None:
    """Start the same command in a session of its own and return as soon as its run exists."""
    from lupin_runtime.stack.runs import live_runs

    arguments = [argument for argument in sys.argv[1:] if argument != "--detach"]
    before = {run.id for run in live_runs()}
    child = subprocess.Popen(
        [sys.executable, "-m", "lupin_cli.app", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    deadline = time.monotonic() + DETACH_BOUND_S
    while time.monotonic() < deadline and child.poll() is None:
        mine = [run for run in live_runs() if run.id not in before and run.info().get("pid") == child.pid]
        if mine:
            typer.echo(f"run {mine[0].id} has begun; follow it with: lupin status --watch; end it with: lupin down")
            return
        time.sleep(0.05)
    said = child.stderr.read().decode(errors="replace") if child.poll() is not None and child.stderr else ""
    typer.echo(f"the run did not begin within {DETACH_BOUND_S:.0f} s\n{said}", err=True)
    raise typer.Exit(3)
