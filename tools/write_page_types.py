"""Write the page's generated modules, `web/src/generated/*`, from the definitions that the rest of Lupin uses.

    python -m tools.write_page_types

`messages.ts` has the types of all messages and services that the table of the graph names, `graph.ts` that table, `robot.ts`
limits, presets, colors, ranges and dimensions, `settings.ts` the page's settings, `sentences.ts` what the robot and the console
say, `robot_model.json` the shapes of the simulated robot, `voice_tools.ts` the voice agent's tools, and `mock_doctor.json` what
the doctor of the page's mock answers.
`tools/build_page.py` runs it before each build, lint and test of the page; git does not have them. A module that did not change
is not written.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from lupin_runtime import graph
from lupin_runtime.arm import limits
from lupin_runtime.arm.presets import PRESET_DURATION_S, PRESETS
from lupin_runtime.console.authority import LEASE_TIMEOUT_S, REQUEST_TIMEOUT_S, Role
from lupin_runtime.console.robot_sentences import SENTENCES
from lupin_runtime.console.settings import OLDEST_VERSION, VERSION, describe_settings
from lupin_runtime.drive.arbiter import INPUTS
from lupin_runtime.drive.twist import HardLimits
from lupin_runtime.lights import BEFORE_MANUAL, palette
from lupin_runtime.ros import type_names
from lupin_runtime.safety.battery_monitor import LOW_THRESHOLD, SOON_THRESHOLD
from lupin_runtime.twin.health import IDEAL_RANGES, MAX_DEVIATION, OFF_RANGE, STATES
from lupin_runtime.voice.declarations import function_declarations
from lupin_sim import mirte, robot_model
from tools import mock_doctor, voice_types

FOLDER = Path(__file__).parents[1] / "web" / "src" / "generated"
HEADER = "// Generated: `python -m tools.write_page_types`.\n"
# Types that the page uses beside those of the table.
EXTRA_SERVICES = {
    "GET_TIME": graph.Service("/rosapi/get_time", "rosapi_msgs/srv/GetTime"),
    "TOPICS": graph.Service("/rosapi/topics", "rosapi_msgs/srv/Topics"),
    "SUBSCRIBERS": graph.Service("/rosapi/subscribers", "rosapi_msgs/srv/Subscribers"),
} | {
    f"CANCEL_{row.name.upper()}": graph.Service(f"/{row.name}/_action/cancel_goal", "action_msgs/srv/CancelGoal")
    for row in (graph.NAVIGATE_TO_POSE, graph.NAVIGATE_THROUGH_POSES, graph.FOLLOW_WAYPOINTS)
}
EXTRA_TOPICS = {"NAVIGATE_STATUS": ("/navigate_to_pose/_action/status", "action_msgs/msg/GoalStatusArray")}
EXTRA_MESSAGES = ("geometry_msgs/msg/TwistStamped", *(kind for _, kind in EXTRA_TOPICS.values()))

_TYPED_ARRAYS = {
    "float": "Float32Array",
    "double": "Float64Array",
    "int8": "Int8Array",
    "octet": "Uint8Array",
    "uint8": "Uint8Array",
    "int16": "Int16Array",
    "uint16": "Uint16Array",
    "int32": "Int32Array",
    "uint32": "Uint32Array",
    "int64": "BigInt64Array",
    "uint64": "BigUint64Array",
}
_ARRAY = re.compile(r"(?:sequence<(?P<sequence>.+?)(?:, \d+)?>|(?P<array>.+)\[\d+\])")


# -- messages.ts ------------------------------------------------------------------------------------------------------
def messages_module() -> str:
    """Interfaces of messages, of requests and responses, and the maps from their names."""
    services = [(row.type, type_names.find(row.type, "srv")) for row in (*graph.services(), *EXTRA_SERVICES.values())]
    goals = [(row.type, type_names.find(row.type, "action")) for row in graph.actions()]
    names = {row.type for row in graph.topics()} | set(EXTRA_MESSAGES)
    roots = [type_names.find(name, "msg") for name in sorted(names)]
    parts = [part for _, service in services for part in (service.Request, service.Response)]
    parts += [part for _, action in goals for part in (action.Goal, action.Result, action.Feedback)]
    blocks = [_interface(kind) for kind in _with_dependencies([*roots, *parts])]
    calls = sorted({(name, _type_name(each.Request), _type_name(each.Response)) for name, each in services})
    actions = sorted({(n, _type_name(a.Goal), _type_name(a.Result), _type_name(a.Feedback)) for n, a in goals})
    return (
        HEADER
        + "// Messages as the console's server sends them in CBOR: arrays of numbers are typed arrays, NaN is NaN.\n"
        + "".join(blocks)
        + _block("interface MessageTypes", (f'"{name}": {_type_name(type_names.find(name, "msg"))};' for name in sorted(names)))
        + _block("interface ServiceTypes", (f'"{n}": {{ request: {q}; response: {a} }};' for n, q, a in calls))
        + _block("interface ActionTypes", (f'"{n}": {{ goal: {g}; result: {r}; feedback: {f} }};' for n, g, r, f in actions))
    )


def _with_dependencies(roots: list[Any]) -> list[Any]:
    found: dict[str, Any] = {}
    waiting = list(roots)
    while waiting:
        kind = waiting.pop()
        name = _type_name(kind)
        if name in found:
            continue
        found[name] = kind
        for field in kind.get_fields_and_field_types().values():
            if "/" in (element := _element(field)[0]):
                waiting.append(type_names.find(element, "msg"))
    return [found[name] for name in sorted(found)]


def _type_name(kind: Any) -> str:
    """`geometry_msgs_Twist`, of a message, or of a part of a service or action."""
    return f"{kind.__module__.split('.')[0]}_{kind.__name__}"


def _element(field: str) -> tuple[str, bool]:
    """The type of a field's elements, and whether it is an array."""
    match = _ARRAY.fullmatch(field)
    return (match["sequence"] or match["array"], True) if match else (field, False)


