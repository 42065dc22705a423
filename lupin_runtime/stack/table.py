"""The whole runtime on a page: every process, what it waits for, what shows that it is up, and what its death means."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from lupin_runtime import graph
from lupin_runtime.stack.sentinels import Acts, Chain, Heard, Lifecycle, Sentinel, Serves

ONBOARD = "onboard"  # the robot's own half; `lupin up --target robot` is the laptop's
ALL_TAGS = 65535  # discovery goal "all that can be found": the largest count that StartMission can carry


@dataclass(frozen=True)
class Options:
    """What one `lupin up` asked for. Defaults are those of a run against the simulator without a mission."""

    target: str = "sim"
    world: str = "demo"
    seed: int = 0
    speed: float = 1.0
    cameras: bool = True
    slam: bool = True
    nav2: bool = True
    twin: bool = True
    perception: bool = True
    yolo: bool = True
    mission: bool = False
    record: bool = True
    rviz: bool = False
    map_file: Path | None = None
    initial_pose: tuple[float, float, float] | None = None  # on the map: x m, y m, yaw rad
    discovery_goal: int = 5
    sweeps: int = 0
    dependency_timeout_s: float = 120.0
    approach_overrides: Path | None = None
    layout: Path | None = None
    run_path: Path = Path()

    @property
    def simulated(self) -> bool:
        """Whether the robot is the simulator."""
        return self.target == "sim"

    def in_folder(self, path: Path) -> Options:
        """The same, for the run that keeps its files at `path`."""
        return replace(self, run_path=path)


Parameters = Mapping[str, Any]


def _none(_: Options) -> Parameters:
    return {}


@dataclass(frozen=True)
class NodeRow:
    """A node: its class as `module:Class`, and its parameters for a run."""

    path: str
    parameters: Callable[[Options], Parameters] = _none
    when: Callable[[Options], bool] = lambda _: True


@dataclass(frozen=True)
class ProcessRow:
    """A process of the stack; without nodes and a command one that somebody else runs, which is only waited for.

    `needs` gates its start and `ready` shows that it is up; `up_within_s` bounds the second. `on_death` is what its
    unplanned end means: "restart" it, or end the "mission" or the "run" with it, since what it knew is gone.
    """

    name: str
    nodes: tuple[NodeRow, ...]
    when: Callable[[Options], bool]
    needs: tuple[Sentinel, ...] = ()
    ready: tuple[Sentinel, ...] = ()
    on_death: str = "restart"
    up_within_s: float = 30.0
    # Stopped after all others, in this order: the drive bus says its zero while the wheels still listen.
    stop_rank: int = 0
    command: Callable[[Options], list[str]] | None = None
    memory_max_mb: int = 384
    next_command: str = ""  # what to type where it never comes up

    @property
    def elsewhere(self) -> bool:
        """Whether it is somebody else's to start."""
        return self.command is None and not self.nodes


def _simulated(options: Options) -> bool:
    return options.simulated


def _on_the_robot(options: Options) -> bool:
    return options.target == ONBOARD


def _close_to_hardware(options: Options) -> bool:
    return options.simulated or _on_the_robot(options)


def _simulator_command(options: Options) -> list[str]:
    command = ["-m", "lupin_sim", "--world", options.world, "--seed", str(options.seed)]
    command += ["--speed", str(options.speed), "--run-dir", str(options.run_path)]
    return command if options.cameras else [*command, "--no-cameras"]


def _rviz_command(options: Options) -> list[str]:
    command = ["-m", "lupin_runtime.stack.external", "rviz2", "--fixed-frame", graph.MAP_FRAME]
    return [*command, "--ros-args", "-p", f"use_sim_time:={str(options.simulated).lower()}"]


def _drive(options: Options) -> Parameters:
    # Twelve processes share the cores: the bus and the e-stop are asked to be served before the rest of them.
    return {"sink": "sim" if options.simulated else "robot", "serve_first": True}


def _estop(_: Options) -> Parameters:
    return {"serve_first": True}


