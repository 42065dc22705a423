"""One simulator per graph: two would publish two clocks and two robots on the same topics.

The claim is a listening Unix socket in the abstract namespace, one per DDS domain and discovery server, so it ends with its
process and belongs to one network namespace, as a domain's UDP ports do. Its peer credentials name the process that holds it.
"""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Mapping

_CREDENTIALS = struct.Struct("3i")  # pid, uid, gid: unix(7), SO_PEERCRED


class GraphTaken(RuntimeError):
    """Another simulator is part of the graph; the message names its process."""


def claim_graph(environment: Mapping[str, str] | None = None) -> socket.socket:
    """Claim the graph that a process with these variables joins; return a socket that holds the claim. Raises GraphTaken."""
    environment = os.environ if environment is None else environment
    domain = environment.get("ROS_DOMAIN_ID") or "0"
    server = environment.get("ROS_DISCOVERY_SERVER", "")
    address = f"\0lupin-simulator/{domain}/{server}"[:100]  # sun_path has 108 bytes
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        claim.bind(address)
        claim.listen(1)
    except OSError:
        claim.close()
        where = f"domain {domain}" + (f" of the discovery server {server}" if server else "")
        raise GraphTaken(
            f"a simulator already runs in {where}: process {_holder(address)}; stop it, or choose another ROS_DOMAIN_ID"
        ) from None
    return claim


def _holder(address: str) -> int:
    """Return the PID of the process that listens at an address; 0 if it has just ended."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as visitor:
        try:
            visitor.connect(address)
            return int(_CREDENTIALS.unpack(visitor.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))[0])
        except OSError:
            return 0
