"""The rules that select the light, and the byte order of colors on the strip."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.lights import (
    BEFORE_MANUAL,
    COLORS_BY_NAME,
    LIFECYCLE_COLORS,
    MANUAL,
    RULES,
    Light,
    Mission,
    MotionDetector,
    Rgb,
    View,
    byte_order,
    choose,
    shown,
)
from lupin_runtime.lights.palette import HELP, HOMING, IN_PROGRESS_COLORS, WAITING
from lupin_runtime.lights.robot_state import RobotState

STATES = ("BOOT", "READY", "PREPARE", "EXPLORING", "INSPECTING", "MONITORING", "RETURNING", "DONE", "FAULT", "NONSENSE")
PHASES = ("", "LOCALIZING", "NAVIGATING", "SCANNING", "CONFIRMING", "PUBLISHING")
MISSION = st.builds(
    Mission, st.sampled_from(STATES), st.sampled_from(PHASES), st.booleans(), st.booleans(), st.booleans(), st.booleans()
)
COLOR = st.builds(Rgb, *[st.integers(0, 255)] * 3)
VIEW = st.builds(View, st.none() | MISSION, st.booleans(), st.none() | COLOR, st.booleans(), st.booleans(), st.booleans())


@given(VIEW)
def test_stop_or_fault_is_red_regardless_of_age(view: Any) -> None:
    mission = view.mission
    if view.estop or (mission and (mission.estop or mission.lifecycle == "FAULT")):
        assert choose(view) == ("e-stop or fault", Light(COLORS_BY_NAME["RED"]))
    else:
        assert choose(view)[0] != "e-stop or fault"


@given(VIEW)
def test_stale_mission_is_ignored(view: Any) -> None:
    if view.mission is None or view.mission.estop or view.mission.lifecycle == "FAULT":
        return
    stale = dataclasses.replace(view, mission=dataclasses.replace(view.mission, fresh=False))
    assert choose(stale) == choose(dataclasses.replace(view, mission=None))


@given(VIEW, COLOR, st.booleans())
def test_manual_color_is_shown_unless_a_rule_before_it_applies(view: Any, color: Any, is_lost: bool) -> None:
    rule, light = choose(dataclasses.replace(view, manual=color, mission_lost=is_lost))
    assert rule in BEFORE_MANUAL or (rule == MANUAL and light == Light(color))


@given(VIEW)
def test_manual_color_is_below_stop_and_pause(view: Any) -> None:
    if view.manual is not None and choose(view)[0] not in ("e-stop or fault", "paused"):
        assert choose(view) == ("set by hand", Light(view.manual))


@given(VIEW)
def test_only_motion_without_a_mission_blinks(view: Any) -> None:
    name, light = choose(view)
    assert light.blinking == (name in ("arm moving", "driving"))
    if light.blinking:
        assert view.current is None or view.current.lifecycle not in IN_PROGRESS_COLORS


@given(VIEW, st.sampled_from(RobotState), st.booleans())
def test_robots_own_state_hides_no_stop_pause_or_mission(view: Any, state: RobotState, lost: bool) -> None:
    before, now = choose(view)[0], choose(dataclasses.replace(view, robot=state, mission_lost=lost))[0]
    if before in ("e-stop or fault", "paused") or (
        not lost and before in ("set by hand", "returning for the battery", "mission under way")
    ):
        assert now == before


@pytest.mark.parametrize(
    ("view", "light"),
    [
        (View(robot=RobotState.WAITING), Light(WAITING, blinking=True)),
        (View(robot=RobotState.HOMING), Light(HOMING, blinking=True)),
        (View(robot=RobotState.HOMING, arm_moving=True), Light(HOMING, blinking=True)),
        (View(robot=RobotState.HELP), Light(HELP, blinking=True)),
        (View(robot=RobotState.READY), Light(COLORS_BY_NAME["BLUE"])),
        # Who drives a robot that needs help sees that it drives.
        (View(robot=RobotState.HELP, driving=True), Light(COLORS_BY_NAME["GREEN"], blinking=True)),
        (View(robot=RobotState.HELP, manual=Rgb(1, 2, 3)), Light(Rgb(1, 2, 3))),
        (View(Mission("READY"), robot=RobotState.HELP), Light(HELP, blinking=True)),
        (View(Mission("EXPLORING", fresh=False), robot=RobotState.HELP, mission_lost=True), Light(HELP, blinking=True)),
        (View(mission_lost=True, manual=Rgb(1, 2, 3)), Light(HELP, blinking=True)),
        (View(mission_lost=True, driving=True), Light(COLORS_BY_NAME["GREEN"], blinking=True)),
        (View(mission_lost=True, estop=True), Light(COLORS_BY_NAME["RED"])),
    ],
)
def test_state_of_the_robot_has_its_light(view: View, light: Light) -> None:
    assert choose(view)[1] == light


def test_lights_of_the_robots_states_differ_from_all_that_blink() -> None:
    blinking = [HELP, HOMING, WAITING, COLORS_BY_NAME["ORANGE"], COLORS_BY_NAME["GREEN"]]
    assert len(set(blinking)) == len(blinking) and COLORS_BY_NAME["RED"] not in blinking


@given(VIEW)
def test_first_applicable_rule_wins(view: Any) -> None:
    spoken = [(name, light) for name, rule in RULES if (light := rule(view)) is not None]
    assert choose(view) == spoken[0]


@pytest.mark.parametrize("lifecycle", LIFECYCLE_COLORS)
def test_every_mission_state_has_its_color(lifecycle: str) -> None:
    assert choose(View(Mission(lifecycle)))[1] == Light(LIFECYCLE_COLORS[lifecycle])


@pytest.mark.parametrize(
    ("view", "color", "blinking"),
    [
        (View(), "BLUE", False),
        (View(Mission("INSPECTING", "SCANNING")), "PURPLE", False),
        (View(Mission("MONITORING", "CONFIRMING")), "PURPLE", False),
        (View(Mission("INSPECTING", "PUBLISHING")), "WHITE", False),
        (View(Mission("EXPLORING", paused=True)), "AMBER", False),
        (View(Mission("READY", paused=True)), "BLUE", False),
        (View(Mission("READY", paused=True), manual=COLORS_BY_NAME["WHITE"]), "WHITE", False),
        (View(Mission("RETURNING", battery_low=True)), "BATTERY_LOW", False),
        (View(Mission("RETURNING", battery_low=True, paused=True)), "AMBER", False),
        (View(Mission("READY", battery_low=True)), "BLUE", False),
        (View(Mission("NONSENSE")), "OFF", False),
        (View(Mission("NONSENSE"), unknown_state_off=False), "BLUE", False),
        (View(Mission("READY"), arm_moving=True, driving=True), "ORANGE", True),
        (View(Mission("DONE"), driving=True), "GREEN", True),
        (View(Mission("EXPLORING"), driving=True), "SPRING", False),
        (View(Mission("DONE", fresh=False)), "BLUE", False),
    ],
)
def test_light_rules_match_the_examples(view: Any, color: str, blinking: bool) -> None:
    assert choose(view)[1] == Light(COLORS_BY_NAME[color], blinking)


@given(st.floats(0, 1e6), st.floats(0.1, 5))
def test_blinking_light_is_on_in_the_first_half_period(now_s: float, hz: float) -> None:
    on = (now_s * hz) % 1.0 < 0.5
    assert shown(Light(COLORS_BY_NAME["GREEN"], True), now_s, hz) == COLORS_BY_NAME["GREEN" if on else "OFF"]
    assert shown(Light(COLORS_BY_NAME["GREEN"]), now_s, hz) == COLORS_BY_NAME["GREEN"]


@given(COLOR, st.permutations("RGB"))
def test_byte_order_matches_the_wiring_of_the_strip(color: Any, order: list[str]) -> None:
    sent = [color[index] for index in byte_order("".join(order))]
    assert dict(zip(order, sent)) == dict(zip("RGB", color))


@pytest.mark.parametrize("order", ["", "RGBW", "RRB", "xyz"])
def test_invalid_color_order_means_rgb(order: str) -> None:
    assert byte_order(order) == (0, 1, 2)


def test_robot_strip_gets_blue_first() -> None:
    assert byte_order("brg") == (2, 0, 1)


def test_slow_motion_is_detected_but_noise_is_not() -> None:
    detector = MotionDetector(0.0087, 0.3)
    for k in range(10):
        detector.update([0.005 * (k % 2), 0.0], k * 10**8)
        assert not detector.moving(k * 10**8)
    for k in range(10, 20):
        detector.update([0.002 * (k - 10), 0.0], k * 10**8)
    assert detector.moving(19 * 10**8) or detector.moving(18 * 10**8)
    assert not detector.moving(30 * 10**8)
