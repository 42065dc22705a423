"""How a laptop joins the robot's graph: a Fast DDS profile, three exports, and two lines in the shell's start file.

Fast DDS 2.6, the robot's, needs both the profile (it alone says SUPER_CLIENT) and ROS_DISCOVERY_SERVER (it alone makes the
participant connect). Everything here is text in, text out; `lupin dds` reads and writes.
"""

from __future__ import annotations

import ipaddress
import os
import re
import shlex
import subprocess
from collections.abc import Mapping
from pathlib import Path

from lupin_cli.facts.dds_profiles import DISCOVERY_PORT, OWN_PROFILE, SERVER_PREFIX, Profile, parse
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

DEFAULT_IP = "192.168.42.1"  # the robot's own access point
NAMES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "ROS_DISCOVERY_SERVER", "RMW_IMPLEMENTATION")
RMW = "rmw_fastrtps_cpp"
START_FILES = {"bash": ".bashrc", "zsh": ".zshrc"}

# The first line of the hook; the second form says that the file was not there before, so that undo takes it away again.
MARK = "# lupin dds: stays last, since a workspace's setup.bash empties ROS_DISCOVERY_SERVER"
MARK_NEW_FILE = f"{MARK} (this file was made for it)"
_HOOK = re.compile(rf"(^|\n){re.escape(MARK)}(?: \(this file was made for it\))?\n[^\n]*\n?")
# A workspace's or distribution's set-up file being sourced, anywhere in a line that isn't a comment.
_SETUP = re.compile(r"^[^#\n]*(?:\bsource|(?:^|[\s;&|{(])\.)\s+[^#\n]*setup\.(?:ba|z)?sh\b")
_OVERRIDE = re.compile(rf"^[^#\n]*\b(?:export\s+|unset\s+)?(?:{'|'.join(NAMES)})(?:=|\s|$)")


@dataclass(frozen=True)
class Places:
    """Where everything lies."""

    home: Path
    directory: Path  # ${XDG_CONFIG_HOME:-~/.config}/lupin

    @property
    def profile(self) -> Path:
        """The XML profile."""
        return self.directory / OWN_PROFILE

    @property
    def exports(self) -> Path:
        """The file that every new shell and `lupin up` reads."""
        return self.directory / "ros-env.sh"

    def start_file(self, shell: str, environment: Mapping[str, str]) -> Path:
        """The file that `shell` reads when a terminal opens."""
        folder = Path(environment.get("ZDOTDIR") or self.home) if shell == "zsh" else self.home
        return folder / START_FILES[shell]


def valid_ip(text: str) -> str:
    """`text` as the IPv4 address that a locator needs. Raises ValueError."""
    try:
        address = ipaddress.IPv4Address(text)
    except ipaddress.AddressValueError:
        raise ValueError(
            f"{text!r} is no IPv4 address, such as 10.42.0.1 on the cable or {DEFAULT_IP} at the access point"
        ) from None
    if address.is_unspecified or address.is_multicast or str(address) == "255.255.255.255":
        raise ValueError(f"{text} is no address of a robot")
    return str(address)


def profile_xml(ip: str) -> str:
    """The profile: its participant is the default one, else Fast DDS passes over it in silence."""
    return f"""<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <profiles>
    <participant profile_name="lupin_super_client" is_default_profile="true">
      <rtps>
        <builtin>
          <discovery_config>
            <discoveryProtocol>SUPER_CLIENT</discoveryProtocol>
            <discoveryServersList>
              <RemoteServer prefix="{SERVER_PREFIX}">
                <metatrafficUnicastLocatorList>
                  <locator>
                    <udpv4>
                      <address>{ip}</address>
                      <port>{DISCOVERY_PORT}</port>
                    </udpv4>
                  </locator>
                </metatrafficUnicastLocatorList>
              </RemoteServer>
            </discoveryServersList>
          </discovery_config>
        </builtin>
      </rtps>
    </participant>
  </profiles>
</dds>
"""