def _interface(kind: Any) -> str:
    fields = kind.get_fields_and_field_types()
    rows = [f"{name}: {_field_type(field)};" for name, field in fields.items()]
    constants = [name for name in dir(type(kind)) if re.fullmatch(r"[A-Z][A-Z0-9_]*", name)]
    text = _block(f"interface {_type_name(kind)}", rows)
    if constants:
        values = ", ".join(f"{name}: {json.dumps(_constant(getattr(kind, name)))}" for name in constants)
        text += f"export const {_type_name(kind)} = {{ {values} }} as const;\n"
    return text


def _constant(value: Any) -> Any:
    return int.from_bytes(value, "little") if isinstance(value, bytes) else value


def _field_type(field: str) -> str:
    element, is_array = _element(field)
    if is_array and element in _TYPED_ARRAYS:
        return _TYPED_ARRAYS[element]
    if "/" in element:
        name = _type_name(type_names.find(element, "msg"))
    elif element == "boolean":
        name = "boolean"
    elif element.startswith(("string", "wstring")):
        name = "string"
    else:
        name = "number"
    return f"{name}[]" if is_array else name


# -- graph.ts ---------------------------------------------------------------------------------------------------------
def graph_module() -> str:
    """The tables of topics, services and actions, and the names of frames and joints."""
    topics = {name: _topic(row) for name, row in _named(graph.Topic)}
    topics |= {
        "BODY_IMAGE_SIM_INFO": _topic(graph.camera_info(graph.BODY_IMAGE_SIM)),
        "BODY_IMAGE_ROBOT_INFO": _topic(graph.camera_info(graph.BODY_IMAGE_ROBOT)),
        "GRIPPER_IMAGE_INFO": _topic(graph.camera_info(graph.GRIPPER_IMAGE)),
    }
    topics |= {
        key: {"name": name, "type": kind, "console": graph.BY_VIEWER, "moves": False, "rateHz": None}
        for key, (name, kind) in EXTRA_TOPICS.items()
    }
    services = {name: _request(row) for name, row in _named(graph.Service)}
    services |= {
        name: {"name": row.name, "type": row.type, "console": graph.BY_VIEWER, "moves": False}
        for name, row in EXTRA_SERVICES.items()
    }
    actions = {name: {**_request(row), "name": type_names.absolute(row.name)} for name, row in _named(graph.Action)}
    angles = {joint: graph.arm_joint_angle(joint) for joint in graph.ARM_JOINTS} | {graph.GRIPPER_JOINT: graph.GRIPPER_ANGLE}
    joint_services = {joint: _request(row) for joint, row in angles.items()}
    joints = {
        "arm": graph.ARM_JOINTS,
        "gripper": graph.GRIPPER_JOINT,
        "wheels": graph.WHEEL_JOINTS,
    }
    frames = {"map": graph.MAP_FRAME, "odom": graph.ODOM_FRAME, "base": graph.BASE_FRAME, "laser": graph.LASER_FRAME}
    return (
        HEADER
        + _constant_block("TOPICS", topics)
        + _constant_block("SERVICES", services)
        + _constant_block("ACTIONS", actions)
        + _constant_block("JOINTS", joints)
        + _constant_block("JOINT_SERVICES", joint_services)
        + _constant_block("FRAMES", frames)
    )


