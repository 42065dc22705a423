"""The XML profiles that make a super client: each of their faults is ignored in silence by Fast DDS."""

from __future__ import annotations

from collections.abc import Iterator
from posixpath import dirname

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.environment import host_of, machines
from lupin_cli.checks.typed import on_robot
from lupin_cli.facts.base import Facts
from lupin_cli.facts.dds_profiles import DDS_PROFILES, OWN_PROFILE, SERVER_PREFIX, Profile
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.facts.shell import SHELL


def find_profiles(evidence: Evidence) -> Iterator[Finding]:
    """Profiles in use that don't do what they are there for. One that nobody names is nobody's concern."""
    for facts in machines(evidence):
        of_shell, of_processes = _shells(facts), _processes(facts)
        for profile in facts.get(DDS_PROFILES) or ():
            shells, processes = of_shell.get(profile.path, {}), of_processes.get(profile.path, {})
            if users := {**shells, **processes}:
                # What the operator's own shell says is the set-up; a process that asks another server is told by itself.
                for id, cause in _faults(profile, shells or processes):
                    yield _finding(evidence, facts.machine, profile, id, cause, users)


def _processes(facts: Facts) -> dict[str, dict[str, str]]:
    """Path of a profile → which process names it beside a discovery server → that server's address."""
    found: dict[str, dict[str, str]] = {}
    for process in facts.get(ROS_PROCESSES) or ():
        if process.profile and process.server and not process.is_server:
            found.setdefault(process.profile, {})[f"{process.name} (process {process.pid})"] = process.server
    return found


def _shells(facts: Facts) -> dict[str, dict[str, str]]:
    """The same of the laptop's shell and of the exports that a new one gets."""
    found: dict[str, dict[str, str]] = {}
    shell = facts.get(SHELL) if facts.machine == "laptop" else None
    if shell is not None:
        for variables, who in ((shell.environment, "this shell"), (shell.exports, shell.exports_path)):
            path, server = variables.get("FASTRTPS_DEFAULT_PROFILES_FILE", ""), variables.get("ROS_DISCOVERY_SERVER", "")
            path = path.replace("${HOME}", shell.home).replace("$HOME", shell.home)
            if path and server:
                found.setdefault(path, {})[who] = server
    return found


def _faults(profile: Profile, users: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Finding and cause. One fault that hides the rest is told alone."""
    if profile.error:
        yield "profile-unreadable", f"Fast DDS can't use the profile: {profile.error}"
        return
    if not profile.default:
        yield "profile-not-default", 'no participant profile says is_default_profile="true", so it is ignored in silence'
        return
    if profile.protocol not in ("SUPER_CLIENT", "SERVER"):
        yield (
            "profile-not-super-client",
            f"discoveryProtocol is {profile.protocol or 'not given'}, not SUPER_CLIENT: its users see only topics of their own",
        )
    for server in profile.servers:
        if server.prefix != SERVER_PREFIX:
            yield "profile-wrong-prefix", f"the server's GUID prefix is {server.prefix or 'missing'}, not {SERVER_PREFIX}"
    if profile.protocol == "SUPER_CLIENT" and not profile.servers:
        yield "profile-without-server", "it names no remote server"
    wanted = {host_of(address) for address in users.values()} - {""}
    stray = [server for server in profile.servers if wanted and server.address not in wanted]
    if stray:
        asked = ", ".join(sorted(wanted))
        yield "profile-wrong-address", f"it points to {stray[0].address}, ROS_DISCOVERY_SERVER to {asked}"


def _finding(evidence: Evidence, machine: str, profile: Profile, id: str, cause: str, users: dict[str, str]) -> Finding:
    setup = f"lupin dds setup {host_of(next(iter(users.values())))}"
    vendors = machine == "robot"  # whose hook writes the profile anew
    return Finding(
        id=id,
        severity=Severity.PROBLEM,
        where=machine,
        symptom="names or topics of the robot are missing, without any error",
        cause=f"{profile.path}: {cause}",
        evidence=(profile.line(), *(f"{who}: ROS_DISCOVERY_SERVER={server}" for who, server in users.items())),
        fix=Fix(on_robot(evidence, "sudo systemctl restart mirte-ros.service") if vendors else setup),
        about="own" if _is_own(evidence, machine, profile) else machine,
    )


def _is_own(evidence: Evidence, machine: str, profile: Profile) -> bool:
    """Whether it is the one that `lupin dds setup` writes."""
    shell = evidence.laptop.get(SHELL)
    return machine == "laptop" and shell is not None and profile.path == f"{dirname(shell.exports_path)}/{OWN_PROFILE}"


CHECKS = (
    Check("dds.profiles", find_profiles, laptop=(DDS_PROFILES, ROS_PROCESSES, SHELL), robot=(DDS_PROFILES, ROS_PROCESSES)),
)
