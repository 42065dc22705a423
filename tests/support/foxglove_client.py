"""A client of the Foxglove protocol for tests: https://github.com/foxglove/ws-protocol, as foxglove-sdk serves it."""

from __future__ import annotations

import asyncio
import json
import socket
import struct
import threading
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any

import aiohttp

from tests.support.waiting import WAIT_S, wait_until

SUBPROTOCOL = "foxglove.sdk.v1"
# Opcodes and layouts of the server's binary frames.
_MESSAGE_DATA, _TIME = 1, 2
_MESSAGE_HEADER = struct.Struct("<BIQ")  # opcode, subscription id, time in ns
_TIME_FRAME = struct.Struct("<BQ")


@dataclass(frozen=True)
class Message:
    """A received message: its topic, the time at which the server got it, and the serialized data."""

    topic: str
    time_ns: int
    data: bytes


class FoxgloveClient:
    """Connects, follows the advertised channels, and collects messages; its event loop runs in its own thread."""

    def __init__(self, port: int, subprotocol: str = SUBPROTOCOL, reads: bool = True) -> None:
        """With `reads` False, it never reads after it has connected. Raises aiohttp.ClientError if the server refuses it."""
        self.server_info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}  # the channels that are advertised now, by topic
        self.messages: list[Message] = []
        self.times_ns: list[int] = []
        self.statuses: list[dict[str, Any]] = []
        self.advertised: list[tuple[str, int]] = []  # topic and id of every channel that was ever advertised
        self._wanted_topics: set[str] = set()
        self._subscriptions: dict[int, str] = {}  # topics by subscription id
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        try:
            self._call(self._connect(port, subprotocol, reads))
        except BaseException:
            self._stop_loop()
            raise

    # -- requests -----------------------------------------------------------------------------------------------------
    def subscribe(self, topic: str) -> None:
        """Subscribe to a topic, and wait until it has a channel."""
        self.subscribe_later(topic)
        self.channel(topic)

    def subscribe_later(self, topic: str) -> None:
        """Subscribe to a topic as viewers do: to its channel, if there is one, and to every channel that it gets later."""
        self._call(self._want_topic(topic))

    def unsubscribe(self, topic: str) -> None:
        """End the subscription to a topic."""
        self._wanted_topics.discard(topic)
        self.send(op="unsubscribe", subscriptionIds=[key for key, name in self._subscriptions.items() if name == topic])

    def send(self, **fields: Any) -> None:
        """Send one message of the protocol."""
        self._call(self._socket.send_str(json.dumps(fields)))

    def send_binary(self, data: bytes) -> None:
        """Send one binary frame."""
        self._call(self._socket.send_bytes(data))

    def synchronize(self) -> None:
        """Wait until the server has handled all earlier requests: it rejects a subscription to a nonexistent channel."""
        before = len(self.statuses)
        self.send(op="subscribe", subscriptions=[{"id": 1, "channelId": 2**31}])
        self.until(lambda: any("Unknown channel" in s["message"] for s in self.statuses[before:]), "the answer to a request")

    # -- what was received --------------------------------------------------------------------------------------------
    def channel(self, topic: str) -> dict[str, Any]:
        """Wait until a topic has a channel, and return it."""
        found: dict[str, Any] = self.until(lambda: self.channels.get(topic), f"a channel of {topic}")
        return found

    def announcements(self, topic: str) -> list[int]:
        """Return the ids of all channels that a topic has had."""
        return [identifier for name, identifier in self.advertised if name == topic]

    def last(self, count: int = 1) -> bytes:
        """Wait until `count` messages have arrived, and return the last one."""
        self.until(lambda: len(self.messages) >= count, f"message {count}")
        return self.messages[-1].data

    def on(self, topic: str) -> list[bytes]:
        """Return the messages of a topic so far."""
        return [message.data for message in self.messages if message.topic == topic]

    def until(self, condition: Callable[[], Any], what: str) -> Any:
        """Wait until a condition is true, and return its value."""
        return wait_until(condition, lambda: f"{what}; the server said {self.statuses}", interval_s=0.002)

    # -- disconnecting ------------------------------------------------------------------------------------------------
    def close(self) -> None:
        """Close the connection as the protocol requires."""
        if self._thread.is_alive():
            self._call(self._leave())
            self._stop_loop()

    def vanish(self) -> None:
        """Reset the connection, as the kernel does for a killed process."""
        self._call(self._reset())
        self._stop_loop()

    # -- the connection -----------------------------------------------------------------------------------------------
    async def _connect(self, port: int, subprotocol: str, reads: bool) -> None:
        self._session = aiohttp.ClientSession()
        try:
            self._socket = await self._session.ws_connect(
                f"ws://127.0.0.1:{port}", protocols=[subprotocol], max_msg_size=0, autoping=True
            )
        except BaseException:
            await self._session.close()
            raise
        if reads:
            self._reader = asyncio.create_task(self._read())

    async def _leave(self) -> None:
        await self._socket.close()
        await self._session.close()

    async def _reset(self) -> None:
        # With a linger time of 0, the kernel resets the connection.
        self._socket.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        assert self._session.connector is not None
        await self._session.connector.close()
        await self._session.close()

    async def _want_topic(self, topic: str) -> None:
        self._wanted_topics.add(topic)
        if topic in self.channels:
            await self._subscribe(topic, self.channels[topic]["id"])

    async def _subscribe(self, topic: str, channel_id: int) -> None:
        identifier = len(self._subscriptions) + 100
        self._subscriptions[identifier] = topic
        subscription = {"id": identifier, "channelId": channel_id}
        await self._socket.send_str(json.dumps({"op": "subscribe", "subscriptions": [subscription]}))

    async def _read(self) -> None:
        async for frame in self._socket:
            if frame.type == aiohttp.WSMsgType.TEXT:
                await self._handle_text(json.loads(frame.data))
            elif frame.type == aiohttp.WSMsgType.BINARY:
                self._handle_binary(frame.data)

    async def _handle_text(self, message: dict[str, Any]) -> None:
        operation = message["op"]
        if operation == "serverInfo":
            self.server_info = message
        elif operation == "advertise":
            for channel in message["channels"]:
                self.channels[channel["topic"]] = channel
                self.advertised.append((channel["topic"], channel["id"]))
                if channel["topic"] in self._wanted_topics:
                    await self._subscribe(channel["topic"], channel["id"])
        elif operation == "unadvertise":
            gone = set(message["channelIds"])
            self.channels = {topic: channel for topic, channel in self.channels.items() if channel["id"] not in gone}
        elif operation == "status":
            self.statuses.append(message)

    def _handle_binary(self, frame: bytes) -> None:
        if frame[0] == _MESSAGE_DATA:
            _, subscription, time_ns = _MESSAGE_HEADER.unpack_from(frame)
            self.messages.append(Message(self._subscriptions[subscription], time_ns, frame[_MESSAGE_HEADER.size :]))
        elif frame[0] == _TIME:
            self.times_ns.append(_TIME_FRAME.unpack(frame)[1])

    def _call(self, coroutine: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop).result(WAIT_S)

    def _stop_loop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(WAIT_S)
        self._loop.close()
