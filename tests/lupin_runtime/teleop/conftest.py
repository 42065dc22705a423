"""Pads made of pipes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.fake_pads import FakePads


@pytest.fixture
def fake_pads(tmp_path: Path) -> Iterator[FakePads]:
    """A folder without pads."""
    made = FakePads(tmp_path)
    yield made
    made.close()