def _topic(row: graph.Topic) -> dict[str, Any]:
    return {**_request(row), "rateHz": row.rate_hz}


def _request(row: graph.Topic | graph.Service | graph.Action) -> dict[str, Any]:
    return {"name": row.name, "type": row.type, "console": row.console, "moves": row.moves}


def _named(kind: type) -> Iterator[tuple[str, Any]]:
    return ((name, row) for name, row in vars(graph).items() if isinstance(row, kind))


# -- robot.ts ---------------------------------------------------------------------------------------------------------
def robot_module() -> str:
    """Limits, presets, colors, ranges and dimensions, and the times of the server's authority."""
    hard = HardLimits()
    drive = {
        "maxLinearMps": hard.linear_mps,
        "maxAngularRps": hard.yaw_radps,
        "manualTimeoutS": next(row.timeout_s for row in INPUTS if row.key == "manual"),
    }
    joints = {
        name: {
            "servoLowerDeg": row.servo_lower,
            "servoUpperDeg": row.servo_upper,
            "lowerDeg": row.lower,
            "upperDeg": row.upper,
        }
        for name, row in limits.LIMITS.items()
    }
    gripper = {
        "openDeg": limits.GRIPPER_OPEN_DEG,
        "closedDeg": limits.GRIPPER_CLOSED_DEG,
        "openRad": limits.GRIPPER_OPEN_RAD,
        "closedRad": limits.GRIPPER_CLOSED_RAD,
        "openApertureM": _rounded(mirte.aperture_from_gripper(limits.GRIPPER_OPEN_RAD)),
        "closedApertureM": _rounded(mirte.aperture_from_gripper(limits.GRIPPER_CLOSED_RAD)),
    }
    colors = {name.lower(): list(rgb) for name, rgb in palette.COLORS_BY_NAME.items() if name != "BATTERY_LOW"}
    states = {name: list(rgb) for name, rgb in {**palette.LIFECYCLE_COLORS, **palette.PHASE_COLORS}.items()}
    ranges = {name: {"low": row.minimum, "high": row.maximum, "unit": row.unit} for name, row in IDEAL_RANGES.items()}
    health = [{"below": limit if np.isfinite(limit) else None, "name": name} for limit, name in STATES]
    half_length, half_width, _ = _rounded_list(_simulated_robot().geom("chassis").size)
    chassis = {"halfLengthM": half_length, "halfWidthM": half_width}
    wheel = {"radiusM": mirte.WHEEL_RADIUS_M, "widthM": mirte.WHEEL_WIDTH_M}
    lidar = {"at": list(mirte.LIDAR_POSITION), "yawRad": mirte.LIDAR_YAW_RAD}
    authority = {"leaseSilenceS": LEASE_TIMEOUT_S, "requestS": REQUEST_TIMEOUT_S}
    return (
        HEADER
        + _constant_block("DRIVE", drive)
        + _constant_block("JOINT_LIMITS", joints)
        + _constant_block("GRIPPER", gripper)
        + _constant_block("ARM_PRESETS", {name: list(angles) for name, angles in PRESETS.items()})
        + f"export const PRESET_DURATION_S = {PRESET_DURATION_S:g};\n"
        + _constant_block("LED_COLORS", colors)
        + _constant_block("LED_STATES", states)
        + _constant_block("LED_RULES_BEFORE_COLOR", list(BEFORE_MANUAL))
        + _constant_block("IDEAL_RANGES", ranges)
        + _constant_block("HEALTH", {"maxDeviation": MAX_DEVIATION, "offRange": OFF_RANGE, "states": health})
        + _constant_block("BATTERY", {"lowShare": LOW_THRESHOLD, "soonShare": SOON_THRESHOLD})
        + f"export const OUTER_RADIUS_M = {mirte.OUTER_RADIUS_M:g};\n"
        + _constant_block("CHASSIS", chassis)
        + _constant_block("WHEEL", wheel)
        + _constant_block("LIDAR", lidar)
        + _constant_block("AUTHORITY", authority)
        + f"export type Role = {' | '.join(json.dumps(role.value) for role in Role)};\n"
    )


