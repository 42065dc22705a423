"""Finds programs of a ROS installation that was sourced, by the rules of `ros2 run` (ament_index_python, ros2pkg)."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.bounded_file import read_bounded_text

_VERSION = re.compile(r"<version>\s*([0-9][0-9.]{0,30})\s*</version>")


@dataclass(frozen=True)
class AmentPackage:
    """An installed package: its name, the prefix that it is installed in, and its version; empty if that is not known."""

    name: str
    prefix: Path
    version: str

    def program(self, name: str) -> Path | None:
        """Return one of its programs; None if it has none of that name."""
        path = self.prefix / "lib" / self.name / name
        return path if path.is_file() and os.access(path, os.X_OK) else None


def find_package(name: str, environment: Mapping[str, str]) -> AmentPackage | None:
    """Return a package of the first prefix of AMENT_PREFIX_PATH that lists it; None if none does."""
    for prefix in filter(None, environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        if (Path(prefix) / "share/ament_index/resource_index/packages" / name).is_file():
            try:
                found = _VERSION.search(read_bounded_text(Path(prefix) / "share" / name / "package.xml", errors="replace"))
            except OSError:
                found = None
            return AmentPackage(name, Path(prefix), found[1] if found else "")
    return None
