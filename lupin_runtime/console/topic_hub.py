"""Delivers topics to any number of clients with one ROS subscription per topic and one encoding per message and format.

A subscription's QoS follows the topic's publishers. A client that joins late gets a latched topic's last messages at once.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from rclpy.node import Node

from lupin_runtime import graph
from lupin_runtime.console.cdr import MalformedMessage, UnsupportedType
from lupin_runtime.console.encoding import publication
from lupin_runtime.console.outbox import SAMPLES_PER_TOPIC, Frame
from lupin_runtime.console.subscription import ClientSubscription, Request
from lupin_runtime.ros import type_names
from lupin_runtime.ros.raw_subscription import QUEUE_DEPTH, RawSubscription

MAX_TOPICS = 300  # that one client may subscribe to
MAX_REQUESTS = 100  # of one client for one topic, each with its id


class TopicFailed(ValueError):
    """A topic that can't be subscribed to or published on; the text is the reason."""


class Receiver(Hashable, Protocol):
    """A client of the hub."""

    def deliver(self, frame: Frame) -> None:
        """Queue a frame; called on the executor's thread."""


@dataclass
class _Stream:
    """A topic with its subscription and its receiving clients, each with the name of the topic as the client sent it."""

    topic: str
    type_name: str
    message_class: Any
    subscription: RawSubscription
    receivers: dict[tuple[Receiver, str], ClientSubscription] = field(default_factory=dict)
    failed: bool = False  # whether a message that can't be encoded has been logged

    @property
    def droppable(self) -> bool:
        """Whether a waiting message may be dropped for a newer one: true for sensor samples, false for changes of state."""
        row = graph.topic(self.topic)
        if row is graph.ESTOP_STATE or row is graph.ROSOUT:
            return False
        return not self.subscription.qos.latched and (row is None or row.rate_hz is not None)


class TopicHub:
    """All methods are called on the executor's thread."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._streams: dict[str, _Stream] = {}  # by absolute name
        self._counts: Counter[Receiver] = Counter()  # of each client's topics

    # -- clients ------------------------------------------------------------------------------------------------------
    def subscribe(self, receiver: Receiver, name: str, type_name: str | None, identifier: Hashable, request: Request) -> None:
        """Add a client's request for a topic; without `type_name`, the type is the graph's. Raises TopicFailed."""
        topic, key = type_names.absolute(name), (receiver, name)
        stream = self._streams.get(topic)
        merged = stream.receivers.get(key) if stream is not None else None
        if merged is None and self._counts[receiver] >= MAX_TOPICS:
            raise TopicFailed(f"{name}: a client may subscribe to {MAX_TOPICS} topics; unsubscribe from others first")
        if merged is not None and identifier not in merged and len(merged) >= MAX_REQUESTS:
            raise TopicFailed(f"{name}: a client may have {MAX_REQUESTS} subscriptions to one topic; unsubscribe some first")
        if stream is None:
            stream = self._streams[topic] = self._open(topic, name, type_name)
        elif type_name is not None and type_names.full_name(type_name, "msg") != stream.type_name:
            raise TopicFailed(type_conflict(name, type_names.full_name(type_name, "msg"), stream.type_name))
        if merged is not None:
            merged.add(identifier, request)
            return
        merged = stream.receivers[key] = ClientSubscription()
        merged.add(identifier, request)
        self._counts[receiver] += 1
        for data in stream.subscription.kept:
            self._send(stream, data, {key: merged})

    def unsubscribe(self, receiver: Receiver, name: str, identifier: Hashable | None) -> None:
        """Remove a client's request with this id, or all of its requests for the topic if the id is None."""
        stream = self._streams.get(type_names.absolute(name))
        merged = stream.receivers.get((receiver, name)) if stream else None
        if stream is None or merged is None:
            return
        merged.remove(identifier)
        if not merged:
            self._remove(stream, receiver, name)

    def leave(self, receiver: Receiver) -> None:
        """Remove all requests of a client."""
        for stream in list(self._streams.values()):
            for name in (stream.topic, stream.topic[1:]):
                if (receiver, name) in stream.receivers:
                    self._remove(stream, receiver, name)

    def follow_publishers(self) -> None:
        """Reopen subscriptions whose publishers now offer another QoS. To be called about once a second."""
        for stream in self._streams.values():
            stream.subscription.follow_publishers()

    # -- subscriptions ------------------------------------------------------------------------------------------------
    def _open(self, topic: str, name: str, type_name: str | None) -> _Stream:
        known = topic_type(self._node, topic)
        if type_name is None:
            if known is None:
                raise TopicFailed(f"Cannot infer topic type for topic {name} as it is not yet advertised")
            requested = known
        else:
            requested = type_names.full_name(type_name, "msg")
            if known is not None and known != requested:
                raise TopicFailed(type_conflict(name, requested, known))
        try:
            message_class = type_names.find(requested, "msg")
        except type_names.UnknownType as error:
            raise TopicFailed(str(error)) from error
        try:
            subscription = RawSubscription(self._node, topic, message_class, lambda data: self._receive(topic, data))
        except Exception as error:  # rclpy raises a different class for each fault of a name
            raise TopicFailed(f"{topic}: {error}") from error
        return _Stream(topic, requested, message_class, subscription)

    def _remove(self, stream: _Stream, receiver: Receiver, name: str) -> None:
        del stream.receivers[receiver, name]
        self._counts -= Counter([receiver])
        if not stream.receivers:
            del self._streams[stream.topic]
            stream.subscription.close()

    # -- messages -----------------------------------------------------------------------------------------------------
    def _receive(self, topic: str, data: bytes) -> None:
        stream = self._streams.get(topic)
        if stream is not None:
            self._send(stream, data, stream.receivers)

    def _send(self, stream: _Stream, data: bytes, receivers: dict[tuple[Receiver, str], ClientSubscription]) -> None:
        now_ns = time.monotonic_ns()
        droppable = stream.droppable
        frames: dict[tuple[str, str, int], Frame] = {}
        for (receiver, name), merged in receivers.items():
            if droppable and not merged.due(now_ns):
                continue
            key = (name, merged.compression, merged.queue_length)
            if key not in frames:
                encoded = self._encode(stream, name, data, merged.compression)
                if encoded is None:
                    return
                depth = merged.queue_length or (SAMPLES_PER_TOPIC if graph.topic(stream.topic) is not None else QUEUE_DEPTH)
                frames[key] = replace(encoded, stream=name, depth=depth) if droppable else encoded
            receiver.deliver(frames[key])

    def _encode(self, stream: _Stream, name: str, data: bytes, compression: str) -> Frame | None:
        received_ns = self._node.get_clock().now().nanoseconds if compression == "cbor-raw" else 0
        try:
            return publication(compression, name, stream.message_class, data, received_ns)
        except (MalformedMessage, UnsupportedType) as error:
            if not stream.failed:
                self._node.get_logger().warning(f"{stream.topic} is not sent to clients: {error}")
            stream.failed = True
            return None


def topic_type(node: Node, topic: str) -> str | None:
    """Return a topic's type on the graph, or else in the graph's table; None if neither knows it."""
    kinds: Sequence[str] = dict(node.get_topic_names_and_types()).get(topic, ())
    row = graph.topic(topic)
    return kinds[0] if kinds else row.type if row is not None else None


def type_conflict(topic: str, requested: str, known: str) -> str:
    """Return the protocol's error text for a topic whose type differs from the one that a client asked for."""
    return f"Tried to register topic {topic} with type {requested} but it is already established with type {known}"
