"""`twist_mux`, the node of the drive bus, and `idle_stop`, a constant zero of the lowest priority for the simulation.

Both work on serialized messages: the bus decodes six doubles, and sends an unchanged command as the bytes that it received.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

from std_msgs.msg import String

from lupin_runtime import graph
from lupin_runtime.drive.arbiter import ESTOP_TIMEOUT_S
from lupin_runtime.drive.bus import Bus
from lupin_runtime.drive.twist import ZERO, HardLimits, Twist, decode, encode
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.priority import request_realtime_scheduling
from lupin_runtime.ros.publisher_watch import PublisherWatch
from lupin_runtime.safety.estop_subscription import subscribe_stops

TICK_HZ = 20.0
STATUS_PERIOD_NS = 200_000_000  # at most 5 Hz
STATUS_REPEAT_NS = 1_000_000_000  # the status contains ages, so it is published again
WATCH_PERIOD_S = 0.5
LAST_ZEROS = 5
LAST_ZERO_GAP_S = 0.01

# A best-effort subscription matches every publisher, and only the newest message of a velocity stream matters.
INPUT_QOS = graph.BEST1

INPUT_TOPICS = {
    "joy": graph.CMD_VEL_JOY,
    "manual": graph.CMD_VEL_MANUAL,
    "auto": graph.CMD_VEL_AUTO,
    "zero": graph.ZERO_CMD_VEL,
}
BYPASSES = "whose commands bypass the drive bus and the e-stop"
FORGES = "which could forge the e-stop; while it publishes there, the e-stop cannot be released"
ESTOP_BRIDGE = "estop_bridge"
SINKS = {"sim": graph.CMD_VEL_SINK_SIM, "robot": graph.CMD_VEL_SINK_ROBOT}
ALSO_OBEYED = {"sim": ("robot",)}  # the simulated base obeys both sinks

_ZERO_BYTES = encode(ZERO)


class TwistMux(LupinNode):
    """The drive bus.

    Parameters: `sink` (sim or robot), `require_estop_heartbeat`, `estop_timeout_s`, `linear_limit_mps`, `yaw_limit_radps`,
    `serve_first` (request real-time scheduling of the process).
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("twist_mux", parameters)
        sink = self.parameter("sink", "sim")
        if sink not in SINKS:
            raise ValueError(f"twist_mux: parameter sink is {sink!r}, expected one of {', '.join(SINKS)}")
        if self.parameter("serve_first", False):
            self.get_logger().info(request_realtime_scheduling())
        limits = HardLimits(self.parameter("linear_limit_mps", 0.6), self.parameter("yaw_limit_radps", 1.9))
        self._bus = Bus(
            limits=limits,
            require_heartbeat=self.parameter("require_estop_heartbeat", True),
            heartbeat_timeout_s=self.parameter("estop_timeout_s", ESTOP_TIMEOUT_S),
            count_estop_publishers=lambda: self.count_publishers(graph.ESTOP_STATE.name),
        )
        self._closed = False
        self._status_key: tuple[object, ...] | None = None
        self._status_ns: int | None = None
        self._sink = self.publisher(SINKS[sink])
        self._status = self.publisher(graph.DRIVE_STATUS)
        self._watches = (
            PublisherWatch(self, SINKS[sink].name, self.get_name(), BYPASSES),
            *(PublisherWatch(self, SINKS[other].name, "", BYPASSES) for other in ALSO_OBEYED.get(sink, ())),
            PublisherWatch(self, graph.ESTOP_STATE.name, ESTOP_BRIDGE, FORGES),
        )
        self._alarms: tuple[str, ...] = ()
        # The executor serves subscriptions in the order of their creation: the e-stop first.
        subscribe_stops(self, self._on_estop)
        for key, topic in INPUT_TOPICS.items():
            self.subscription(topic, self._forwarder(key), qos=INPUT_QOS, raw=True)
        self.create_timer(1.0 / TICK_HZ, self._on_tick)
        self.create_timer(WATCH_PERIOD_S, self._watch_publishers)

    def before_shutdown(self) -> None:
        """Lock the bus and send zero several times, in case a packet is lost."""
        self._closed = True
        self._bus.close(self.elapsed_clock_ns())
        for _ in range(LAST_ZEROS):
            self._sink.publish(_ZERO_BYTES)
            time.sleep(LAST_ZERO_GAP_S)

    def _forwarder(self, key: str) -> Callable[[bytes], None]:
        bus, sink, clock_ns = self._bus, self._sink, self.elapsed_clock_ns

        def forward(data: bytes) -> None:
            command = decode(data)
            out = bus.handle_command(key, command, clock_ns())
            if out is not None and not self._closed:
                sink.publish(data if out is command else encode(out))

        return forward

    def _on_estop(self, stop: bool) -> None:
        self._send(self._bus.handle_estop_state(stop, self.elapsed_clock_ns()))

    def _on_tick(self) -> None:
        now_ns = self.elapsed_clock_ns()
        self._send(self._bus.tick(now_ns, LupinNode.motion_hold()))
        self._report(now_ns)

    def _watch_publishers(self) -> None:
        now_ns = self.elapsed_clock_ns()
        alarms = tuple(alarm for watch in self._watches for alarm in watch.alarms(now_ns))
        for alarm in alarms:
            if alarm not in self._alarms:
                self.get_logger().error(alarm)
        self._alarms = alarms

    def _send(self, twist: Twist | None) -> None:
        if twist is not None and not self._closed:
            self._sink.publish(encode(twist))

    def _report(self, now_ns: int) -> None:
        since_ns = STATUS_REPEAT_NS if self._status_ns is None else now_ns - self._status_ns
        if 0 <= since_ns < STATUS_PERIOD_NS:
            return
        decision = self._bus.decision(now_ns)
        # Without a subscriber of the sink the robot ignores every command, and no error is reported.
        listeners = self._sink.get_subscription_count()
        key = (decision.winner, decision.locks, listeners, self._alarms, *decision.why.items(), *self._bus.rejected.items())
        if key == self._status_key and 0 <= since_ns < STATUS_REPEAT_NS:
            return
        if self._status_key is None or decision.locks != self._status_key[1]:
            self.get_logger().warning("locked: " + ", ".join(decision.locks) if decision.locks else "unlocked")
        self._status_key, self._status_ns = key, now_ns
        inputs = {
            name: {"age_s": decision.age_s[name], "why": why, "rejected": self._bus.rejected[name]}
            for name, why in decision.why.items()
        }
        status = {
            "winner": decision.winner,
            "locks": list(decision.locks),
            "alarms": list(self._alarms),
            "sink": {"topic": self._sink.topic_name, "listeners": listeners},
            "inputs": inputs,
        }
        self._status.publish(String(data=json.dumps(status)))


class IdleStop(LupinNode):
    """`idle_stop`: publishes a constant zero on `/zero_cmd_vel`, the lowest-priority input. Simulation only.

    The simulated drive keeps its last velocity; this stops it even if the drive bus sent no zero itself.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("idle_stop", parameters)
        publisher = self.publisher(graph.ZERO_CMD_VEL)
        self.create_timer(0.1, lambda: publisher.publish(_ZERO_BYTES))