# -- settings.ts ------------------------------------------------------------------------------------------------------
def settings_module() -> str:
    """The settings' table, and their type."""
    table = describe_settings()
    rows = []
    for row in table:
        choices = " | ".join(json.dumps(choice) for choice in row.get("choices", ()))
        kind = choices or {bool: "boolean", str: "string"}.get(type(row["default"]), "number")
        rows.append(f"{row['name']}: {kind};")
    return (
        HEADER
        + f"export const SETTINGS_VERSION = {VERSION};\nexport const OLDEST_SETTINGS_VERSION = {OLDEST_VERSION};\n"
        + _block("interface Settings", rows)
        + _constant_block("SETTINGS", {row["name"]: {k: v for k, v in row.items() if k != "name"} for row in table})
    )


# -- sentences.ts -----------------------------------------------------------------------------------------------------
def _plain_places(template: str) -> str:
    """Return a template without the formats of its places: `{seconds:g}` becomes `{seconds}`."""
    return re.sub(r"\{(\w+):[^}]*\}", r"{\1}", template)


# -- robot_model.json -------------------------------------------------------------------------------------------------
def robot_model_rows() -> str:
    """Bodies, joints and shapes of the simulated robot, one a line, for `robot/model.ts`; m, quaternions as (x, y, z, w)."""
    model = _simulated_robot()
    rows = (json.dumps(_body(model, body), separators=(",", ":")) for body in range(1, model.nbody))
    return "[\n" + ",\n".join(rows) + "\n]\n"


@functools.cache
def _simulated_robot() -> Any:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    robot_model.add_robot(spec)
    return spec.compile()


def _body(model: Any, body: int) -> dict[str, Any]:
    kinds = {int(mujoco.mjtGeom.mjGEOM_BOX): "box", int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder"}
    shapes = [
        {
            "kind": kinds[int(model.geom_type[geom])],
            "name": model.geom(geom).name,
            "size": _rounded_list(model.geom_size[geom]),
            "at": _rounded_list(model.geom_pos[geom]),
            "turned": _xyzw(model.geom_quat[geom]),
            "color": _rounded_list(model.geom_rgba[geom][:3]),
        }
        for geom in np.flatnonzero(model.geom_bodyid == body)
    ]
    # The base's own joints place it in the world; the page places it by its pose.
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    joint = first if count == 1 else None
    return {
        "name": model.body(body).name,
        "parent": model.body(int(model.body_parentid[body])).name if body > 1 else "",
        "at": _rounded_list(model.body_pos[body]),
        "turned": _xyzw(model.body_quat[body]),
        "joint": "" if joint is None else model.joint(joint).name,
        "axis": [0, 0, 0] if joint is None else _rounded_list(model.jnt_axis[joint]),
        "slides": joint is not None and int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_SLIDE),
        "shapes": shapes,
    }


def _xyzw(quaternion: Any) -> list[float]:
    w, x, y, z = quaternion
    return _rounded_list([x, y, z, w])


def _rounded(value: float) -> float:
    return round(float(value), 5)


def _rounded_list(values: Any) -> list[float]:
    return [_rounded(value) for value in values]


# -- voice_tools.ts ---------------------------------------------------------------------------------------------------
def voice_tools_module() -> str:
    """The voice agent's tools, the types of their arguments, and their declarations for a model."""
    return (
        HEADER
        + _constant_block("VOICE_TOOLS", voice_types.described_tools())
        + "export type VoiceToolName = keyof typeof VOICE_TOOLS;\n"
        + _block("interface VoiceToolArguments", voice_types.argument_types())
        + _constant_block("FUNCTION_DECLARATIONS", function_declarations())
    )


# -- writing ----------------------------------------------------------------------------------------------------------
def _block(head: str, rows: Any) -> str:
    return f"export {head} {{\n" + "".join(f"  {row}\n" for row in rows) + "}\n"


def _constant_block(name: str, value: Any) -> str:
    return f"export const {name} = {json.dumps(value, indent=2, ensure_ascii=False)} as const;\n"


@functools.cache
def modules() -> dict[str, str]:
    """The text of each generated module, by its file name."""
    return {
        "messages.ts": messages_module(),
        "graph.ts": graph_module(),
        "robot.ts": robot_module(),
        "settings.ts": settings_module(),
        "sentences.ts": HEADER + _constant_block("SENTENCES", {name: _plain_places(text) for name, text in SENTENCES.items()}),
        "robot_model.json": robot_model_rows(),
        "voice_tools.ts": voice_tools_module(),
        "mock_doctor.json": json.dumps(mock_doctor.answers(), ensure_ascii=False) + "\n",
    }


def write(folder: Path) -> list[str]:
    """Write the modules that differ from what the folder has; return their names."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in modules().items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            written.append(name)
    return written


def main() -> None:
    """Write the modules that differ from what is there."""
    write(FOLDER)


if __name__ == "__main__":
    main()
