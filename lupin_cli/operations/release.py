"""`release`: the release that a robot runs: this checkout's, or one that the robot has kept."""

from __future__ import annotations

import os
import platform
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.release_transfer import (
    InstalledReleases,
    activate,
    changed_files,
    current_manifest,
    installed_script,
    parse_installed,
    read_installed,
    upload,
)
from lupin_cli.release.contents import ReleaseError, RobotPlatform, release_files
from lupin_cli.release.manifest import HashCache, Manifest, build_manifest
from lupin_cli.release.paths import ROOT

_build_lock = threading.Lock()
_MANIFEST = "@ manifest\n"


@cache
def build_release(robot: RobotPlatform) -> Manifest:
    """Return the release of this checkout for `robot`, built once per process. Raises OperationError."""
    folder = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    try:
        return build_manifest(release_files(robot), HashCache(Path(folder) / "lupin" / "release-hashes.json"))
    except ReleaseError as error:
        raise OperationError(f"no release can be built for the robot: {error}", "make setup") from error


def _build_once(robot: RobotPlatform) -> Manifest:
    """Return `build_release(robot)`; playbook runs that need it at the same time wait for the first one."""
    with _build_lock:
        return build_release(robot)


@dataclass(frozen=True, kw_only=True)
class Release(Operation):
    """`release` is the id of a release that the robot has kept; if it is empty, this checkout's release is used."""

    name: ClassVar[str] = "release"
    effect: ClassVar[str] = "the robot has this machine's release, or one that it kept, and it is current"
    undo_effect: ClassVar[str] = "the previous release is current again"
    prefetchable: ClassVar[bool] = True

    release: str = ""
    root: str = ROOT

    def prepare(self) -> None:
        """Build the release that takes longest to build: the one for a robot without ROS, whose platform is this machine's."""
        if not self.release:
            _build_once(RobotPlatform(platform.machine(), (sys.version_info.major, sys.version_info.minor), ""))

    def probe(self) -> Script:
        return probe_script(installed_script(self.root))

    def complete(self, target: Target, output: Output) -> Output:
        """Add the manifest of the robot's current release if another one will be installed."""
        state = parse_installed(output)
        if self.release or not state.current or _build_once(state.robot).id == state.current:
            return output
        return replace(output, stdout=f"{output.stdout}{_MANIFEST}{current_manifest(target, state, self.root)}")

    def judge(self, output: Output) -> Difference | None:
        text, _, old_manifest = output.stdout.partition(_MANIFEST)
        state = parse_installed(replace(output, stdout=text))
        if (self.release or _build_once(state.robot).id) == state.current:
            return None
        before = {"current": state.current}
        replaces = f"replacing {state.current}" if state.current else "the first one"
        if self.release:
            self._require_kept(state)
            return Difference(f"switch to release {self.release}, {replaces}", before=before)
        manifest = build_release(state.robot)
        lines, size = changed_files(old_manifest, manifest)
        summary = f"install release {manifest.id}, {replaces}: {len(manifest.entries)} files, {size / 1e6:.1f} MB of them new"
        return Difference(summary, "\n".join(lines) + "\n", before)

    def change(self, target: Target, difference: Difference) -> None:
        state = read_installed(target, self.root)
        if self.release:
            self._require_kept(state)
            activate(target, self.release, self.root)
            return
        manifest = build_release(state.robot)
        upload(target, state, manifest, self.root)
        activate(target, manifest.id, self.root)

    def _require_kept(self, state: InstalledReleases) -> None:
        if self.release not in state.releases:
            kept = ", ".join(state.releases) or "none"
            raise OperationError(f"the robot has no release {self.release}; it has: {kept}", "lupin deploy robot")

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        activate(target, str(before["current"]), self.root)
