"""The smoother limits velocity and acceleration, and falls silent when its input does."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.drive import ZERO, AxisLimits, Smoother, Twist
from lupin_runtime.drive.smoother import REST_REPEATS

X = AxisLimits(0.5, -0.35, 2.5, -2.0)
Y = AxisLimits(0.5, -0.5, 2.5, -2.5)
YAW = AxisLimits(1.9, -1.9, 3.2, -3.2)
DT = 0.05
TICK_NS = 50_000_000
NUMBER = st.one_of(st.floats(-3, 3), st.sampled_from([math.nan, math.inf, -math.inf]))
COMMANDS = st.lists(st.one_of(st.none(), st.builds(Twist, NUMBER, NUMBER, NUMBER)), min_size=1, max_size=60)


def smoother() -> Smoother:
    return Smoother(X, Y, YAW)


def run(commands: Sequence[Twist | None]) -> list[Twist]:
    """Return the outputs of one tick after each command; None stands for a tick without a command."""
    core, out, now_ns = smoother(), [], 0
    for command in commands:
        now_ns += TICK_NS
        if command is not None:
            core.command(command, now_ns)
        out.append(core.tick(now_ns, DT) or ZERO)
    return out


@settings(max_examples=200)
@given(COMMANDS)
def test_velocity_and_its_change_stay_within_the_limits(commands: Sequence[Twist | None]) -> None:
    before = ZERO
    for after in run(commands):
        for limits, a, b in zip((X, Y, YAW), before, after):
            assert math.isfinite(b)
            assert limits.slowest <= b <= limits.fastest
            assert abs(b - a) <= max(limits.accel, -limits.decel) * DT + 1e-12
            if abs(b) > abs(a) and a * b >= 0:
                assert abs(b) - abs(a) <= limits.accel * DT + 1e-12
            elif a * b >= 0:
                assert abs(a) - abs(b) <= -limits.decel * DT + 1e-12
        before = after


@given(st.builds(Twist, st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3)))
def test_steady_command_is_reached_within_the_limits(command: Twist) -> None:
    allowed = [min(axis.fastest, max(axis.slowest, value)) for axis, value in zip((X, Y, YAW), command)]
    assert run([command] * 40)[-1] == Twist(*allowed)


@given(st.floats(0.05, 0.35))
def test_reversal_passes_through_rest(speed: float) -> None:
    xs = [out.x for out in run([Twist(speed, 0, 0)] * 20 + [Twist(-speed, 0, 0)] * 20)][19:]
    assert all(a >= b for a, b in itertools.pairwise(xs)) and xs[-1] == -speed


def test_silent_input_brings_the_output_to_rest_and_silence() -> None:
    core = smoother()
    core.command(Twist(0.5, 0.0, 1.0), 0)
    outputs = [core.tick(k * TICK_NS, DT) for k in range(1, 60)]
    assert outputs[18] == Twist(0.5, 0.0, 1.0), "it continues within the timeout of 1 s"
    rest = outputs.index(ZERO)
    assert outputs[rest : rest + REST_REPEATS] == [ZERO] * REST_REPEATS
    assert set(outputs[rest + REST_REPEATS :]) == {None}


def test_zero_command_does_not_win_the_bus() -> None:
    core = smoother()
    outputs = []
    for k in range(40):
        core.command(ZERO, k * TICK_NS)
        outputs.append(core.tick(k * TICK_NS, DT))
    assert set(outputs[REST_REPEATS:]) == {None}


@pytest.mark.parametrize("bad", [None, Twist(math.nan, 0.0, 0.0), Twist(0.1, math.inf, 0.0)])
def test_non_finite_command_slows_down_to_rest(bad: Any) -> None:
    core = smoother()
    core.command(Twist(0.5, 0.0, 0.0), 0)
    for k in range(10):
        core.tick(k * TICK_NS, DT)
    core.command(bad, 10 * TICK_NS)
    speeds = [(core.tick(k * TICK_NS, DT) or ZERO).x for k in range(10, 20)]
    assert speeds[0] == pytest.approx(0.4) and speeds[-1] == 0.0
    assert core.rejected == 1


def test_clock_jump_back_ends_the_command() -> None:
    core = smoother()
    core.command(Twist(0.5, 0.0, 0.0), 10**10)
    fast = core.tick(10**10, DT)
    slower = core.tick(10**9, DT)
    assert fast and slower and 0.0 < slower.x < fast.x


def test_deadband_suppresses_small_commands() -> None:
    core = Smoother(X, Y, YAW, deadband=Twist(0.05, 0.05, 0.1))
    core.command(Twist(0.04, -0.06, 0.09), 0)
    assert core.tick(TICK_NS, DT) == Twist(0.0, -0.06, 0.0)


@pytest.mark.parametrize("bad", [(-0.1, -0.2, 1, -1), (0.5, 0.1, 1, -1), (0.5, -0.5, 0, -1), (0.5, -0.5, 1, 1)])
def test_limits_with_a_wrong_sign_are_refused(bad: tuple[float, float, int, int]) -> None:
    with pytest.raises(ValueError, match="expected"):
        AxisLimits(*bad)