def _strip(options: Options) -> Parameters:
    # The robot's strip was wired with its colours in another order.
    return {"drive_topic": graph.CMD_VEL_SINK_SIM.name} if options.simulated else {"color_order": "BRG"}


def _slam(options: Options) -> Parameters:
    parameters: dict[str, Any] = {"session_file": str(options.run_path / "slam_session.npz")}
    if options.simulated:
        # The frontier planner looks at the map once a second: no need to wait for the five that spare a WiFi link.
        parameters["map_update_interval"] = 1.0
    return parameters


def _map(options: Options) -> Parameters:
    return {"yaml_filename": str(options.map_file)}


def _amcl(options: Options) -> Parameters:
    pose = options.initial_pose
    if pose is None and options.simulated:
        # Every run begins at the world's start, and so did the run that made the map: there is its origin.
        pose = (0.0, 0.0, 0.0)
    return {} if pose is None else {f"initial_pose.{name}": value for name, value in zip(("x", "y", "yaw"), pose)}


def _annotator(options: Options) -> Parameters:
    if options.simulated:
        return {"image_topic": graph.BODY_IMAGE_SIM.name}
    # Raw pictures never cross the WiFi link.
    return {"image_topic": graph.BODY_IMAGE_ROBOT.name, "compressed": True}


def _bridge(options: Options) -> Parameters:
    return {"tag_file": str(options.layout)} if options.layout else {}


def _mission(options: Options) -> Parameters:
    parameters: dict[str, Any] = {
        "dependency_timeout_s": options.dependency_timeout_s,
        "discovery_goal": options.discovery_goal,
        "monitoring_sweeps": options.sweeps,
        "approach_overrides_file": str(options.approach_overrides or ""),
        "require_visual_confirmation": not options.simulated,
    }
    if options.simulated:
        parameters.update(
            flower_scan_dwell_s=4.0, arm_patrol_enabled=True, arm_travel_settle_s=3.2, exploration_timeout_s=900.0
        )
    return parameters


