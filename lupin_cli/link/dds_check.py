"""Checks of a laptop's DDS set-up, one item each: profile, exports, hook, and the variables of a terminal."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lupin_cli.facts.dds_profiles import SERVER_PREFIX, parse_profile
from lupin_cli.link.dds_setup import RMW, VARIABLES, SetupPaths, find_hooks, hook_line, lines_undoing_hook, parse_robot_ip
from lupin_runtime.ports import DISCOVERY_PORT


@dataclass(frozen=True)
class CheckedItem:
    """The result of one check; `problem` is empty if the item is correct."""

    name: str
    place: str  # the file or program that was checked
    problem: str = ""
    fix: str = ""  # a command to type
    instruction: str = ""  # what a person does by hand, or must know


def read_exports(text: str, home: Path) -> tuple[dict[str, str], list[str]]:
    """Return the variables that ros-env.sh exports, and its lines that are not exports."""
    found, others = {}, []
    for line in text.splitlines():
        match = re.match(r"^export ([A-Za-z_]\w*)=(.*)$", line)
        try:
            words = shlex.split(match[2]) if match else []
        except ValueError:  # an open quote
            words = []
        if match and len(words) == 1:
            found[match[1]] = words[0].replace("${HOME}", str(home)).replace("$HOME", str(home))
        elif line.strip():
            others.append(line.strip())
    return found, others


def check_exports(text: str | None, paths: SetupPaths, fix: str) -> CheckedItem:
    """Check that ros-env.sh has exactly the three exports, with values that can work."""
    item = CheckedItem("exports", str(paths.exports))
    if text is None:
        return CheckedItem(item.name, item.place, "the file is missing", fix)
    found, others = read_exports(text, paths.home)
    problems = [f"it must only export variables, but has: {line}" for line in others[:1]]
    problems += [f"{name} is missing" for name in VARIABLES if name not in found]
    problems += [f"it exports {name} as well" for name in found if name not in VARIABLES]
    if found.get("RMW_IMPLEMENTATION", RMW) != RMW:
        problems.append(f"RMW_IMPLEMENTATION is {found['RMW_IMPLEMENTATION']}, which ignores the other two; it must be {RMW}")
    if found.get("FASTRTPS_DEFAULT_PROFILES_FILE", str(paths.profile)) != str(paths.profile):
        problems.append(f"FASTRTPS_DEFAULT_PROFILES_FILE is {found['FASTRTPS_DEFAULT_PROFILES_FILE']}, not {paths.profile}")
    server = found.get("ROS_DISCOVERY_SERVER")
    if server is not None and server_ip(server) is None:
        problems.append(f"ROS_DISCOVERY_SERVER is {server!r}, not ADDRESS:{DISCOVERY_PORT}")
    return CheckedItem(item.name, item.place, "; ".join(problems), fix if problems else "")


def server_ip(value: str) -> str | None:
    """Return the address in a ROS_DISCOVERY_SERVER value that names one server on the usual port; None for other values."""
    host, _, port = value.partition(":")
    try:
        return parse_robot_ip(host) if port == str(DISCOVERY_PORT) else None
    except ValueError:
        return None


def check_profile(text: str | None, ip: str | None, paths: SetupPaths, fix: str) -> CheckedItem:
    """Check that the profile makes participants SUPER_CLIENTs of the server at `ip` (None: any address)."""
    place = str(paths.profile)
    if text is None:
        return CheckedItem("profile", place, "the file is missing", fix)
    profile = parse_profile(place, text)
    problems = [profile.error] if profile.error else []
    if not problems:
        if not profile.default:
            problems.append(
                'its participant is not the default profile: is_default_profile="true" is missing, and Fast DDS ignores it'
            )
        if profile.protocol != "SUPER_CLIENT":
            problems.append(
                f"its discoveryProtocol is {profile.protocol or 'not given'}, not SUPER_CLIENT: few topics are discovered"
            )
        if not profile.servers:
            problems.append("it has no server")
        for server in profile.servers:
            if server.prefix != SERVER_PREFIX:
                problems.append(f"the server's prefix is {server.prefix or 'missing'}; server 0 has {SERVER_PREFIX}")
            if server.port != DISCOVERY_PORT:
                problems.append(f"the server's port is {server.port}, not {DISCOVERY_PORT}")
            if ip is not None and server.address != ip:
                problems.append(f"it names the server at {server.address}, ros-env.sh the one at {ip}")
    return CheckedItem("profile", place, "; ".join(problems), fix if problems else "")


def check_hook(text: str | None, place: Path, paths: SetupPaths, fix: str) -> CheckedItem:
    """Check that the startup file sources ros-env.sh once, after everything that would undo it."""
    if text is None or not find_hooks(text):
        return CheckedItem("hook", str(place), "it does not source ros-env.sh, so new terminals do not see the robot", fix)
    if len(find_hooks(text)) > 1:
        return CheckedItem("hook", str(place), f"it has the hook {len(find_hooks(text))} times", fix)
    if hook_line(paths) not in text:
        return CheckedItem("hook", str(place), f"its hook sources another file than {paths.exports}", fix)
    undoing_lines = lines_undoing_hook(text)
    return CheckedItem(
        "hook",
        str(place),
        f"a line after the hook undoes it: {undoing_lines[0]}" if undoing_lines else "",
        fix if undoing_lines else "",
    )


def check_variables(
    name: str, actual: Mapping[str, str], expected: Mapping[str, str], place: str, fix: str, instruction: str = ""
) -> CheckedItem:
    """Check that an environment has the values that ros-env.sh exports."""
    problems = []
    for variable in VARIABLES:
        if variable in expected and actual.get(variable) != expected[variable]:
            value = actual.get(variable)
            problems.append(f"{variable} is {'not set' if value is None else repr(value)}, not {expected[variable]}")
    wrong = bool(problems)
    return CheckedItem(name, place, "; ".join(problems), fix if wrong else "", instruction if wrong else "")


def read_terminal_environment(shell: str, environment: Mapping[str, str], timeout_s: float = 10.0) -> dict[str, str] | None:
    """Return the environment of a new interactive `shell` after its startup files ran; None if it does not answer in time.

    The shell runs in its own session: otherwise it would take over the terminal.
    """
    base = {name: value for name, value in environment.items() if name not in VARIABLES}
    command = [shell, "-i", "-c", "printf 'lupin-%s\\n' begins; env -0"]
    try:
        output = subprocess.run(
            command,
            env=base,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=timeout_s,
            start_new_session=True,
        ).stdout
    except (OSError, subprocess.TimeoutExpired):
        return None
    _, marker, listed = output.partition(b"lupin-begins\n")
    pairs = (entry.partition(b"=") for entry in listed.split(b"\0"))
    return {os.fsdecode(name): os.fsdecode(value) for name, _, value in pairs if name} if marker else None
