"""Which nodes of a graph are programs of the laptop: what a person started there is mended there, whatever graph it joined."""

from __future__ import annotations

from collections.abc import Iterable

from lupin_cli.checks.base import Snapshot
from lupin_cli.checks.dds_environment import server_host, server_port
from lupin_cli.facts.graph import Graph
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess, domain_id


def program_on_laptop(snapshot: Snapshot, graph: Graph, node: str) -> RosProcess | None:
    """Return the laptop's process that runs a node of a graph; None if there is none, or if the robot may run it as well."""
    if any(process.may_run(node) for process in snapshot.robot_fact(ROS_PROCESSES) or ()):
        return None
    processes = snapshot.laptop.get(ROS_PROCESSES) or ()
    return next((each for each in processes if each.may_run(node) and _may_be_in(graph, each)), None)


def programs_by_machine(snapshot: Snapshot, graph: Graph, nodes: Iterable[str]) -> dict[str, dict[str, RosProcess | None]]:
    """Return nodes by the machine on which they run, each with its process of the laptop, if that is known."""
    found: dict[str, dict[str, RosProcess | None]] = {}
    for node in nodes:
        program = program_on_laptop(snapshot, graph, node)
        found.setdefault("laptop" if program is not None else graph.machine, {})[node] = program
    return found


def _may_be_in(graph: Graph, process: RosProcess) -> bool:
    """Return whether the variables of a process lead to a graph. Some programs set the server themselves, once they run."""
    variables = dict(graph.environment)
    if process.is_daemon or process.is_graph_probe or process.domain != domain_id(variables):
        return False
    server = variables.get("ROS_DISCOVERY_SERVER", "")
    same_server = (server_host(process.server), server_port(process.server)) == (server_host(server), server_port(server))
    return not process.server or same_server
