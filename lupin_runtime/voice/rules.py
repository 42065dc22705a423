"""The rules of the grammar: what a phrase becomes, in every language. A rule is a tool with its arguments, or a problem."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from lupin_runtime.voice.arguments import BadArgument
from lupin_runtime.voice.known_names import NoName
from lupin_runtime.voice.tools import BY_NAME, MAX_BURST_S, MIN_BURST_S
from lupin_runtime.voice.utterance import Call, Context

MAX_SPOKEN_SPEED = 2.0  # m/s or rad/s: the server limits a burst much further, and a larger number was misheard
_CAP_FACTOR = 0.5
_MIN_CAP = 0.1
_MAX_LISTED = 8

# Problems, as questions to the operator.
HOW_FAR = "how far, or at which speed and for how long?"
WHICH_WAY = "in which direction?"
WHICH_ANGLE = "by how many degrees?"
SIGNED_TWICE = "say either a direction or a sign"
RELEASED_BY_HAND = "the e-stop is released only by hand, at the page"
BURST_RANGE = f"a burst lasts {MIN_BURST_S:g} to {MAX_BURST_S:g} seconds"
SPEED_RANGE = f"a speed must be above 0 and at most {MAX_SPOKEN_SPEED:g} metres or radians per second"
AT_MAXIMUM = "the speed cap is at its maximum"
AT_MINIMUM = f"the speed cap is at its minimum of {_MIN_CAP:.0%}; to stand still say: stop"

Values = Mapping[str, Any]
Build = Callable[[Values, Context], Mapping[str, Any]]


class Unclear(Exception):
    """A sentence that is understood so far that its problem can be named."""


def _as_said(values: Values, _context: Context) -> Mapping[str, Any]:
    return values


@dataclass(frozen=True)
class Rule:
    """The tool that a rule calls, its fixed arguments, and how the others are made of the slots; or the problem."""

    tool: str = ""
    fixed: Mapping[str, Any] = field(default_factory=dict)
    build: Build = _as_said
    problem: str = ""


def apply(name: str, values: Values, context: Context) -> Call:
    """Return the call that a rule makes of the values of its slots. Raises Unclear."""
    rule = RULES[name]
    if rule.problem:
        raise Unclear(rule.problem)
    if missing := next((value for value in values.values() if isinstance(value, NoName)), None):
        raise Unclear(_describe_missing(missing, rule.tool, context))
    if name == "cancel" and context.running:
        return Call(context.running, {"action": "cancel"})
    arguments = {**rule.fixed, **rule.build(values, context)}
    try:
        BY_NAME[rule.tool].check(arguments)
    except BadArgument as error:
        raise Unclear(str(error)) from error
    return Call(rule.tool, arguments)


def _describe_missing(missing: NoName, tool: str, context: Context) -> str:
    if missing.candidates:
        return f"{missing.heard!r} can be {' or '.join(missing.candidates[:_MAX_LISTED])}"
    kind = _NAME_KINDS[tool]
    names = context.names.of(kind)
    listed = ", ".join(names[:_MAX_LISTED]) + (f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else "")
    return f"there is no {kind} {missing.heard!r}; there are: {listed}" if names else f"there is no {kind} yet"


_NAME_KINDS = {
    "nav_goto_named": "location",
    "save_named_location": "location",
    "arm_goto_pose": "pose",
    "arm_save_pose": "pose",
    "arm_run_sequence": "sequence",
    "arm_record": "sequence",
}


def _positive(value: float, problem: str = SIGNED_TWICE) -> float:
    """Return a quantity that stands beside a direction, and so has no sign."""
    if value <= 0:
        raise Unclear(problem)
    return value


def _spoken_speed(value: float) -> float:
    if not 0 < value <= MAX_SPOKEN_SPEED:
        raise Unclear(SPEED_RANGE)
    return round(value, 6)


def _drive(values: Values, _context: Context) -> Mapping[str, Any]:
    velocity: dict[str, float] = {}
    if "way" in values:
        velocity["linear_x"] = values["way"] * _spoken_speed(values["speed"])
    if "side" in values:
        velocity["linear_y"] = values["side"] * _spoken_speed(values.get("side_speed", values.get("speed", 0.0)))
    if "turn_side" in values:
        velocity["angular_z"] = values["turn_side"] * _spoken_speed(math.radians(values["rate"]))
    if not MIN_BURST_S <= values["duration"] <= MAX_BURST_S:
        raise Unclear(BURST_RANGE)
    return {**velocity, "duration_s": values["duration"]}


def _offset(values: Values, _context: Context) -> Mapping[str, Any]:
    offset: dict[str, float] = {}
    if "forward" in values:
        offset["forward_m"] = values["way"] * _positive(values["forward"])
    if "lateral" in values:
        offset["lateral_m"] = values["side"] * _positive(values["lateral"])
    if "turn_angle" in values:
        offset["rotate_deg"] = values["turn_side"] * _positive(values["turn_angle"])
    return offset


def _rotation(values: Values, _context: Context) -> Mapping[str, Any]:
    if "signed" in values:
        return {"angle_deg": round(values["signed"], 3)}
    direction = values.get("side", values.get("clock"))
    return {"angle_deg": direction * round(_positive(values["angle"]), 3)}


def _goal(values: Values, _context: Context) -> Mapping[str, Any]:
    heading = {"yaw": round(math.radians(values["yaw"]), 4)} if "yaw" in values else {}
    return {"x": values["x"], "y": values["y"], **heading}


def _slower(_values: Values, context: Context) -> Mapping[str, Any]:
    if context.speed_cap <= _MIN_CAP:
        raise Unclear(AT_MINIMUM)
    return {"value": max(_MIN_CAP, context.speed_cap * _CAP_FACTOR)}


def _faster(_values: Values, context: Context) -> Mapping[str, Any]:
    if context.speed_cap >= 1.0:
        raise Unclear(AT_MAXIMUM)
    return {"value": min(1.0, max(context.speed_cap, _MIN_CAP) / _CAP_FACTOR)}


def _fields(values: Values, _context: Context) -> Mapping[str, Any]:
    return {"fields": list(dict.fromkeys(values.values()))}


RULES: Mapping[str, Rule] = {
    "drive": Rule("drive", build=_drive),
    "stop": Rule("stop"),
    "nav_goto": Rule("nav_goto", build=_goal),
    "nav_forward": Rule("nav_forward", build=_offset),
    "rotate": Rule("rotate", build=_rotation),
    "turn_around": Rule("rotate", {"angle_deg": 180.0}),
    "set_speed_cap": Rule("set_speed_cap"),
    "slower": Rule("set_speed_cap", build=_slower),
    "faster": Rule("set_speed_cap", build=_faster),
    "nav_cancel": Rule("nav_cancel"),
    "cancel": Rule("nav_cancel"),
    "nav_goto_named": Rule("nav_goto_named"),
    "list_named_locations": Rule("list_named_locations"),
    "save_named_location": Rule("save_named_location"),
    "gripper_open": Rule("gripper", {"action": "open"}),
    "gripper_close": Rule("gripper", {"action": "close"}),
    "gripper_set": Rule("gripper", {"action": "set"}),
    "arm_preset": Rule("arm_preset"),
    "arm_goto_pose": Rule("arm_goto_pose"),
    "arm_save_pose": Rule("arm_save_pose"),
    "arm_list_library": Rule("arm_list_library"),
    "arm_run_sequence": Rule("arm_run_sequence"),
    "arm_stop": Rule("arm_stop"),
    "record_start": Rule("arm_record", {"action": "start"}),
    "record_save": Rule("arm_record", {"action": "save"}),
    "record_cancel": Rule("arm_record", {"action": "cancel"}),
    "calibrate_start": Rule("calibrate_arm", {"action": "start"}),
    "calibrate_commit": Rule("calibrate_arm", {"action": "commit"}),
    "calibrate_cancel": Rule("calibrate_arm", {"action": "cancel"}),
    "calibrate_status": Rule("calibrate_arm", {"action": "status"}),
    "query_state": Rule("query_state"),
    "query_fields": Rule("query_state", build=_fields),
    "engage_estop": Rule("engage_estop"),
    "speak": Rule("speak"),
    "light_color": Rule("set_light"),
    "light_auto": Rule("set_light", {"mode": "auto"}),
    "ask_extent": Rule(problem=HOW_FAR),
    "ask_direction": Rule(problem=WHICH_WAY),
    "ask_angle": Rule(problem=WHICH_ANGLE),
    "release_estop": Rule(problem=RELEASED_BY_HAND),
}
