"""Evidence lines about packets captured on both machines: in which directions the link passes data."""

from __future__ import annotations

from collections.abc import Iterable

from lupin_cli.checks.base import Snapshot
from lupin_cli.facts.packets import CAPTURE_S, PACKETS, Flow, Packets
from lupin_runtime.ports import DISCOVERY_PORT

SHOWN_FLOWS = 4


def packet_lines(snapshot: Snapshot) -> tuple[str, ...]:
    """Return a line for each machine and direction, or why a machine could not capture. Empty if no capture was requested."""
    laptop, robot = _captures(snapshot)
    lines = [
        f"{machine}: packets were not captured: {packets.refused}"
        for machine, packets in (("laptop", laptop), ("robot", robot))
        if packets is not None and packets.refused
    ]
    laptop_addresses = set(laptop.own if laptop else ())
    robot_addresses = set(robot.own if robot else ()) - laptop_addresses
    if laptop is not None and not laptop.refused:
        sent = [flow for flow in laptop.sent_flows() if not robot_addresses or flow.destination in robot_addresses]
        lines.append(f"captured on the laptop for {CAPTURE_S:.0f} s: data sent to the robot: {_format_flows(sent)}")
        lines += [
            f"captured on the laptop: {flow.count} packets to the robot's discovery server at {flow.destination}:{flow.port}"
            for flow in sent
            if flow.port == DISCOVERY_PORT
        ]
    if robot is not None and not robot.refused:
        arrived = [flow for flow in robot.received_flows() if not laptop_addresses or flow.source in laptop_addresses]
        sent = [flow for flow in robot.sent_flows() if not laptop_addresses or flow.destination in laptop_addresses]
        lines.append(f"captured on the robot: data that arrived from the laptop: {_format_flows(arrived)}")
        lines.append(f"captured on the robot: data sent to the laptop: {_format_flows(sent)}")
    return tuple(lines)


def data_reaches_robot(snapshot: Snapshot) -> bool:
    """Return whether the capture shows data from the laptop arriving at the robot. False also if nothing was captured."""
    laptop, robot = _captures(snapshot)
    if laptop is None or robot is None:
        return False
    return any(flow.is_data and flow.source in laptop.own for flow in robot.received_flows())


def _captures(snapshot: Snapshot) -> tuple[Packets | None, Packets | None]:
    return snapshot.laptop.get(PACKETS), snapshot.robot_fact(PACKETS)


def _format_flows(flows: Iterable[Flow]) -> str:
    data = sorted((flow for flow in flows if flow.is_data), key=lambda flow: -flow.count)
    if not data:
        return "none"
    more = f" and {len(data) - SHOWN_FLOWS} more" if len(data) > SHOWN_FLOWS else ""
    return ", ".join(f"{flow.count} to {flow.destination}:{flow.port}" for flow in data[:SHOWN_FLOWS]) + more
