"""Whether a ROS graph that this machine joins is that of the selected robot."""

from __future__ import annotations

from lupin_cli.checks.base import Snapshot
from lupin_cli.checks.dds_environment import server_host
from lupin_cli.checks.robot_address import is_of_examined_robot
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.graph import Graph


def other_robot(snapshot: Snapshot, graph: Graph) -> str:
    """Return the address of the graph's discovery server if it is not that of the selected robot; empty if it may be.

    A robot that was reached shows its addresses. One that was not is only told from the other robots that are examined too.
    Nothing of another robot arrives in an empty graph: there, the wrong address is why this machine receives nothing.
    """
    host = server_host(dict(graph.environment).get("ROS_DISCOVERY_SERVER", ""))
    addresses, link = snapshot.robot_fact(ADDRESSES), snapshot.link
    if link is None or graph.kind == "sim" or host == link.address or not host.replace(".", "").isdigit():
        return ""
    examined_too = is_of_examined_robot(snapshot, host)
    if addresses is None:
        return host if examined_too else ""
    is_own = addresses.has(host) and not host.startswith("127.")
    return "" if is_own or not (examined_too or graph.nodes or graph.topics) else host
