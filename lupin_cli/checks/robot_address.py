"""The address at which the robot was reached, or was tried."""

from __future__ import annotations

from lupin_cli.checks.base import Snapshot
from lupin_cli.facts.routes import ROUTES


def robot_address(snapshot: Snapshot) -> str:
    """Return the robot's IPv4 address on the link. Empty if no robot was selected or its name was not resolved."""
    if snapshot.link is None:
        return ""
    address = snapshot.link.address
    if address.replace(".", "").isdigit():
        return address
    routes = snapshot.laptop.get(ROUTES)
    return routes.names.get(address, "") if routes is not None else ""
