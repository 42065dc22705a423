"""Rendered views of tags, shared with the benchmark; property tests without deadlines."""

from __future__ import annotations

from types import ModuleType

import pytest
from hypothesis import settings

from tests.support import tag_views as tag_views_module

# On a shared machine one slow example is not a failure.
settings.register_profile("shared machine", deadline=None)
settings.load_profile("shared machine")


@pytest.fixture(scope="session")
def tag_views() -> ModuleType:
    """The module `tests/support/tag_views.py`: `render`, `at_range`, `tag_rotation`, and the camera they use."""
    return tag_views_module