def exports(ip: str, places: Places) -> str:
    """ros-env.sh: three exports and nothing else, since every new terminal runs it."""
    values = (_in_home(places.profile, places.home), f'"{ip}:{DISCOVERY_PORT}"', RMW)
    return "".join(f"export {name}={value}\n" for name, value in zip(NAMES, values))


def hook_line(places: Places) -> str:
    """The line that reads ros-env.sh; it is silent, and succeeds, where the file is gone."""
    path = _in_home(places.exports, places.home)
    return f"if [ -f {path} ]; then . {path}; fi"


def _in_home(path: Path, home: Path) -> str:
    """A path for double quotes, through $HOME where it lies there."""
    inside = path.is_relative_to(home)
    text = f"/{path.relative_to(home)}" if inside else str(path)
    if re.search(r'["$`\\\n]', text):
        raise ValueError(f"{path} has a character in it that no shell file can quote; set XDG_CONFIG_HOME to a plainer one")
    return f'"{"$HOME" if inside else ""}{text}"'


# -- the start file of a shell


def hooks(text: str) -> list[str]:
    """The hooks in a start file, with the line before each one's mark."""
    return [found[0] for found in _HOOK.finditer(text)]


def with_hook(text: str | None, places: Places) -> str:
    """A start file (None: there is none) with the hook once, at its end; as it is where it stands right."""
    if text is not None and hooks(text) and not misplaced(text) and hook_line(places) in text and len(hooks(text)) == 1:
        return text
    if text is None:
        return f"{MARK_NEW_FILE}\n{hook_line(places)}\n"
    made = MARK_NEW_FILE in text
    rest = without_hook(text) or ""
    # The new line before the mark is the hook's: whether the text ended in one or not, taking it out gives the same bytes.
    return (f"{MARK_NEW_FILE}\n" if made and not rest else f"{rest}\n{MARK}\n") + f"{hook_line(places)}\n"


def without_hook(text: str) -> str | None:
    """A start file without the hook, byte for byte as it was; None where it was made for the hook and has nothing else."""
    made = MARK_NEW_FILE in text
    while (found := _HOOK.search(text)) is not None:
        before, after = text[: found.start()], text[found.end() :]
        # Lines that somebody wrote below stay lines of their own.
        joint = "\n" if before and after and not before.endswith("\n") else ""
        text = before + joint + after
    return None if made and not text else text


def misplaced(text: str) -> list[str]:
    """The lines after the hook that undo it: a set-up file that is sourced there, or one of the variables set anew."""
    found = list(_HOOK.finditer(text))
    after = text[found[-1].end() :] if found else ""
    return [line.strip() for line in after.splitlines() if _SETUP.match(line) or _OVERRIDE.match(line)]


# -- what is wrong, item by item


@dataclass(frozen=True)
class Item:
    """One thing looked at. `problem` is empty where it is as it should be."""

    name: str
    place: str
    problem: str = ""
    fix: str = ""


def read_exports(text: str, home: Path) -> tuple[dict[str, str], list[str]]:
    """What ros-env.sh exports, and the lines of it that are no export."""
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


def check_exports(text: str | None, places: Places, fix: str) -> Item:
    """Whether ros-env.sh has exactly the three exports, with values that can work."""
    item = Item("exports", str(places.exports))
    if text is None:
        return Item(item.name, item.place, "it is not there", fix)
    found, others = read_exports(text, places.home)
    problems = [f"it does more than export: {line}" for line in others[:1]]
    problems += [f"{name} is missing" for name in NAMES if name not in found]
    problems += [f"it exports {name} as well" for name in found if name not in NAMES]
    if found.get("RMW_IMPLEMENTATION", RMW) != RMW:
        problems.append(
            f"RMW_IMPLEMENTATION is {found['RMW_IMPLEMENTATION']}, which reads neither of the others; it must be {RMW}"
        )
    if found.get("FASTRTPS_DEFAULT_PROFILES_FILE", str(places.profile)) != str(places.profile):
        problems.append(f"FASTRTPS_DEFAULT_PROFILES_FILE is {found['FASTRTPS_DEFAULT_PROFILES_FILE']}, not {places.profile}")
    server = found.get("ROS_DISCOVERY_SERVER")
    if server is not None and server_ip(server) is None:
        problems.append(f"ROS_DISCOVERY_SERVER is {server!r}, not ADDRESS:{DISCOVERY_PORT}")
    return Item(item.name, item.place, "; ".join(problems), fix if problems else "")


