"""The table of the voice agent's tools.

Declarations for the model, the server's checks, the page's types and docs/voice.md are made from it. A tool without a backend
is not in it: a model stops calling a tool that always fails, and invents results for one that silently succeeds.
`scan_apriltags`, `detect_flowers` and `record_observation` have no service.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from lupin_runtime import graph
from lupin_runtime.arm.presets import PRESETS
from lupin_runtime.graph import Action, Service, Topic
from lupin_runtime.lights.palette import COLORS_BY_NAME, Rgb
from lupin_runtime.voice.arguments import Argument, BadArgument, Kind, Outside, Values, check_arguments

COLORS: dict[str, Rgb] = {name.lower(): rgb for name, rgb in COLORS_BY_NAME.items() if name != "BATTERY_LOW"}
STATE_FIELDS = ("pose", "battery", "estop")
MIN_BURST_S, MAX_BURST_S, DEFAULT_BURST_S = 0.1, 2.0, 0.5
STOP_REASON = "voice-agent"
CONFIRMATION = Argument(
    "confirmation", Kind.NAME, "the token of the read-back that the operator has confirmed; absent in the first call"
)


class Gate(enum.Enum):
    """When the e-stop blocks a tool. The value describes it."""

    NONE = "–"
    ESTOP = "e-stop"
    ESTOP_ON_START = "e-stop, for start only"


class Effect(enum.Enum):
    """What a tool does, which decides who may call it. The value describes it.

    MOTION and CHANGE need control, SESSION and READ do not, and STOP is always carried out.
    """

    MOTION = "moves the robot"
    CHANGE = "changes the robot"
    SESSION = "changes this voice session"
    READ = "reads"
    STOP = "stops"


@dataclass(frozen=True)
class Tool:
    """One tool. `description` is for the model, `does` for people.

    `read_back` has the sentences by which a call is read back to the operator, who must confirm it in a later turn: templates
    of the checked arguments by the value of the argument `action`, or one by "" if there is none. Other calls are carried out
    at once. Of the arguments `any_of`, at least one must be given; `for_action` names the argument that an action needs.
    `backends` are what the tool uses on the graph.
    """

    name: str
    description: str
    does: str
    effect: Effect
    results: tuple[str, ...]
    arguments: tuple[Argument, ...] = ()
    gate: Gate = Gate.NONE
    needs_pose: bool = False
    read_back: Mapping[str, str] = field(default_factory=dict)
    any_of: tuple[str, ...] = ()
    for_action: Mapping[str, str] = field(default_factory=dict)
    backends: tuple[Topic | Service | Action, ...] = ()

    @property
    def needs_control(self) -> bool:
        """Whether only a session with control may call it."""
        return self.effect in (Effect.MOTION, Effect.CHANGE)

    def is_blocked_by_estop(self, arguments: Values) -> bool:
        """Return whether a call with these checked arguments is refused while the e-stop is engaged."""
        return self.gate is Gate.ESTOP or (self.gate is Gate.ESTOP_ON_START and arguments.get("action") == "start")

    def sentence(self, arguments: Values) -> str:
        """Return what is read back for a call with these checked arguments; empty if it needs no confirmation."""
        return self.read_back.get(arguments.get("action", ""), "").format(**arguments)

    @property
    def parameters(self) -> tuple[Argument, ...]:
        """All arguments, with that of the confirmation if calls are read back."""
        return (*self.arguments, CONFIRMATION) if self.read_back else self.arguments

    def check(self, values: Any) -> dict[str, Any]:
        """Return the checked arguments of a call, and its confirmation if it has one. Raises BadArgument."""
        confirmation = () if self.effect is Effect.STOP else (CONFIRMATION,)
        checked = check_arguments((*self.arguments, *confirmation), values)
        if self.any_of and all(values.get(name) is None for name in self.any_of):
            raise BadArgument(f"expected at least one of {', '.join(self.any_of)}")
        needed = self.for_action.get(checked.get("action", ""))
        if needed is not None and needed not in checked:
            raise BadArgument(f"{needed} is missing, which {checked['action']} needs")
        return checked


def _number(
    name: str, description: str, unit: str, low: float, high: float, *, required: bool = False, default: float | None = None
) -> Argument:
    return Argument(name, Kind.NUMBER, description, unit, low, high, required=required, default=default)


def _name(what: str, *, required: bool = True) -> Argument:
    return Argument("name", Kind.NAME, f"the name of the {what}", required=required)


def _action(*choices: str, description: str = "what to do") -> Argument:
    return Argument("action", Kind.CHOICE, description, choices=choices, required=True)


def _speed(name: str, description: str, unit: str, setting: str) -> Argument:
    """A velocity, which the envelope limits to the setting's value times the session's cap."""
    text = f"-{setting} to {setting} {unit}, times the speed cap"
    return Argument(name, Kind.NUMBER, description, outside=Outside.LIMIT, range_text=text, default=0.0)


# ±π, rounded up. A larger number is likely to be in degrees.
_YAW = _number("yaw", "heading on the map, counter-clockwise", "rad", -3.1416, 3.1416, default=0.0)
_PRESETS = tuple(PRESETS)
_GOAL = (graph.GOAL_POSE,)

TOOLS = (
    Tool(
        "drive",
        "Drive a short burst of velocity, which ends by itself after at most 2 s. For a distance or a place use nav_forward, "
        "rotate or nav_goto: bursts do not avoid obstacles and reach at most 0.6 m.",
        "publishes a velocity 20 times a second, and zero after the duration",
        Effect.MOTION,
        ("action", "linear_x", "linear_y", "angular_z", "duration_s"),
        (
            _speed("linear_x", "forward velocity", "m/s", "voiceMaxLinearMps"),
            _speed("linear_y", "velocity to the left", "m/s", "voiceMaxLinearMps"),
            _speed("angular_z", "turn rate, counter-clockwise", "rad/s", "voiceMaxAngularRps"),
            Argument(
                "duration_s", Kind.NUMBER, "how long to drive", "s", MIN_BURST_S, MAX_BURST_S, Outside.LIMIT,
                required=True, fallback=DEFAULT_BURST_S,
            ),
        ),
        Gate.ESTOP,
        any_of=("linear_x", "linear_y", "angular_z"),
        backends=(graph.CMD_VEL_MANUAL,),
    ),
    Tool(
        "stop",
        "Stop the wheels at once and end a drive burst. Always allowed. It does not cancel navigation: nav_cancel does.",
        "publishes a zero velocity, and ends the burst",
        Effect.STOP,
        ("action",),
        backends=(graph.CMD_VEL_MANUAL,),
    ),
    Tool(
        "nav_goto",
        "Navigate to a pose on the map, around obstacles.",
        "sends a navigation goal",
        Effect.MOTION,
        ("action", "x", "y", "yaw"),
        (
            _number("x", "x on the map", "m", -1000.0, 1000.0, required=True),
            _number("y", "y on the map", "m", -1000.0, 1000.0, required=True),
            _YAW,
        ),
        Gate.ESTOP,
        read_back={"": "navigate to x {x:g} m, y {y:g} m, heading {yaw:g} rad on the map"},
        backends=_GOAL,
    ),
    Tool(
        "nav_forward",
        "Navigate by an offset from where the robot is now: forward, to the left, and turned.",
        "sends a navigation goal relative to the robot's pose",
        Effect.MOTION,
        ("action", "from", "goal", "forward_m", "lateral_m", "rotate_deg"),
        (
            _number("forward_m", "distance forward; negative is backward", "m", -50.0, 50.0, default=0.0),
            _number("lateral_m", "distance to the left; negative is to the right", "m", -50.0, 50.0, default=0.0),
            _number("rotate_deg", "turn at the goal, counter-clockwise", "degrees", -3600.0, 3600.0, default=0.0),
        ),
        Gate.ESTOP,
        needs_pose=True,
        any_of=("forward_m", "lateral_m", "rotate_deg"),
        read_back={"": "navigate {forward_m:+g} m forward, {lateral_m:+g} m to the left, turned by {rotate_deg:+g} degrees"},
        backends=_GOAL,
    ),
    Tool(
        "rotate",
        "Turn in place by an angle.",
        "sends a navigation goal at the robot's position",
        Effect.MOTION,
        ("action", "from_yaw", "to_yaw", "delta_deg"),
        (_number("angle_deg", "angle, counter-clockwise", "degrees", -3600.0, 3600.0, required=True),),
        Gate.ESTOP,
        needs_pose=True,
        read_back={"": "turn in place by {angle_deg:+g} degrees, counter-clockwise if positive"},
        backends=_GOAL,
    ),
    Tool(
        "set_speed_cap",
        "Limit the speed of drive bursts in this session to a share of the maximum.",
        "sets the share of the maximum velocity for this session's bursts",
        Effect.SESSION,
        ("value", "max_linear_mps", "max_angular_rps"),
        (_number("value", "share of the maximum: 0 is standstill, 1 the maximum", "", 0.0, 1.0, required=True),),
    ),
    Tool(
        "nav_cancel",
        "Cancel navigation. Always allowed. It does not end a drive burst: stop does.",
        "cancels every goal of navigation",
        Effect.STOP,
        ("action", "response"),
        backends=(graph.NAVIGATE_TO_POSE,),
    ),
    Tool(
        "nav_goto_named",
        "Navigate to a named location.",
        "sends a navigation goal; an unknown name lists the locations",
        Effect.MOTION,
        ("action", "name", "x", "y", "yaw"),
        (_name("location"),),
        Gate.ESTOP,
        read_back={"": "navigate to the location {name}"},
        backends=_GOAL,
    ),
    Tool(
        "list_named_locations",
        "List the named locations on the map.",
        "reads the locations",
        Effect.READ,
        ("locations",),
    ),
    Tool(
        "save_named_location",
        "Save where the robot is now under a name; a location of that name is replaced.",
        "saves the robot's pose on the map",
        Effect.CHANGE,
        ("name", "x", "y", "yaw"),
        (_name("location"),),
        needs_pose=True,
    ),
    Tool(
        "gripper",
        "Open or close the gripper, or set its opening.",
        "commands the gripper: 0 % is closed, at +30 degrees, and 100 % open, at -30 degrees",
        Effect.MOTION,
        ("direction", "percent", "angle_deg", "note"),
        (
            _action("open", "close", "set"),
            _number("percent", "opening, for set: 0 is closed, 100 open", "%", 0.0, 100.0),
        ),
        Gate.ESTOP,
        read_back={
            "open": "open the gripper",
            "close": "close the gripper",
            "set": "set the gripper to {percent:g} % open",
        },
        for_action={"set": "percent"},
        backends=(graph.GRIPPER_ANGLE,),
    ),
    Tool(
        "arm_preset",
        "Move the arm to a built-in pose.",
        "calls the preset service",
        Effect.MOTION,
        ("name", "message"),
        (Argument("name", Kind.CHOICE, "the built-in pose", choices=_PRESETS, required=True),),
        Gate.ESTOP,
        read_back={"": "move the arm to the built-in pose {name}"},
        backends=(graph.ARM_PRESET,),
    ),
    Tool(
        "arm_goto_pose",
        "Move the arm to a stored pose; a built-in one works too.",
        "calls the preset service for built-in names, else the arm library",
        Effect.MOTION,
        ("name", "message"),
        (_name("pose"),),
        Gate.ESTOP,
        read_back={"": "move the arm to the pose {name}"},
        backends=(graph.ARM_PRESET, graph.ARM_LIBRARY_GOTO_POSE),
    ),
    Tool(
        "arm_save_pose",
        "Store the arm's present pose under a name; a pose of that name is replaced.",
        "stores the pose in the arm library, with the gripper",
        Effect.CHANGE,
        ("name", "message"),
        (_name("pose"),),
        backends=(graph.ARM_LIBRARY_SAVE_POSE,),
    ),
    Tool(
        "arm_list_library",
        "List the arm's stored poses and sequences.",
        "reads the arm library",
        Effect.READ,
        ("poses", "sequences"),
        backends=(graph.ARM_LIBRARY_LIST,),
    ),
    Tool(
        "arm_run_sequence",
        "Replay a stored sequence of the arm.",
        "plays the sequence",
        Effect.MOTION,
        ("name", "speed", "message"),
        (_name("sequence"), _number("speed", "factor of the recorded speed", "", 0.25, 2.0, default=1.0)),
        Gate.ESTOP,
        read_back={"": "replay the arm sequence {name} at {speed:g} times its speed"},
        backends=(graph.ARM_LIBRARY_PLAY,),
    ),
    Tool(
        "arm_stop",
        "Stop a replay, a recording or a motion of the arm. Always allowed.",
        "stops the arm",
        Effect.STOP,
        ("message",),
        backends=(graph.ARM_LIBRARY_STOP,),
    ),
    Tool(
        "arm_record",
        "Record a motion of the arm as a sequence: start, then save or cancel in a later turn. Kinesthetic makes the arm limp, "
        "to be led by hand: a person must hold it before the start.",
        "records, with the gripper; a sequence of that name is replaced",
        Effect.MOTION,
        ("message", "duration_s", "n_waypoints"),
        (
            _action("start", "save", "cancel"),
            Argument("mode", Kind.CHOICE, "how the arm is led", choices=("teleop", "kinesthetic"), default="teleop"),
            _name("sequence", required=False),
        ),
        Gate.ESTOP_ON_START,
        read_back={"start": "start a {mode} recording of the arm"},
        backends=(graph.ARM_LIBRARY_RECORD,),
    ),
    Tool(
        "calibrate_arm",
        "Calibrate the zero offsets of the arm. Start makes the arm limp: the operator poses it with every joint at zero. "
        "Commit writes the offsets. Never commit before the operator has said, after the start, that the arm is posed.",
        "calls the calibration, which only the robot has",
        Effect.MOTION,
        ("state", "message", "joint_names", "offsets_applied", "diffs_observed"),
        (_action("start", "commit", "cancel", "status"),),
        Gate.ESTOP_ON_START,
        read_back={
            "start": "start the calibration: the arm becomes limp, so a person must hold it",
            "commit": "write the new zero offsets: the arm moves to its new zero",
        },
        backends=(graph.ARM_CALIBRATE,),
    ),
    Tool(
        "query_state",
        "Read the robot's pose by odometry, its battery and its e-stop. Moves nothing.",
        "reads the last messages",
        Effect.READ,
        ("pose", "battery", "estop"),
        (Argument("fields", Kind.CHOICES, "what to read", choices=STATE_FIELDS, default=STATE_FIELDS),),
        backends=(graph.ODOM, graph.BATTERY, graph.ESTOP_STATUS),
    ),
    Tool(
        "engage_estop",
        "Engage the e-stop. Always allowed. No tool can release it: only a person does, at the page.",
        f"engages the stop of the console, with the reason {STOP_REASON}",
        Effect.STOP,
        ("action", "reason"),
        backends=(graph.CONSOLE_STOP,),
    ),
    Tool(
        "speak",
        "Write a text to the transcript.",
        "adds an entry to the transcript of the page",
        Effect.SESSION,
        (),
        (Argument("text", Kind.TEXT, "the text", required=True),),
    ),
    Tool(
        "set_light",
        "Set the LED strip to a color, or let it show the robot's state again. If the result has shown false, the color is "
        "set, but not visible yet: tell the operator why.",
        "calls the LED services; `mode` wins over `color`; says if a stop or a pause keeps the color from being shown",
        Effect.CHANGE,
        ("action", "color", "rgb", "shown", "message"),
        (
            Argument("color", Kind.CHOICE, "the color", choices=tuple(COLORS)),
            Argument("mode", Kind.CHOICE, "auto: show the robot's state", choices=("auto",)),
        ),
        any_of=("color", "mode"),
        backends=(graph.LEDS_SET, graph.LEDS_AUTO),
    ),
)  # fmt: skip
BY_NAME = {tool.name: tool for tool in TOOLS}
