"""What the options of a run give each process: the parameters of its nodes, and the arguments of its program."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from lupin_runtime import graph
from lupin_runtime.mission.overrides import OVERRIDES_NAME
from lupin_runtime.safety.expected_sources import BUTTON, CONSOLE, WITNESS
from lupin_runtime.stack.engines import SLAM_TOOLBOX, Engine
from lupin_runtime.stack.options import ROBOT_CAMERAS, Options

Parameters = Mapping[str, Any]


def simulator_command(options: Options) -> list[str]:
    command = ["-m", "lupin_sim", "--world", options.world, "--seed", str(options.seed)]
    command += ["--speed", str(options.speed), "--run-dir", str(options.run_path)]
    return command if options.cameras else [*command, "--no-cameras"]


def rviz_command(options: Options) -> list[str]:
    command = ["-m", "lupin_runtime.stack.external", "rviz2", "--fixed-frame", graph.MAP_FRAME]
    return [*command, "--ros-args", "-p", f"use_sim_time:={str(options.simulated).lower()}"]


def drive(options: Options) -> Parameters:
    # A dozen processes share the cores: the drive bus and the e-stop request a higher priority than the others.
    return {"sink": "sim" if options.simulated else "robot", "serve_first": True}


def estop(options: Options) -> Parameters:
    # The console of a laptop comes and goes while the robot runs: the robot cannot expect it.
    started = {BUTTON: options.estop_button, CONSOLE: options.simulated and options.console, WITNESS: True}
    expected = " ".join(source for source, is_expected in started.items() if is_expected)
    return {"serve_first": True, "expected_sources": expected}


def console(options: Options) -> Parameters:
    return {
        "folder": str(options.run_path),
        "host": "",
        "tls": True,
        "port": options.port,
        "rosbridge_port": options.rosbridge_port,
    }


def video(options: Options) -> Parameters:
    # Browsers get the robot's images through the laptop's console, other programs directly.
    return {"host": "0.0.0.0"} if options.target == ROBOT_CAMERAS else {}


def light_strip(options: Options) -> Parameters:
    # The robot's strip expects its colors in the order blue, red, green.
    return {"drive_topic": graph.CMD_VEL_SINK_SIM.name} if options.simulated else {"color_order": "BRG", "onboard": True}


def slam(options: Options) -> Parameters:
    parameters: dict[str, Any] = {"session_file": str(options.run_path / "slam_session.npz")}
    if options.simulated:
        # The frontier planner reads the map once a second; the default of 5 s saves bandwidth on WiFi, which is not used here.
        parameters["map_update_interval"] = 1.0
    return parameters


def toolbox(options: Options) -> Parameters:
    interval = {name: value for name, value in slam(options).items() if name == "map_update_interval"}
    return {**programs(SLAM_TOOLBOX)(options), **interval}


def programs(engine: Engine) -> Callable[[Options], Parameters]:
    def parameters(options: Options) -> Parameters:
        file = options.run_path / "processes" / f"{engine.title.lower()}.yaml"
        return {"programs": [str(program) for program in engine.programs], "parameter_file": str(file)}

    return parameters


def map_server(options: Options) -> Parameters:
    return {"yaml_filename": str(options.map_file)}


def amcl(options: Options) -> Parameters:
    # Every simulated run starts at the same pose, which is the origin of a map that was made in such a run.
    pose = options.initial_pose or ((0.0, 0.0, 0.0) if options.simulated else ())
    stated = {f"initial_pose.{name}": value for name, value in zip(("x", "y", "yaw"), pose)}
    return {"state_file": str(options.run_path / "localization.json"), **stated}


def annotator(options: Options) -> Parameters:
    if options.simulated:
        return {"image_topic": graph.BODY_IMAGE_SIM.name}
    # Raw images are too large for the WiFi link, and the next JPEG is better than one that is sent again.
    return {"image_topic": graph.BODY_IMAGE_ROBOT.name, "compressed": True, "reliable": False}


def recorder(options: Options) -> Parameters:
    # Every subscriber gets its own copy across the WiFi link: the recorder's would take as much of it as perception's.
    body = {} if options.simulated else {"body_images": "scanning"}
    return {"output": str(options.run_path / "recording.mcap"), **body}


def greenhouse(options: Options) -> Parameters:
    return {"tag_file": str(options.layout)} if options.layout else {}


def _overrides_file(options: Options) -> str:
    """The file of the run's approach overrides; empty for a process that is started by itself, without a run."""
    path = options.run_path / OVERRIDES_NAME
    return str(path) if path.is_file() else ""


def mission(options: Options) -> Parameters:
    parameters: dict[str, Any] = {
        "dependency_timeout_s": options.dependency_timeout_s,
        "discovery_goal": options.discovery_goal,
        "monitoring_sweeps": options.monitoring_rounds,
        "approach_overrides_file": _overrides_file(options),
        "require_visual_confirmation": not options.simulated,
    }
    if options.simulated:
        parameters.update(
            flower_scan_dwell_s=4.0, arm_patrol_enabled=True, arm_travel_settle_s=3.2, exploration_timeout_s=900.0
        )
    return parameters
