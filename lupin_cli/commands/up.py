"""`lupin up`: start the stack and follow the run; with `--mission`, explore the greenhouse and report."""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli import user_path
from lupin_cli.completion import worlds
from lupin_cli.exit_codes import USAGE_ERROR
from lupin_cli.printed_commands import lupin, print_next
from lupin_cli.terminal import echo, output_may_vanish, timed_progress
from lupin_runtime.bounded_file import expand_home
from lupin_runtime.interpreter import PYTHON
from lupin_runtime.ports import CONSOLE_PORT, FOXGLOVE_PORT, ROSBRIDGE_PORT, VIDEO_PORT

if TYPE_CHECKING:
    from lupin_cli.safe_console import SafeConsole
    from lupin_runtime.stack.options import Options

LUPIN_ENGINE, SYSTEM_ENGINE = "lupin", "system"
DEFAULT_GOAL = {"sim": "all", "robot": "5"}


def command(
    mission: bool = typer.Option(False, "--mission/--no-mission", help="Run the exploration mission, then stop the stack."),
    target: str = typer.Option("sim", help="Start the stack for sim or robot."),
    world: str = typer.Option(
        "demo", autocompletion=worlds, help="Simulate demo, course[:STRETCH], random:SEED, walled, or a layout file."
    ),
    seed: int = typer.Option(0, min=0, help="Seed the simulator's noise."),
    speed: float = typer.Option(1.0, help="Simulate this many seconds per second."),
    headless: bool = typer.Option(False, "--headless", help="Open no console and no window."),
    slam: bool = typer.Option(True, "--slam/--no-slam", help="Build a map while driving."),
    map_file: Path = typer.Option(
        None, "--map", parser=user_path.path, help="Localize on this saved map (YAML) instead of mapping."
    ),
    initial_pose: str = typer.Option(
        None,
        metavar="X,Y,YAW",
        help="Start at this pose of the map, m and rad [0,0,0 in the sim, AMCL's default on the robot].",
    ),
    navigation: bool = typer.Option(True, "--nav2/--no-nav2", help="Plan paths and drive."),
    twin: bool = typer.Option(True, "--twin/--no-twin", help="Keep a digital twin of the greenhouse."),
    perception: bool = typer.Option(True, "--perception/--no-perception", help="Detect tags and estimate their positions."),
    flowers: bool = typer.Option(True, "--yolo/--no-yolo", help="Detect flowers."),
    cameras: bool = typer.Option(True, "--cameras/--no-cameras", help="Simulate the cameras."),
    record: bool = typer.Option(True, "--record/--no-record", help="Record the graph to an MCAP file."),
    web: bool = typer.Option(True, "--web/--no-web", help="Serve the console: its page, and rosbridge for programs."),
    port: int = typer.Option(CONSOLE_PORT, min=1, max=65535, help="Serve the console's page on this port."),
    rosbridge_port: int = typer.Option(
        ROSBRIDGE_PORT, min=0, max=65535, help="Serve rosbridge on this port of localhost; 0: any free one."
    ),
    video: bool = typer.Option(
        True, "--video/--no-video", help=f"Serve the simulated cameras' images to the console, on 127.0.0.1:{VIDEO_PORT}."
    ),
    foxglove: bool = typer.Option(
        False,
        "--foxglove/--no-foxglove",
        help=f"Serve the graph to Foxglove and Lichtblick, read-only, on 127.0.0.1:{FOXGLOVE_PORT}.",
    ),
    joystick: bool = typer.Option(True, "--joystick/--no-joystick", help="Drive with a gamepad that is connected here."),
    rviz: bool = typer.Option(True, "--rviz/--no-rviz", help="Start RViz, if it is installed and there is a display."),
    discovery_goal: str = typer.Option(None, help="Number of tags to discover, or all [5 on the robot, all in the sim]."),
    monitoring_rounds: int = typer.Option(
        None, "--sweeps", min=0, help="Number of monitoring rounds; 0 repeats them forever [0 on the robot, 1 in the sim]."
    ),
    dependency_timeout_s: float = typer.Option(120.0, min=1.0, help="Let the mission wait this long for its dependencies, s."),
    overrides: Path = typer.Option(
        None, parser=user_path.path, help="Read approach poses of individual tags from this file (YAML)."
    ),
    engine: list[str] = typer.Option(
        [], "--engine", metavar="PART=ENGINE", help="Use Nav2 or slam_toolbox, if installed: nav2=system, slam=system."
    ),
    detach: bool = typer.Option(
        False, "--detach", help="Return once all processes are up, or with the reason why not; follow it with: lupin status."
    ),
    dry_run: bool = typer.Option(False, "--dry-run", help="Check all of that, and print what would be started; start nothing."),
    as_json: bool = typer.Option(False, "--json", help="Print only one JSON object on standard output, at the end."),
) -> None:
    """Start the stack; with --mission, explore, read every tag and write a report.

    Exit status: 0 the mission ended DONE, 1 it ended otherwise, 2 usage, 3 a process did not come up, 130 interrupted.

    Example: lupin up --mission --world random:7
    """
    world = str(expand_home(world))
    if target not in DEFAULT_GOAL:
        raise typer.BadParameter(f"{target!r} is neither sim nor robot", param_hint="--target")
    if speed <= 0.0:
        raise typer.BadParameter("must be positive", param_hint="--speed")
    _check_port(port, rosbridge_port)
    _check_files(map_file, overrides)
    if foxglove:
        _check_foxglove_extra()

    from lupin_cli.run.mission_client import goal_count
    from lupin_runtime.stack.options import Options

    no_cameras = _why_no_cameras() if cameras and target == "sim" else ""
    if no_cameras and mission:
        echo(f"lupin up: --mission: the tags are read by the cameras: {no_cameras}", err=True)
        raise typer.Exit(USAGE_ERROR)
    serves_video = video and web and cameras and target == "sim"
    requested = {"web": web, "video": serves_video, "foxglove": foxglove, "rviz": rviz and not headless}
    unavailable = _find_unavailable({flag for flag, wanted in requested.items() if wanted}, Options(port=port))
    if no_cameras:
        unavailable["cameras"] = no_cameras
    options = Options(
        target=target,
        world=world,
        layout=_layout(world, target),
        seed=seed,
        speed=speed,
        cameras=cameras and not no_cameras,
        slam=slam,
        map_file=map_file.resolve() if map_file else None,
        initial_pose=_pose(initial_pose, map_file),
        navigation=navigation,
        twin=twin,
        perception=perception,
        flowers=flowers,
        mission=mission,
        record=record,
        console=web and "web" not in unavailable,
        port=port,
        rosbridge_port=rosbridge_port,
        video=video and "video" not in unavailable,
        foxglove=foxglove and "foxglove" not in unavailable,
        joystick=joystick,
        rviz=rviz and not headless and "rviz" not in unavailable,
        discovery_goal=goal_count(discovery_goal or DEFAULT_GOAL[target]),
        monitoring_rounds=monitoring_rounds if monitoring_rounds is not None else int(target == "sim"),
        dependency_timeout_s=dependency_timeout_s,
        approach_overrides=overrides.resolve() if overrides else None,
        system_engines=_system_engines(engine),
    )
    _check_engines(options)
    if options.console:
        _report_taken_port(rosbridge_port)
    if dry_run:
        from lupin_cli.run.plan import show_plan

        for line in () if as_json else _not_started(unavailable):
            echo(line, err=True)
        show_plan(options, unavailable, as_json)
        return
    if detach:
        raise typer.Exit(_detach(unavailable, as_json))
    open_browser = not headless and sys.stdout.isatty() and bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    with output_may_vanish():  # a closed terminal ends the run, which still leaves its result and its report
        exit_status = _run(options, unavailable, as_json, open_browser)
    raise typer.Exit(exit_status)


