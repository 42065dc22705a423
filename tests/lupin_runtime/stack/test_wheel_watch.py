"""Whether the wheels turn while they are commanded."""

from __future__ import annotations

import pytest

from lupin_runtime.drive.twist import ZERO, Twist
from lupin_runtime.stack.wheel_watch import WheelWatch

FORWARD = Twist(0.2, 0.0, 0.0)


def odometry(x: int, stamp: int) -> bytes:
    return b"\x00\x01\x00\x00" + stamp.to_bytes(8, "little") + b"odom" + x.to_bytes(8, "little")


def driven(twist: Twist, moves_every_s: float = 60.0, until_s: float = 2.0) -> WheelWatch:
    """Return a watch after commands at 20 Hz and odometry at 50 Hz."""
    watch = WheelWatch()
    for step in range(round(until_s * 100)):
        now_s = step / 100
        if step % 5 == 0:
            watch.command("joy", twist, now_s)
        if step % 2 == 0:
            watch.odometry(odometry(int(now_s / moves_every_s), step), now_s)
    return watch


def test_commanded_wheels_that_stand_are_measured() -> None:
    assert driven(FORWARD).idle_s == pytest.approx(2.0, abs=0.05)
    assert driven(Twist(0.0, 0.0, -0.5)).idle_s == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("twist", [ZERO, Twist(0.02, 0.0, 0.1)])
def test_wheels_that_are_not_commanded_may_stand(twist: Twist) -> None:
    assert driven(twist).idle_s == 0.0


def test_wheels_that_turn_slowly_are_not_idle() -> None:
    assert driven(FORWARD, moves_every_s=0.3).idle_s <= 0.31


def test_silent_odometry_shows_nothing() -> None:
    watch = WheelWatch()
    for step in range(40):
        watch.command("joy", FORWARD, step / 20)
    assert watch.idle_s == 0.0


def test_locked_bus_and_gaps_between_commands_count_nothing() -> None:
    watch = WheelWatch()
    for step in range(20):
        watch.command("joy", FORWARD, step / 10)
        watch.bus("joy", is_locked=True)
        watch.odometry(odometry(0, step), step / 10)
    assert watch.idle_s == 0.0
    for step in range(4):
        watch.command("joy", FORWARD, 10.0 + step)
        watch.bus("joy", is_locked=False)
        watch.odometry(odometry(0, step), 10.1 + step)
    assert watch.idle_s <= 0.11


@pytest.mark.parametrize("known_from_s", [0.0, 0.5])
def test_zeros_of_another_input_hide_nothing(known_from_s: float) -> None:
    watch = WheelWatch()
    for step in range(40):
        now_s = step / 20
        if now_s >= known_from_s:
            watch.bus("joy", is_locked=False)
        watch.command("joy", FORWARD, now_s)
        watch.command("manual", ZERO, now_s)
        watch.odometry(odometry(0, step), now_s)
    assert watch.idle_s == pytest.approx(2.0 - known_from_s, abs=0.15)


def test_commands_of_an_outranked_input_count_nothing() -> None:
    watch = WheelWatch()
    watch.bus("joy", is_locked=False)
    for step in range(40):
        watch.command("joy", ZERO, step / 20)
        watch.command("manual", FORWARD, step / 20)
        watch.odometry(odometry(0, step), step / 20)
    assert watch.idle_s == 0.0