def server_ip(value: str) -> str | None:
    """The address in a ROS_DISCOVERY_SERVER that names one server on the usual port."""
    host, _, port = value.partition(":")
    try:
        return valid_ip(host) if port == str(DISCOVERY_PORT) else None
    except ValueError:
        return None


def check_profile(text: str | None, ip: str | None, places: Places, fix: str) -> Item:
    """Whether the profile makes a SUPER_CLIENT of the server at `ip` (None where that isn't known)."""
    place = str(places.profile)
    if text is None:
        return Item("profile", place, "it is not there", fix)
    profile: Profile = parse(
        Output(0, f"@@ file {place}\n" + "".join(f" {line}\n" for line in text.splitlines()) + "@@ end\n")
    )[0]
    problems = [profile.error] if profile.error else []
    if not problems:
        if not profile.default:
            problems.append(
                'its participant is not the default profile: is_default_profile="true" is missing, so it is ignored'
            )
        if profile.protocol != "SUPER_CLIENT":
            problems.append(
                f"its discoveryProtocol is {profile.protocol or 'not given'}, not SUPER_CLIENT: few topics are seen"
            )
        if not profile.servers:
            problems.append("it names no server")
        for server in profile.servers:
            if server.prefix != SERVER_PREFIX:
                problems.append(f"the server's prefix is {server.prefix or 'missing'}; server 0 has {SERVER_PREFIX}")
            if server.port != DISCOVERY_PORT:
                problems.append(f"the server's port is {server.port}, not {DISCOVERY_PORT}")
            if ip is not None and server.address != ip:
                problems.append(f"it names the server at {server.address}, ros-env.sh the one at {ip}")
    return Item("profile", place, "; ".join(problems), fix if problems else "")


def check_hook(text: str | None, place: Path, places: Places, fix: str) -> Item:
    """Whether the start file reads ros-env.sh, once, after everything that would undo it."""
    if text is None or not hooks(text):
        return Item("hook", str(place), "it does not read ros-env.sh, so new terminals miss the robot", fix)
    if len(hooks(text)) > 1:
        return Item("hook", str(place), f"it has the hook {len(hooks(text))} times", fix)
    if hook_line(places) not in text:
        return Item("hook", str(place), f"its hook reads another file than {places.exports}", fix)
    late = misplaced(text)
    return Item("hook", str(place), f"after the hook comes what undoes it: {late[0]}" if late else "", fix if late else "")


def check_variables(name: str, seen: Mapping[str, str], wanted: Mapping[str, str], place: str, fix: str) -> Item:
    """Whether an environment has the values that ros-env.sh gives."""
    problems = []
    for variable in NAMES:
        if variable in wanted and seen.get(variable) != wanted[variable]:
            value = seen.get(variable)
            problems.append(f"{variable} is {'not set' if value is None else repr(value)}, not {wanted[variable]}")
    return Item(name, place, "; ".join(problems), fix if problems else "")


def new_terminal(shell: str, environment: Mapping[str, str], timeout_s: float = 10.0) -> dict[str, str] | None:
    """The environment of a fresh interactive `shell`: what its start files really leave. None where it does not answer.

    It runs in a session of its own, since an interactive shell takes the terminal otherwise.
    """
    base = {name: value for name, value in environment.items() if name not in NAMES}
    command = [shell, "-i", "-c", "printf 'lupin-%s\\n' begins; env -0"]
    try:
        said = subprocess.run(
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
    _, begun, listed = said.partition(b"lupin-begins\n")
    pairs = (entry.partition(b"=") for entry in listed.split(b"\0"))
    return {os.fsdecode(name): os.fsdecode(value) for name, _, value in pairs if name} if begun else None
