"""The supervisor's monitor of the graph: tests readiness conditions, measures topic rates, collects the drive bus's alarms,
starts and follows the mission.

It is one node without a thread of its own; the supervisor's loop spins it. A readiness probe exists only until its condition
holds, so that the monitor of a running stack costs no more than the rates that the operator sees.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import rclpy
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor

from lupin_runtime import graph
from lupin_runtime.ros.node import LupinNode, interface
from lupin_runtime.ros.tf import TransformListener
from lupin_runtime.stack.readiness import (
    ActionReady,
    MissionReady,
    Port,
    Readiness,
    ServiceReady,
    TopicSample,
    TransformReady,
)
from lupin_runtime.transforms import TransformUnavailable

RATE_WINDOW_S = 5.0
# A discovery server that starts together with its clients sometimes leaves a subscription unmatched for good: its topic is
# listed with a publisher, but nothing arrives (seen on one start in four on a loaded machine). A new subscription is matched.
RESUBSCRIBE_AFTER_S = 5.0
SILENT_AFTER_S = 3.0
MAX_ALARMS, MAX_ALARM_CHARS = 10, 300
MONITORED_TOPICS = tuple(topic for topic in graph.topics() if topic.monitored)
REPEATING_TOPICS = tuple(topic for topic in MONITORED_TOPICS if topic.repeats)


class Rate:
    """Messages per second over a sliding window of wall time."""

    def __init__(self) -> None:
        self._arrivals: deque[float] = deque(maxlen=512)

    def tick(self) -> None:
        """Count a message that arrived now."""
        self._arrivals.append(time.monotonic())

    def hz(self) -> float:
        """The rate over the last window."""
        since = time.monotonic() - RATE_WINDOW_S
        recent = [arrival for arrival in list(self._arrivals) if arrival > since]
        return len(recent) / RATE_WINDOW_S

    def silent_s(self) -> float | None:
        """Seconds since the last message; None before the first one."""
        return time.monotonic() - self._arrivals[-1] if self._arrivals else None


class GraphMonitor:
    """Monitors the graph that this process's environment selects. Call `close` before the process ends."""

    def __init__(self, rated: Sequence[graph.Topic] = MONITORED_TOPICS) -> None:
        """Join the graph; the rates of the topics `rated` are measured, each by a subscription."""
        rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        self.node = LupinNode("lupin_supervisor", enable_rosout=False)
        self._satisfied: set[Readiness] = set()
        self._probes: dict[Readiness, _Probe] = {}
        self._probed_s: dict[Readiness, float] = {}
        self._rates = {topic.name: Rate() for topic in (*rated, graph.MISSION_STATE)}
        for topic in rated:
            if topic is not graph.MISSION_STATE:
                self.node.subscription(topic, partial(self._count, topic.name), raw=True)
        self.mission: Any = None
        self.mission_received_s = 0.0
        self.node.subscription(graph.MISSION_STATE, self._take_mission)
        self.alarms: tuple[str, ...] = ()  # of the drive bus
        self.node.subscription(graph.DRIVE_STATUS, self._take_drive_status)
        self._start = self.node.client(graph.MISSION_START)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def spin(self, seconds: float) -> None:
        """Handle messages for this many seconds."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown(timeout_sec=1.0)
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _count(self, name: str, _: bytes) -> None:
        self._rates[name].tick()

    def _take_mission(self, message: Any) -> None:
        self._rates[graph.MISSION_STATE.name].tick()
        self.mission_received_s = time.monotonic()
        self.mission = message

    def _take_drive_status(self, message: Any) -> None:
        try:
            alarms = json.loads(message.data)["alarms"]
        except (ValueError, KeyError, TypeError):
            return  # not from a drive bus of this version
        self.alarms = tuple(str(alarm)[:MAX_ALARM_CHARS] for alarm in alarms[:MAX_ALARMS]) if isinstance(alarms, list) else ()

    def rates_hz(self) -> dict[str, float]:
        """The rate of each monitored topic."""
        return {name: rate.hz() for name, rate in self._rates.items()}

    def silent_s(self) -> dict[str, float]:
        """The repeating topics that have fallen silent after a first message, each with the silence in seconds."""
        ages = {topic.name: self._rates[topic.name].silent_s() for topic in REPEATING_TOPICS if topic.name in self._rates}
        return {name: round(age, 1) for name, age in ages.items() if age is not None and age > SILENT_AFTER_S}

    def forget(self, condition: Readiness) -> None:
        """Test the condition again: the process that satisfied it has ended."""
        self._satisfied.discard(condition)

    def satisfied(self, condition: Readiness) -> bool:
        """Whether the condition holds. A condition that has held once is not tested again before `forget`."""
        if condition in self._satisfied:
            return True
        probe = self._probes.get(condition)
        if probe is None:
            probe = self._probes[condition] = self._make_probe(condition)
            self._probed_s[condition] = time.monotonic()
        if probe():
            self._satisfied.add(condition)
            self._probes.pop(condition).close()
            return True
        if isinstance(condition, TopicSample) and time.monotonic() - self._probed_s[condition] > RESUBSCRIBE_AFTER_S:
            self._probes.pop(condition).close()
        return False

    def explain(self, condition: Readiness) -> str:
        """Why the condition does not hold, as far as the graph shows it."""
        if isinstance(condition, TopicSample):
            publishers = self.node.count_publishers(condition.topic.name)
            return f"{condition}: {'no publisher' if publishers == 0 else f'{publishers} publisher(s), no sample yet'}"
        if isinstance(condition, MissionReady):
            state = self.mission.lifecycle_state if self.mission is not None else "not received yet"
            detail = f" ({self.mission.last_error})" if self.mission is not None and self.mission.last_error else ""
            return f"{condition}: the mission's state is {state}{detail}"
        if isinstance(condition, Port):
            return f"{condition}: nothing listens"
        return f"{condition}: not available"

    def _make_probe(self, condition: Readiness) -> _Probe:
        if isinstance(condition, TopicSample):
            return _TopicProbe(self.node, condition.topic)
        if isinstance(condition, TransformReady):
            return _TransformProbe(self.node, condition)
        if isinstance(condition, ServiceReady):
            client = self.node.client(condition.service)
            return _PollProbe(client.service_is_ready, lambda: self.node.destroy_client(client))
        if isinstance(condition, ActionReady):
            action = ActionClient(self.node, interface(condition.action.type), condition.action.name)
            return _PollProbe(action.server_is_ready, action.destroy)
        if isinstance(condition, Port):
            return _PollProbe(condition.is_listening, lambda: None)
        return _PollProbe(self._mission_is_ready, lambda: None)

    def _mission_is_ready(self) -> bool:
        return self.mission is not None and self.mission.lifecycle_state not in ("BOOT", "FAULT")

    def start_mission(self, mission_type: str, discovery_goal: int, done: Callable[[bool, str], None]) -> None:
        """Request a mission; `done(accepted, mission id or reason)` is called while spinning."""
        request = interface(graph.MISSION_START.type).Request()
        request.mission_type = mission_type
        request.discovery_goal = discovery_goal

        def answered(future: Any) -> None:
            answer = future.result()
            done(answer.accepted, answer.mission_id if answer.accepted else answer.error_message)

        self._start.call_async(request).add_done_callback(answered)


class _Probe(Protocol):
    """Tests one condition until it is closed."""

    def __call__(self) -> bool: ...

    def close(self) -> None: ...


class _TopicProbe:
    """Waits for one sample, without deserializing it."""

    def __init__(self, node: LupinNode, topic: graph.Topic) -> None:
        self._node = node
        self._received = False
        self._subscription = node.subscription(topic, self._take, raw=True)

    def _take(self, _: bytes) -> None:
        self._received = True

    def __call__(self) -> bool:
        return self._received

    def close(self) -> None:
        self._node.destroy_subscription(self._subscription)


class _TransformProbe:
    """Listens to transforms until the one between two frames is known."""

    def __init__(self, node: LupinNode, condition: TransformReady) -> None:
        self._condition = condition
        self._listener = TransformListener(node)

    def __call__(self) -> bool:
        try:
            self._listener.tree.lookup(self._condition.target, self._condition.source)
        except TransformUnavailable:
            return False
        return True

    def close(self) -> None:
        self._listener.close()


class _PollProbe:
    """Calls a function that returns whether a server is available."""

    def __init__(self, poll: Callable[[], bool], close: Callable[[], object]) -> None:
        self._poll = poll
        self._close = close

    def __call__(self) -> bool:
        return self._poll()

    def close(self) -> None:
        self._close()
