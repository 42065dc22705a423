"""The builder of `interfaces/`, which is not installed: loaded from its own folder, so that `sys.path` stays as it is."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from typing import Any

from tests.support.paths import INTERFACES


def load_rosidl_build(module: str) -> Any:
    """Import one of the builder's modules, for example `packages`. Returns Any: mypy does not check the builder."""
    if "rosidl_build" not in sys.modules:
        path = INTERFACES / "rosidl_build/__init__.py"
        spec = importlib.util.spec_from_file_location("rosidl_build", path, submodule_search_locations=[str(path.parent)])
        assert spec is not None and spec.loader is not None
        package = importlib.util.module_from_spec(spec)
        sys.modules["rosidl_build"] = package
        spec.loader.exec_module(package)
    return importlib.import_module(f"rosidl_build.{module}")
