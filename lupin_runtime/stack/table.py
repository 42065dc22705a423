"""The table of processes: what each one runs and waits for, what shows that it is up, and what follows if it dies.

Adding a process is adding one row to TABLE.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from lupin_runtime import graph
from lupin_runtime.ports import CONSOLE_PORT, FOXGLOVE_PORT, VIDEO_PORT
from lupin_runtime.stack import parameters
from lupin_runtime.stack.engines import NAV2, SLAM_TOOLBOX, Engine
from lupin_runtime.stack.options import LAPTOP_TARGETS, ONBOARD, ROBOT, ROBOT_CAMERAS, SIM, Options
from lupin_runtime.stack.parameters import Parameters
from lupin_runtime.stack.readiness import ActionReady, MissionReady, Port, Readiness, ServiceReady, TopicSample, TransformReady


def _none(_: Options) -> Parameters:
    return {}


@dataclass(frozen=True)
class NodeRow:
    """A node: its class as `module:Class`, its parameters for a run, and the condition under which it is part of a run."""

    path: str
    parameters: Callable[[Options], Parameters] = _none
    when: Callable[[Options], bool] = lambda _: True


@dataclass(frozen=True)
class SystemRow:
    """What a row has instead of its own if the run's options name its flag in `system_engines`."""

    engine: Engine
    nodes: tuple[NodeRow, ...]
    memory_max_mb: int
    on_death: str = "restart"
    up_within_s: float = 90.0


@dataclass(frozen=True)
class ProcessRow:
    """A process of the stack. A row without nodes and without a command is external: it is not started, only waited for.

    A run for one of its `targets` has it if the options fulfill `when`. It starts when all of `needs` hold, and is up when all
    of `ready` hold, which must happen within `up_within_s`. `on_death` says what follows an unplanned exit: "restart" starts
    the process again; "mission" or "run" stops the mission or the run, because the state of the process is lost. A run
    continues without a process that is `optional`. `next_command` is what an operator should type if it does not come up.
    """

    name: str
    nodes: tuple[NodeRow, ...] = ()
    targets: tuple[str, ...] = LAPTOP_TARGETS
    when: Callable[[Options], bool] = lambda _: True
    flag: str = ""  # the option of `lupin up` that selects it: --FLAG or --no-FLAG
    needs: tuple[Readiness, ...] = ()
    ready: tuple[Readiness, ...] = ()
    on_death: str = "restart"
    up_within_s: float = 30.0
    # Processes are stopped by ascending rank, so that the base still receives the drive bus's last zero.
    stop_rank: int = 0
    command: Callable[[Options], list[str]] | None = None
    memory_max_mb: int = 384
    sends_heartbeats: bool = True
    optional: bool = False
    needed_to_drive: bool = False  # the robot is drivable once all such processes of the run are up
    watched: bool = False  # on the robot, systemd restarts the service if it does not respond
    commands_motion: bool = False  # the supervisor tells it to stop while another process does not respond
    next_command: str = ""
    system: SystemRow | None = None
    engine: str = ""  # what does its work in this run, if that is not Lupin

    @property
    def external(self) -> bool:
        """Whether the supervisor only waits for it."""
        return self.command is None and not self.nodes

    @property
    def may_be_replaced(self) -> bool:
        """Whether a person's own process may have its place during a run: its state is not lost, and stopping needs it not."""
        return self.on_death == "restart" and not self.needed_to_drive and not self.external

    @property
    def listens(self) -> tuple[int, ...]:
        """The TCP ports that it listens on."""
        return tuple(condition.number for condition in self.ready if isinstance(condition, Port))


CLOSE_TO_HARDWARE = (SIM, ONBOARD)


def _simulated(options: Options) -> bool:
    return options.simulated


def _on_robot(options: Options) -> bool:
    return options.target == ONBOARD


def _camera_driver(kind: str) -> ProcessRow:
    return ProcessRow(
        f"{kind}-camera",
        targets=(ROBOT_CAMERAS,),
        command=lambda _: ["-m", "lupin_runtime.cameras.driver", kind],
        sends_heartbeats=False,
        optional=True,
    )


