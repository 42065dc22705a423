"""Makes what these tests share importable under importlib's import mode, and this machine a target."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from lupin_cli.target.local import LocalTarget

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def here() -> LocalTarget:
    return LocalTarget("robot")
