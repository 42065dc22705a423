from __future__ import annotations

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.lights import (
    COLOURS,
    LIFECYCLE,
    RULES,
    Light,
    Mission,
    MotionDetector,
    Rgb,
    View,
    choose,
    permutation,
    shown,
)
from lupin_runtime.lights.palette import IN_PROGRESS

STATES = ("BOOT", "READY", "PREPARE", "EXPLORING", "INSPECTING", "MONITORING", "RETURNING", "DONE", "FAULT", "NONSENSE")
PHASES = ("", "LOCALIZING", "NAVIGATING", "SCANNING", "CONFIRMING", "PUBLISHING")
MISSION = st.builds(
    Mission, st.sampled_from(STATES), st.sampled_from(PHASES), st.booleans(), st.booleans(), st.booleans(), st.booleans()
)
COLOUR = st.builds(Rgb, *[st.integers(0, 255)] * 3)
VIEW = st.builds(View, st.none() | MISSION, st.booleans(), st.none() | COLOUR, st.booleans(), st.booleans(), st.booleans())


@given(VIEW)
def test_a_stop_or_fault_is_red_whatever_else_is_and_however_old_it_is(view):
    mission = view.mission
    if view.estop or (mission and (mission.estop or mission.lifecycle == "FAULT")):
        assert choose(view) == ("e-stop or fault", Light(COLOURS["RED"]))
    else:
        assert choose(view)[0] != "e-stop or fault"


@given(VIEW)
def test_a_mission_that_fell_silent_is_as_good_as_none(view):
    if view.mission is None or view.mission.estop or view.mission.lifecycle == "FAULT":
        return
    stale = dataclasses.replace(view, mission=dataclasses.replace(view.mission, fresh=False))
    assert choose(stale) == choose(dataclasses.replace(view, mission=None))


@given(VIEW)
def test_below_stop_and_pause_what_was_set_by_hand_is_shown(view):
    if view.manual is not None and choose(view)[0] not in ("e-stop or fault", "paused"):
        assert choose(view) == ("set by hand", Light(view.manual))


@given(VIEW)
def test_only_a_moving_robot_without_a_mission_under_way_blinks(view):
    name, light = choose(view)
    assert light.blinking == (name in ("arm moving", "driving"))
    if light.blinking:
        assert view.current is None or view.current.lifecycle not in IN_PROGRESS


@given(VIEW)
def test_the_first_rule_that_speaks_wins(view):
    spoken = [(name, light) for name, rule in RULES if (light := rule(view)) is not None]
    assert choose(view) == spoken[0]


@pytest.mark.parametrize("lifecycle", LIFECYCLE)
def test_every_state_has_its_colour(lifecycle):
    assert choose(View(Mission(lifecycle)))[1] == Light(LIFECYCLE[lifecycle])


@pytest.mark.parametrize(
    ("view", "colour", "blinking"),
    [
        (View(), "BLUE", False),
        (View(Mission("INSPECTING", "SCANNING")), "PURPLE", False),
        (View(Mission("MONITORING", "CONFIRMING")), "PURPLE", False),
        (View(Mission("INSPECTING", "PUBLISHING")), "WHITE", False),
        (View(Mission("EXPLORING", paused=True)), "AMBER", False),
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
def test_examples_of_the_table(view, colour, blinking):
    assert choose(view)[1] == Light(COLOURS[colour], blinking)


@given(st.floats(0, 1e6), st.floats(0.1, 5))
def test_a_blinking_light_is_on_in_the_first_half_of_each_period_and_a_steady_one_always(now_s, hz):
    on = (now_s * hz) % 1.0 < 0.5
    assert shown(Light(COLOURS["GREEN"], True), now_s, hz) == COLOURS["GREEN" if on else "OFF"]
    assert shown(Light(COLOURS["GREEN"]), now_s, hz) == COLOURS["GREEN"]


@given(COLOUR, st.permutations("RGB"))
def test_bytes_are_permuted_so_that_each_drives_the_colour_it_is_wired_to(colour, order):
    sent = [colour[index] for index in permutation("".join(order))]
    assert dict(zip(order, sent)) == dict(zip("RGB", colour))


@pytest.mark.parametrize("order", ["", "RGBW", "RRB", "xyz"])
def test_an_order_that_is_none_is_rgb(order):
    assert permutation(order) == (0, 1, 2)


def test_the_robots_strip_gets_blue_first():
    assert permutation("brg") == (2, 0, 1)


def test_trembling_is_no_motion_and_a_slow_one_is():
    detector = MotionDetector(0.0087, 0.3)
    for k in range(10):
        detector.update([0.005 * (k % 2), 0.0], k * 10**8)
        assert not detector.moving(k * 10**8)
    for k in range(10, 20):
        detector.update([0.002 * (k - 10), 0.0], k * 10**8)
    assert detector.moving(19 * 10**8) or detector.moving(18 * 10**8)
    assert not detector.moving(30 * 10**8)
