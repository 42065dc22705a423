"""The page's settings. Pages take types and defaults from the same table.

Topics, limits and what concerns the robot are stored by the console for all browsers. Each browser keeps its own look, voice
and focus settings: they suit one screen and one person, and changing them must command nothing.

The key for a voice service is not among them: it stays in the browser in which it was typed. An empty address means this
console's own rosbridge or the robot's own video server. A page on another rosbridge watches and stops, and commands nothing.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_runtime import graph
from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.console.shared_file import change_object, read_object
from lupin_runtime.console.short_text import short_repr
from lupin_runtime.stack.runs import state_directory

VERSION = 5
OLDEST_VERSION = 2
# Before version 5, browsers stored values under these names that no operator had chosen.
_DROPPED_BEFORE_5 = ("polarityInvertHmi", "estopAutoOnFocusLoss", "rosUrl", "webVideoServerUrl")
_KEPT_BY_BROWSERS = ("geminiApiKey", "voiceNamedLocations")
# No user, query or fragment: the one is a secret, the others belong to a request.
_ADDRESS = re.compile(
    r"(?P<scheme>[a-z]+)://(\[[0-9A-Fa-f:.]{2,45}\]|[A-Za-z0-9_.-]{1,253})(:(?P<port>[0-9]{1,5}))?(/[A-Za-z0-9_.~/-]*)?"
)
_NAME = re.compile(r"[A-Za-z_/][A-Za-z0-9_/]{0,255}")


class BadSetting(ValueError):
    """An unknown setting, or a value that is not allowed; the text has the setting's name and what is expected."""


@dataclass(frozen=True)
class Setting:
    """One setting, of the same type as its default. Numbers have a range; texts may have choices, be ROS names, or be an
    address of one of some schemes or empty.

    Those that are not `shared` are kept by each browser.
    """

    name: str
    default: bool | int | float | str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    ros_name: bool = False
    schemes: tuple[str, ...] = ()
    max_length: int = 256
    shared: bool = True

    def check(self, value: Any) -> Any:
        """Return the value if it is allowed. Raises BadSetting."""
        if isinstance(self.default, bool):
            return self._expect(value, isinstance(value, bool), "true or false")
        if isinstance(self.default, (int, float)):
            fits = isinstance(value, (int, float)) and not isinstance(value, bool) and self.low <= value <= self.high
            whole = isinstance(self.default, int)
            kind = (
                f"a {'whole ' if whole else ''}number from {self.low:g} to {self.high:g}{f' {self.unit}' if self.unit else ''}"
            )
            return self._expect(value, fits and (not whole or value == int(value)), kind)
        if self.choices:
            return self._expect(value, value in self.choices, f"one of {', '.join(self.choices)}")
        if self.ros_name:
            return self._expect(value, isinstance(value, str) and bool(_NAME.fullmatch(value)), "a ROS name")
        if self.schemes:
            return self._expect(value, isinstance(value, str) and self._is_address(value), self._address_kind())
        return self._expect(
            value, isinstance(value, str) and len(value) <= self.max_length, f"text of up to {self.max_length} characters"
        )

    def _is_address(self, value: str) -> bool:
        found = _ADDRESS.fullmatch(value) if len(value) <= self.max_length else None
        return value == "" or (found is not None and found["scheme"] in self.schemes and 0 < int(found["port"] or 1) < 65536)

    def _address_kind(self) -> str:
        return f"empty or an address like {' or '.join(f'{scheme}://10.42.0.1:9090' for scheme in self.schemes)}"

    def _expect(self, value: Any, fits: bool, kind: str) -> Any:
        if not fits:
            raise BadSetting(f"{self.name} must be {kind}, not {short_repr(value, 60)}")
        return value


def _topic(name: str, row: graph.Topic) -> Setting:
    return Setting(name, row.name, ros_name=True)


