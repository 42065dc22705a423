"""The address at which a robot was reached or tried."""

from __future__ import annotations

from lupin_cli.checks.base import Snapshot
from lupin_cli.facts.routes import ROUTES


def robot_address(snapshot: Snapshot) -> str:
    """The IPv4 address of the robot on the link, reached or tried. Empty where no robot was selected or its name is unknown."""
    if snapshot.link is None:
        return ""
    address = snapshot.link.address
    if address.replace(".", "").isdigit():
        return address
    routes = snapshot.laptop.get(ROUTES)
    return routes.names.get(address, "") if routes is not None else ""
