"""What a capture at both ends says of a way that is open in one direction only, in lines for a finding."""

from __future__ import annotations

from collections.abc import Iterable

from lupin_cli.checks.base import Evidence
from lupin_cli.facts.dds_profiles import DISCOVERY_PORT
from lupin_cli.facts.packets import CAPTURE_S, PACKETS, Flow, Packets

MOST_PLACES = 4


def packet_lines(evidence: Evidence) -> tuple[str, ...]:
    """One line for each end and direction; that nobody was allowed to look is said too. None where nobody looked closer."""
    here = evidence.laptop.get(PACKETS)
    there = evidence.robot.get(PACKETS) if evidence.robot is not None else None
    lines = [f"{who}: packets were not captured: {seen.refused}" for who, seen in _ends(here, there) if seen.refused]
    own = set(here.own if here else ())
    robots = set(there.own if there else ()) - own
    if here is not None and not here.refused:
        leaving = [flow for flow in here.sent() if not robots or flow.destination in robots]
        lines.append(f"captured here for {CAPTURE_S:.0f} s: data sent to the robot: {_places(leaving)}")
        asked = [flow for flow in leaving if flow.port == DISCOVERY_PORT]
        lines += [f"captured here: {flow.count} packets to its server at {flow.destination}:{flow.port}" for flow in asked]
    if there is not None and not there.refused:
        coming = [flow for flow in there.arrived() if not own or flow.source in own]
        going = [flow for flow in there.sent() if not own or flow.destination in own]
        lines.append(f"captured on the robot: data that arrived from here: {_places(coming)}")
        lines.append(f"captured on the robot: data that it sent here: {_places(going)}")
    return tuple(lines)


def reaches_robot(evidence: Evidence) -> bool:
    """Whether the robot was seen to get data from this machine. False also where nobody looked."""
    here = evidence.laptop.get(PACKETS)
    there = evidence.robot.get(PACKETS) if evidence.robot is not None else None
    if here is None or there is None:
        return False
    return any(flow.is_data and flow.source in here.own for flow in there.arrived())


def _ends(here: Packets | None, there: Packets | None) -> Iterable[tuple[str, Packets]]:
    return [(who, seen) for who, seen in (("laptop", here), ("robot", there)) if seen is not None]


def _places(flows: Iterable[Flow]) -> str:
    found = sorted((flow for flow in flows if flow.is_data), key=lambda flow: -flow.count)
    if not found:
        return "none"
    more = f" and {len(found) - MOST_PLACES} more" if len(found) > MOST_PLACES else ""
    return ", ".join(f"{flow.count} to {flow.destination}:{flow.port}" for flow in found[:MOST_PLACES]) + more
