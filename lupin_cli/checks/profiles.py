"""The XML profiles that make a process a super client. Fast DDS reports no error for any fault in them."""

from __future__ import annotations

from collections.abc import Iterator
from posixpath import dirname

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.dds_environment import server_host, server_port
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.layers import EVERYTHING
from lupin_cli.checks.remote_command import FixText, restart_processes, restart_unit, source_exports
from lupin_cli.checks.robot_address import robot_address, set_up_laptop
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.base import Facts
from lupin_cli.facts.dds_profiles import DDS_PROFILES, OWN_PROFILE, SERVER_PREFIX, Profile
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.facts.routes import ROUTES
from lupin_cli.facts.shell import SHELL
from lupin_runtime.ports import DISCOVERY_PORT

THIS_SHELL = "this shell"
START_S = 2.0  # between the start of a process and the time at which it reads its profile
Users = dict[str, str]  # who uses a profile (a shell or process) → its ROS_DISCOVERY_SERVER


def find_profile_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """A profile in use does not make its users super clients of the robot's server. Unused profiles are not judged."""
    for facts in snapshot.machines:
        shell_users, process_users = _shell_users(facts), _process_users(facts)
        for profile in facts.get(DDS_PROFILES) or ():
            shells, processes = shell_users.get(profile.path, {}), process_users.get(profile.path, {})
            if users := {**shells, **processes}:
                # The operator's shell decides which server is meant; a process that asks another one is another finding.
                breaks = (EVERYTHING,) if shells or facts.machine == "robot" else ()
                faults = [*_faults(profile, shells or processes, known_addresses(snapshot))]
                faults += [] if profile.error else [*_transport_faults(snapshot, facts, profile)]
                for id, cause in faults:
                    yield _profile_finding(snapshot, facts.machine, profile, id, cause, users, breaks)


def find_outdated_processes(snapshot: Snapshot) -> Iterator[Finding]:
    """A process read a profile before it was last changed: the file shows what the next start will use, not what runs.

    That alone harms nothing, and the vendor's login scripts rewrite their profile. So it is named while something is missing.
    """
    if ground_truth.measure(snapshot).state is not ground_truth.State.BROKEN:
        return
    for facts in snapshot.machines:
        for profile in facts.get(DDS_PROFILES) or ():
            if profile.age_s is None or profile.age_s < 0 or profile.error:
                continue  # the clock was set back meanwhile; or the file itself is a finding
            older = [
                process
                for process in facts.get(ROS_PROCESSES) or ()
                if process.profile == profile.path and process.server and process.age_s > profile.age_s + START_S
                if not (process.is_server or process.is_graph_probe)
            ]
            if not older:
                continue
            names = ", ".join(f"{process.name} (process {process.pid})" for process in older[:4])
            yield make_finding(
                "profile-changed",
                where=facts.machine,
                cause=f"{names} started before {profile.path} was changed {profile.age_s:.0f} s ago, and use what it said then",
                evidence=(
                    profile.line(),
                    *(f"{each.line('FASTRTPS_DEFAULT_PROFILES_FILE')}: {each.age_s:.0f} s old" for each in older[:4]),
                ),
                about=profile.path,
                **restart_processes(snapshot, facts.machine, older),
            )


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
        for variables, user in ((shell.environment, THIS_SHELL), (shell.exports, shell.exports_path)):
            path, server = variables.get("FASTRTPS_DEFAULT_PROFILES_FILE", ""), variables.get("ROS_DISCOVERY_SERVER", "")
            path = path.replace("${HOME}", shell.home).replace("$HOME", shell.home)
            if path and server:
                found.setdefault(path, {})[user] = server
    return found


def known_addresses(snapshot: Snapshot) -> frozenset[str]:
    """Return the addresses that the robot has; empty if it was not asked."""
    addresses = snapshot.robot_fact(ADDRESSES)
    return frozenset(each.address for each in addresses.entries) if addresses is not None else frozenset()


def _faults(profile: Profile, users: Users, real: frozenset[str]) -> Iterator[tuple[str, str]]:
    """Yield the finding id and the cause of each fault; a fault that hides the others is the only one.

    A profile that names one of the robot's `real` addresses is right if its users ask a server at an address that is none.
    """
    if profile.error:
        yield "profile-unreadable", f"Fast DDS cannot use the profile: {profile.error}"
        return
    if not profile.default:
        yield "profile-not-default", 'no participant profile says is_default_profile="true", so Fast DDS ignores it'
        return
    if profile.protocol != "SUPER_CLIENT":
        protocol = profile.protocol or "not given"
        effect = "are servers themselves, or do not start" if protocol == "SERVER" else "see only their own topics"
        yield "profile-not-super-client", f"discoveryProtocol is {protocol}, not SUPER_CLIENT: its users {effect}"
    for server in profile.servers:
        if server.prefix != SERVER_PREFIX:
            yield "profile-wrong-prefix", f"the server's GUID prefix is {server.prefix or 'missing'}, not {SERVER_PREFIX}"
    if profile.protocol == "SUPER_CLIENT" and not profile.servers:
        yield "profile-without-server", "it names no remote server"
    expected = {(server_host(address), server_port(address)) for address in users.values()} - {("", DISCOVERY_PORT)}
    if any(host in real for host, _ in expected):
        real = frozenset()
    wrong_servers = [
        server
        for server in profile.servers
        if expected and (server.address, server.port) not in expected
        if not (server.address in real and server.port == DISCOVERY_PORT)
    ]
    if wrong_servers:
        named = ", ".join(f"{host}:{port}" for host, port in sorted(expected))
        found = f"{wrong_servers[0].address}:{wrong_servers[0].port}"
        yield "profile-wrong-address", f"it points to {found}, but ROS_DISCOVERY_SERVER to {named}"


