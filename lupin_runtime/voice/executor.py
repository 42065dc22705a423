"""Carries out calls that the envelope has approved, on a robot that is reached through the protocol `Robot`."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

from lupin_runtime import graph
from lupin_runtime.arm.limits import GRIPPER_CLOSED_DEG, GRIPPER_OPEN_DEG
from lupin_runtime.arm.presets import PRESETS
from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.json_text import parse_json
from lupin_runtime.lights.precedence import BEFORE_MANUAL
from lupin_runtime.voice.arguments import Values
from lupin_runtime.voice.envelope import NO_POSE
from lupin_runtime.voice.tools import COLORS, STOP_REASON
from lupin_runtime.voice.untrusted import MAX_ITEMS, clean, quote, quote_all

_GRIPPER_PERCENT = {"open": 100.0, "close": 0.0}
_GRIPPER_NOTE = "commanded; the gripper stops where it grips something"
UNKNOWN_NAME = "there is no {kind} of this name"
ROBOT_REFUSED = "the robot refused"
GRIPPER_REFUSED = "the gripper refused"
NO_STRIP = "the LED strip is not connected"
NOT_SHOWN = "the color is set, but not shown while this lasts: {rule}"
_CALIBRATION_ARRAYS = ("offsets_applied", "diffs_observed")

Result = dict[str, Any]


class CommandFailed(RuntimeError):
    """A command that was not carried out; the text, which may come from the robot, is the reason."""


@dataclass(frozen=True)
class RobotState:
    """The last state that was received; None for what was not: the pose by odometry, volts, and the charge 0..1."""

    odometry: Pose2 | None
    battery: tuple[float, float] | None
    estop: tuple[str, ...]


class Robot(Protocol):
    """What the tools use of the robot, on behalf of one session. All but the stops raise CommandFailed."""

    @property
    def is_inverted(self) -> bool:
        """Whether the setting polarityInvertHmi is on."""

    @property
    def gripper_rate_degps(self) -> float:
        """The rate of the arm's joints by the settings."""

    @property
    def speed_limits(self) -> tuple[float, float]:
        """The maximum speed of a burst in m/s and rad/s, with the session's cap."""

    async def call(self, service: graph.Service, arguments: dict[str, Any]) -> dict[str, Any]:
        """Call a service, and return the fields of its response."""

    async def cancel_navigation(self) -> str:
        """Cancel every goal of navigation, and return what its servers answered."""

    async def send_goal(self, goal: Pose2) -> None:
        """Send the robot to a pose on the map."""

    async def start_burst(self, linear_x: float, linear_y: float, angular_z: float, duration_s: float) -> None:
        """Drive with a velocity in m/s and rad/s that ends by itself. It replaces an earlier burst."""

    def stop_wheels(self) -> None:
        """End the burst, and send zero velocity."""

    def engage_stop(self) -> None:
        """Engage the stop of the console."""

    async def map_pose(self) -> Pose2 | None:
        """Return where the robot is on the map; None if that is not known."""

    async def state(self) -> RobotState:
        """Return the robot's last state."""

    async def light_rule(self) -> str:
        """Return the rule by which the light strip shows its light; empty if that is not known."""

    async def locations(self) -> dict[str, Pose2]:
        """Return the named locations."""

    async def save_location(self, name: str, pose: Pose2) -> None:
        """Save or replace a named location."""


