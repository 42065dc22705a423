"""The publishers for topics that clients publish on: one per topic, shared by all clients."""

from __future__ import annotations

import time
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher

from lupin_runtime import graph
from lupin_runtime.console.topic_hub import TopicFailed, topic_type, type_conflict
from lupin_runtime.ros import type_names
from lupin_runtime.ros.node import qos_profile

# A reloaded page advertises the same topics within seconds; a new publisher would lose its first messages during discovery.
UNREGISTER_AFTER_S = 10.0
MAX_TOPICS = 300  # that one client may publish on
MAX_ADVERTISEMENTS = 100  # of one client for one topic, each with its id
_BY_PUBLISHING = object()  # the id of the advertisement of a client that publishes without one


@dataclass
class _Shared:
    """A publisher, and the ids of the advertisements, by client, that keep it open."""

    type_name: str
    message_class: Any
    publisher: Publisher
    users: dict[Hashable, set[Hashable]] = field(default_factory=dict)
    unused_since_s: float = 0.0


class PublisherPool:
    """All methods are called on the executor's thread. An unused publisher is kept for `unregister_after_s`."""

    def __init__(self, node: Node, unregister_after_s: float = UNREGISTER_AFTER_S) -> None:
        self._node = node
        self._unregister_after_s = unregister_after_s
        self._topics: dict[str, _Shared] = {}

    def advertise(
        self, client: Hashable, name: str, type_name: str | None, identifier: Hashable, latch: bool, queue_size: int
    ) -> None:
        """Register a client for a topic. Raises TopicFailed.

        The first registration sets the QoS: that of the topic's row in the graph's table, or else reliable, and latched if
        `latch` is set.
        """
        identifiers = self._shared(client, name, type_name, latch, queue_size).users[client]
        if identifier not in identifiers and len(identifiers) >= MAX_ADVERTISEMENTS:
            raise TopicFailed(f"{name}: a client may advertise a topic {MAX_ADVERTISEMENTS} times; unadvertise it first")
        identifiers.add(identifier)

    def to_publish(
        self, client: Hashable, name: str, type_name: str | None, latch: bool, queue_size: int
    ) -> tuple[Any, Publisher]:
        """Return a topic's message class and publisher, after advertising it if the client has not. Raises TopicFailed."""
        shared = self._shared(client, name, type_name, latch, queue_size)
        if not shared.users[client]:
            shared.users[client].add(_BY_PUBLISHING)
        return shared.message_class, shared.publisher

    def _shared(self, client: Hashable, name: str, type_name: str | None, latch: bool, queue_size: int) -> _Shared:
        topic = type_names.absolute(name)
        shared = self._topics.get(topic)
        if (shared is None or client not in shared.users) and self._count(client) >= MAX_TOPICS:
            raise TopicFailed(f"{name}: a client may publish on {MAX_TOPICS} topics; unadvertise others first")
        if shared is None:
            shared = self._topics[topic] = self._open(topic, name, type_name, latch, queue_size)
        elif type_name is not None and type_names.full_name(type_name, "msg") != shared.type_name:
            raise TopicFailed(type_conflict(name, type_names.full_name(type_name, "msg"), shared.type_name))
        shared.users.setdefault(client, set())
        return shared

    def _count(self, client: Hashable) -> int:
        return sum(client in shared.users for shared in self._topics.values())

    def unadvertise(self, client: Hashable, name: str, identifier: Hashable | None) -> None:
        """Remove a client's advertisement with this id, or all of its advertisements of the topic if the id is None."""
        shared = self._topics.get(type_names.absolute(name))
        if shared is None or client not in shared.users:
            return
        identifiers = shared.users[client]
        identifiers.discard(identifier)
        if identifier is None or identifiers <= {_BY_PUBLISHING}:
            del shared.users[client]
        if not shared.users:
            shared.unused_since_s = time.monotonic()

    def leave(self, client: Hashable) -> None:
        """Remove all advertisements of a client."""
        for topic in list(self._topics):
            self.unadvertise(client, topic, None)

    def close_unused(self) -> None:
        """Destroy publishers that no client has used for a while. To be called about twice a second."""
        now_s = time.monotonic()
        for topic, shared in list(self._topics.items()):
            if not shared.users and now_s - shared.unused_since_s >= self._unregister_after_s:
                self._node.destroy_publisher(shared.publisher)
                del self._topics[topic]

    def _open(self, topic: str, name: str, type_name: str | None, latch: bool, queue_size: int) -> _Shared:
        known = topic_type(self._node, topic)
        if type_name is None and known is None:
            raise TopicFailed(f"Cannot infer topic type for topic {name} as it is not yet advertised")
        requested = type_names.full_name(type_name, "msg") if type_name is not None else str(known)
        if known is not None and known != requested:
            raise TopicFailed(type_conflict(name, requested, known))
        row = graph.topic(topic)
        qos = row.qos if row is not None else graph.Qos(reliable=True, latched=latch, depth=1 if latch else queue_size)
        try:
            message_class = type_names.find(requested, "msg")
            publisher = self._node.create_publisher(message_class, topic, qos_profile(qos))
        except type_names.UnknownType as error:
            raise TopicFailed(str(error)) from error
        except Exception as error:  # rclpy raises a different class for each fault of a name
            raise TopicFailed(f"{topic}: {error}") from error
        return _Shared(requested, message_class, publisher)