TABLE: tuple[ProcessRow, ...] = (
    ProcessRow(
        "robot",
        (),
        when=lambda o: o.target == "robot",
        # The vendor's half and ours; one that still boots is waited for.
        ready=(Heard(graph.SCAN), Heard(graph.ODOM), Heard(graph.ESTOP_STATE), Heard(graph.DRIVE_STATUS)),
        up_within_s=120.0,
        next_command="lupin doctor",
    ),
    ProcessRow(
        "sim",
        (),
        when=_simulated,
        command=_simulator_command,
        ready=(Heard(graph.CLOCK), Heard(graph.ODOM), Heard(graph.SCAN)),
        on_death="run",
        stop_rank=3,
        memory_max_mb=512,
    ),
    ProcessRow(
        "estop",
        (NodeRow("lupin_runtime.safety.node:EstopBridge", _estop),),
        when=_close_to_hardware,
        ready=(Heard(graph.ESTOP_STATE),),
        stop_rank=2,
    ),
    ProcessRow(
        "drive",
        (
            NodeRow("lupin_runtime.drive.node:TwistMux", _drive),
            NodeRow("lupin_runtime.drive.node:IdleStop", when=_simulated),
        ),
        when=_close_to_hardware,
        ready=(Heard(graph.DRIVE_STATUS),),
        stop_rank=1,
    ),
    ProcessRow(
        "slam",
        (
            NodeRow("lupin_runtime.slam.node:SlamNode", _slam),
            NodeRow("lupin_runtime.slam.node:SlamResetNode"),
        ),
        when=lambda o: o.slam and o.map_file is None,
        needs=(Heard(graph.SCAN),),
        ready=(Heard(graph.MAP),),
    ),
    ProcessRow(
        "localization",
        (
            NodeRow("lupin_runtime.slam.node:MapServer", _map),
            NodeRow("lupin_runtime.slam.node:AmclNode", _amcl),
        ),
        when=lambda o: o.slam and o.map_file is not None,
        needs=(Heard(graph.SCAN),),
        ready=(Heard(graph.MAP), Heard(graph.AMCL_POSE)),
    ),
    ProcessRow(
        "nav",
        (
            NodeRow("lupin_runtime.navigation.node:Navigator"),
            NodeRow("lupin_runtime.drive.smoother_node:VelocitySmoother"),
        ),
        when=lambda o: o.nav2,
        needs=(Heard(graph.MAP), Chain(graph.ODOM_FRAME, graph.BASE_FRAME)),
        ready=(Acts(graph.NAVIGATE_TO_POSE),),
    ),
    ProcessRow(
        "body",
        (
            NodeRow("lupin_runtime.arm.node:ArmPresetServer"),
            NodeRow("lupin_runtime.arm.calibrate_server:ArmCalibrateServer", when=_on_the_robot),
            NodeRow("lupin_runtime.arm.node:GripperActionBridge"),
            NodeRow("lupin_runtime.arm.node:ArmLibraryServer"),
            NodeRow("lupin_runtime.lights.node:LightStripBridge", _strip),
        ),
        when=_close_to_hardware,
        needs=(Heard(graph.JOINT_STATES),),
        ready=(Serves(graph.ARM_PRESET),),
    ),
    ProcessRow(
        "perception",
        (
            NodeRow("lupin_runtime.perception.annotator:TagAnnotator", _annotator),
            NodeRow("lupin_runtime.perception.flower_nodes:SimFlowerDetector", when=lambda o: o.yolo and o.simulated),
            NodeRow("lupin_runtime.perception.flower_nodes:YoloDetector", when=lambda o: o.yolo and not o.simulated),
            NodeRow("lupin_runtime.perception.aggregator:PerceptionAggregator"),
        ),
        when=lambda o: o.perception,
        ready=(Heard(graph.DISCOVERED_TAGS),),
    ),
    ProcessRow(
        "twin",
        (NodeRow("lupin_runtime.twin.node:TwinNode"),),
        when=lambda o: o.twin,
        ready=(Heard(graph.TWIN_STATE),),
    ),
    ProcessRow(
        "mission",
        (
            NodeRow("lupin_runtime.greenhouse.node:GreenhouseBridge", _bridge),
            NodeRow("lupin_runtime.mission.node:PoseSeed", when=lambda o: o.map_file is None),
            NodeRow("lupin_runtime.mission.node:MissionOrchestrator", _mission),
        ),
        when=lambda o: o.mission,
        ready=(Lifecycle(),),
        on_death="mission",
        up_within_s=150.0,
    ),
    ProcessRow(
        "recorder",
        (NodeRow("lupin_runtime.record.node:Recorder", lambda o: {"output": str(o.run_path / "recording.mcap")}),),
        when=lambda o: o.record,
    ),
    ProcessRow("rviz", (), when=lambda o: o.rviz, command=_rviz_command),
)


@dataclass(frozen=True)
class Launch:
    """A row made concrete for a run: what to execute and the configuration it reads."""

    row: ProcessRow
    arguments: list[str]
    config: dict[str, Any] | None = field(default=None)


def rows(options: Options) -> tuple[ProcessRow, ...]:
    """The rows that a run consists of, each with only the nodes it asks for."""
    chosen = (replace(row, nodes=tuple(n for n in row.nodes if n.when(options))) for row in TABLE if row.when(options))
    if _on_the_robot(options):
        # What heals the vendor's controllers starts after this half is up, so nothing of it may wait for what they publish.
        return tuple(replace(row, needs=()) for row in chosen)
    return tuple(chosen)


def launch(row: ProcessRow, options: Options) -> Launch:
    """How to start a row: arguments for the Python interpreter, and the file they name where there is one."""
    if row.command is not None:
        return Launch(row, row.command(options))
    config = {
        "name": row.name,
        "simulated_time": options.simulated,
        "nodes": [{"class": node.path, "parameters": dict(node.parameters(options))} for node in row.nodes],
    }
    path = options.run_path / "processes" / f"{row.name}.json"
    return Launch(row, ["-m", "lupin_runtime.stack.process", str(path)], config)
