"""DDS environments: a private domain on loopback for a simulated run, and the robot's graph as configured in `ros-env.sh`.

The loopback profile uses UDP on 127.0.0.1 only, so no packet leaves the machine. It does not use shared memory, which leaves
orphaned or foreign segments and lets late joiners see names without samples; tuned UDP is also faster for images. The large
socket buffers need `net.core.rmem_max` and `wmem_max` of 4 MiB. With less the kernel clips them and large raw images lose
fragments; the cameras' JPEG topics are small enough.
"""

from __future__ import annotations

import os
import random
import re
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.bounded_file import is_file, read_bounded_text

SOCKET_BUFFER_BYTES = 4 * 1024 * 1024

# The variables that a process needs to join the same graph.
GRAPH_VARIABLES = ("ROS_DOMAIN_ID", "ROS_DISCOVERY_SERVER", "RMW_IMPLEMENTATION", "FASTRTPS_DEFAULT_PROFILES_FILE")

# RTPS 2.2, 9.6.1.1: a domain's ports start at 7400 + 250 * domain. Above domain 101 they overlap the ephemeral range.
_PORT_BASE = 7400
_PORTS_PER_DOMAIN = 250
_FIRST_DOMAIN, _LAST_DOMAIN = 1, 100
# The last port of a domain belongs to its 120th participant, which no run has. Binding it claims the domain.
_CLAIM_OFFSET = _PORTS_PER_DOMAIN - 1

_LOOPBACK_PROFILE = "fastdds_loopback.xml"
_PROFILE = f"""<?xml version="1.0" encoding="UTF-8" ?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <transport_descriptors>
    <transport_descriptor>
      <transport_id>loopback_udp</transport_id>
      <type>UDPv4</type>
      <sendBufferSize>{SOCKET_BUFFER_BYTES}</sendBufferSize>
      <receiveBufferSize>{SOCKET_BUFFER_BYTES}</receiveBufferSize>
      <maxMessageSize>65000</maxMessageSize>
      <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
    </transport_descriptor>
  </transport_descriptors>
  <participant profile_name="lupin_loopback" is_default_profile="true">
    <rtps>
      <useBuiltinTransports>false</useBuiltinTransports>
      <userTransports><transport_id>loopback_udp</transport_id></userTransports>
    </rtps>
  </participant>
</profiles>
"""

# Each of these variables would take a process out of its private graph.
FOREIGN = (
    "ROS_DISCOVERY_SERVER",
    "ROS_SUPER_CLIENT",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "FASTDDS_BUILTIN_TRANSPORTS",
    "FASTDDS_DEFAULT_PROFILES_FILE",
)


class NoFreeDomain(RuntimeError):
    """Every domain that a run may use is claimed by another run."""


@dataclass
class DomainClaim:
    """A claimed domain, held until `release` or until this process exits."""

    domain: int
    _socket: socket.socket

    def release(self) -> None:
        """Release the domain."""
        self._socket.close()


def claim_domain(first: int | None = None) -> DomainClaim:
    """Claim a domain that no other run on this machine holds; `first` requests a particular one.

    The claim is a bound port, so the kernel releases it when the process exits. Raises NoFreeDomain.
    """
    candidates = [first] if first is not None else random.sample(range(_FIRST_DOMAIN, _LAST_DOMAIN + 1), _LAST_DOMAIN)
    for domain in candidates:
        holder = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            holder.bind(("127.0.0.1", _PORT_BASE + _PORTS_PER_DOMAIN * domain + _CLAIM_OFFSET))
        except OSError:
            holder.close()
            continue
        return DomainClaim(domain, holder)
    claimed = f"domain {first} is" if first is not None else "all 100 domains are"
    raise NoFreeDomain(f"{claimed} in use by other runs; stop one of them with: lupin down")


def loopback_environment(domain: int, directory: Path, base: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the environment in which a process joins `domain` on loopback; write the DDS profile into `directory`."""
    profile = directory / _LOOPBACK_PROFILE
    directory.mkdir(parents=True, exist_ok=True)
    write_atomically(profile, _PROFILE)
    environment = {key: value for key, value in (os.environ if base is None else base).items() if key not in FOREIGN}
    environment.update(
        ROS_DOMAIN_ID=str(domain),
        RMW_IMPLEMENTATION="rmw_fastrtps_cpp",
        FASTRTPS_DEFAULT_PROFILES_FILE=str(profile),
    )
    return environment


class NoRobotEnvironment(RuntimeError):
    """This machine has no discovery server of a robot configured; the message gives the command to type."""


_EXPORT = re.compile(r"^\s*export\s+([A-Za-z_][A-Za-z0-9_]*)=(.*?)\s*$")


def robot_environment(base: Mapping[str, str] | None = None) -> tuple[dict[str, str], list[str]]:
    """Return the environment in which a process joins the robot's graph, and the variable names that `ros-env.sh` set.

    Reads the `export NAME=value` lines of `${XDG_CONFIG_HOME:-~/.config}/lupin/ros-env.sh`, so that a terminal that was opened
    before the set-up works, too. Raises NoRobotEnvironment if neither the file nor the shell names a discovery server.
    """
    environment = dict(os.environ if base is None else base)
    home = Path(environment.get("HOME") or Path.home())
    path = Path(environment.get("XDG_CONFIG_HOME") or home / ".config") / "lupin" / "ros-env.sh"
    applied = []
    if is_file(path):
        for line in read_bounded_text(path, errors="replace").splitlines():
            found = _EXPORT.match(line)
            if found:
                value = found[2].strip("\"'").replace("${HOME}", str(home)).replace("$HOME", str(home))
                environment[found[1]] = value
                applied.append(found[1])
    if not environment.get("ROS_DISCOVERY_SERVER"):
        raise NoRobotEnvironment(
            f"this machine knows no robot: {path} sets no ROS_DISCOVERY_SERVER; "
            "use --target sim, or set this machine up for the robot's address with: lupin dds setup 10.42.0.1"
        )
    return environment, applied


@dataclass(frozen=True)
class DiscoveryMode:
    """How processes find each other in an environment. `warning` says what will not work and what to type, or is empty."""

    sentence: str
    warning: str = ""


def discovery_mode(environment: Mapping[str, str]) -> DiscoveryMode:
    """Return the discovery mode of a process that starts with these variables; other terminals may have another mode."""
    domain = environment.get("ROS_DOMAIN_ID") or "0"
    if server := environment.get("ROS_DISCOVERY_SERVER"):
        return DiscoveryMode(f"discovery server {server}, domain {domain}")
    if Path(environment.get("FASTRTPS_DEFAULT_PROFILES_FILE", "")).name == _LOOPBACK_PROFILE:
        return DiscoveryMode(f"this machine only, domain {domain}")
    return DiscoveryMode(
        f"multicast, domain {domain}: no discovery server",
        "A robot with a discovery server stays unseen: the console seems live, but shows no battery and no telemetry, and "
        "cannot drive. Set this machine up for the robot's address, then start again: lupin dds setup 10.42.0.1",
    )