def _pose(text: str | None, map_file: Path | None) -> tuple[float, float, float] | None:
    """Parse X,Y,YAW as three finite numbers. Raises typer.BadParameter."""
    if text is None:
        return None
    if map_file is None:
        raise typer.BadParameter("needs the saved map that it refers to; add --map", param_hint="--initial-pose")
    try:
        x, y, yaw = (float(part) for part in text.split(","))
    except ValueError:
        x = y = yaw = math.nan
    if not all(map(math.isfinite, (x, y, yaw))):
        raise typer.BadParameter(f"expected X,Y,YAW such as 1.5,-0.3,1.57, found {text!r}", param_hint="--initial-pose")
    return x, y, yaw


def _check_port(port: int, rosbridge_port: int) -> None:
    """Refuse a port for the page that another part of the run uses. Raises typer.BadParameter."""
    users = {rosbridge_port: "rosbridge", VIDEO_PORT: "the cameras' images", FOXGLOVE_PORT: "Foxglove"}
    if port in users:
        raise typer.BadParameter(f"{port} is the port of {users[port]}; choose another, such as 8092", param_hint="--port")


def _check_files(map_file: Path | None, overrides: Path | None) -> None:
    """Read the user's files before anything starts, so that an error stops the command and not a process of the run."""
    for path, hint in ((map_file, "--map"), (overrides, "--overrides")):
        if path is not None and not path.is_file():
            raise typer.BadParameter(f"there is no file {path}", param_hint=hint)
    try:
        if overrides is not None:
            from lupin_runtime.mission.overrides import load_overrides

            load_overrides(overrides)
        if map_file is not None:
            from lupin_runtime.slam.map_io import load_map

            load_map(map_file, warn=lambda text: echo(f"lupin up: {text}", err=True))
    except (ValueError, OSError) as error:
        echo(f"lupin up: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error


def _why_no_cameras() -> str:
    """Return why this machine cannot simulate cameras, with what to install; empty if it can."""
    from lupin_sim.graphics import DISABLED, NO_GRAPHICS, usable_backend

    return NO_GRAPHICS if usable_backend() == DISABLED else ""


def _system_engines(choices: Sequence[str]) -> tuple[str, ...]:
    """Return the parts of a run that `--engine` gives to the ROS distribution. Raises typer.BadParameter."""
    from lupin_runtime.stack.table import TABLE

    parts = [row.flag for row in TABLE if row.system is not None]
    known = " or ".join(f"{part}={LUPIN_ENGINE}|{SYSTEM_ENGINE}" for part in parts)
    chosen: dict[str, str] = {}
    for choice in choices:
        part, _, engine = choice.partition("=")
        if part not in parts or engine not in (LUPIN_ENGINE, SYSTEM_ENGINE):
            raise typer.BadParameter(f"expected {known}, found {choice!r}", param_hint="--engine")
        if part in chosen:
            raise typer.BadParameter(f"{part} is given twice: {chosen[part]} and {engine}", param_hint="--engine")
        chosen[part] = engine
    return tuple(part for part, engine in chosen.items() if engine == SYSTEM_ENGINE)


def _check_engines(options: Options) -> None:
    """Refuse an engine that has no part in the run, or that this machine does not have."""
    from lupin_runtime.stack.engines import find_problem
    from lupin_runtime.stack.table import rows

    engines = {row.flag: row.system.engine for row in rows(options) if row.engine and row.system is not None}
    for part in options.system_engines:
        if part not in engines:
            unless = "--map, which needs Lupin's own AMCL" if part == "slam" and options.map_file else f"--no-{part}"
            raise typer.BadParameter(f"{part}={SYSTEM_ENGINE} does not go with {unless}; leave one out", param_hint="--engine")
        if problem := find_problem(engines[part], os.environ):
            echo(f"lupin up: --engine {part}={SYSTEM_ENGINE}: {problem}", err=True)
            raise typer.Exit(USAGE_ERROR)


def _check_foxglove_extra() -> None:
    """Exit with a usage error if the extra `foxglove` is not installed."""
    from lupin_runtime.foxglove.extra import install_advice, is_installed

    if not is_installed():
        echo(f"lupin up: --foxglove: {install_advice()}", err=True)
        raise typer.Exit(USAGE_ERROR)


def _find_unavailable(requested: Collection[str], options: Options) -> dict[str, str]:
    """Return the requested parts, by their flags, that cannot be started on this machine, each with the reason."""
    from lupin_runtime.console.ports import PortInUse, check_free
    from lupin_runtime.stack.table import TABLE, select_nodes

    unavailable = {}
    for row in TABLE:
        try:
            for port in select_nodes(row, options).listens if row.flag in requested else ():
                check_free("127.0.0.1", port)
        except PortInUse as error:
            unavailable[row.flag] = f"{error}; choose another with --port" if row.flag == "web" else str(error)
    if "rviz" in requested and shutil.which("rviz2") is None:
        unavailable["rviz"] = "rviz2 is not on PATH; install rviz2 of your ROS distribution and source its setup.bash"
    elif "rviz" in requested and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        unavailable["rviz"] = "rviz2 needs a display; set DISPLAY or WAYLAND_DISPLAY"
    return unavailable


def _report_taken_port(rosbridge_port: int) -> None:
    """Say if another program, such as the vendor's rosbridge, uses the port for programs: browsers need another one."""
    from lupin_runtime.console.ports import PortInUse, check_free

    try:
        if rosbridge_port:
            check_free("127.0.0.1", rosbridge_port)
    except PortInUse as error:
        echo(f"lupin up: no rosbridge for programs: {error}; choose another port with --rosbridge-port", err=True)


def _layout(world: str, target: str) -> Path | None:
    """Check the world before anything starts; return its layout file, which the greenhouse bridge reads too, if it has one."""
    if target != "sim":
        return None
    from lupin_sim.worlds import WorldError, load_world

    try:
        load_world(world)
    except WorldError as error:
        raise typer.BadParameter(str(error), param_hint="--world") from error
    return Path(world).resolve() if world.endswith(".json") else None


def _run(options: Options, unavailable: dict[str, str], as_json: bool, open_browser: bool) -> int:
    from lupin_cli.run.live_view import LiveView
    from lupin_cli.run.next_steps import next_steps
    from lupin_cli.run.summary import summarize
    from lupin_cli.safe_console import SafeConsole
    from lupin_runtime.stack.dds import NoFreeDomain, NoRobotEnvironment
    from lupin_runtime.stack.runs import RunError
    from lupin_runtime.stack.stack_runner import StackRunner

    console = SafeConsole(stderr=as_json)
    announced = ready = False

    def observe(state: dict[str, Any]) -> None:
        nonlocal announced, ready
        if not announced and _console_is_up(state):
            announced = True
            _announce_console(runner.run.path, console, open_browser)
        view.show(state)
        if not ready and runner.supervisor.all_up():
            ready = True
            console.print(f"READY after {state['age_s']:.1f} s")
            for line in next_steps(runner.run, foreground=True):
                console.print(line, soft_wrap=True)

    try:
        view = LiveView(console)
        runner = StackRunner(options, observe)
    except (NoFreeDomain, NoRobotEnvironment, RunError) as error:
        echo(f"lupin up: {error}", err=True)
        return USAGE_ERROR
    if runner.applied:
        console.print(f"variables from ros-env.sh: {', '.join(runner.applied)}")
    for line in (*_not_started(unavailable), *_engine_lines(options)):
        console.print(line, soft_wrap=True)
    with view:
        console.print(f"run {runner.run.id}  logs: {runner.run.logs}", soft_wrap=True)
        outcome = runner.execute()
    result = summarize(runner.run, options, outcome, console)
    if as_json:
        print(json.dumps(result))
    return outcome.exit_status


def _console_is_up(state: dict[str, Any]) -> bool:
    return any(stage["name"] == "console" and stage["phase"] == "up" for stage in state["stages"])


def _announce_console(folder: Path, console: SafeConsole, open_browser: bool) -> None:
    """Print where the console is; on a desktop, also open its page."""
    from rich.text import Text

    from lupin_cli.run.console_access import access_banner
    from lupin_runtime.console.description import read_description

    described = read_description(folder)
    if described is None:
        return
    stream = sys.stderr if console.stderr else sys.stdout
    console.print(Text.from_ansi(access_banner(described, os.environ, stream)), soft_wrap=True)
    if open_browser:
        import webbrowser

        webbrowser.open(described.url)


def _not_started(unavailable: dict[str, str]) -> list[str]:
    return [f"not started: {reason} (--no-{flag})" for flag, reason in unavailable.items()]


def _engine_lines(options: Options) -> list[str]:
    from lupin_runtime.stack.engines import describe
    from lupin_runtime.stack.table import rows

    systems = [(row.name, row.system.engine) for row in rows(options) if row.engine and row.system is not None]
    return [f"{name}: {describe(engine, os.environ)}" for name, engine in systems]


def _detach(unavailable: dict[str, str], as_json: bool) -> int:
    """Start the same command in the background; return the exit status once all processes are up, or the run has ended."""
    from lupin_cli.run.detached import start
    from lupin_cli.run.next_steps import next_steps

    for line in _not_started(unavailable):
        echo(line, err=True)
    arguments = [argument for argument in sys.argv[1:] if argument != "--detach"]
    with timed_progress() as show:
        started = start([*PYTHON, "-m", "lupin_cli.app", *arguments], show)
    run = started.run
    if started.exit_status:
        echo(started.text, err=True)
        if run is not None:
            words = [started.failed_process] if started.failed_process else []
            print_next(lupin("logs", *words, "--run", run.id))
    elif run is not None and not as_json:
        echo(f"run {run.id} has started; its {started.processes} processes are up after {started.up_after_s:.1f} s")
        for line in next_steps(run, foreground=False):
            echo(line, wrap=False)
    if as_json and run is not None:
        print(json.dumps({"run": run.id, "up": not started.exit_status, "up_after_s": started.up_after_s, "why": started.text}))
    return started.exit_status
