"""The target of the operations' tests: this machine, under the robot's name."""

from __future__ import annotations

import pytest

from lupin_cli.connection.local import LocalTarget


@pytest.fixture
def target() -> LocalTarget:
    return LocalTarget("robot")