TABLE: tuple[ProcessRow, ...] = (
    ProcessRow(
        "robot",
        targets=(ROBOT,),
        # Published by the vendor's software and the onboard service of a robot that may still be booting.
        ready=(
            TopicSample(graph.SCAN),
            TopicSample(graph.ODOM),
            TopicSample(graph.ESTOP_STATE),
            TopicSample(graph.DRIVE_STATUS),
        ),
        up_within_s=120.0,
        needed_to_drive=True,
        next_command="lupin doctor",
    ),
    ProcessRow(
        "sim",
        targets=(SIM,),
        command=parameters.simulator_command,
        ready=(TopicSample(graph.CLOCK), TopicSample(graph.ODOM), TopicSample(graph.SCAN)),
        on_death="run",
        stop_rank=3,
        needed_to_drive=True,
        memory_max_mb=512,
    ),
    ProcessRow(
        "estop",
        (NodeRow("lupin_runtime.safety.node:EstopBridge", parameters.estop),),
        targets=CLOSE_TO_HARDWARE,
        ready=(TopicSample(graph.ESTOP_STATE),),
        stop_rank=2,
        needed_to_drive=True,
        watched=True,
    ),
    ProcessRow(
        "drive",
        (
            NodeRow("lupin_runtime.drive.node:TwistMux", parameters.drive),
            NodeRow("lupin_runtime.safety.node:EstopWitness"),
            NodeRow("lupin_runtime.arm.guard_node:ArmGuard"),
            NodeRow("lupin_runtime.drive.node:IdleStop", when=_simulated),
        ),
        targets=CLOSE_TO_HARDWARE,
        ready=(TopicSample(graph.DRIVE_STATUS),),
        stop_rank=1,
        needed_to_drive=True,
        watched=True,
        commands_motion=True,
    ),
    ProcessRow(
        "slam",
        (
            NodeRow("lupin_runtime.slam.node:SlamNode", parameters.slam),
            NodeRow("lupin_runtime.slam.node:SlamResetNode"),
        ),
        when=lambda o: o.slam and o.map_file is None,
        flag="slam",
        needs=(TopicSample(graph.SCAN),),
        ready=(TopicSample(graph.MAP),),
        system=SystemRow(
            SLAM_TOOLBOX,
            (
                NodeRow("lupin_runtime.slam.toolbox_engine:ToolboxEngine", parameters.toolbox),
                NodeRow("lupin_runtime.slam.node:SlamResetNode"),
            ),
            memory_max_mb=1024,
            on_death="mission",  # a new one starts with an empty map, at another origin
        ),
    ),
    ProcessRow(
        "localization",
        (
            NodeRow("lupin_runtime.slam.node:MapServer", parameters.map_server),
            NodeRow("lupin_runtime.slam.node:AmclNode", parameters.amcl),
        ),
        when=lambda o: o.slam and o.map_file is not None,
        flag="slam",
        needs=(TopicSample(graph.SCAN),),
        ready=(TopicSample(graph.MAP), TopicSample(graph.AMCL_POSE)),
    ),
    ProcessRow(
        "nav",
        (
            NodeRow("lupin_runtime.navigation.node:Navigator", lambda _: {"wait_for_estop": True}),
            NodeRow("lupin_runtime.navigation.waypoint_follower:WaypointFollower"),
            NodeRow("lupin_runtime.drive.smoother_node:VelocitySmoother"),
        ),
        when=lambda o: o.navigation,
        flag="nav2",
        needs=(TopicSample(graph.MAP), TransformReady(graph.ODOM_FRAME, graph.BASE_FRAME)),
        ready=(ActionReady(graph.NAVIGATE_TO_POSE),),
        commands_motion=True,
        system=SystemRow(
            NAV2,
            (
                # The gate and the smoother come first: they are the first to be told to end, and send their last zero.
                NodeRow("lupin_runtime.navigation.nav2_engine:Nav2Gate"),
                NodeRow("lupin_runtime.drive.smoother_node:VelocitySmoother"),
                NodeRow("lupin_runtime.navigation.nav2_engine:Nav2Engine", parameters.programs(NAV2)),
            ),
            memory_max_mb=2048,
        ),
    ),
    ProcessRow(
        "body",
        (
            NodeRow("lupin_runtime.arm.node:ArmPresetServer"),
            NodeRow("lupin_runtime.arm.calibrate_server:ArmCalibrateServer", when=_on_robot),
            NodeRow("lupin_runtime.arm.node:GripperActionBridge"),
            NodeRow("lupin_runtime.arm.node:ArmLibraryServer"),
            NodeRow("lupin_runtime.arm.teleop_node:ArmTeleop"),
            NodeRow("lupin_runtime.arm.monitor_node:ArmMonitor"),
            NodeRow("lupin_runtime.lights.node:LightStripBridge", parameters.light_strip),
        ),
        targets=CLOSE_TO_HARDWARE,
        needs=(TopicSample(graph.JOINT_STATES),),
        ready=(ServiceReady(graph.ARM_PRESET),),
    ),
    ProcessRow(
        "perception",
        (
            NodeRow("lupin_runtime.perception.annotator:TagAnnotator", parameters.annotator),
            NodeRow("lupin_runtime.perception.flower_nodes:SimFlowerDetector", when=lambda o: o.flowers and o.simulated),
            NodeRow("lupin_runtime.perception.flower_nodes:YoloDetector", when=lambda o: o.flowers and not o.simulated),
            NodeRow("lupin_runtime.perception.aggregator:PerceptionAggregator"),
        ),
        when=lambda o: o.perception,
        flag="perception",
        ready=(TopicSample(graph.DISCOVERED_TAGS),),
    ),
    ProcessRow(
        "twin",
        (NodeRow("lupin_runtime.twin.node:TwinNode"),),
        when=lambda o: o.twin,
        flag="twin",
        ready=(TopicSample(graph.TWIN_STATE),),
    ),
    ProcessRow(
        "mission",
        (
            NodeRow("lupin_runtime.greenhouse.node:GreenhouseBridge", parameters.greenhouse),
            NodeRow("lupin_runtime.mission.pose_seed:PoseSeed", when=lambda o: o.map_file is None),
            NodeRow("lupin_runtime.mission.node:MissionOrchestrator", parameters.mission),
        ),
        when=lambda o: o.mission,
        flag="mission",
        ready=(MissionReady(),),
        on_death="mission",
        up_within_s=150.0,
    ),
    ProcessRow(
        "recorder",
        (NodeRow("lupin_runtime.record.node:Recorder", parameters.recorder),),
        when=lambda o: o.record,
        flag="record",
    ),
    ProcessRow(
        "console",
        (NodeRow("lupin_runtime.console.node:Console", parameters.console),),
        when=lambda o: o.console,
        flag="web",
        ready=(
            Port(CONSOLE_PORT, option="port"),
        ),  # the other one, for programs, may be in use: browsers are served all the same
        memory_max_mb=768,  # 350 of them for the listener, a process of its own that runs while a page uses its microphone
        optional=True,
        next_command="lupin logs console",
    ),
    _camera_driver("body"),
    _camera_driver("gripper"),
    ProcessRow(
        "video",
        (NodeRow("lupin_runtime.cameras.node:VideoServer", parameters.video),),
        targets=(SIM, ROBOT_CAMERAS),
        when=lambda o: not o.simulated or (o.console and o.video and o.cameras),
        flag="video",
        ready=(Port(VIDEO_PORT),),
        memory_max_mb=256,
        optional=True,
        watched=True,
        next_command="lupin logs video",
    ),
    ProcessRow(
        "foxglove",
        (NodeRow("lupin_runtime.foxglove.node:FoxgloveBridge"),),
        when=lambda o: o.foxglove,
        flag="foxglove",
        ready=(Port(FOXGLOVE_PORT),),
        memory_max_mb=512,  # for several slow clients of raw images: each may have up to 128 images waiting
        optional=True,
        next_command="lupin logs foxglove",
    ),
    ProcessRow(
        "joystick",
        (NodeRow("lupin_runtime.teleop.node:PadTeleop", lambda o: {"onboard": True} if _on_robot(o) else {}),),
        targets=(*LAPTOP_TARGETS, ONBOARD),
        when=lambda o: o.joystick,
        flag="joystick",
        memory_max_mb=256,
        optional=True,
        next_command="lupin logs joystick",
    ),
    ProcessRow("rviz", when=lambda o: o.rviz, flag="rviz", command=parameters.rviz_command, sends_heartbeats=False),
)


