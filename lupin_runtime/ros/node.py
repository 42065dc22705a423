"""A node whose publishers, subscriptions, services and actions come from rows of `graph.py`."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, ClassVar

from rclpy.action import ActionClient, ActionServer
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.service import Service as RosService
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from lupin_runtime.graph import Action, Qos, Service, Topic
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.ros.polled_subscription import PolledGroup

# For rclpy.init: no log files below the home folder. The supervisor keeps the output of each process, and rclpy does not start
# if that folder cannot be written.
ROS_ARGUMENTS = ["--ros-args", "--disable-external-lib-logs"]

_STEADY = Clock(clock_type=ClockType.STEADY_TIME)


def qos_profile(qos: Qos) -> QoSProfile:
    """Return the rclpy profile of a QoS."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=qos.depth,
        reliability=ReliabilityPolicy.RELIABLE if qos.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if qos.latched else DurabilityPolicy.VOLATILE,
    )


class LupinNode(Node):
    """A node whose publishers, subscriptions, services and actions come from rows of `graph.py`.

    It offers no parameter services, because their discovery slows down the start of every node. `parameters` overrides the
    declared defaults.
    """

    simulated_time: ClassVar[bool] = False  # whether this process follows `/clock`; set before its nodes are created
    # Returns why nothing may move now according to the supervisor of this process; empty if motion is allowed.
    motion_hold: ClassVar[Callable[[], str]] = staticmethod(lambda: "")

    def __init__(self, name: str, parameters: dict[str, Any] | None = None, **options: Any) -> None:
        overrides = [Parameter(key, value=value) for key, value in (parameters or {}).items()]
        options.setdefault("start_parameter_services", False)
        super().__init__(name, parameter_overrides=overrides, **options)

    def parameter(self, name: str, default: Any) -> Any:
        """Declare a parameter and return its value; the default gives the type."""
        return self.declare_parameter(name, default).value

    def before_shutdown(self) -> None:
        """Prepare for leaving the graph. Nodes that must stop motion or close a file override this."""

    def publisher(self, topic: Topic, qos: Qos | None = None) -> Publisher:
        """Return a publisher with the row's type and QoS."""
        return self.create_publisher(interface(topic.type), topic.name, qos_profile(qos or topic.qos))

    def subscription(
        self, topic: Topic, callback: Callable[[Any], None], qos: Qos | None = None, raw: bool = False
    ) -> Subscription:
        """Return a subscription with the row's type and QoS; `qos` overrides the depth or asks for less than is offered."""
        return self.create_subscription(interface(topic.type), topic.name, callback, qos_profile(qos or topic.qos), raw=raw)

    def polled_subscription(self, topic: Topic, qos: Qos | None = None) -> Subscription:
        """Return a subscription whose serialized messages wait until the node takes them; they wake nothing."""
        profile = qos_profile(qos or topic.qos)
        return self.create_subscription(
            interface(topic.type), topic.name, lambda _: None, profile, callback_group=PolledGroup(), raw=True
        )

    def service(self, row: Service, callback: Callable[[Any, Any], Any], group: CallbackGroup | None = None) -> RosService:
        """Return a server of the row's service; the callback takes (request, response) and returns the response.

        A coroutine callback that awaits service calls needs a reentrant `group` that it shares with the clients of those calls.
        """
        return self.create_service(interface(row.type), row.name, callback, callback_group=group)

    def client(self, row: Service, group: CallbackGroup | None = None) -> Client:
        """Return a client of the row's service. Never call it synchronously from a callback of the same node."""
        return self.create_client(interface(row.type), row.name, callback_group=group)

    def action_client(self, row: Action) -> ActionClient:
        """Return a client of the row's action."""
        return ActionClient(self, interface(row.type), row.name)

    def create_timer(self, timer_period_sec: float, callback: Callable[[], Any], *args: Any, **options: Any) -> Timer:
        """Create a timer on simulated time if the process follows `/clock`, else on the monotonic clock.

        rclpy's default is the wall clock: when it is stepped back by five minutes, every timer stops for five minutes, also in
        the drive bus and the e-stop.
        """
        if options.get("clock") is None and not self.simulated_time:
            options["clock"] = _STEADY
        return super().create_timer(timer_period_sec, callback, *args, **options)

    def destroy_node(self) -> None:
        """Destroy the node and its action servers and clients, which would keep it visible until its DDS lease expires."""
        for waitable in list(self.waitables):
            if isinstance(waitable, ActionServer | ActionClient):
                waitable.destroy()
        super().destroy_node()

    def now_ns(self) -> int:
        """Return ROS time for stamps: the simulator's if the process follows `/clock`, else the system's."""
        return int(self.get_clock().now().nanoseconds)

    @staticmethod
    def monotonic_ns() -> int:
        """Return real time, for timeouts that do not follow the simulation. A test replaces it to stretch all timeouts."""
        return time.monotonic_ns()

    def elapsed_clock_ns(self) -> int:
        """Return the time for timeouts: simulated if the process follows `/clock`, else monotonic.

        A step of the wall clock then cannot lengthen or shorten a timeout that keeps the robot safe.
        """
        clock = self.get_clock()
        if clock.clock_type == ClockType.ROS_TIME and clock.ros_time_is_active:
            return int(clock.now().nanoseconds)
        return self.monotonic_ns()
