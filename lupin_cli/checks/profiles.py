"""The XML profiles that make a process a super client. Fast DDS reports no error for any fault in them."""

from __future__ import annotations

from collections.abc import Iterator
from posixpath import dirname

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.dds_environment import server_host
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.remote_command import command_on_robot
from lupin_cli.facts.base import Facts
from lupin_cli.facts.dds_profiles import DDS_PROFILES, OWN_PROFILE, SERVER_PREFIX, Profile
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.facts.shell import SHELL

Users = dict[str, str]  # who uses a profile (a shell or process) → its ROS_DISCOVERY_SERVER


def find_profile_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """A profile in use does not make its users super clients of the robot's server. Unused profiles are not judged."""
    for facts in snapshot.machines:
        shell_users, process_users = _shell_users(facts), _process_users(facts)
        for profile in facts.get(DDS_PROFILES) or ():
            shells, processes = shell_users.get(profile.path, {}), process_users.get(profile.path, {})
            if users := {**shells, **processes}:
                # The operator's shell decides which server is meant; a process that asks another one is another finding.
                for id, cause in _faults(profile, shells or processes):
                    yield _profile_finding(snapshot, facts.machine, profile, id, cause, users)


def _process_users(facts: Facts) -> dict[str, Users]:
    """Return the processes that name a profile together with a discovery server, by the profile's path."""
    found: dict[str, Users] = {}
    for process in facts.get(ROS_PROCESSES) or ():
        if process.profile and process.server and not process.is_server:
            found.setdefault(process.profile, {})[f"{process.name} (process {process.pid})"] = process.server
    return found


def _shell_users(facts: Facts) -> dict[str, Users]:
    """Return the same for the operator's shell on the laptop, and for the exports that a new shell gets."""
    found: dict[str, Users] = {}
    shell = facts.get(SHELL) if facts.machine == "laptop" else None
    if shell is not None:
        for variables, user in ((shell.environment, "this shell"), (shell.exports, shell.exports_path)):
            path, server = variables.get("FASTRTPS_DEFAULT_PROFILES_FILE", ""), variables.get("ROS_DISCOVERY_SERVER", "")
            path = path.replace("${HOME}", shell.home).replace("$HOME", shell.home)
            if path and server:
                found.setdefault(path, {})[user] = server
    return found


def _faults(profile: Profile, users: Users) -> Iterator[tuple[str, str]]:
    """Yield the finding id and the cause of each fault; a fault that hides the others is the only one."""
    if profile.error:
        yield "profile-unreadable", f"Fast DDS cannot use the profile: {profile.error}"
        return
    if not profile.default:
        yield "profile-not-default", 'no participant profile says is_default_profile="true", so Fast DDS ignores it'
        return
    if profile.protocol not in ("SUPER_CLIENT", "SERVER"):
        protocol = profile.protocol or "not given"
        yield (
            "profile-not-super-client",
            f"discoveryProtocol is {protocol}, not SUPER_CLIENT: its users see only their own topics",
        )
    for server in profile.servers:
        if server.prefix != SERVER_PREFIX:
            yield "profile-wrong-prefix", f"the server's GUID prefix is {server.prefix or 'missing'}, not {SERVER_PREFIX}"
    if profile.protocol == "SUPER_CLIENT" and not profile.servers:
        yield "profile-without-server", "it names no remote server"
    expected = {server_host(address) for address in users.values()} - {""}
    wrong_servers = [server for server in profile.servers if expected and server.address not in expected]
    if wrong_servers:
        yield (
            "profile-wrong-address",
            f"it points to {wrong_servers[0].address}, but ROS_DISCOVERY_SERVER to {', '.join(sorted(expected))}",
        )


def _profile_finding(snapshot: Snapshot, machine: str, profile: Profile, id: str, cause: str, users: Users) -> Finding:
    if machine == "robot":  # a restart makes the vendor's hook write the profile again
        command = command_on_robot(snapshot, "sudo systemctl restart mirte-ros.service")
    else:
        command = f"lupin dds setup {server_host(next(iter(users.values())))}"
    return make_finding(
        id,
        where=machine,
        cause=f"{profile.path}: {cause}",
        evidence=(profile.line(), *(f"{user}: ROS_DISCOVERY_SERVER={server}" for user, server in users.items())),
        command=command,
        about="own" if _is_own_profile(snapshot, machine, profile) else machine,
    )


def _is_own_profile(snapshot: Snapshot, machine: str, profile: Profile) -> bool:
    """Return whether `lupin dds setup` wrote the profile."""
    shell = snapshot.laptop.get(SHELL)
    return machine == "laptop" and shell is not None and profile.path == f"{dirname(shell.exports_path)}/{OWN_PROFILE}"


CHECKS = (
    Check(
        "dds.profiles",
        find_profile_faults,
        laptop=(DDS_PROFILES, ROS_PROCESSES, SHELL),
        robot=(DDS_PROFILES, ROS_PROCESSES),
    ),
)
