import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_sim import pacing
from lupin_sim.faults import FAULTS, Faults, UnknownFault
from lupin_sim.pacing import CATCH_UP_S, HURRY, Pacer

RANGES = np.linspace(1, 2, 360, dtype=np.float32)


class Clock:
    def __init__(self, monkeypatch):
        self.now = 50.0
        monkeypatch.setattr(pacing.time, "monotonic", lambda: self.now)


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


@pytest.mark.parametrize("speed", [0.5, 1.0, 3.0])
def test_simulated_time_waits_for_the_wall_clock(clock, speed):
    pacer = Pacer(speed)
    pacer.start(1.0)
    assert pacer.wait_s(1.3) == pytest.approx(0.3 / speed)
    clock.now += 0.3 / speed
    assert pacer.wait_s(1.3) == pytest.approx(0.0)
    assert pacer.real_time_factor(1.3) == pytest.approx(speed)


def test_a_little_lost_time_is_caught_up(clock):
    pacer = Pacer(1.0)
    pacer.start(0.0)
    clock.now += CATCH_UP_S * 0.9
    assert pacer.wait_s(0.0) == 0.0
    assert pacer.wait_s(CATCH_UP_S) == pytest.approx(CATCH_UP_S * 0.1)


def test_much_lost_time_is_made_up_slowly(clock):
    pacer, sim_s = Pacer(1.0), 0.0
    pacer.start(0.0)
    clock.now += 2.0
    for _ in range(6000):
        began_s, wait_s = clock.now, pacer.wait_s(sim_s)
        clock.now += max(wait_s, 0.001)
        sim_s += 0.01
        assert clock.now - began_s >= 0.01 / (1.0 + 2 * HURRY) or sim_s <= 0.02
    assert pacer.real_time_factor(sim_s) == pytest.approx(1.0, abs=1e-3)


def test_much_lost_time_shows_in_the_factor_and_is_not_hurried_after(clock):
    pacer = Pacer(1.0)
    pacer.start(0.0)
    clock.now += 10.0
    assert pacer.wait_s(0.0) == 0.0
    assert pacer.wait_s(0.5) == pytest.approx(0.5)
    clock.now += 0.5
    assert pacer.real_time_factor(0.5) == pytest.approx(0.5 / 10.5)


def test_speed_zero_never_waits(clock):
    pacer = Pacer(0.0)
    pacer.start(0.0)
    assert pacer.wait_s(1000.0) == 0.0


# -- faults -----------------------------------------------------------------------------------------------------------
def test_a_sound_lidar_says_what_it_sees():
    assert Faults().scan(RANGES) is RANGES


def test_each_way_to_break_a_lidar():
    faults = Faults()
    faults.order("scan nan")
    assert np.isnan(faults.scan(RANGES)).all()
    faults.order("scan zero")
    assert not faults.scan(RANGES).any()
    faults.order("scan silent")
    assert faults.scan(RANGES) is None
    faults.order("scan frozen")
    assert faults.scan(RANGES) is RANGES
    assert faults.scan(RANGES * 2) is RANGES
    faults.order("scan none")
    assert faults.scan(RANGES * 2)[0] == 2.0


def test_other_sensors_fall_silent_one_by_one():
    faults = Faults()
    faults.order(" camera silent ")
    assert faults.silent("camera")
    assert not faults.silent("odometry")
    faults.order("camera none")
    assert not faults.silent("camera")


def test_the_clock_jumps_ahead_and_back():
    faults = Faults()
    faults.order("clock 5")
    faults.order("clock -7.5")
    assert faults.clock_offset_ns == -2_500_000_000


@pytest.mark.parametrize("text", ["", "scan", "scan broken", "lidar nan", "clock", "clock soon", "clock nan", "clock 1e9"])
def test_an_unknown_order_is_refused_and_breaks_nothing(text):
    faults = Faults()
    with pytest.raises(UnknownFault, match=r"there are|seconds"):
        faults.order(text)
    assert faults == Faults()


@given(st.text())
def test_no_text_does_more_than_the_table_says(text):
    faults = Faults()
    try:
        faults.order(text)
    except UnknownFault:
        return
    assert math.isfinite(faults.clock_offset_ns)
    assert all(faults.broken[what] in ways for what, ways in FAULTS.items())
