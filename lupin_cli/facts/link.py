"""The link from this machine to a robot: the address that was tried, and why connecting failed if it did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from lupin_cli.facts.clock import Offset


@dataclass(frozen=True)
class Link:
    """The result of one attempt to connect to a robot.

    `kind` is empty if the robot answered. Otherwise it is `Unreachable.kind`, or for other failures one of host-key-unknown,
    host-key-changed, authentication, private-key, no-key, ssh-config, login-shell, root and target.
    """

    robot: str  # name in the inventory, or the address as it was typed
    address: str  # host name or IP address that was tried
    kind: str = ""
    message: str = ""
    next_command: str = ""
    transport: str = ""  # in the inventory: wired, router or ap; empty for an address that was typed
    addresses: Mapping[str, str] = field(default_factory=dict)  # hosts of this robot in the inventory, by transport
    login: str = ""  # the command that logs in there
    clock: Offset | None = None  # offset of the robot's clock from this machine's; None if it was not measured

    @property
    def reachable(self) -> bool:
        """Whether the robot answered."""
        return not self.kind

    @property
    def unasked(self) -> bool:
        """Whether the connection failed on this machine or before the robot, so that it says nothing about the robot."""
        return self.kind in ("ssh-config", "jump", "private-key", "no-key")