SETTINGS = (
    _topic("cmdVelTopic", graph.CMD_VEL_MANUAL),
    Setting("cmdVelType", "geometry_msgs/msg/Twist", choices=("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")),
    Setting("imuTopic", "/io/imu/movement/data", ros_name=True),
    Setting("batteryTopic", "/io/power/power_watcher", ros_name=True),
    _topic("scanTopic", graph.SCAN),
    _topic("odomTopic", graph.ODOM),
    _topic("jointStatesTopic", graph.JOINT_STATES),
    _topic("rosoutTopic", graph.ROSOUT),
    _topic("cameraTopic", graph.BODY_IMAGE_ROBOT),
    _topic("mapTopic", graph.MAP),
    _topic("planTopic", graph.PLAN),
    _topic("goalPoseTopic", graph.GOAL_POSE),
    # A browser's own: the page of one operator may watch another robot.
    Setting("rosUrl", "", schemes=("ws", "wss"), shared=False),
    Setting("webVideoServerUrl", "", schemes=("http", "https")),
    Setting("mapFrame", graph.MAP_FRAME, ros_name=True),
    Setting("baseFrame", graph.BASE_FRAME, ros_name=True),
    Setting("speedScale", 0.5, low=0.05, high=1.0),
    Setting("armServoNamespace", "/io/servo/hiwonder", ros_name=True),
    Setting("armRateDegPerSec", 60.0, "deg/s", 1.0, 180.0),
    Setting("voiceEngine", "auto", choices=("auto", "offline"), shared=False),
    Setting("geminiModel", "models/gemini-3.1-flash-live-preview", shared=False),
    Setting("voiceLanguage", "en-US", max_length=35, shared=False),
    Setting("voicePushToTalk", True, shared=False),
    Setting("voiceVadEnabled", True, shared=False),
    Setting("voiceVadEndHoldMs", 800, "ms", 100, 10_000, shared=False),
    Setting("voiceVadStartThreshold", 0.02, low=0.0, high=1.0, shared=False),
    Setting("voiceVadEndThreshold", 0.012, low=0.0, high=1.0, shared=False),
    Setting("voiceVadMaxUtteranceMs", 15_000, "ms", 1000, 120_000, shared=False),
    Setting("voiceMaxLinearMps", 0.3, "m/s", 0.0, 0.6),
    Setting("voiceMaxAngularRps", 0.8, "rad/s", 0.0, 1.9),
    Setting("voiceSystemPrompt", "", max_length=20_000, shared=False),
    Setting("theme", "dark", choices=("dark", "light"), shared=False),
    Setting("surfaceContrast", "normal", choices=("normal", "high"), shared=False),
    Setting("reduceTransparency", False, shared=False),
    Setting("debugPublish", False, shared=False),
    Setting("estopAutoOnFocusLoss", True, shared=False),
    Setting("polarityInvertHmi", False),
)
_BY_NAME = {setting.name: setting for setting in SETTINGS}


def settings_file() -> Path:
    """Return the file of this user's settings."""
    return state_directory() / "console" / "settings.json"


def stored_settings(path: Path) -> dict[str, Any]:
    """Return the settings that were changed for all browsers. Raises MalformedFile and OSError."""
    try:
        return {name: _BY_NAME[name].check(value) for name, value in read_object(path).items() if _is_shared(name)}
    except BadSetting as error:
        raise MalformedFile(path, None, str(error)) from error


def change_settings(path: Path, changes: Any, version: Any = VERSION) -> dict[str, Any]:
    """Change some settings, sent by a page of `version`, and return all that were ever changed.

    Raises BadSetting, MalformedFile and OSError.
    """
    checked = _checked(changes, version)
    stored = change_object(path, lambda before: {**before, **checked})
    return {name: value for name, value in stored.items() if _is_shared(name)}


def _is_shared(name: str) -> bool:
    return name in _BY_NAME and _BY_NAME[name].shared


def describe_settings() -> list[dict[str, Any]]:
    """Return the table: each setting's name, default, unit and allowed values."""
    rows = []
    for setting in SETTINGS:
        row: dict[str, Any] = {"name": setting.name, "default": setting.default, "unit": setting.unit}
        if math.isfinite(setting.low):
            row.update(low=setting.low, high=setting.high)
        if setting.choices:
            row["choices"] = setting.choices
        elif setting.ros_name:
            row["ros_name"] = True
        elif setting.schemes:
            row.update(schemes=setting.schemes, max_length=setting.max_length)
        elif isinstance(setting.default, str):
            row["max_length"] = setting.max_length
        if not setting.shared:
            row["shared"] = False
        rows.append(row)
    return rows


def _checked(changes: Any, version: Any) -> dict[str, Any]:
    if isinstance(version, bool) or not isinstance(version, int) or not OLDEST_VERSION <= version <= VERSION:
        raise BadSetting(f"version must be a whole number from {OLDEST_VERSION} to {VERSION}, not {short_repr(version, 60)}")
    if not isinstance(changes, dict):
        raise BadSetting("settings must be an object of names and values")
    dropped = (*_KEPT_BY_BROWSERS, *(_DROPPED_BEFORE_5 if version < VERSION else ()))
    checked = {}
    for name, value in changes.items():
        if name in dropped:
            continue
        setting = _BY_NAME.get(name)
        if setting is None:
            raise BadSetting(f"there is no setting {name[:60]!r}")
        if setting.shared:
            checked[name] = setting.check(value)
    return checked
