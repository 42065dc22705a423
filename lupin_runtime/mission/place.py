"""Where the robot is, asked for when somebody wants to know instead of with every transform that comes.

A listener costs 4 % of a core at a hundred transforms a second, nearly all of it in waking up. Here no executor waits for
`/tf`: the middleware keeps the newest hundred messages, and a look takes them out and reads the last of each kind.
"""

from __future__ import annotations

import struct
from typing import Any

from rclpy.serialization import deserialize_message
from tf2_msgs.msg import TFMessage

from lupin_runtime import graph
from lupin_runtime.mission.freshness import Freshness
from lupin_runtime.ros import LupinNode, stamp_ns
from lupin_runtime.ros.node import qos_profile
from lupin_runtime.ros.tf import from_message
from lupin_runtime.ros.unspun import Unspun
from lupin_runtime.transforms import Transform

_MOST_AT_ONCE = 500  # a look ends, whatever comes in meanwhile


def kind_of(data: bytes) -> bytes:
    """The frames of the first transform of a serialised TFMessage: messages of one publisher and kind share them.

    CDR: 4 bytes of encapsulation, uint32 count, then per transform int32 and uint32 of a stamp and two strings, each a
    uint32 length with its zero byte, aligned to 4 from behind the encapsulation.
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


class Place:
    """The newest pose of one frame in another, from the newest transform of each step between them.

    The steps may be some tens of milliseconds apart, which at half a metre a second is a centimetre.
    """

    def __init__(self, node: LupinNode, target: str, source: str) -> None:
        self._node, self._target, self._source = node, target, source
        self._edges: dict[str, tuple[str, Transform, int | None]] = {}
        self._freshness = Freshness()
        self._moving = node.create_subscription(
            TFMessage,
            graph.TF.name,
            lambda _: None,
            qos_profile(graph.TF.qos),
            callback_group=Unspun(),
            raw=True,
        )
        node.subscription(graph.TF_STATIC, lambda message: self._take(message, static=True))

    def look(self) -> tuple[Transform, float] | None:
        """`target_from_source` and for how many seconds no step of it has been renewed; None where the chain has gaps."""
        self._drain()
        frame, result, newest_ns = self._source, Transform(), None
        for _ in range(len(self._edges) + 1):
            if frame == self._target:
                return result, self._freshness.age_s(newest_ns, self._node.elapsed_clock_ns() / 1e9)
            edge = self._edges.get(frame)
            if edge is None:
                return None
            frame, step, time_ns = edge
            result = step @ result
            if time_ns is not None:
                newest_ns = time_ns if newest_ns is None else min(newest_ns, time_ns)
        return None  # the frames form a loop

    def _drain(self) -> None:
        last: dict[bytes, bytes] = {}
        handle = self._moving.handle
        with handle:
            for _ in range(_MOST_AT_ONCE):
                taken = handle.take_message(TFMessage, True)
                if taken is None:
                    break
                last[kind_of(taken[0])] = taken[0]
        for data in last.values():
            self._take(deserialize_message(data, TFMessage), static=False)

    def _take(self, message: Any, static: bool) -> None:
        for item in message.transforms:
            transform = from_message(item)
            # Not a number anywhere would make a number of nothing: NaN is the only value that differs from itself.
            if any(value != value for value in (*transform.translation, *transform.rotation)):
                continue
            self._edges[item.child_frame_id] = (
                item.header.frame_id,
                transform,
                None if static else stamp_ns(item.header.stamp),
            )
