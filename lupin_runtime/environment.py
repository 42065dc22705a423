"""Variables of the environment: those that switch something off, and those that another program must not inherit."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

OFF = ("false", "0", "no", "off")
# ros_wheels_bootstrapper sets it once it has put the libraries of the ROS wheels into LD_LIBRARY_PATH.
_BOOTSTRAPPED = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"


def is_off(environment: Mapping[str, str], name: str) -> bool:
    """Return whether the variable says so, in any case. One that is unset or empty does not."""
    return environment.get(name, "").strip().lower() in OFF


def without_ros_wheels(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the environment for a program of another ROS installation, which would load the wheels' libraries."""
    own = (Path(sys.prefix), Path(sys.prefix).resolve())
    paths = [path for path in environment.get("LD_LIBRARY_PATH", "").split(os.pathsep) if path]
    foreign = [path for path in paths if not any(Path(path).is_relative_to(prefix) for prefix in own)]
    changed = {**environment, "LD_LIBRARY_PATH": os.pathsep.join(foreign)}
    unwanted = {_BOOTSTRAPPED, *(() if foreign else ("LD_LIBRARY_PATH",))}
    return {name: value for name, value in changed.items() if name not in unwanted}
