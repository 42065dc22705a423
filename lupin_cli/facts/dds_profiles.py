"""The XML profiles that Fast DDS reads: those that running processes and this shell name, and Lupin's own."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from lupin_cli.facts.base import Fact
from lupin_cli.facts.ros_processes import SAME_NETWORK
from lupin_cli.facts.sections import PRELUDE, answers
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

# The prefix of discovery server 0, which the vendor's super clients and ours name: its bytes spell DS_PROSIMA.
SERVER_PREFIX = "44.53.00.5f.45.50.52.4f.53.49.4d.41"
DISCOVERY_PORT = 11811
OWN_PROFILE = "fastdds_super_client.xml"  # of `lupin dds setup`, beside ros-env.sh

PROBE = (
    PRELUDE
    + rf"""names='FASTRTPS_DEFAULT_PROFILES_FILE|FASTDDS_DEFAULT_PROFILES_FILE'
pids=$(grep -zlasE "^($names)=" /proc/[0-9]*/environ | cut -d/ -f3)
{SAME_NETWORK}
{{ [ -z "$pids" ] || grep -zHasE "^($names)=" $(for pid in $pids; do echo "/proc/$pid/environ"; done) /dev/null |
    tr '\n\0' ' \n' | sed -E 's#^(/proc/[0-9]+)/environ:[^=]*=#\1/root #'
  env | sed -nE "s#^($names)=#/ #p"
  echo "/ ${{XDG_CONFIG_HOME:-$HOME/.config}}/lupin/{OWN_PROFILE}"
}} | sort -u -k2 -k1,1 | {{
  last= found=
  missing() {{ [ -z "$last" ] || [ -n "$found" ] || {{ echo "@@ file $last"; echo missing; }}; }}
  while read -r root path; do
    [ -n "$path" ] || continue
    [ "$path" = "$last" ] || {{ missing; last=$path found=; }}
    case $path in /*) file="${{root%/}}$path" ;; *) file="${{root%root}}cwd/$path" ;; esac
    # A process may end before its root is looked at: any other that names the path will do.
    [ -z "$found" ] && [ -r "$file" ] || continue
    found=yes; echo "@@ file $path"; head -c 20000 "$file" | sed 's/^/ /'; echo
  done
  missing
}}
echo '@@ end'
"""
)


@dataclass(frozen=True)
class Server:
    """A discovery server that a profile points to."""

    prefix: str
    address: str
    port: int


@dataclass(frozen=True)
class Profile:
    """What Fast DDS makes of a file. `error` says why it makes nothing of it."""

    path: str
    error: str = ""
    default: bool = False  # whether its participant profile is the default one: another is ignored in silence
    protocol: str = ""  # SIMPLE, CLIENT, SUPER_CLIENT, SERVER
    servers: tuple[Server, ...] = ()
    whitelist: tuple[str, ...] = ()  # the only addresses that participants use and announce

    @property
    def for_server(self) -> bool:
        """Whether it is meant to join a discovery server's graph."""
        return bool(self.protocol not in ("", "SIMPLE") or self.servers)

    def line(self) -> str:
        """What matters of it."""
        if self.error:
            return f"{self.path}: {self.error}"
        servers = ", ".join(f"{server.prefix} at {server.address}:{server.port}" for server in self.servers) or "none"
        default = "true" if self.default else "not true"
        return f"{self.path}: discoveryProtocol {self.protocol or 'none'}; is_default_profile {default}; servers: {servers}"


def parse(output: Output) -> tuple[Profile, ...]:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    if not said.every("end"):
        raise ValueError("the probe ended before its last line")
    return tuple(_profile(section.argument, section.lines) for section in said.every("file"))


def _profile(path: str, lines: tuple[str, ...]) -> Profile:
    if lines and lines[0] == "missing":
        return Profile(path, error="there is no readable file")
    text = "\n".join(line[1:] for line in lines).strip()
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        return Profile(path, error="it declares a document type; Fast DDS profiles have none")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        return Profile(path, error=f"it is not well-formed XML: {error}")
    for element in root.iter():  # eProsima's namespace differs between versions and is often left out
        element.tag = re.sub(r"^\{[^}]*\}", "", element.tag)
    participants = [e for e in root.iter("participant") if e.get("profile_name")]
    chosen = next((e for e in participants if e.get("is_default_profile", "").lower() == "true"), None)
    default = chosen is not None
    if chosen is None:
        chosen = participants[0] if participants else None
    whitelist = tuple(sorted({_text(e) for wl in root.iter("interfaceWhiteList") for e in wl}))
    if chosen is None:
        return Profile(path, error="it has no participant profile", whitelist=whitelist)
    servers = tuple(
        Server(
            remote.get("prefix", "").lower(), _text(udp.find("address")), _port(_text(udp.find("port")) or str(DISCOVERY_PORT))
        )
        for remote in chosen.iter("RemoteServer")
        for udp in remote.iter("udpv4")
    )
    return Profile(path, "", default, _text(next(chosen.iter("discoveryProtocol"), None)), servers, whitelist)


def _text(element: ElementTree.Element | None) -> str:
    return (element.text or "").strip() if element is not None else ""


def _port(text: str) -> int:
    return int(text) if text.isdigit() else 0


DDS_PROFILES = Fact("dds-profiles", PROBE, parse)
