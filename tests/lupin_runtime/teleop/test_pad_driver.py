"""What pads publish: velocities while a dead-man button is held, one zero at its release, and then nothing."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.drive import ZERO, Twist
from lupin_runtime.teleop.events import ABS_RX, ABS_X, ABS_Y, BTN_TL, BTN_TR
from lupin_runtime.teleop.pad_driver import PadDriver
from lupin_runtime.teleop.pad_selection import MIN_PERIOD_S, PERIOD_S
from lupin_runtime.teleop.pad_state import PadState
from lupin_runtime.teleop.velocity import NORMAL, TURBO, Sticks, command_velocity, normalize, shape
from tests.support.pad_events import MS, SETTLED_NS, axis, held_state, key, new_state

NOW_NS = SETTLED_NS + 100 * MS
PERIOD_NS = int(PERIOD_S * 1e9)
UNITS = st.floats(-1.0, 1.0)


def release(state: PadState, at_ns: int = NOW_NS) -> None:
    state.handle(key(BTN_TL, 0, at_ns), at_ns)


def press(state: PadState, at_ns: int = NOW_NS) -> None:
    state.handle(key(BTN_TL, 1, at_ns), at_ns)


def test_nothing_is_published_before_the_dead_man_is_held() -> None:
    state, driver = new_state(), PadDriver()
    state.handle(axis(ABS_Y, -32768, NOW_NS), NOW_NS)
    assert driver.step({"event7": state}, NOW_NS) is None


def test_held_pad_publishes_twenty_times_a_second() -> None:
    state, driver = held_state(NOW_NS), PadDriver()
    state.handle(axis(ABS_Y, -32768, NOW_NS), NOW_NS)
    sent = [driver.step({"event7": state}, NOW_NS + index * MS) for index in range(1000)]
    assert [twist for twist in sent if twist is not None] == [Twist(NORMAL.linear_mps, 0.0, 0.0)] * 20


def test_change_is_published_at_once_but_not_each_of_a_flood() -> None:
    state, driver = held_state(NOW_NS), PadDriver()
    pads = {"event7": state}
    assert driver.step(pads, NOW_NS) == ZERO
    later_ns = NOW_NS + int(MIN_PERIOD_S * 1e9)
    state.handle(axis(ABS_Y, -32768, later_ns), later_ns)
    assert driver.step(pads, later_ns) == Twist(NORMAL.linear_mps, 0.0, 0.0)
    state.handle(axis(ABS_Y, 32767, later_ns), later_ns)
    assert driver.step(pads, later_ns + MS) is None
    assert driver.delayed
    state.handle(axis(ABS_Y, 0, later_ns), later_ns)
    assert driver.step(pads, later_ns + 2 * MS) == ZERO
    assert not driver.delayed


def test_release_publishes_one_zero_and_then_nothing() -> None:
    state, driver = held_state(NOW_NS), PadDriver()
    assert driver.step({"event7": state}, NOW_NS) is not None
    release(state)
    sent = [driver.step({"event7": state}, NOW_NS + index * PERIOD_NS) for index in range(100)]
    assert sent == [ZERO] + [None] * 99


def test_unplugged_pad_publishes_one_zero() -> None:
    driver = PadDriver()
    assert driver.step({"event7": held_state(NOW_NS)}, NOW_NS) is not None
    assert [driver.step({}, NOW_NS), driver.step({}, NOW_NS + PERIOD_NS)] == [ZERO, None]


def test_second_pad_drives_only_after_a_new_press() -> None:
    first, second, driver = held_state(NOW_NS), held_state(NOW_NS), PadDriver()
    pads = {"event7": first}
    driver.step(pads, NOW_NS)
    pads["event8"] = second
    driver.step(pads, NOW_NS + PERIOD_NS)
    assert driver.driving == "event7"
    release(first)
    assert [driver.step(pads, NOW_NS + index * PERIOD_NS) for index in (2, 3)] == [ZERO, None]
    release(second)
    assert driver.step(pads, NOW_NS + 4 * PERIOD_NS) is None
    press(second)
    assert driver.step(pads, NOW_NS + 5 * PERIOD_NS) is not None
    assert driver.driving == "event8"


def test_turbo_is_faster() -> None:
    state, driver = held_state(NOW_NS), PadDriver()
    state.handle(axis(ABS_RX, 32767, NOW_NS) + axis(ABS_X, 32767, NOW_NS) + key(BTN_TR, 1, NOW_NS), NOW_NS)
    assert driver.step({"event7": state}, NOW_NS) == Twist(0.0, -TURBO.linear_mps, -TURBO.yaw_radps)


@given(st.builds(Sticks, UNITS, UNITS, UNITS), st.booleans(), st.sampled_from([0.1, 0.15]))
def test_speed_stays_within_its_limits_and_keeps_direction(sticks: Sticks, turbo: bool, dead_zone: float) -> None:
    twist, speeds = command_velocity(sticks, turbo=turbo, dead_zone=dead_zone), TURBO if turbo else NORMAL
    assert math.hypot(twist.x, twist.y) <= speeds.linear_mps * 1.000001
    assert abs(twist.yaw) <= speeds.yaw_radps
    assert twist.x * sticks.forward >= 0.0
    assert twist.y * sticks.left >= 0.0
    assert twist.yaw * sticks.turn_left >= 0.0
    if math.hypot(sticks.forward, sticks.left) <= dead_zone:
        assert (twist.x, twist.y) == (0.0, 0.0)


@given(st.floats(0.0, 1.5), st.floats(0.0, 1.5))
def test_more_deflection_is_never_slower(one: float, other: float) -> None:
    low, high = sorted((one, other))
    assert 0.0 <= shape(low, 0.1) <= shape(high, 0.1) <= 1.0


@pytest.mark.parametrize(("value", "place"), [(None, 0.0), (0, -1.0), (255, 1.0), (-10, -1.0), (1000, 0.0), (-1000, 0.0)])
def test_stick_values_become_shares_of_its_way(value: int | None, place: float) -> None:
    assert normalize(value, 0, 255) == place
    assert normalize(value, 5, 5) == 0.0