@dataclass(frozen=True)
class Launch:
    """How to start a row in a run: the interpreter's arguments, and the configuration that it reads from a file."""

    row: ProcessRow
    arguments: list[str]
    config: dict[str, Any] | None = field(default=None)


def rows(options: Options) -> tuple[ProcessRow, ...]:
    """Return the rows that a run with these options starts, each with the nodes that the options select."""
    chosen = (row for row in TABLE if options.target in row.targets and row.when(options))
    selected = (select_nodes(row, options) for row in chosen)
    if options.target == ROBOT_CAMERAS:
        # That service needs only the video server; a camera may be absent.
        return tuple(replace(row, optional=row.name != "video") for row in selected)
    if _on_robot(options):
        # `lupin-auto-home` repairs the vendor's controllers, and starts after these processes: they must not wait for topics
        # that the controllers publish.
        return tuple(replace(row, needs=()) for row in selected)
    return tuple(selected)


def select_nodes(row: ProcessRow, options: Options) -> ProcessRow:
    """Return the row with the engine, the nodes and the ports that a run with these options has."""
    ready = tuple(
        replace(each, number=getattr(options, each.option)) if isinstance(each, Port) and each.option else each
        for each in row.ready
    )
    if row.system is not None and row.flag in options.system_engines:
        system = row.system
        row = replace(
            row,
            nodes=system.nodes,
            engine=system.engine.title,
            memory_max_mb=system.memory_max_mb,
            on_death=system.on_death,
            up_within_s=system.up_within_s,
        )
    return replace(row, nodes=tuple(node for node in row.nodes if node.when(options)), ready=ready)


def launch(row: ProcessRow, options: Options) -> Launch:
    """Return how to start a row: the interpreter's arguments and, for a row of nodes, the configuration file that they name."""
    if row.command is not None:
        return Launch(row, row.command(options))
    config = {
        "name": row.name,
        "simulated_time": options.simulated,
        "nodes": [{"class": node.path, "parameters": dict(node.parameters(options))} for node in row.nodes],
    }
    path = options.run_path / "processes" / f"{row.name}.json"
    return Launch(row, ["-m", "lupin_runtime.stack.process", str(path)], config)
