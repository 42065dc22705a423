"""Delivers topics to any number of clients with one ROS subscription per topic and one encoding per message and format.

A subscription's QoS follows the topic's publishers. A client that joins late gets a latched topic's last messages at once.
"""

from __future__ import annotations

import time
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from rclpy.node import Node

from lupin_runtime import graph
from lupin_runtime.console import interfaces
from lupin_runtime.console.cdr import MalformedMessage, UnsupportedType
from lupin_runtime.console.encoding import publication
from lupin_runtime.console.outbox import SAMPLES_PER_TOPIC, Frame
from lupin_runtime.console.subscription import ClientSubscription, Request
from lupin_runtime.ros.raw_subscription import QUEUE_DEPTH, RawSubscription


class TopicFailed(ValueError):
    """A topic that can't be subscribed to or published on; the text is the reason."""


class Receiver(Protocol):
    """A client of the hub."""

    def deliver(self, frame: Frame) -> None:
        """Queue a frame; called on the executor's thread."""


@dataclass
class _Stream:
    """A topic with its subscription and its receiving clients."""

    topic: str
    type_name: str
    message_class: Any
    subscription: RawSubscription
    receivers: dict[Receiver, ClientSubscription] = field(default_factory=dict)
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
        self._streams: dict[str, _Stream] = {}

    # -- clients ------------------------------------------------------------------------------------------------------
    def subscribe(self, receiver: Receiver, topic: str, type_name: str | None, identifier: Hashable, request: Request) -> None:
        """Add a client's request for a topic; without `type_name`, the type is the graph's. Raises TopicFailed."""
        stream = self._streams.get(topic)
        if stream is None:
            stream = self._streams[topic] = self._open(topic, type_name)
        elif type_name is not None and interfaces.full_name(type_name, "msg") != stream.type_name:
            raise TopicFailed(type_conflict(topic, interfaces.full_name(type_name, "msg"), stream.type_name))
        known = receiver in stream.receivers
        merged = stream.receivers.setdefault(receiver, ClientSubscription())
        merged.add(identifier, request)
        if not known:
            for data in stream.subscription.kept:
                self._send(stream, data, {receiver: merged})

    def unsubscribe(self, receiver: Receiver, topic: str, identifier: Hashable | None) -> None:
        """Remove a client's request with this id, or all of its requests for the topic if the id is None."""
        stream = self._streams.get(topic)
        merged = stream.receivers.get(receiver) if stream else None
        if stream is None or merged is None:
            return
        merged.remove(identifier)
        if merged.empty:
            del stream.receivers[receiver]
            self._close_unused(stream)

    def leave(self, receiver: Receiver) -> None:
        """Remove all requests of a client."""
        for stream in list(self._streams.values()):
            if stream.receivers.pop(receiver, None) is not None:
                self._close_unused(stream)

    def follow_publishers(self) -> None:
        """Reopen subscriptions whose publishers now offer another QoS. To be called about once a second."""
        for stream in self._streams.values():
            stream.subscription.follow_publishers()

    # -- subscriptions ------------------------------------------------------------------------------------------------
    def _open(self, topic: str, type_name: str | None) -> _Stream:
        known = topic_type(self._node, topic)
        if type_name is None:
            if known is None:
                raise TopicFailed(f"Cannot infer topic type for topic {topic} as it is not yet advertised")
            requested = known
        else:
            requested = interfaces.full_name(type_name, "msg")
            if known is not None and known != requested:
                raise TopicFailed(type_conflict(topic, requested, known))
        try:
            message_class = interfaces.find(requested, "msg")
        except interfaces.UnknownType as error:
            raise TopicFailed(str(error)) from error
        try:
            subscription = RawSubscription(self._node, topic, message_class, lambda data: self._receive(topic, data))
        except Exception as error:  # rclpy raises a different class for each fault of a name
            raise TopicFailed(f"{topic}: {error}") from error
        return _Stream(topic, requested, message_class, subscription)

    def _close_unused(self, stream: _Stream) -> None:
        if not stream.receivers:
            stream.subscription.close()
            del self._streams[stream.topic]

    # -- messages -----------------------------------------------------------------------------------------------------
    def _receive(self, topic: str, data: bytes) -> None:
        stream = self._streams.get(topic)
        if stream is not None:
            self._send(stream, data, stream.receivers)

    def _send(self, stream: _Stream, data: bytes, receivers: dict[Receiver, ClientSubscription]) -> None:
        now_ns = time.monotonic_ns()
        frames: dict[tuple[str, int], Frame] = {}
        for receiver, merged in receivers.items():
            if not merged.due(now_ns):
                continue
            key = (merged.compression, merged.queue_length)
            if key not in frames:
                encoded = self._encode(stream, data, merged.compression)
                if encoded is None:
                    return
                depth = merged.queue_length or (SAMPLES_PER_TOPIC if graph.topic(stream.topic) is not None else QUEUE_DEPTH)
                frames[key] = replace(encoded, stream=stream.topic, depth=depth) if stream.droppable else encoded
            receiver.deliver(frames[key])

    def _encode(self, stream: _Stream, data: bytes, compression: str) -> Frame | None:
        received_ns = self._node.get_clock().now().nanoseconds if compression == "cbor-raw" else 0
        try:
            return publication(compression, stream.topic, stream.message_class, data, received_ns)
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
