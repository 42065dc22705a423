"""The supervisor's monitor of the graph: tests readiness conditions, measures topic rates, collects the alarms of drive bus
and arm, starts and follows the mission.

It is one node, which the supervisor's loop spins. A readiness test exists only until its condition holds, so that monitoring a
running stack costs no more than measuring the rates that the operator sees.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import rclpy
from rclpy.action import ActionClient

from lupin_runtime import graph
from lupin_runtime.json_text import parse_json
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.ros.leaving import leave_graph
from lupin_runtime.ros.node import ROS_ARGUMENTS, LupinNode
from lupin_runtime.ros.node_executor import NodeExecutor
from lupin_runtime.ros.tf import TransformListener
from lupin_runtime.safety.expected_sources import waits_for_sources
from lupin_runtime.safety.unheard_press import UnheardPress
from lupin_runtime.stack.mission_events import MissionEvents
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
# A discovery server that starts together with its clients sometimes never matches a subscription: its topic is listed with a
# publisher, but nothing arrives (seen on one start in four on a loaded machine). A new subscription is matched. The last ones
# stay meanwhile, because a first sample may take 3.3 s.
RESUBSCRIBE_AFTER_S, MAX_SUBSCRIPTIONS = 2.0, 3
SILENT_AFTER_S = 3.0
MAX_ALARMS, MAX_ALARM_CHARS = 10, 300
MONITORED_TOPICS = tuple(topic for topic in graph.topics() if topic.monitored)
REPEATING_TOPICS = tuple(topic for topic in MONITORED_TOPICS if topic.repeats)


def _sentences(values: Any) -> tuple[str, ...]:
    """The texts of a list from the graph, limited in number and length; empty for anything else."""
    return tuple(str(value)[:MAX_ALARM_CHARS] for value in values[:MAX_ALARMS]) if isinstance(values, list) else ()


class Rate:
    """Messages per second over a sliding window of wall time."""

    def __init__(self) -> None:
        self._arrivals: deque[float] = deque(maxlen=512)

    def tick(self) -> None:
        """Count a message that arrived now."""
        self._arrivals.append(time.monotonic())

    def hz(self) -> float:
        """Return the rate over the last window."""
        since = time.monotonic() - RATE_WINDOW_S
        recent = [arrival for arrival in list(self._arrivals) if arrival > since]
        return len(recent) / RATE_WINDOW_S

    def silent_s(self) -> float | None:
        """Return seconds since the last message; None before the first one."""
        return time.monotonic() - self._arrivals[-1] if self._arrivals else None


class GraphMonitor:
    """Monitors the graph that this process's environment selects. Call `close` before the process exits."""

    def __init__(self, rated: Sequence[graph.Topic] = MONITORED_TOPICS) -> None:
        """Join the graph, and subscribe to the topics `rated` to measure their rates."""
        rclpy.init(args=ROS_ARGUMENTS, signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        self.node = LupinNode("lupin_supervisor", enable_rosout=False)
        self._satisfied: set[Readiness] = set()
        self._probes: dict[Readiness, _Probe] = {}
        self._probed_s: dict[Readiness, float] = {}
        self._earlier_probes: dict[Readiness, deque[_Probe]] = {}
        self._rates = {topic.name: Rate() for topic in (*rated, graph.MISSION_STATE)}
        for topic in rated:
            if topic is not graph.MISSION_STATE:
                self.node.subscription(topic, partial(self._count, topic.name), raw=True)
        self.mission: Any = None
        self.mission_received_s = 0.0
        self.mission_events = MissionEvents()
        self.node.subscription(graph.MISSION_STATE, self._take_mission)
        self._drive_alarms: tuple[str, ...] = ()
        self._arm_alarms: tuple[str, ...] = ()
        self._arm_status_s = 0.0
        self.drive_bus_locks: tuple[str, ...] = ()
        self.was_pressed = False  # whether the e-stop was pressed after its first status arrived
        self.estop_waits = True  # whether the e-stop's process was not heard yet, or has not heard every source
        self._presses: UnheardPress | None = None
        self.node.subscription(graph.DRIVE_STATUS, self._take_drive_status)
        self.node.subscription(graph.ARM_STATUS, self._take_arm_status)
        self.node.subscription(graph.ESTOP_STATUS, self._take_estop_status)
        self._start = self.node.client(graph.MISSION_START)
        self._executor = NodeExecutor()
        self._executor.add_node(self.node)

    def spin(self, seconds: float) -> None:
        """Handle messages for this many seconds."""
        deadline = time.monotonic() + seconds
        while (remaining_s := deadline - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=remaining_s)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown(timeout_sec=1.0)
        leave_graph(self.node)

    def _count(self, name: str, _: bytes) -> None:
        self._rates[name].tick()

    def _take_mission(self, message: Any) -> None:
        self._rates[graph.MISSION_STATE.name].tick()
        self.mission_received_s = time.monotonic()
        self.mission = message
        self.mission_events.note(message)

    def _take_drive_status(self, message: Any) -> None:
        try:
            status = parse_json(message.data)
            alarms, locks = status["alarms"], status["locks"]
        except (ValueError, KeyError, TypeError):
            return  # not from a drive bus of this version
        self._drive_alarms, self.drive_bus_locks = _sentences(alarms), _sentences(locks)

    def _take_arm_status(self, message: Any) -> None:
        try:
            self._arm_alarms = _sentences(parse_json(message.data)["alarms"])
        except (ValueError, KeyError, TypeError):
            return  # not from an arm of this version
        self._arm_status_s = time.monotonic()

    @property
    def alarms(self) -> tuple[str, ...]:
        """The alarms of the drive bus, and those of an arm whose status is repeated."""
        arm_is_heard = time.monotonic() - self._arm_status_s <= SILENT_AFTER_S
        return self._drive_alarms + (self._arm_alarms if arm_is_heard else ())

    def _take_estop_status(self, message: Any) -> None:
        self.estop_waits = waits_for_sources(message.data)
        if self._presses is None:
            self._presses = UnheardPress()
            self._presses.status(message.data, time.monotonic_ns())  # what was pressed before is not this run's concern
        elif self._presses.status(message.data, time.monotonic_ns()):
            self.was_pressed = True

    def rates_hz(self) -> dict[str, float]:
        """Return the rate of each monitored topic."""
        return {name: rate.hz() for name, rate in self._rates.items()}

    def silent_s(self) -> dict[str, float]:
        """Return the repeating topics that have fallen silent after a first message, each with the silence in seconds."""
        ages = {topic.name: self._rates[topic.name].silent_s() for topic in REPEATING_TOPICS if topic.name in self._rates}
        return {name: round(age, 1) for name, age in ages.items() if age is not None and age > SILENT_AFTER_S}

    def forget(self, condition: Readiness) -> None:
        """Test the condition again, because the process that satisfied it has exited."""
        self._satisfied.discard(condition)

    def satisfied(self, condition: Readiness) -> bool:
        """Return whether the condition holds. A condition that has held once is not tested again before `forget`."""
        if condition in self._satisfied:
            return True
        probe = self._probes.get(condition)
        if probe is None:
            probe = self._probes[condition] = self._make_probe(condition)
            self._probed_s[condition] = time.monotonic()
        earlier = self._earlier_probes.setdefault(condition, deque())
        if any(each() for each in (probe, *earlier)):
            self._satisfied.add(condition)
            for each in (self._probes.pop(condition), *self._earlier_probes.pop(condition)):
                each.close()
            return True
        if isinstance(condition, TopicSample) and time.monotonic() - self._probed_s[condition] > RESUBSCRIBE_AFTER_S:
            earlier.append(self._probes.pop(condition))
            if len(earlier) >= MAX_SUBSCRIPTIONS:
                earlier.popleft().close()
        return False

    def explain(self, condition: Readiness) -> str:
        """Return why the condition does not hold, as far as the graph shows it."""
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

    def can_start_mission(self) -> bool:
        """Return whether the service that starts missions is available: an earlier request would be lost."""
        return bool(self._start.service_is_ready())

    def start_mission(self, mission_type: str, discovery_goal: int, done: Callable[[bool, str], None]) -> None:
        """Request a mission; `done` is called while spinning with True and the mission's id, or with False and the reason."""
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
