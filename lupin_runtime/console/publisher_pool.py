"""Publishers for the topics that clients publish on: one per topic, shared by all clients."""

from __future__ import annotations

import time
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher

from lupin_runtime import graph
from lupin_runtime.console import interfaces
from lupin_runtime.console.topic_hub import TopicFailed, topic_type, type_conflict
from lupin_runtime.ros.node import qos_profile

# A page that is loaded again advertises the same topics within seconds; discovery would lose its first messages.
UNREGISTER_AFTER_S = 10.0
DEFAULT_QUEUE = 100


@dataclass
class _Shared:
    """A publisher with the advertisements that keep it: of each client, by id."""

    type_name: str
    message_class: Any
    publisher: Publisher
    users: dict[Hashable, set[Hashable]] = field(default_factory=dict)
    unused_since_s: float = 0.0


class PublisherPool:
    """All methods are called on the thread of the node's executor. `unregister_after_s` is how long an unused one is kept."""

    def __init__(self, node: Node, unregister_after_s: float = UNREGISTER_AFTER_S) -> None:
        self._node = node
        self._unregister_after_s = unregister_after_s
        self._topics: dict[str, _Shared] = {}

    def advertise(
        self, client: Hashable, topic: str, type_name: str | None, identifier: Hashable, latch: bool, queue_size: int
    ) -> tuple[Any, Publisher]:
        """Register a client for a topic; returns the message class and the publisher. Raises TopicFailed.

        The first registration sets the QoS: a topic of the graph has its row's; others are reliable, and latched as asked for.
        """
        shared = self._topics.get(topic)
        if shared is None:
            shared = self._topics[topic] = self._open(topic, type_name, latch, queue_size)
        elif type_name is not None and interfaces.full_name(type_name, "msg") != shared.type_name:
            raise TopicFailed(type_conflict(topic, interfaces.full_name(type_name, "msg"), shared.type_name))
        shared.users.setdefault(client, set()).add(identifier)
        return shared.message_class, shared.publisher

    def unadvertise(self, client: Hashable, topic: str, identifier: Hashable | None) -> None:
        """Remove a client's advertisement of that id; all of its own for the topic where the id is None."""
        shared = self._topics.get(topic)
        if shared is None or client not in shared.users:
            return
        identifiers = shared.users[client]
        if identifier is not None:
            identifiers.discard(identifier)
        if identifier is None or not identifiers:
            del shared.users[client]
        if not shared.users:
            shared.unused_since_s = time.monotonic()

    def leave(self, client: Hashable) -> None:
        """Remove all advertisements of a client."""
        for topic in list(self._topics):
            self.unadvertise(client, topic, None)

    def close_unused(self) -> None:
        """Destroy the publishers that nobody has used for a while. To be called about twice a second."""
        now_s = time.monotonic()
        for topic, shared in list(self._topics.items()):
            if not shared.users and now_s - shared.unused_since_s >= self._unregister_after_s:
                self._node.destroy_publisher(shared.publisher)
                del self._topics[topic]

    def _open(self, topic: str, type_name: str | None, latch: bool, queue_size: int) -> _Shared:
        known = topic_type(self._node, topic)
        if type_name is None and known is None:
            raise TopicFailed(f"Cannot infer topic type for topic {topic} as it is not yet advertised")
        wanted = interfaces.full_name(type_name, "msg") if type_name is not None else str(known)
        if known is not None and known != wanted:
            raise TopicFailed(type_conflict(topic, wanted, known))
        row = graph.topic(topic)
        qos = row.qos if row is not None else graph.Qos(reliable=True, latched=latch, depth=1 if latch else queue_size)
        try:
            message_class = interfaces.find(wanted, "msg")
            publisher = self._node.create_publisher(message_class, topic, qos_profile(qos))
        except interfaces.UnknownType as error:
            raise TopicFailed(str(error)) from error
        except Exception as error:  # rclpy raises a different class for each fault of a name
            raise TopicFailed(f"{topic}: {error}") from error
        return _Shared(wanted, message_class, publisher)
