"""The files that make a laptop join the robot's graph: Fast DDS profile, three exports, two lines in a shell's startup file.

Fast DDS 2.6, the robot's version, needs both the profile (only it can say SUPER_CLIENT) and ROS_DISCOVERY_SERVER (only it makes
the participant connect). This module maps text to text; `lupin dds` reads and writes the files.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lupin_cli.facts.dds_profiles import OWN_PROFILE, SERVER_PREFIX
from lupin_runtime.ports import DISCOVERY_PORT

DEFAULT_IP = "192.168.42.1"  # the robot's own access point
VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "ROS_DISCOVERY_SERVER", "RMW_IMPLEMENTATION")
RMW = "rmw_fastrtps_cpp"
START_FILES = {"bash": ".bashrc", "zsh": ".zshrc"}

# The first line of the hook. The second form records that the startup file did not exist, so that `remove` deletes it.
MARK = "# lupin dds: stays last, since a workspace's setup.bash empties ROS_DISCOVERY_SERVER"
MARK_NEW_FILE = f"{MARK} (this file was made for it)"
_HOOK = re.compile(rf"(^|\n){re.escape(MARK)}(?: \(this file was made for it\))?\n[^\n]*\n?")
# A line, not a comment, that sources the setup file of a workspace or distribution.
_SETUP = re.compile(r"^[^#\n]*(?:\bsource|(?:^|[\s;&|{(])\.)\s+[^#\n]*setup\.(?:ba|z)?sh\b")
_OVERRIDE = re.compile(rf"^[^#\n]*\b(?:export\s+|unset\s+)?(?:{'|'.join(VARIABLES)})(?:=|\s|$)")


@dataclass(frozen=True)
class SetupPaths:
    """The paths of the files that `lupin dds setup` writes."""

    home: Path
    directory: Path  # ${XDG_CONFIG_HOME:-~/.config}/lupin

    @property
    def profile(self) -> Path:
        """The XML profile."""
        return self.directory / OWN_PROFILE

    @property
    def exports(self) -> Path:
        """The file that every new shell and `lupin up` read."""
        return self.directory / "ros-env.sh"

    def start_file(self, shell: str, environment: Mapping[str, str]) -> Path:
        """Return the file that `shell` reads when a terminal opens."""
        folder = Path(environment.get("ZDOTDIR") or self.home) if shell == "zsh" else self.home
        return folder / START_FILES[shell]


def parse_robot_ip(text: str) -> str:
    """Normalize an IPv4 address for a DDS locator. Raises ValueError if it cannot be a robot's."""
    try:
        address = ipaddress.IPv4Address(text)
    except ipaddress.AddressValueError:
        raise ValueError(
            f"{text!r} is not an IPv4 address, such as 10.42.0.1 on the cable or {DEFAULT_IP} at the access point"
        ) from None
    if address.is_unspecified or address.is_multicast or str(address) == "255.255.255.255":
        raise ValueError(f"{text} cannot be the address of a robot")
    return str(address)


def profile_xml(ip: str) -> str:
    """Return the Fast DDS profile. Its participant profile is the default one, since Fast DDS silently ignores others."""
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


def exports_text(ip: str, paths: SetupPaths) -> str:
    """Return the content of ros-env.sh: three exports and nothing else, since every new terminal runs it."""
    values = (_quote_path(paths.profile, paths.home), f'"{ip}:{DISCOVERY_PORT}"', RMW)
    return "".join(f"export {name}={value}\n" for name, value in zip(VARIABLES, values))


def hook_line(paths: SetupPaths) -> str:
    """Return the line that sources ros-env.sh. It prints nothing and succeeds even if the file is missing."""
    path = _quote_path(paths.exports, paths.home)
    return f"if [ -f {path} ]; then . {path}; fi"


def _quote_path(path: Path, home: Path) -> str:
    """Quote `path` for a shell, with $HOME for the home folder. Raises ValueError if it cannot be quoted."""
    in_home = path.is_relative_to(home)
    text = f"/{path.relative_to(home)}" if in_home else str(path)
    if re.search(r'["$`\\\n]', text):
        raise ValueError(
            f"{path} contains a character that cannot be quoted in a shell file; set XDG_CONFIG_HOME to a path without it"
        )
    return f'"{"$HOME" if in_home else ""}{text}"'


# -- the hook in a shell's startup file


def find_hooks(text: str) -> list[str]:
    """Return all hooks in a startup file."""
    return [found[0] for found in _HOOK.finditer(text)]


def add_hook(text: str | None, paths: SetupPaths) -> str:
    """Return a startup file's text (None: no file) with the hook once, at its end; unchanged if it is already correct."""
    if text is not None and len(find_hooks(text)) == 1 and hook_line(paths) in text and not lines_undoing_hook(text):
        return text
    if text is None:
        return f"{MARK_NEW_FILE}\n{hook_line(paths)}\n"
    created = MARK_NEW_FILE in text
    rest = remove_hook(text) or ""
    # The newline before the mark belongs to the hook: removing the hook restores a text that had no final newline.
    return (f"{MARK_NEW_FILE}\n" if created and not rest else f"{rest}\n{MARK}\n") + f"{hook_line(paths)}\n"


def remove_hook(text: str) -> str | None:
    """Return a startup file's text without the hook, byte for byte as before; None if it was made for the hook and is empty."""
    created = MARK_NEW_FILE in text
    while (found := _HOOK.search(text)) is not None:
        before, after = text[: found.start()], text[found.end() :]
        # Lines written below the hook must not be joined with the line above it.
        joint = "\n" if before and after and not before.endswith("\n") else ""
        text = before + joint + after
    return None if created and not text else text


def lines_undoing_hook(text: str) -> list[str]:
    """Return the lines after the last hook that undo it: they source a setup file, or set one of the variables again."""
    found = list(_HOOK.finditer(text))
    after = text[found[-1].end() :] if found else ""
    return [line.strip() for line in after.splitlines() if _SETUP.match(line) or _OVERRIDE.match(line)]
