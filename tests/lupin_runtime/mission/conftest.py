"""Fixtures of the mission's tests."""

from __future__ import annotations

import pytest

from tests.support.mission_rig import Rig


@pytest.fixture
def make_rig() -> type[Rig]:
    """Return the class of an orchestrator with fakes; keyword arguments are parameters of MissionConfig."""
    return Rig
