"""The XML profiles of Fast DDS that running processes and this shell use, and the one that `lupin dds setup` writes."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from xml.etree import ElementTree

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.ros_processes import FILTER_NETWORK_NAMESPACE
from lupin_cli.facts.sections import PRELUDE, Section, number, parse_sections
from lupin_runtime.ports import DISCOVERY_PORT

# The GUID prefix of discovery server 0 in the vendor's profiles and in ours; its bytes spell DS_EPROSIMA.
SERVER_PREFIX = "44.53.00.5f.45.50.52.4f.53.49.4d.41"
OWN_PROFILE = "fastdds_super_client.xml"  # written by `lupin dds setup`, in the folder of ros-env.sh

PROBE = (
    PRELUDE
    + rf"""names='FASTRTPS_DEFAULT_PROFILES_FILE|FASTDDS_DEFAULT_PROFILES_FILE'
pids=$(grep -zlasE "^($names)=" /proc/[0-9]*/environ | cut -d/ -f3)
{FILTER_NETWORK_NAMESPACE}
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
    # A process may exit before its root folder is read; any other process with the same path will do.
    [ -z "$found" ] && [ -r "$file" ] || continue
    found=yes; echo "@@ age $path"; echo $(( $(date +%s) - $(stat -L -c %Y "$file") ))
    echo "@@ file $path"; head -c 20000 "$file" | sed 's/^/ /'; echo
  done
  missing
}}
echo '@@ end'
"""
)


@dataclass(frozen=True)
class Server:
    """A discovery server in a profile."""

    prefix: str
    address: str
    port: int


@dataclass(frozen=True)
class Profile:
    """A profile as Fast DDS reads it; `error` says why it cannot be used."""

    path: str
    error: str = ""
    default: bool = False  # whether its participant profile is the default one; Fast DDS silently ignores others
    protocol: str = ""  # SIMPLE, CLIENT, SUPER_CLIENT, SERVER
    servers: tuple[Server, ...] = ()
    whitelist: tuple[str, ...] = ()  # interfaceWhiteList: the only addresses that participants use and announce
    age_s: float | None = None  # since the file was last written, by the machine's clock; None if that is not known
    own_transports: tuple[str, ...] = ()  # types of the transports that it defines for its participants
    builtin_transports: bool = True  # whether participants also have those of Fast DDS: shared memory and UDP

    @property
    def for_server(self) -> bool:
        """Whether it is for participants of a discovery server."""
        return bool(self.protocol not in ("", "SIMPLE") or self.servers)

    def line(self) -> str:
        """Return a one-line summary."""
        if self.error:
            return f"{self.path}: {self.error}"
        servers = ", ".join(f"{server.prefix} at {server.address}:{server.port}" for server in self.servers) or "none"
        default = "true" if self.default else "not true"
        return f"{self.path}: discoveryProtocol {self.protocol or 'none'}; is_default_profile {default}; servers: {servers}"


def parse(output: Output) -> tuple[Profile, ...]:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    if not sections.all("end"):
        raise ValueError("the probe's output has no last line: it was cut off")
    ages = {section.argument: number(section.text, "an age in seconds") for section in sections.all("age") if section.text}
    return tuple(replace(_from_section(section), age_s=ages.get(section.argument)) for section in sections.all("file"))


def _from_section(section: Section) -> Profile:
    if section.lines[:1] == ("missing",):
        return Profile(section.argument, error="the file is missing or not readable")
    return parse_profile(section.argument, "\n".join(line[1:] for line in section.lines))  # each line has a space before it


def parse_profile(path: str, text: str) -> Profile:
    """Parse the XML text of the profile at `path`. Errors in it are part of the result."""
    text = text.strip()
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        return Profile(path, error="it declares a document type, which Fast DDS profiles don't have")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, UnicodeEncodeError) as error:  # the second for bytes that are not UTF-8
        return Profile(path, error=f"it is not well-formed XML: {error}")
    for element in root.iter():  # eProsima's namespace differs between versions and is often missing
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
    types = {_text(each.find("transport_id")): _text(each.find("type")) for each in root.iter("transport_descriptor")}
    used = (types.get(_text(each), "") for each in chosen.findall(".//userTransports/transport_id"))
    return Profile(
        path,
        "",
        default,
        _text(next(chosen.iter("discoveryProtocol"), None)),
        servers,
        whitelist,
        own_transports=tuple(filter(None, used)),
        builtin_transports=_text(next(chosen.iter("useBuiltinTransports"), None)).lower() not in ("false", "0"),
    )


def _text(element: ElementTree.Element | None) -> str:
    return (element.text or "").strip() if element is not None else ""


def _port(text: str) -> int:
    return int(text) if text.isdigit() else 0


DDS_PROFILES = Fact("dds-profiles", PROBE, parse)
