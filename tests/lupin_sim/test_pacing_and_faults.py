"""The simulation keeps to the wall clock, and its sensors fail on request."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_sim.pacing import CATCH_UP_RATE, CATCH_UP_S, Pacer
from lupin_sim.sensor_faults import FAULTS, InvalidFault, SensorFaults
from tests.support.optional import present

RANGES = np.linspace(1, 2, 360, dtype=np.float32)


class Clock:
    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 50.0
        monkeypatch.setattr(time, "monotonic", lambda: self.now)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Any:
    return Clock(monkeypatch)


@pytest.mark.parametrize("speed", [0.5, 1.0, 3.0])
def test_pacer_waits_for_the_wall_clock(clock: Any, speed: float) -> None:
    pacer = Pacer(speed)
    pacer.start(1.0)
    assert pacer.wait_s(1.3) == pytest.approx(0.3 / speed)
    clock.now += 0.3 / speed
    assert pacer.wait_s(1.3) == pytest.approx(0.0)
    assert pacer.real_time_factor(1.3) == pytest.approx(speed)


def test_small_delay_is_caught_up_at_once(clock: Any) -> None:
    pacer = Pacer(1.0)
    pacer.start(0.0)
    clock.now += CATCH_UP_S * 0.9
    assert pacer.wait_s(0.0) == 0.0
    assert pacer.wait_s(CATCH_UP_S) == pytest.approx(CATCH_UP_S * 0.1)


def test_large_delay_is_made_up_slowly(clock: Any) -> None:
    pacer, sim_s = Pacer(1.0), 0.0
    pacer.start(0.0)
    clock.now += 2.0
    for _ in range(6000):
        start_s, wait_s = clock.now, pacer.wait_s(sim_s)
        clock.now += max(wait_s, 0.001)
        sim_s += 0.01
        assert clock.now - start_s >= 0.01 / (1.0 + 2 * CATCH_UP_RATE) or sim_s <= 0.02
    assert pacer.real_time_factor(sim_s) == pytest.approx(1.0, abs=1e-3)


def test_large_delay_shows_in_the_real_time_factor(clock: Any) -> None:
    pacer = Pacer(1.0)
    pacer.start(0.0)
    clock.now += 10.0
    assert pacer.wait_s(0.0) == 0.0
    assert pacer.wait_s(0.5) == pytest.approx(0.5)
    clock.now += 0.5
    assert pacer.real_time_factor(0.5) == pytest.approx(0.5 / 10.5)


@pytest.mark.usefixtures("clock")
def test_speed_zero_never_waits() -> None:
    pacer = Pacer(0.0)
    pacer.start(0.0)
    assert pacer.wait_s(1000.0) == 0.0


# -- faults -----------------------------------------------------------------------------------------------------------
def test_lidar_without_fault_is_unchanged() -> None:
    assert SensorFaults().distort_scan(RANGES) is RANGES


def test_lidar_faults_change_the_ranges() -> None:
    faults = SensorFaults()
    faults.apply("scan nan")
    assert np.isnan(present(faults.distort_scan(RANGES))).all()
    faults.apply("scan zero")
    assert not present(faults.distort_scan(RANGES)).any()
    faults.apply("scan silent")
    assert faults.distort_scan(RANGES) is None
    faults.apply("scan frozen")
    assert faults.distort_scan(RANGES) is RANGES
    assert faults.distort_scan(RANGES * 2) is RANGES
    faults.apply("scan none")
    assert present(faults.distort_scan(RANGES * 2))[0] == 2.0


def test_sensors_are_silenced_separately() -> None:
    faults = SensorFaults()
    faults.apply(" camera silent ")
    assert faults.is_silent("camera")
    assert not faults.is_silent("odometry")
    faults.apply("camera none")
    assert not faults.is_silent("camera")


def test_clock_jumps_forward_and_backward() -> None:
    faults = SensorFaults()
    faults.apply("clock 5")
    faults.apply("clock -7.5")
    assert faults.clock_offset_ns == -2_500_000_000


@pytest.mark.parametrize("text", ["", "scan", "scan broken", "lidar nan", "clock", "clock soon", "clock nan", "clock 1e9"])
def test_unknown_fault_is_refused_and_changes_nothing(text: str) -> None:
    faults = SensorFaults()
    with pytest.raises(InvalidFault, match=r"expected one of: scan|expected a clock jump"):
        faults.apply(text)
    assert faults == SensorFaults()


@given(st.text())
def test_any_text_sets_known_modes_only(text: str) -> None:
    faults = SensorFaults()
    try:
        faults.apply(text)
    except InvalidFault:
        return
    assert math.isfinite(faults.clock_offset_ns)
    assert all(faults.modes[sensor] in modes for sensor, modes in FAULTS.items())
