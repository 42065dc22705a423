"""Selects the light to show: a table of rules in the order of their precedence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import takewhile
from typing import NamedTuple

from lupin_runtime.lights.palette import (
    AMBER,
    BATTERY_LOW,
    GREEN,
    HELP,
    HOMING,
    IN_PROGRESS_COLORS,
    OFF,
    ORANGE,
    PHASE_COLORS,
    READY,
    RED,
    RESTING_COLORS,
    WAITING,
    Rgb,
)
from lupin_runtime.lights.robot_state import RobotState


class Light(NamedTuple):
    """A color, steady or blinking."""

    color: Rgb
    blinking: bool = False


@dataclass(frozen=True)
class Mission:
    """The last state of the mission. A state that is not `fresh` is ignored, except for its e-stop and fault."""

    lifecycle: str
    phase: str = ""
    paused: bool = False
    estop: bool = False
    battery_low: bool = False
    fresh: bool = True


@dataclass(frozen=True)
class View:
    """The inputs of the rules."""

    mission: Mission | None = None
    estop: bool = False
    manual: Rgb | None = None
    arm_moving: bool = False
    driving: bool = False
    unknown_state_off: bool = True
    robot: RobotState = RobotState.READY
    mission_lost: bool = False  # a mission was in progress when its laptop fell silent

    @property
    def current(self) -> Mission | None:
        """The mission's state, if it is fresh."""
        return self.mission if self.mission is not None and self.mission.fresh else None


Rule = Callable[[View], "Light | None"]
MANUAL = "set by hand"


def _stopped(view: View) -> Light | None:
    mission = view.mission
    # Freshness does not matter here: after the last received stop the strip stays red, even if the publisher has died. On a
    # robot, MissionWatch forgets it.
    stopped = view.estop or (mission is not None and (mission.estop or mission.lifecycle == "FAULT"))
    return Light(RED) if stopped else None


def _paused(view: View) -> Light | None:
    # A stop pauses a mission at rest, too: it has nothing to resume, so its own color comes back once the stop is released.
    mission = view.current
    return Light(AMBER) if mission is not None and mission.paused and mission.lifecycle not in RESTING_COLORS else None


def _mission_lost(view: View) -> Light | None:
    # Above a color set by hand, which hides nothing that needs a person. A person who drives the robot by gamepad is there.
    return Light(HELP, blinking=True) if view.mission_lost and not (view.driving or view.arm_moving) else None


def _manual(view: View) -> Light | None:
    return Light(view.manual) if view.manual is not None else None


def _battery(view: View) -> Light | None:
    mission = view.current
    returning = mission is not None and mission.battery_low and mission.lifecycle == "RETURNING"
    return Light(BATTERY_LOW) if returning else None


def _in_progress(view: View) -> Light | None:
    mission = view.current
    if mission is None or mission.lifecycle not in IN_PROGRESS_COLORS:
        return None
    return Light(PHASE_COLORS.get(mission.phase, IN_PROGRESS_COLORS[mission.lifecycle]))


def _homing(view: View) -> Light | None:
    return Light(HOMING, blinking=True) if view.robot is RobotState.HOMING else None


def _arm(view: View) -> Light | None:
    return Light(ORANGE, blinking=True) if view.arm_moving else None


def _driving(view: View) -> Light | None:
    return Light(GREEN, blinking=True) if view.driving else None


def _help(view: View) -> Light | None:
    return Light(HELP, blinking=True) if view.robot is RobotState.HELP else None


def _waiting(view: View) -> Light | None:
    return Light(WAITING, blinking=True) if view.robot is RobotState.WAITING else None


def _resting(view: View) -> Light | None:
    mission = view.current
    if mission is None:
        return None
    if mission.lifecycle in RESTING_COLORS:
        return Light(RESTING_COLORS[mission.lifecycle])
    return Light(OFF) if view.unknown_state_off else None


RULES: tuple[tuple[str, Rule], ...] = (
    ("e-stop or fault", _stopped),
    ("paused", _paused),
    ("laptop lost in a mission", _mission_lost),
    (MANUAL, _manual),
    ("returning for the battery", _battery),
    ("mission under way", _in_progress),
    ("homing", _homing),
    ("arm moving", _arm),
    ("driving", _driving),
    ("needs help", _help),
    ("waiting for vendor", _waiting),
    ("mission at rest", _resting),
    ("ready", lambda _: Light(READY)),
)
# While one of these applies, a color that was set by hand is kept, and not shown.
BEFORE_MANUAL = tuple(takewhile(lambda name: name != MANUAL, (name for name, _ in RULES)))


def choose(view: View) -> tuple[str, Light]:
    """Return the name and light of the first rule that applies."""
    for name, rule in RULES:
        light = rule(view)
        if light is not None:
            return name, light
    raise AssertionError("the last rule always applies")


def shown(light: Light, now_s: float, blink_hz: float) -> Rgb:
    """Return the color of a light at `now_s`: a blinking one is on during the first half of each period."""
    if light.blinking and (now_s * blink_hz) % 1.0 >= 0.5:
        return OFF
    return light.color
