"""The supervisor's eye on the graph: answers sentinels, measures rates, follows and starts the mission.

One node without a thread of its own: the supervisor's loop spins it. Sentinel probes exist only until they are satisfied, so
that a supervised stack pays for watching only what its operator sees.
"""

from __future__ import annotations

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
from lupin_runtime.stack.sentinels import Acts, Chain, Heard, Lifecycle, Sentinel, Serves
from lupin_runtime.transforms import TransformUnavailable

RATE_WINDOW_S = 5.0
# A discovery server that starts together with its clients now and then leaves a reader unmatched for good: its topic is listed
# with a publisher, and nothing arrives (seen on one start in four on a loaded machine). A new reader is matched anew.
LISTEN_ANEW_S = 5.0
# What comes several times a second as long as the robot and the link to it are well.
STEADY_TOPICS = (graph.SCAN, graph.ESTOP_STATE)
SILENT_AFTER_S = 3.0
RATED_TOPICS = (graph.SCAN, graph.MAP, graph.MISSION_STATE, graph.ESTOP_STATE, graph.CMD_VEL_NAV)


class Rate:
    """Messages a second over a sliding window of wall time."""

    def __init__(self) -> None:
        self._arrivals: deque[float] = deque(maxlen=512)

    def tick(self) -> None:
        """A message arrived now."""
        self._arrivals.append(time.monotonic())

    def hz(self) -> float:
        """The rate over the last window."""
        since = time.monotonic() - RATE_WINDOW_S
        recent = [arrival for arrival in list(self._arrivals) if arrival > since]
        return len(recent) / RATE_WINDOW_S

    def silent_s(self) -> float | None:
        """How long ago the last message came; None where none ever did."""
        return time.monotonic() - self._arrivals[-1] if self._arrivals else None


