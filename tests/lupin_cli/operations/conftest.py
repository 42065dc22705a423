"""The target of the operations' tests: this machine, named like a robot."""

from __future__ import annotations

import pytest

from lupin_cli.connection.local import LocalTarget


@pytest.fixture
def target() -> LocalTarget:
    return LocalTarget("robot")
