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
    DEPLOY,
    DIGEST_TIMEOUT_S,
    InstalledReleases,
    activate,
    changed_folders,
    current_manifest,
    find_damage,
    installed_script,
    name_some,
    parse_installed,
    read_installed,
    require_undamaged,
    upload,
)
from lupin_cli.release.contents import ReleaseError, RobotPlatform, release_files
from lupin_cli.release.manifest import HashCache, Manifest, build_manifest
from lupin_cli.release.paths import ROOT
from lupin_cli.release.signing_key import SigningKeyError, ensure_key
from lupin_cli.release.verification import parse_damage, verification_script
from lupin_cli.release.verify_release import SIGNERS, UNSIGNED

_build_lock = threading.Lock()
_DAMAGED, _MANIFEST = "@ damaged\n", "@ manifest\n"


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


def _parse(text: str, output: Output) -> tuple[InstalledReleases, tuple[str, ...]]:
    """Return the releases on the robot, and the damage of the current one. Raises OperationError."""
    installed, _, damage = text.partition(_DAMAGED)
    state = parse_installed(replace(output, stdout=installed))
    return state, parse_damage(damage) if state.current else ()


@dataclass(frozen=True, kw_only=True)
class Release(Operation):
    """`release` is the id of a release that the robot has kept; if it is empty, this checkout's release is used.

    It is signed with this operator's release key. A current release that is damaged, or that no trusted key has signed, is
    installed again; with `force`, an undamaged one is, too.
    """

    name: ClassVar[str] = "release"
    effect: ClassVar[str] = "the robot has this machine's release, or one that it kept, and it is current"
    undo_effect: ClassVar[str] = "the previous release is current again"
    prefetchable: ClassVar[bool] = True

    release: str = ""
    force: bool = False
    root: str = ROOT
    signers: str = SIGNERS  # the keys that the robot trusts: `release-key`

    def prepare(self) -> None:
        """Build the release that takes longest to build: the one for a robot without ROS, whose platform is this machine's."""
        if not self.release:
            _build_once(RobotPlatform(platform.machine(), (sys.version_info.major, sys.version_info.minor), ""))

    def probe(self) -> Script:
        verify = verification_script(f"{self.root}/current", self.signers)
        return probe_script(f"{installed_script(self.root)}\necho '{_DAMAGED.strip()}'\n{verify}", timeout_s=DIGEST_TIMEOUT_S)

    def with_baseline(self, before: Mapping[str, Any]) -> Release:
        return replace(self, force=False)  # once is enough

    def complete(self, target: Target, output: Output) -> Output:
        """Add the manifest of the robot's current release if another one will be installed."""
        state, _ = _parse(output.stdout, output)
        if self.release or not state.current or _build_once(state.robot).id == state.current:
            return output
        return replace(output, stdout=f"{output.stdout}{_MANIFEST}{current_manifest(target, state, self.root)}")

    def judge(self, output: Output) -> Difference | None:
        text, _, old_manifest = output.stdout.partition(_MANIFEST)
        state, damage = _parse(text, output)
        wanted = self.release or _build_once(state.robot).id
        if wanted == state.current and not damage and not self.force:
            return None
        if self.release and wanted == state.current and damage:
            raise OperationError(f"the robot's release {wanted} is damaged: {name_some(damage)}", DEPLOY)
        if wanted == state.current and not self.release:
            reason = f"because of damaged files: {name_some(damage)}" if damage else "as asked"
            if damage == (UNSIGNED,):
                reason = "because it is not signed"
            diff = "".join(f"+{path}\n" for path in damage)
            return Difference(f"install release {wanted} again, {reason}", diff, {"current": state.current})
        before = {"current": state.current}
        replaces = f"replacing {state.current}" if state.current else "the first one"
        if self.release:
            self._require_kept(state)
            return Difference(f"switch to release {self.release}, {replaces}", before=before)
        manifest = build_release(state.robot)
        lines, size = changed_folders(old_manifest, manifest)
        summary = f"install release {manifest.id}, {replaces}: {len(manifest.entries)} files, {size / 1e6:.1f} MB of them new"
        return Difference(summary, "\n".join(lines) + "\n", before)

    def change(self, target: Target, difference: Difference) -> None:
        state = read_installed(target, self.root)
        if self.release:
            self._require_kept(state)
            require_undamaged(target, self.release, self.root, self.signers)
            activate(target, self.release, self.root)
            return
        manifest = build_release(state.robot)
        kept = manifest.id in state.releases and manifest.id != state.current
        if not kept or find_damage(target, manifest.id, self.root, self.signers):
            try:
                key = ensure_key()
            except SigningKeyError as error:
                raise OperationError(str(error), error.next_command) from error
            upload(target, state, manifest, key, self.root, self.signers)
        activate(target, manifest.id, self.root)

    def _require_kept(self, state: InstalledReleases) -> None:
        if self.release not in state.releases:
            kept = ", ".join(state.releases) or "none"
            raise OperationError(f"the robot has no release {self.release}; it has: {kept}", DEPLOY)

    def overwritten(self, output: Output) -> dict[str, bytes]:
        state, _ = _parse(output.stdout.partition(_MANIFEST)[0], output)
        return {"the robot's current release": state.current.encode()}

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        release = str(before["current"])
        # One from before releases were signed may return: the undo restores its units too, which do not ask for a signature.
        if release and find_damage(target, release, self.root, self.signers) != (UNSIGNED,):
            require_undamaged(target, release, self.root, self.signers)
        activate(target, release, self.root)
