"""What is known of the way from this machine to the robot, whether or not it could be gone."""

from __future__ import annotations

from lupin_cli.facts.clock import Offset
from lupin_cli.quick_dataclass import dataclass


@dataclass(frozen=True)
class Link:
    """One try to reach a robot. `kind` is empty where the robot answered; otherwise it is `Unreachable.kind`, or one of
    host-key-unknown, host-key-changed, authentication and target for the other ways to fail."""

    robot: str  # the inventory's name, or the address as it was typed
    address: str  # host name or IP address that was tried
    kind: str = ""
    message: str = ""
    next_command: str = ""
    clock: Offset | None = None  # the robot's against this machine's, None where it wasn't measured

    @property
    def reachable(self) -> bool:
        """Whether the robot answered."""
        return not self.kind
