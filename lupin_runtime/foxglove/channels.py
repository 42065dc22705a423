"""A channel for every topic on the graph. A topic is subscribed to only while a client is subscribed to its channel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from foxglove import Channel, Context, Schema
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.validate_full_topic_name import validate_full_topic_name

from lupin_runtime.foxglove.schemas import ros2msg_schema
from lupin_runtime.ros import type_names
from lupin_runtime.ros.raw_subscription import RawSubscription

# How many channels are closed, renewed and opened in one turn. Every change sends a message or two to every client, and a
# client whose message queue overflows is disconnected (MESSAGE_BACKLOG in server.py).
MAX_CHANGES = 24
# foxglove-sdk 0.30 announces a new channel to a connected client shortly before it accepts subscriptions to it. A viewer that
# subscribes too early is refused and does not try again: observed for 8 of 500 new topics beside four busy loops.
RENEWALS = 3


@dataclass
class _Topic:
    """A topic with its channel and the clients that are subscribed to it.

    `renewals` is how often the channel may still be closed and announced again while nobody has subscribed to it.
    """

    name: str
    type_name: str
    message_class: Any
    channel: Channel
    clients: set[int] = field(default_factory=set)
    subscription: RawSubscription | None = None
    renewals: int = RENEWALS


class GraphChannels:
    """The channels of one server. All methods are called on the executor's thread.

    `log_time_ns` returns the arrival time to send with a message; if it returns None, the SDK sends the wall-clock time.
    """

    def __init__(self, node: Node, context: Context, log_time_ns: Callable[[], int | None]) -> None:
        self._node = node
        self._context = context
        self._log_time_ns = log_time_ns
        self._topics: dict[str, _Topic] = {}
        self._by_channel: dict[int, _Topic] = {}
        self._refused: set[tuple[str, str]] = set()  # topics and types that can't be served, each logged once

    # -- topics -------------------------------------------------------------------------------------------------------
    def follow_graph(self) -> None:
        """Open channels for new topics, close those of removed topics, and adapt subscriptions to their publishers.

        To be called about once a second.
        """
        types = self._live_types()
        gone = [topic for name, topic in self._topics.items() if types.get(name) != topic.type_name]
        for topic in gone[:MAX_CHANGES]:
            self._close(topic)
        unsubscribed = [topic for topic in self._topics.values() if topic.renewals and not topic.channel.has_sinks()]
        for topic in unsubscribed[:MAX_CHANGES]:
            self._close(topic)
            self._open(topic.name, topic.type_name, topic.renewals - 1)
        new = [name for name in sorted(types) if name not in self._topics]
        for name in new[:MAX_CHANGES]:
            self._open(name, types[name])
        for topic in self._topics.values():
            if topic.subscription is not None:
                topic.subscription.follow_publishers()

    def _live_types(self) -> dict[str, str]:
        """Return the type of every topic that can be served and that another node publishes or subscribes to."""
        found = {}
        for name, kinds in self._node.get_topic_names_and_types():
            topic = self._topics.get(name)
            kind = topic.type_name if topic is not None and topic.type_name in kinds else kinds[0]
            if (name, kind) in self._refused:
                continue
            try:
                # DDS participants that are not ROS nodes may use any name; the calls below would raise for an invalid one.
                validate_full_topic_name(name)
            except InvalidTopicNameException:
                self._refuse(name, kind, "its name is not a valid ROS topic name")
                continue
            own = int(topic is not None and topic.subscription is not None)
            if self._node.count_publishers(name) or self._node.count_subscribers(name) > own:
                found[name] = kind
        return found

    def _open(self, name: str, type_name: str, renewals: int = RENEWALS) -> None:
        try:
            message_class = type_names.find(type_name, "msg")
            schema = Schema(name=type_name, encoding="ros2msg", data=ros2msg_schema(type_name).encode())
        except (LookupError, OSError, ValueError) as error:
            self._refuse(name, type_name, str(error))
            return
        channel = Channel(name, message_encoding="cdr", schema=schema, context=self._context)
        topic = _Topic(name, type_name, message_class, channel, renewals=renewals)
        self._topics[name] = self._by_channel[channel.id()] = topic

    def _close(self, topic: _Topic) -> None:
        self._leave(topic)
        del self._topics[topic.name], self._by_channel[topic.channel.id()]
        topic.channel.close()

    def _refuse(self, name: str, type_name: str, reason: str) -> None:
        """Log once that a topic is not served."""
        self._refused.add((name, type_name))
        self._node.get_logger().warning(f"{name!r} of type {type_name!r} is not served: {reason}")

    # -- clients ------------------------------------------------------------------------------------------------------
    def add_client(self, channel_id: int, client_id: int) -> None:
        """Handle a client's subscription to a channel. A late client gets the last messages of a latched topic at once."""
        topic = self._by_channel.get(channel_id)
        if topic is None:
            return
        topic.clients.add(client_id)
        topic.renewals = 0
        if topic.subscription is not None:
            for data in topic.subscription.kept:
                topic.channel.log(data, log_time=self._log_time_ns(), sink_id=client_id)
            return
        try:
            topic.subscription = RawSubscription(
                self._node,
                topic.name,
                topic.message_class,
                lambda data: topic.channel.log(data, log_time=self._log_time_ns()),
            )
        except Exception as error:  # rclpy raises a different class for each fault of a topic
            self._close(topic)
            self._refuse(topic.name, topic.type_name, str(error))

    def remove_client(self, channel_id: int, client_id: int) -> None:
        """Handle that a client has unsubscribed from a channel or has disconnected."""
        topic = self._by_channel.get(channel_id)
        if topic is not None:
            topic.clients.discard(client_id)
            if not topic.clients:
                self._leave(topic)

    def _leave(self, topic: _Topic) -> None:
        if topic.subscription is not None:
            topic.subscription.close()
            topic.subscription = None
