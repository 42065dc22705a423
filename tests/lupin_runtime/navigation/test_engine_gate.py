"""The gate between an engine that knows nothing of the e-stop and the drive bus."""

from __future__ import annotations

import pytest

from lupin_runtime.navigation.engine_gate import EngineGate
from lupin_runtime.safety.estop_monitor import DRAIN_S


@pytest.fixture
def gate() -> EngineGate:
    """A gate that knows everything that it needs."""
    gate = EngineGate(["/state", "/status"])
    for name in ("/state", "/status"):
        assert not gate.is_open(0.0)
        gate.note_known(name)
    assert gate.is_open(0.0)
    return gate


def test_press_closes_the_gate_and_cancels_goals(gate: EngineGate) -> None:
    gate.note_goals("/navigate_to_pose", True)
    assert gate.is_open(0.0) and not gate.cancels(0.0)
    gate.note_estop(True, 1.0)
    assert not gate.is_open(1.0) and gate.cancels(1.0)


def test_release_opens_nothing_while_an_older_goal_is_active(gate: EngineGate) -> None:
    gate.note_goals("/follow_path", True)
    gate.note_estop(True, 1.0)
    gate.note_estop(False, 5.0)
    assert not gate.is_open(60.0) and gate.cancels(60.0)
    gate.note_goals("/follow_path", False)
    assert gate.is_open(60.0) and not gate.cancels(60.0)
    gate.note_goals("/follow_path", True)
    assert gate.is_open(61.0), "a goal that is newer than the release may move the robot"


def test_requests_as_old_as_the_release_are_cancelled(gate: EngineGate) -> None:
    gate.note_estop(True, 1.0)
    gate.note_estop(False, 5.0)
    assert gate.cancels(5.0 + 0.9 * DRAIN_S) and gate.is_open(5.0 + 1.1 * DRAIN_S)


def test_press_during_a_release_closes_again(gate: EngineGate) -> None:
    gate.note_estop(True, 1.0)
    gate.note_estop(False, 5.0)
    gate.note_estop(True, 5.01)
    assert not gate.is_open(60.0)
