"""What is installed: a release that runs, of the same version as here, for the Python that is there, under a user who may."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli import __version__
from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.typed import on_robot
from lupin_cli.facts.account import ACCOUNT
from lupin_cli.facts.devices import DEVICES
from lupin_cli.facts.versions import VERSIONS
from lupin_cli.onboard import ROOT

DEPLOY = Fix("lupin deploy robot", playbook="deploy-robot")
# What each group opens; the pad's group is only asked for once Lupin is there.
DEVICE_GROUPS = {"dialout": ("/dev/ttyACM", "/dev/ttyUSB"), "video": ("/dev/video",)}


def release(evidence: Evidence) -> Iterator[Finding]:
    """The robot's release: there, whole, and the same as here."""
    versions = evidence.robot.get(VERSIONS) if evidence.robot else None
    if versions is None:
        return
    here = f"laptop: lupin {__version__}"
    if not versions.python:
        yield Finding(
            id="python-missing",
            severity=Severity.PROBLEM,
            where="robot",
            symptom="nothing of Lupin can run on the robot",
            cause="the robot has no python3",
            evidence=("command -v python3: nothing", versions.system),
            fix=Fix(on_robot(evidence, "sudo apt install python3")),
            explains=frozenset({"not-deployed", "unit-failed", "oneshot-failed", "unit-restarting"}),
        )
    found = versions.release
    if found is None or not (found.current or found.releases):
        yield Finding(
            id="not-deployed",
            severity=Severity.WARNING,
            where="robot",
            symptom="without the laptop there is no drive bus, no e-stop and no home pose",
            cause="Lupin was never deployed to this robot",
            evidence=(f"{ROOT}: no release",),
            fix=DEPLOY,
        )
    elif not found.current or not found.complete:
        target = f"-> releases/{found.current}" if found.current else "missing"
        yield Finding(
            id="release-broken",
            severity=Severity.PROBLEM,
            where="robot",
            symptom="Lupin's units fail at start",
            cause=f"{ROOT}/current leads nowhere",
            evidence=(f"{ROOT}/current: {target}", f"releases: {' '.join(found.releases) or 'none'}"),
            fix=DEPLOY,
            explains=frozenset({"unit-failed", "oneshot-failed", "unit-restarting", "unit-start-limit"}),
        )
    elif versions.python and found.python and versions.python[:2] != found.python[:2]:
        yield Finding(
            id="python-changed",
            severity=Severity.PROBLEM,
            where="robot",
            symptom="Lupin's units fail at start with ModuleNotFoundError",
            cause=f"the release was built for Python {_dotted(found.python)}, the robot has {_dotted(versions.python)} now",
            evidence=(
                f"release {found.current}: python {_dotted(found.python)}",
                f"python3 --version: {_dotted(versions.python)}",
            ),
            fix=DEPLOY,
            explains=frozenset({"unit-failed", "oneshot-failed", "unit-restarting", "unit-start-limit"}),
        )
    elif found.version and found.version != __version__:
        yield Finding(
            id="version-skew",
            severity=Severity.WARNING,
            where="link",
            symptom="services and topics of the two halves may not fit",
            cause=f"the robot runs Lupin {found.version}, this machine {__version__}",
            evidence=(here, f"robot: lupin {found.version} (release {found.current})"),
            fix=DEPLOY,
        )


def groups(evidence: Evidence) -> Iterator[Finding]:
    """A user who may not open the robot's devices."""
    robot = evidence.robot
    account = robot.get(ACCOUNT) if robot else None
    devices, versions = (robot.get(DEVICES), robot.get(VERSIONS)) if robot else (None, None)
    if account is None or account.uid == 0:
        return
    there = [*(devices.serials if devices else ()), *(video.device for video in (devices.videos if devices else ()))]
    wanted = {group for group, paths in DEVICE_GROUPS.items() if any(path.startswith(paths) for path in there)}
    if versions and versions.release and versions.release.current:
        wanted.add("input")
    lacking = sorted(group for group in wanted if group in account.known_groups and group not in account.groups)
    if lacking:
        yield Finding(
            id="groups-missing",
            severity=Severity.WARNING,
            where="robot",
            symptom="'Permission denied' on cameras, motor board or gamepad",
            cause=f"{account.user} is not in {', '.join(lacking)}",
            evidence=(f"id -Gn: {' '.join(account.groups)}",),
            fix=Fix(on_robot(evidence, f"sudo usermod -aG {','.join(lacking)} {account.user}")),
        )


def home(evidence: Evidence) -> Iterator[Finding]:
    """A home folder that its user may not write to."""
    account = evidence.robot.get(ACCOUNT) if evidence.robot else None
    if account is not None and not account.home_writable:
        yield Finding(
            id="home-not-writable",
            severity=Severity.PROBLEM,
            where="robot",
            symptom="the vendor's environment script and every ROS log fail",
            cause=f"{account.user} may not write to {account.home}",
            evidence=(f"[ -w {account.home} ]: no",),
            fix=Fix(on_robot(evidence, f"sudo chown -R {account.user}: {account.home}")),
        )


def _dotted(version: tuple[int, ...]) -> str:
    return ".".join(map(str, version))


CHECKS = (
    Check("software.release", release, robot=(VERSIONS,)),
    Check("software.groups", groups, robot=(ACCOUNT, DEVICES, VERSIONS)),
    Check("software.home", home, robot=(ACCOUNT,)),
)
