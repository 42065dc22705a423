"""Rendered views of tags, shared with the benchmark; property tests without deadlines."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import settings

# On a shared machine an example that is slow once is no failure.
settings.register_profile("shared machine", deadline=None)
settings.load_profile("shared machine")


@pytest.fixture(scope="session")
def tag_views() -> ModuleType:
    """The module `bench/tag_views.py`: `render`, `at_range`, `tag_rotation`, and the camera they use."""
    path = Path(__file__).parents[2] / "bench" / "tag_views.py"
    spec = importlib.util.spec_from_file_location("tag_views", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
