"""The time is counted for which shoulder_lift holds the arm extended."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.arm import PRESETS
from lupin_runtime.arm.load_budget import BUDGET_S, LOADED, REMINDER_S, LoadBudget, shoulder_load

S = 10**9
EXTENDED = (0.0, -1.4, 0.0, 0.0)
HOME = PRESETS["home"]
ANGLE = st.floats(-math.pi, math.pi)


def hold(budget: LoadBudget, arm: tuple[float, float, float, float] | None, seconds: int, start_s: int = 0) -> list[int]:
    """Hold a pose, and return at which seconds a warning was due."""
    return [second for second in range(start_s, start_s + seconds) if budget.step(arm, second * S)]


@given(ANGLE, ANGLE, ANGLE, ANGLE)
def test_load_is_a_share_of_the_horizontal_arms(pan: float, lift: float, elbow: float, wrist: float) -> None:
    assert 0.0 <= shoulder_load((pan, lift, elbow, wrist)) <= 1.0 + 1e-9


def test_load_is_largest_stretched_out_and_none_upright() -> None:
    assert shoulder_load((0.0, -math.pi / 2, 0.0, 0.0)) == pytest.approx(1.0)
    assert shoulder_load((1.0, 0.0, 0.0, 0.0)) == 0.0


def test_no_preset_parks_the_arm_extended() -> None:
    assert {name for name, arm in PRESETS.items() if shoulder_load(arm) >= LOADED} == set()
    assert shoulder_load(HOME) < 0.1


def test_warning_is_due_once_the_budget_is_spent_and_repeats() -> None:
    budget = LoadBudget()
    assert hold(budget, EXTENDED, 200) == [int(BUDGET_S), int(BUDGET_S + REMINDER_S), int(BUDGET_S + 2 * REMINDER_S)]
    assert budget.is_spent
    assert "for 3 min" in budget.sentence()


@pytest.mark.parametrize("pose", [HOME, None])
def test_rest_gives_the_time_back_but_not_the_total(pose: tuple[float, float, float, float] | None) -> None:
    budget = LoadBudget()
    hold(budget, EXTENDED, 51)
    hold(budget, pose, 30, 51)
    assert (budget.held_s, budget.total_s) == (20.0, 50.0)
    hold(budget, pose, 300, 81)
    assert budget.held_s == 0.0
    assert not budget.is_spent


def test_clock_that_jumps_back_counts_nothing() -> None:
    budget = LoadBudget()
    budget.step(EXTENDED, 100 * S)
    budget.step(EXTENDED, 0)
    assert budget.held_s == 0.0
