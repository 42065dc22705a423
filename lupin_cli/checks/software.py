"""What is installed on the robot: a release that can run, Python, and the permissions of its user."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli import __version__
from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.remote_command import command_on_robot, robot_option
from lupin_cli.facts.account import ACCOUNT
from lupin_cli.facts.devices import DEVICES
from lupin_cli.facts.release_files import RELEASE_FILES
from lupin_cli.facts.versions import VERSIONS
from lupin_cli.release.paths import ROOT
from lupin_cli.release.verify_release import UNSIGNED

DEPLOY = "lupin deploy robot"
# Unix group → devices that it may open. The gamepad's group `input` is required only if Lupin is deployed.
DEVICE_GROUPS = {"dialout": ("/dev/ttyACM", "/dev/ttyUSB"), "video": ("/dev/video",)}
_FAILING_UNITS = frozenset({"unit-failed", "oneshot-failed", "unit-restarting", "unit-start-limit"})


def find_release_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot has no release, a broken one, one for another Python, or another version than the laptop."""
    versions = snapshot.robot_fact(VERSIONS)
    if versions is None:
        return
    if not versions.python:
        yield make_finding(
            "python-missing",
            where="robot",
            cause="the robot has no python3",
            evidence=("command -v python3: nothing", versions.system),
            command=command_on_robot(snapshot, "sudo apt install python3"),
            explains={"not-deployed", "release-damaged", "unit-failed", "oneshot-failed", "unit-restarting"},
        )
    release = versions.release
    if release is None or not (release.current or release.releases):
        yield make_finding(
            "not-deployed",
            where="robot",
            cause="Lupin was never deployed to this robot",
            evidence=(f"{ROOT}: no release",),
            command=DEPLOY,
        )
    elif not release.current or not release.complete:
        target = f"-> releases/{release.current}" if release.current else "missing"
        yield make_finding(
            "release-broken",
            where="robot",
            cause=f"{ROOT}/current does not lead to a complete release",
            evidence=(f"{ROOT}/current: {target}", f"releases: {' '.join(release.releases) or 'none'}"),
            command=DEPLOY,
            explains=_FAILING_UNITS,
        )
    elif versions.python and release.python and versions.python[:2] != release.python[:2]:
        built, present = _dotted(release.python), _dotted(versions.python)
        yield make_finding(
            "python-changed",
            where="robot",
            cause=f"the release was built for Python {built}, but the robot now has {present}",
            evidence=(f"release {release.current}: python {built}", f"python3 --version: {present}"),
            command=DEPLOY,
            explains=_FAILING_UNITS,
        )
    elif release.version and release.version != __version__:
        yield make_finding(
            "version-skew",
            where="link",
            cause=f"the robot runs Lupin {release.version}, the laptop {__version__}",
            evidence=(f"laptop: lupin {__version__}", f"robot: lupin {release.version} (release {release.current})"),
            command=DEPLOY,
        )


def find_damaged_release(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot's release is not signed by a trusted key, or something in it has changed since it was signed."""
    damage = snapshot.robot_fact(RELEASE_FILES)
    command = f"{DEPLOY}{robot_option(snapshot)}"
    if damage == (UNSIGNED,):
        yield make_finding(
            "release-unsigned",
            where="robot",
            cause="the release is not signed; an earlier version of Lupin deployed it",
            evidence=(f"{ROOT}/current/{UNSIGNED}",),
            command=command,
            explains=_FAILING_UNITS,
        )
    elif damage:
        yield make_finding(
            "release-damaged",
            where="robot",
            cause=f"the release is not as it was signed: {len(damage)} path{' differs' if len(damage) == 1 else 's differ'}",
            evidence=tuple(path if path.startswith("/") else f"{ROOT}/current/{path}" for path in damage),
            command=command,
            explains=_FAILING_UNITS,
        )


def find_missing_groups(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot's user is not in the groups that may open its devices."""
    account = snapshot.robot_fact(ACCOUNT)
    devices, versions = snapshot.robot_fact(DEVICES), snapshot.robot_fact(VERSIONS)
    if account is None or account.uid == 0:
        return
    present = [*devices.serials, *(video.device for video in devices.videos)] if devices else []
    required = {group for group, paths in DEVICE_GROUPS.items() if any(path.startswith(paths) for path in present)}
    if versions and versions.release and versions.release.current:
        required.add("input")
    missing = sorted(group for group in required if group in account.known_groups and group not in account.groups)
    if missing:
        yield make_finding(
            "groups-missing",
            where="robot",
            cause=f"{account.user} is not in {', '.join(missing)}",
            evidence=(f"id -Gn: {' '.join(account.groups)}",),
            command=command_on_robot(snapshot, f"sudo usermod -aG {','.join(missing)} {account.user}"),
        )


def find_unwritable_home(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot's user may not write to its home folder."""
    account = snapshot.robot_fact(ACCOUNT)
    if account is not None and not account.home_writable:
        yield make_finding(
            "home-not-writable",
            where="robot",
            cause=f"{account.user} may not write to {account.home}",
            evidence=(f"[ -w {account.home} ]: no",),
            command=command_on_robot(snapshot, f"sudo chown -R {account.user}: {account.home}"),
        )


def _dotted(version: tuple[int, ...]) -> str:
    return ".".join(map(str, version))


CHECKS = (
    Check("software.release", find_release_faults, robot=(VERSIONS,)),
    Check("software.release-files", find_damaged_release, robot=(RELEASE_FILES,)),
    Check("software.groups", find_missing_groups, robot=(ACCOUNT, DEVICES, VERSIONS)),
    Check("software.home", find_unwritable_home, robot=(ACCOUNT,)),
)
