"""A simulated log and its map, each made once per test session."""

from __future__ import annotations

import pytest

from tests.support import slam_worlds
from tests.support.mapping_run import MappingRun


@pytest.fixture(scope="session")
def greenhouse_log() -> slam_worlds.Log:
    """Two minutes in the greenhouse: an outer loop and half of an inner one."""
    return slam_worlds.greenhouse_log(2.0, seed=3)


@pytest.fixture(scope="session")
def mapped(greenhouse_log: slam_worlds.Log) -> MappingRun:
    """The finished run over `greenhouse_log`, shared by tests that do not change it."""
    return MappingRun(greenhouse_log).process(0, len(greenhouse_log.stamps))
