"""Follows `/clock` for all nodes of a process, at a third of the processor time of a node on an executor.

rclpy's TimeSource needs a spinning node, whose executor builds a wait set, a task and a message object for every tick. At 100
ticks per second that costs 5 % of a core in each of a dozen processes. ClockFollower waits for one subscription in its own
thread and reads the twelve bytes of the message.
"""

from __future__ import annotations

import os
import struct
import threading
import traceback
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.clock import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from lupin_runtime import graph
from lupin_runtime.ros.node import qos_profile
from lupin_runtime.ros.polled_subscription import PolledGroup

_STOP_POLL_NS = 200_000_000
# CDR: four bytes of encapsulation, the second of which gives the byte order; then int32 seconds, uint32 nanoseconds.
_LITTLE, _BIG = struct.Struct("<iI"), struct.Struct(">iI")
_HEADER_BYTES = 4


def clock_ns(data: bytes) -> int:
    """Return the time in nanoseconds of a serialized rosgraph_msgs/Clock."""
    seconds, nanoseconds = (_LITTLE if data[1] & 1 else _BIG).unpack_from(data, _HEADER_BYTES)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


class ClockFollower:
    """Sets the ROS time of every attached node from `/clock`. Create it after `rclpy.init`; stop it before the shutdown."""

    def __init__(self, on_failure: Callable[[], None] = lambda: None) -> None:
        """`on_failure` is called if the clock can no longer be followed; it must stop the process, whose timers stand still."""
        self._on_failure = on_failure
        self._node = Node(
            f"clock_{os.getpid()}",
            start_parameter_services=False,
            enable_rosout=False,
            parameter_overrides=[Parameter("use_sim_time", value=False)],
        )
        self._subscription = self._node.create_subscription(
            Clock,
            graph.CLOCK.name,
            lambda _: None,
            qos_profile(graph.CLOCK.qos),
            callback_group=PolledGroup(),
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )
        self._clocks: list[Any] = []
        self._latest = Time(nanoseconds=0, clock_type=ClockType.ROS_TIME)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="clock", daemon=True)

    def attach(self, node: Node) -> None:
        """Make a node's clock follow `/clock`; until the first message its time is zero."""
        clock: Any = node.get_clock()
        clock._set_ros_time_is_active(True)
        clock.set_ros_time_override(self._latest)
        self._clocks.append(clock)

    def start(self) -> None:
        """Start the thread that follows `/clock`."""
        self._thread.start()

    def stop(self) -> None:
        """Stop following; wait up to 2 s for the thread to leave the middleware."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(10 * _STOP_POLL_NS / 1e9)
        self._node.destroy_node()

    def _run(self) -> None:
        try:
            self._follow()
        except Exception:
            # Any exception of the middleware must terminate the process with its stack trace.
            traceback.print_exc()
            self._on_failure()

    def _follow(self) -> None:
        context = rclpy.get_default_context()
        with context.handle:
            wait_set = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, context.handle)
        handle = self._subscription.handle
        with handle:
            while not self._stop.is_set():
                wait_set.clear_entities()
                wait_set.add_subscription(handle)
                wait_set.wait(_STOP_POLL_NS)
                taken = handle.take_message(Clock, True)
                if taken is not None:
                    self._latest = Time(nanoseconds=clock_ns(taken[0]), clock_type=ClockType.ROS_TIME)
                    for clock in self._clocks:
                        clock.set_ros_time_override(self._latest)
