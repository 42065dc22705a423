"""The release that a robot runs: the one made here, or one that it has kept."""

from __future__ import annotations

import os
import platform
import sys
import threading
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from lupin_cli.onboard import ROOT
from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.release.contents import CannotBuild, Robot, files
from lupin_cli.release.manifest import Hashes, Manifest, manifest_of
from lupin_cli.release.transfer import Installed, activate, changes, installed, upload
from lupin_cli.target.base import Target

_turn = threading.Lock()


@cache
def built(robot: Robot) -> Manifest:
    """The release of this checkout for `robot`; made once a process."""
    folder = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    try:
        return manifest_of(files(robot), Hashes(Path(folder) / "lupin" / "release-hashes.json"))
    except CannotBuild as error:
        raise OperationError(f"no release can be made for the robot: {error}", "make setup") from error


def _built_once(robot: Robot) -> Manifest:
    """Several robots want it at the same time: the first one's is everybody's."""
    with _turn:
        return built(robot)


@dataclass(frozen=True)
class Release:
    """`release` is the id of one that the robot has kept; empty: what this machine has."""

    name: ClassVar[str] = "release"
    stands: ClassVar[bool] = True

    machine: str = "robot"
    release: str = ""
    root: str = ROOT

    def prepare(self) -> None:
        """Make the release that takes longest to make: for a robot like this machine, which has no ROS of its own."""
        if not self.release:
            _built_once(Robot(platform.machine(), (sys.version_info.major, sys.version_info.minor), ""))

    def differs(self, target: Target) -> Difference | None:
        state = installed(target, self.root)
        if (self.release or _built_once(state.robot).id) == state.current:
            return None
        before = {"current": state.current}
        there = f"replaces {state.current}" if state.current else "is the first"
        if self.release:
            self._kept(target, state)
            return Difference(f"release {self.release} {there}", before=before)
        manifest = built(state.robot)
        lines, size = changes(target, state, manifest, self.root)
        summary = f"release {manifest.id} {there}: {len(manifest.entries)} files, {size / 1e6:.1f} MB of them new"
        return Difference(summary, "\n".join(lines) + "\n", before)

    def change(self, target: Target, difference: Difference) -> None:
        state = installed(target, self.root)
        if self.release:
            self._kept(target, state)
            activate(target, self.release, self.root)
            return
        manifest = built(state.robot)
        upload(target, state, manifest, self.root)
        activate(target, manifest.id, self.root)

    def _kept(self, target: Target, state: Installed) -> None:
        if self.release not in state.releases:
            kept = ", ".join(state.releases) or "none"
            raise OperationError(f"{target.name} has no release {self.release}; it has: {kept}", "lupin deploy robot")

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        activate(target, str(before["current"]), self.root)
