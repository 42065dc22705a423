"""Which of its addresses a robot is reached at, as checks of both ends need it."""

from __future__ import annotations

from lupin_cli.checks.base import Evidence
from lupin_cli.facts.link import Link
from lupin_cli.facts.routes import ROUTES


def robot_address(evidence: Evidence) -> str:
    """The robot's IPv4 address on the link, or the one that was tried; empty where no robot was asked for or no one knows."""
    link, routes = evidence.link, evidence.laptop.get(ROUTES)
    if not isinstance(link, Link):
        return ""
    if link.address.replace(".", "").isdigit():
        return link.address
    return routes.names.get(link.address, "") if routes is not None else ""
