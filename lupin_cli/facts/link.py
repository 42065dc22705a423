"""The link from this machine to a robot: the address that was tried, and why connecting failed if it did."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.facts.clock import Offset


@dataclass(frozen=True)
class Link:
    """The result of one attempt to connect to a robot.

    `kind` is empty if the robot answered. Otherwise it is `Unreachable.kind`, or for other failures one of host-key-unknown,
    host-key-changed, authentication, root and target.
    """

    robot: str  # name in the inventory, or the address as it was typed
    address: str  # host name or IP address that was tried
    kind: str = ""
    message: str = ""
    next_command: str = ""
    clock: Offset | None = None  # offset of the robot's clock from this machine's; None if it was not measured

    @property
    def reachable(self) -> bool:
        """Whether the robot answered."""
        return not self.kind
