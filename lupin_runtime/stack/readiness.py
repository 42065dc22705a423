"""Readiness conditions: what a process of the stack waits for before it starts, and what shows that it is up."""

from __future__ import annotations

import socket
from dataclasses import dataclass

from lupin_runtime.graph import MISSION_STATE, Action, Service, Topic

CONNECT_TIMEOUT_S = 0.05


@dataclass(frozen=True)
class TopicSample:
    """A sample of the topic has arrived."""

    topic: Topic

    def __str__(self) -> str:
        return self.topic.name


@dataclass(frozen=True)
class TransformReady:
    """The transform from frame `source` to frame `target` is known."""

    target: str
    source: str

    def __str__(self) -> str:
        return f"transform {self.target} -> {self.source}"


@dataclass(frozen=True)
class ServiceReady:
    """The service has a server."""

    service: Service

    def __str__(self) -> str:
        return f"service {self.service.name}"


@dataclass(frozen=True)
class ActionReady:
    """The action has a server."""

    action: Action

    def __str__(self) -> str:
        return f"action {self.action.name}"


@dataclass(frozen=True)
class Port:
    """A TCP server accepts connections on the port. `address` is an IP address of this machine or the robot.

    `option` names the field of a run's options that chooses another number; empty if none does.
    """

    number: int
    address: str = "127.0.0.1"
    option: str = ""

    def __str__(self) -> str:
        return f"port {self.address}:{self.number}"

    def is_listening(self) -> bool:
        """Connect and disconnect; return False if the connection is refused or takes longer than CONNECT_TIMEOUT_S."""
        try:
            socket.create_connection((self.address, self.number), CONNECT_TIMEOUT_S).close()
        except OSError:
            return False
        return True


@dataclass(frozen=True)
class MissionReady:
    """The mission has left BOOT, so its dependencies are available, and is not in FAULT."""

    def __str__(self) -> str:
        return f"{MISSION_STATE.name} READY"


Readiness = TopicSample | TransformReady | ServiceReady | ActionReady | Port | MissionReady
