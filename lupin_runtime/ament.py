"""Finds programs of an installed ROS distribution: by the rules of `ros2 run` (ament_index_python), or where Debian has it."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.bounded_file import read_bounded_text

DISTRIBUTION = "jazzy"
SYSTEM_PREFIX = Path("/opt/ros") / DISTRIBUTION
_VERSION = re.compile(r"<version>\s*([0-9][0-9.]{0,30})\s*</version>")


@dataclass(frozen=True)
class AmentPackage:
    """An installed package: its name, the prefix that it is installed in, and its version; empty if that is not known."""

    name: str
    prefix: Path
    version: str
    is_sourced: bool

    def command(self, program: str) -> list[str]:
        """Return how to run one of its programs; empty if it has none of that name.

        If the prefix was not sourced, the program's shell does that: in Lupin's own environment, the distribution's rclpy would
        be imported instead of the one of the ROS wheels.
        """
        path = self.prefix / "lib" / self.name / program
        if not (path.is_file() and os.access(path, os.X_OK)):
            return []
        return [str(path)] if self.is_sourced else ["sh", "-c", '. "$0"; exec "$@"', f"{self.prefix}/setup.sh", str(path)]


def find_package(name: str, environment: Mapping[str, str]) -> AmentPackage | None:
    """Return a package of the first prefix of AMENT_PREFIX_PATH that lists it, else of SYSTEM_PREFIX; None if none does."""
    sourced = [Path(prefix) for prefix in environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    for prefix in (*sourced, SYSTEM_PREFIX):
        if (prefix / "share/ament_index/resource_index/packages" / name).is_file():
            try:
                found = _VERSION.search(read_bounded_text(prefix / "share" / name / "package.xml", errors="replace"))
            except OSError:
                found = None
            return AmentPackage(name, prefix, found[1] if found else "", prefix in sourced)
    return None
