"""Rendered views of tags, shared with the benchmark."""

from __future__ import annotations

from types import ModuleType

import pytest

from tests.support import tag_views as tag_views_module


@pytest.fixture(scope="session")
def tag_views() -> ModuleType:
    """The module `tests/support/tag_views.py`: `render`, `at_range`, `tag_rotation`, and the camera they use."""
    return tag_views_module
