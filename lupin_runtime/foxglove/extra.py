"""Whether the extra `lupin[foxglove]` is installed, and how to install it. Needs neither the extra nor ROS."""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Iterable

from packaging.requirements import Requirement

EXTRA = "foxglove"
_PACKAGE = "foxglove-sdk"


def is_installed() -> bool:
    """Whether this Python has the SDK."""
    try:
        importlib.metadata.version(_PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def install_advice(requirements: Iterable[str] | None = None) -> str:
    """What the extra brings, and the command that installs it into this Python.

    `requirements` are those of the distribution `lupin`; without them, those of the installed one.
    """
    found = importlib.metadata.requires("lupin") if requirements is None else requirements
    wanted = next((str(each) for each in map(_of_extra, found or ()) if each), _PACKAGE)
    return (
        f"the extra lupin[{EXTRA}] is not installed; it is {_PACKAGE}: MIT, one package of 54 MB, without dependencies. "
        f"Install it with: {sys.executable} -m pip install '{wanted}'"
    )


def _of_extra(line: str) -> Requirement | None:
    """A requirement of the extra, without its marker; None for all others."""
    requirement = Requirement(line)
    if requirement.marker is None or requirement.name != _PACKAGE:
        return None
    requirement.marker = None
    return requirement
