"""Looks up a transform on demand, without a callback per message.

A transform listener costs 4 % of a core at a hundred transforms a second, nearly all of it for wake-ups. Here no executor
waits for `/tf`: the middleware keeps the newest hundred messages. A lookup takes them and decodes, of the messages with the
same frames, only the last.
"""

from __future__ import annotations

import struct
from typing import Any

from rclpy.serialization import deserialize_message
from tf2_msgs.msg import TFMessage

from lupin_runtime import graph
from lupin_runtime.mission.transform_age import TransformAge
from lupin_runtime.ros import LupinNode, stamp_ns
from lupin_runtime.ros.node import qos_profile
from lupin_runtime.ros.polled_subscription import PolledGroup
from lupin_runtime.ros.tf import STREAM_QOS, from_message
from lupin_runtime.transforms import Transform, frame_name

_MAX_MESSAGES = 500  # bounds a lookup while messages keep arriving


def frames_of(data: bytes) -> bytes:
    """Return the bytes of the frame names of a serialized TFMessage's first transform; b"" for an empty message.

    Messages of one publisher usually hold the same frames, so this tells which messages replace each other. CDR layout: 4
    bytes of encapsulation, uint32 count; per transform the stamp as int32 and uint32, then two strings, each a uint32
    length (including the final zero byte) and characters, aligned to 4 bytes after the encapsulation.
    """
    word = struct.Struct("<I" if data[1] & 1 else ">I")
    if len(data) < 24 or word.unpack_from(data, 4)[0] == 0:
        return b""
    parent = word.unpack_from(data, 16)[0]
    child_at = 20 + parent + (-parent) % 4
    if child_at + 4 > len(data):
        return b""
    child = word.unpack_from(data, child_at)[0]
    return data[20 : child_at + 4 + child]


class PolledTransform:
    """The newest transform between two frames, chained from the newest transform of each edge between them.

    The stamps of the edges may differ by some tens of milliseconds, which is a centimeter at half a meter per second.
    """

    def __init__(self, node: LupinNode, target: str, source: str) -> None:
        self._node, self._target, self._source = node, frame_name(target), frame_name(source)
        self._edges: dict[str, tuple[str, Transform, int | None]] = {}
        self._age = TransformAge()
        self._subscription = node.create_subscription(
            TFMessage,
            graph.TF.name,
            lambda _: None,
            qos_profile(STREAM_QOS),
            callback_group=PolledGroup(),
            raw=True,
        )
        self._static = node.subscription(graph.TF_STATIC, lambda message: self._store(message, static=True))

    def close(self) -> None:
        """End the subscriptions; call it on the executor's thread. Without it they last as long as the node."""
        for subscription in (self._subscription, self._static):
            self._node.destroy_subscription(subscription)

    def lookup(self) -> tuple[Transform, float] | None:
        """Return `target_from_source` and the seconds since its oldest edge changed; None if an edge is missing."""
        self._take_messages()
        frame, result, newest_ns = self._source, Transform(), None
        for _ in range(len(self._edges) + 1):
            if frame == self._target:
                return result, self._age.age_s(newest_ns, self._node.elapsed_clock_ns() / 1e9)
            edge = self._edges.get(frame)
            if edge is None:
                return None
            frame, step, time_ns = edge
            result = step @ result
            if time_ns is not None:
                newest_ns = time_ns if newest_ns is None else min(newest_ns, time_ns)
        return None  # the frames form a loop

    def _take_messages(self) -> None:
        last: dict[bytes, bytes] = {}
        handle = self._subscription.handle
        with handle:
            for _ in range(_MAX_MESSAGES):
                taken = handle.take_message(TFMessage, True)
                if taken is None:
                    break
                last[frames_of(taken[0])] = taken[0]
        for data in last.values():
            self._store(deserialize_message(data, TFMessage), static=False)

    def _store(self, message: Any, static: bool) -> None:
        for item in message.transforms:
            transform = from_message(item)
            # One NaN would spoil every later product; NaN is the only value that differs from itself.
            if any(value != value for value in (*transform.translation, *transform.rotation)):
                continue
            self._edges[frame_name(item.child_frame_id)] = (
                frame_name(item.header.frame_id),
                transform,
                None if static else stamp_ns(item.header.stamp),
            )