def _transport_faults(snapshot: Snapshot, facts: Facts, profile: Profile) -> Iterator[tuple[str, str]]:
    """Yield the transports with which no participant reaches the other machine.

    Whether transports of its own work depends on their settings: they are only named while nothing arrives.
    """
    addresses, link = facts.get(ADDRESSES), robot_address(snapshot)
    allowed = set(profile.whitelist)
    if allowed and addresses is not None and link:
        near = [each for each in addresses.announced if each.on_same_subnet(link)]
        if near and not any(allowed & {each.address, each.interface} for each in near):
            names, own = ", ".join(sorted(allowed)), f"{near[0].address} ({near[0].interface})"
            yield "profile-excludes-link", f"interfaceWhiteList allows only {names}, and the link to the robot has {own}"
            return
    if profile.builtin_transports:
        return
    own = ", ".join(profile.own_transports)
    if not any(each.startswith(("UDPv4", "TCPv4")) for each in profile.own_transports):
        what = f"its own transports are {own}" if own else "it has no transport of its own"
        yield "profile-excludes-link", f"useBuiltinTransports is false, and {what}"
    elif (truth := ground_truth.measure(snapshot)).state is ground_truth.State.BROKEN and not truth.heard:
        yield "profile-excludes-link", f"useBuiltinTransports is false, and its own transports ({own}) may not reach the robot"


def _profile_finding(
    snapshot: Snapshot, machine: str, profile: Profile, id: str, cause: str, users: Users, breaks: tuple[str, ...]
) -> Finding:
    own, real = _is_own_profile(snapshot, machine, profile), known_addresses(snapshot)
    hosts = [server_host(server) for server in users.values()]
    if machine == "robot":  # a restart makes the vendor's hook write the profile again
        fix = FixText(command=restart_unit(snapshot))
    elif own or any(user in (THIS_SHELL, exports_path(snapshot)) for user in users):
        fix = set_up_laptop(snapshot, next((host for host in hosts if host in real or not real), ""), source=not own)
    else:
        readers = [each for each in snapshot.laptop.get(ROS_PROCESSES) or () if each.profile == profile.path and each.server]
        fix = restart_processes(snapshot, machine, readers, again=f"in a terminal after: {source_exports(snapshot)}")
    return make_finding(
        id,
        where=machine,
        cause=f"{profile.path}: {cause}",
        evidence=(profile.line(), *(f"{user}: ROS_DISCOVERY_SERVER={server}" for user, server in users.items())),
        about="own" if own else machine,
        explains={"shell-program-fails"} if machine == "laptop" and breaks else (),
        breaks=breaks,
        layer="environment" if _is_other_than_set_up(snapshot, users) else "",
        **fix,
    )


def exports_path(snapshot: Snapshot) -> str:
    """Return the path of ros-env.sh; empty if it is not known."""
    shell = snapshot.laptop.get(SHELL)
    return shell.exports_path if shell is not None else ""


def _is_other_than_set_up(snapshot: Snapshot, users: Users) -> bool:
    """Return whether only this shell names the profile, although Lupin's set-up names another one: the variable is at fault."""
    shell = snapshot.laptop.get(SHELL)
    return shell is not None and bool(shell.exports) and set(users) == {THIS_SHELL}


def _is_own_profile(snapshot: Snapshot, machine: str, profile: Profile) -> bool:
    """Return whether `lupin dds setup` wrote the profile."""
    shell = snapshot.laptop.get(SHELL)
    return machine == "laptop" and shell is not None and profile.path == f"{dirname(shell.exports_path)}/{OWN_PROFILE}"


CHECKS = (
    Check(
        "dds.profiles",
        find_profile_faults,
        laptop=(DDS_PROFILES, ROS_PROCESSES, SHELL, ADDRESSES, ROUTES),
        robot=(DDS_PROFILES, ROS_PROCESSES, ADDRESSES),
    ),
    Check(
        "dds.profile-age",
        find_outdated_processes,
        laptop=(DDS_PROFILES, ROS_PROCESSES, GRAPH),
        robot=(DDS_PROFILES, ROS_PROCESSES),
    ),
)