class GraphWatch:
    """Watches the graph that this process's environment names. `close` before the process ends."""

    def __init__(self, rated: Sequence[graph.Topic] = RATED_TOPICS) -> None:
        """`rated` are the topics whose rates are measured, each by a subscription."""
        rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        self.node = LupinNode("lupin_supervisor", enable_rosout=False)
        self._satisfied: set[Sentinel] = set()
        self._probes: dict[Sentinel, _Probe] = {}
        self._probed_s: dict[Sentinel, float] = {}
        self._rates = {topic.name: Rate() for topic in (*rated, graph.MISSION_STATE)}
        for topic in rated:
            if topic is not graph.MISSION_STATE:
                self.node.subscription(topic, partial(self._tick, topic.name), raw=True)
        self.mission: Any = None
        self.mission_heard_s = 0.0
        self.node.subscription(graph.MISSION_STATE, self._take_mission)
        self._start = self.node.client(graph.MISSION_START)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def spin(self, seconds: float) -> None:
        """Take what arrives for this long."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown(timeout_sec=1.0)
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _tick(self, name: str, _: bytes) -> None:
        self._rates[name].tick()

    def _take_mission(self, message: Any) -> None:
        self._rates[graph.MISSION_STATE.name].tick()
        self.mission_heard_s = time.monotonic()
        self.mission = message

    def rates_hz(self) -> dict[str, float]:
        """Rate of each watched topic."""
        return {name: rate.hz() for name, rate in self._rates.items()}

    def silent_s(self) -> dict[str, float]:
        """Steady topics that were heard and no longer are, with their silence in seconds."""
        ages = {topic.name: self._rates[topic.name].silent_s() for topic in STEADY_TOPICS if topic.name in self._rates}
        return {name: round(age, 1) for name, age in ages.items() if age is not None and age > SILENT_AFTER_S}

    def forget(self, sentinel: Sentinel) -> None:
        """Ask again: the process that satisfied it has ended."""
        self._satisfied.discard(sentinel)

    def satisfied(self, sentinel: Sentinel) -> bool:
        """Whether the sentinel holds by now; once it does it is not asked again until `forget`."""
        if sentinel in self._satisfied:
            return True
        probe = self._probes.get(sentinel)
        if probe is None:
            probe = self._probes[sentinel] = self._make_probe(sentinel)
            self._probed_s[sentinel] = time.monotonic()
        if probe():
            self._satisfied.add(sentinel)
            self._probes.pop(sentinel).close()
            return True
        if isinstance(sentinel, Heard) and time.monotonic() - self._probed_s[sentinel] > LISTEN_ANEW_S:
            self._probes.pop(sentinel).close()
        return False

    def explain(self, sentinel: Sentinel) -> str:
        """What the graph shows of an unsatisfied sentinel."""
        if isinstance(sentinel, Heard):
            publishers = self.node.count_publishers(sentinel.topic.name)
            said = "nobody publishes it" if publishers == 0 else f"{publishers} publisher(s), no sample yet"
            return f"{sentinel}: {said}"
        if isinstance(sentinel, Lifecycle):
            state = self.mission.lifecycle_state if self.mission is not None else "not heard"
            detail = f" ({self.mission.last_error})" if self.mission is not None and self.mission.last_error else ""
            return f"{sentinel}: the mission is {state}{detail}"
        return f"{sentinel}: not there"

    def _make_probe(self, sentinel: Sentinel) -> _Probe:
        if isinstance(sentinel, Heard):
            return _TopicProbe(self.node, sentinel.topic)
        if isinstance(sentinel, Chain):
            return _ChainProbe(self.node, sentinel)
        if isinstance(sentinel, Serves):
            client = self.node.client(sentinel.service)
            return _ReadyProbe(client.service_is_ready, lambda: self.node.destroy_client(client))
        if isinstance(sentinel, Acts):
            action = ActionClient(self.node, interface(sentinel.action.type), sentinel.action.name)
            return _ReadyProbe(action.server_is_ready, action.destroy)
        return _ReadyProbe(self._mission_is_ready, lambda: None)

    def _mission_is_ready(self) -> bool:
        return self.mission is not None and self.mission.lifecycle_state not in ("BOOT", "FAULT")

    def start_mission(self, mission_type: str, discovery_goal: int, done: Callable[[bool, str], None]) -> None:
        """Ask for a mission; `done(accepted, mission id or reason)` is called while spinning."""
        request = interface(graph.MISSION_START.type).Request()
        request.mission_type = mission_type
        request.discovery_goal = discovery_goal

        def answered(future: Any) -> None:
            answer = future.result()
            done(answer.accepted, answer.mission_id if answer.accepted else answer.error_message)

        self._start.call_async(request).add_done_callback(answered)


class _Probe(Protocol):
    """Asks for one sentinel until it is closed."""

    def __call__(self) -> bool: ...

    def close(self) -> None: ...


class _TopicProbe:
    """Hears one sample, without decoding it."""

    def __init__(self, node: LupinNode, topic: graph.Topic) -> None:
        self._node = node
        self._heard = False
        self._subscription = node.subscription(topic, self._take, raw=True)

    def _take(self, _: bytes) -> None:
        self._heard = True

    def __call__(self) -> bool:
        return self._heard

    def close(self) -> None:
        self._node.destroy_subscription(self._subscription)


class _ChainProbe:
    """Follows transforms until the chain is known."""

    def __init__(self, node: LupinNode, sentinel: Chain) -> None:
        self._sentinel = sentinel
        self._listener = TransformListener(node)

    def __call__(self) -> bool:
        try:
            self._listener.tree.lookup(self._sentinel.target, self._sentinel.source)
        except TransformUnavailable:
            return False
        return True

    def close(self) -> None:
        self._listener.close()


class _ReadyProbe:
    """Asks a client whether its server is there."""

    def __init__(self, ready: Callable[[], bool], close: Callable[[], object]) -> None:
        self._ready = ready
        self._close = close

    def __call__(self) -> bool:
        return self._ready()

    def close(self) -> None:
        self._close()