class Executor:
    """Carries out approved calls, each with its tool's checked arguments."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._handlers: dict[str, Callable[[Values], Awaitable[Result]]] = {
            "drive": self._drive,
            "stop": self._stop,
            "nav_goto": self._nav_goto,
            "nav_forward": self._nav_forward,
            "rotate": self._rotate,
            "set_speed_cap": self._set_speed_cap,
            "nav_cancel": self._nav_cancel,
            "nav_goto_named": self._nav_goto_named,
            "list_named_locations": self._list_named_locations,
            "save_named_location": self._save_named_location,
            "gripper": self._gripper,
            "arm_preset": self._arm_preset,
            "arm_goto_pose": self._arm_goto_pose,
            "arm_save_pose": self._arm_save_pose,
            "arm_list_library": self._arm_list_library,
            "arm_run_sequence": self._arm_run_sequence,
            "arm_stop": self._arm_stop,
            "arm_record": self._arm_record,
            "calibrate_arm": self._calibrate_arm,
            "query_state": self._query_state,
            "engage_estop": self._engage_estop,
            "speak": self._speak,
            "set_light": self._set_light,
        }

    async def carry_out(self, tool: str, arguments: Values) -> Result:
        """Carry out a call, and return its result for the model: `ok`, and the tool's fields or an `error`."""
        try:
            return await self._handlers[tool](arguments)
        except CommandFailed as error:
            return {"ok": False, "error": clean(error)}

    async def find_unknown_name(self, tool: str, arguments: Values) -> Result | None:
        """Return the failure of a call whose location, pose or sequence does not exist, before anybody is asked to confirm it.

        None if it exists, or if that cannot be found out.
        """
        name = str(arguments.get("name", ""))
        try:
            if tool == "nav_goto_named":
                locations = await self._robot.locations()
                return None if _find(name, locations) else _unknown("location", locations)
            kind = {"arm_goto_pose": "poses", "arm_run_sequence": "sequences"}.get(tool)
            if kind is None or (kind == "poses" and name.lower() in PRESETS):
                return None
            known = (await self._library())[kind]
        except CommandFailed:
            return None
        return None if name.lower() in known else _unknown(kind.removesuffix("s"), known)

    # -- driving ------------------------------------------------------------------------------------------------------
    async def _drive(self, arguments: Values) -> Result:
        applied = {name: arguments[name] for name in ("linear_x", "linear_y", "angular_z")}
        sign = self._sign  # turns the axes by 180 degrees, as for the page's sticks; the turn rate stays
        x, y, turn = sign * applied["linear_x"], sign * applied["linear_y"], applied["angular_z"]
        await self._robot.start_burst(x, y, turn, arguments["duration_s"])
        return {"ok": True, "action": "drive", **applied, "duration_s": arguments["duration_s"]}

    async def _stop(self, _: Values) -> Result:
        self._robot.stop_wheels()
        return {"ok": True, "action": "stop"}

    async def _set_speed_cap(self, arguments: Values) -> Result:
        linear_mps, angular_rps = self._robot.speed_limits
        caps = {"max_linear_mps": round(linear_mps, 3), "max_angular_rps": round(angular_rps, 3)}
        return {"ok": True, "value": arguments["value"], **caps}

    async def _engage_estop(self, _: Values) -> Result:
        self._robot.engage_stop()
        return {"ok": True, "action": "engage_estop", "reason": STOP_REASON}

    @property
    def _sign(self) -> int:
        return -1 if self._robot.is_inverted else 1

    # -- navigation ---------------------------------------------------------------------------------------------------
    async def _nav_goto(self, arguments: Values) -> Result:
        goal = Pose2(arguments["x"], arguments["y"], wrap_angle(arguments["yaw"]))
        await self._robot.send_goal(goal)
        return {"ok": True, "action": "nav_goto", **_fields(goal)}

    async def _nav_forward(self, arguments: Values) -> Result:
        sign = self._sign
        turn_rad = math.radians(sign * arguments["rotate_deg"])
        start, goal = await self._go_by(Pose2(sign * arguments["forward_m"], sign * arguments["lateral_m"], turn_rad))
        return {"ok": True, "action": "nav_forward", "from": _fields(start), "goal": _fields(goal), **arguments}

    async def _rotate(self, arguments: Values) -> Result:
        start, goal = await self._go_by(Pose2(0.0, 0.0, math.radians(self._sign * arguments["angle_deg"])))
        yaws = {"from_yaw": round(start.yaw, 4), "to_yaw": round(goal.yaw, 4)}
        return {"ok": True, "action": "rotate", **yaws, "delta_deg": arguments["angle_deg"]}

    async def _go_by(self, offset: Pose2) -> tuple[Pose2, Pose2]:
        """Send a goal at an offset from the robot: x forward, y to the left. Return the poses on the map."""
        start = await self._map_pose()
        goal = start @ offset
        await self._robot.send_goal(goal)
        return start, goal

    async def _map_pose(self) -> Pose2:
        pose = await self._robot.map_pose()
        if pose is None:
            raise CommandFailed(NO_POSE)
        return pose

    async def _nav_cancel(self, _: Values) -> Result:
        return {"ok": True, "action": "nav_cancel", "response": await self._robot.cancel_navigation()}

    async def _nav_goto_named(self, arguments: Values) -> Result:
        locations = await self._robot.locations()
        name = _find(arguments["name"], locations)
        if name is None:
            return _unknown("location", locations)
        await self._robot.send_goal(locations[name])
        return {"ok": True, "action": "nav_goto_named", "name": quote(name), **_fields(locations[name])}

    async def _list_named_locations(self, _: Values) -> Result:
        locations = list((await self._robot.locations()).items())[:MAX_ITEMS]
        return {"ok": True, "locations": [{"name": quote(name), **_fields(pose)} for name, pose in locations]}

    async def _save_named_location(self, arguments: Values) -> Result:
        pose = await self._map_pose()
        await self._robot.save_location(arguments["name"], pose)
        return {"ok": True, "name": arguments["name"], **_fields(pose)}

    # -- the arm ------------------------------------------------------------------------------------------------------
    async def _gripper(self, arguments: Values) -> Result:
        action = arguments["action"]
        percent = _GRIPPER_PERCENT[action] if action in _GRIPPER_PERCENT else float(arguments["percent"])
        angle_deg = GRIPPER_CLOSED_DEG + (GRIPPER_OPEN_DEG - GRIPPER_CLOSED_DEG) * percent / 100.0
        request = {"angle": angle_deg, "rate": self._robot.gripper_rate_degps, "degrees": True}
        answer = await self._robot.call(graph.GRIPPER_ANGLE, request)
        if not answer["status"]:
            raise CommandFailed(GRIPPER_REFUSED)
        done = {"direction": action, "percent": percent, "angle_deg": angle_deg, "note": _GRIPPER_NOTE}
        return {"ok": True, **done}

    async def _arm_preset(self, arguments: Values) -> Result:
        return await self._ask(graph.ARM_PRESET, {"name": arguments["name"]}, name=arguments["name"])

    async def _arm_goto_pose(self, arguments: Values) -> Result:
        name = arguments["name"]
        service = graph.ARM_PRESET if name.lower() in PRESETS else graph.ARM_LIBRARY_GOTO_POSE
        return await self._ask(service, {"name": name}, name=name)

    async def _arm_save_pose(self, arguments: Values) -> Result:
        request = {"name": arguments["name"], "from_current": True, "has_gripper": True, "overwrite": True}
        return await self._ask(graph.ARM_LIBRARY_SAVE_POSE, request, name=arguments["name"])

    async def _arm_list_library(self, _: Values) -> Result:
        return {"ok": True, **{kind: quote_all(names) for kind, names in (await self._library()).items()}}

    async def _library(self) -> dict[str, list[str]]:
        """Return the names of the arm's poses and sequences."""
        answer = await self._robot.call(graph.ARM_LIBRARY_LIST, {})
        try:
            library = parse_json(answer["json"])
            return {kind: [str(each["name"]) for each in library[kind]] for kind in ("poses", "sequences")}
        except (ValueError, KeyError, TypeError) as error:
            raise CommandFailed("the arm's library is damaged") from error

    async def _arm_run_sequence(self, arguments: Values) -> Result:
        return await self._ask(graph.ARM_LIBRARY_PLAY, dict(arguments), **arguments)

    async def _arm_stop(self, _: Values) -> Result:
        return await self._ask(graph.ARM_LIBRARY_STOP, {})

    async def _arm_record(self, arguments: Values) -> Result:
        action = arguments["action"]
        request = {**arguments, "name": arguments.get("name", ""), "include_gripper": True, "overwrite": True}
        return await self._ask(graph.ARM_LIBRARY_RECORD, request, ("duration_s", "n_waypoints") if action == "save" else ())

    async def _calibrate_arm(self, arguments: Values) -> Result:
        fields = ("state", *(("joint_names", *_CALIBRATION_ARRAYS) if arguments["action"] == "commit" else ()))
        return await self._ask(graph.ARM_CALIBRATE, dict(arguments), fields)

    async def _ask(
        self, service: graph.Service, request: dict[str, Any], fields: tuple[str, ...] = (), **echoed: Any
    ) -> Result:
        """Call a service that answers `success` and `message`; the result also has these fields of the answer."""
        answer = await self._robot.call(service, request)
        result = {**echoed, "message": quote(answer["message"]), **{name: answer[name] for name in fields}}
        return {"ok": True, **result} if answer["success"] else {"ok": False, "error": ROBOT_REFUSED, **result}

    # -- the rest -----------------------------------------------------------------------------------------------------
    async def _query_state(self, arguments: Values) -> Result:
        state = await self._robot.state()
        battery = None if state.battery is None else dict(zip(("voltage", "percentage"), map(_number, state.battery)))
        fields = {
            "pose": None if state.odometry is None else _fields(state.odometry),
            "battery": battery,
            "estop": {"active": bool(state.estop), "reason": quote("; ".join(state.estop)) if state.estop else None},
        }
        return {"ok": True, **{name: fields[name] for name in arguments["fields"]}}

    async def _speak(self, _: Values) -> Result:
        return {"ok": True}

    async def _set_light(self, arguments: Values) -> Result:
        if "mode" in arguments:
            return await self._ask(graph.LEDS_AUTO, {}, action="auto")
        rgb = COLORS[arguments["color"]]
        answer = await self._robot.call(graph.LEDS_SET, {"color": rgb._asdict()})
        if not answer["status"]:
            raise CommandFailed(NO_STRIP)
        done = {"ok": True, "action": "set", "color": arguments["color"], "rgb": list(rgb)}
        rule = await self._robot.light_rule()
        return {**done, "shown": False, "message": NOT_SHOWN.format(rule=rule)} if rule in BEFORE_MANUAL else done


def _find(name: str, known: dict[str, Pose2]) -> str | None:
    """Return the known name that was meant: the same, or the same in other case."""
    return name if name in known else next((each for each in known if each.lower() == name.lower()), None)


def _unknown(kind: str, known: Iterable[str]) -> Result:
    return {"ok": False, "error": UNKNOWN_NAME.format(kind=kind), f"{kind}s": quote_all(known)}


def _fields(pose: Pose2) -> dict[str, float]:
    return {"x": round(pose.x, 3), "y": round(pose.y, 3), "yaw": round(pose.yaw, 4)}


def _number(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None
