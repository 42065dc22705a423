"""What a stage waits for, as data. A stage never sleeps: it waits for one of these, and its delay names it."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime.graph import Action, Service, Topic


@dataclass(frozen=True)
class Heard:
    """A sample of the topic arrived."""

    topic: Topic

    def __str__(self) -> str:
        return self.topic.name


@dataclass(frozen=True)
class Chain:
    """A transform between the frames is known."""

    target: str
    source: str

    def __str__(self) -> str:
        return f"transform {self.target} -> {self.source}"


@dataclass(frozen=True)
class Serves:
    """The service has a server."""

    service: Service

    def __str__(self) -> str:
        return f"service {self.service.name}"


@dataclass(frozen=True)
class Acts:
    """The action has a server."""

    action: Action

    def __str__(self) -> str:
        return f"action {self.action.name}"


@dataclass(frozen=True)
class Lifecycle:
    """The mission has left BOOT: its own dependencies answer."""

    def __str__(self) -> str:
        return "/mission/state READY"


Sentinel = Heard | Chain | Serves | Acts | Lifecycle
