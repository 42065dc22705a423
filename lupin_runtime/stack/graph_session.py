"""One visit of the graph of this process's environment: names, samples, rates, service calls.

A visit changes nothing: it subscribes, and calls only services without side effects. Every wait has a timeout. It collects

* names: nodes, topics, and for each topic the publishers and subscriptions with their QoS;
* samples: whether messages arrive on the topics that a working robot always publishes, how old their stamps are, and in which
  frame they are. A visitor joins later than every other process, so it sees names without samples if the data path is broken
  and the discovery server still works;
* rates: a topic that delivers is observed until it has reached a usable rate, or has clearly missed it;
* round trips: only a service call needs the route to the robot and back;
* the drive bus: whether a publisher of drive commands would be matched with it. Nothing is published;
* the wheels: for how long the odometry did not change while they were commanded, if somebody drives.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from lupin_runtime import graph
from lupin_runtime.drive.twist import decode
from lupin_runtime.json_text import parse_json
from lupin_runtime.stack.message_header import read_header
from lupin_runtime.stack.service_calls import CALL_TIMEOUT_S, ServiceCalls
from lupin_runtime.stack.wheel_watch import WheelWatch

# Names are complete once they have not changed for this long: the first time if a working robot has been observed, the last
# time if a part of one is missing.
COMPLETE_S, SETTLE_S, LATE_S = 0.2, 0.6, 1.5
JOIN_TIMEOUT_S = 4.0
# Console and drive bus repeat at 20 and 1 Hz: this is long enough to see which source is active.
LISTEN_S = 1.2
SAMPLE_TIMEOUT_S = 4.0
# A first sample takes up to 3.3 s through a discovery server. Until any topic has delivered, the timeout is longer.
SILENCE_TIMEOUT_S = 6.0
# A topic has shown a usable rate, or clearly missed it, only after these times since its first sample: data may come in bursts.
RATE_AFTER_S, RATE_WINDOW_S = 0.5, 1.5
QUEUE = 50  # a second of the fastest topic: a pause of this process must not look like a slow topic
WAIT_TIMEOUT_S = 10.0
POLL_S, RESCAN_S = 0.1, 0.2

# Published by every working robot: until all of them are seen, a missing one may be late.
ROBOT_TOPICS = tuple(topic for topic in graph.topics() if topic.repeats and topic.from_vendor)
PROBED_TOPICS = tuple(topic for topic in graph.topics() if topic.repeats or topic.probed)
# By the names by which the bus says who drives.
DRIVE_INPUTS = {"joy": graph.CMD_VEL_JOY, "manual": graph.CMD_VEL_MANUAL, "auto": graph.CMD_VEL_AUTO}
NOMINAL_HZ = {row.name: row.rate_hz for row in PROBED_TOPICS if row.repeats and (row.rate_hz or 0.0) > graph.UNTIMED_HZ}
NODE_PREFIX = "lupin_probe_"  # of the node of every graph probe


class GraphSession:
    """A node that joins the graph of this process's environment for one probe."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        from lupin_runtime.ros.node import ROS_ARGUMENTS, LupinNode

        rclpy.init(args=ROS_ARGUMENTS, signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        self.node = LupinNode(f"{NODE_PREFIX}{os.getpid()}", enable_rosout=False)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._started_s = time.monotonic()
        self.samples: dict[str, dict[str, Any]] = {}
        self.inputs: dict[str, dict[str, int]] = {}
        self.states: dict[str, Any] = {}
        self.calls = ServiceCalls(self.node)
        self._names: dict[str, Any] = {}
        self._since_s: dict[str, float] = {}  # when each topic was subscribed
        self._begun = _processor_time_s()
        self.late: list[str] = []  # topics and services that appeared too late to be observed
        self.wheels = WheelWatch()
        self._drive: Any = None  # a publisher of drive commands, which never publishes

    def close(self) -> None:
        """Leave the graph, so that its other nodes are informed at once."""
        from lupin_runtime.ros.leaving import leave_graph

        self._executor.shutdown(timeout_sec=1.0)
        leave_graph(self.node)

    def until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Handle messages until `condition()` holds; return False after the timeout."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.02)
        return True

    def join(self) -> float:
        """Wait until the names no longer change, subscribing and calling meanwhile; return the seconds since the start."""
        since_s, polled_s = time.monotonic(), 0.0

        def settled() -> bool:
            nonlocal since_s, polled_s
            self.calls.advance()
            now_s = time.monotonic()
            if now_s - polled_s < POLL_S:
                return False
            polled_s, seen = now_s, self.names()
            if seen != self._names:
                self._names, since_s = seen, now_s
                self._subscribe_and_call()
            # Node names are sent as data, topic names by discovery: one of the two may never arrive.
            has_names, settle_s = bool(seen["nodes"] or seen["topics"]), COMPLETE_S if self._is_observed() else SETTLE_S
            return has_names and now_s - since_s > settle_s

        self.until(settled, JOIN_TIMEOUT_S)
        return self.elapsed_s()

    def _subscribe_and_call(self) -> None:
        """Subscribe to the topics and call the services that have appeared since the last time."""
        self.subscribe({topic["name"]: topic for topic in self._names["topics"]})
        self.calls.begin()

    def names(self) -> dict[str, Any]:
        """Return the nodes, and the topics with their endpoints, without those of this probe."""
        nodes = sorted(
            f"{namespace.rstrip('/')}/{name}"
            for name, namespace in self.node.get_node_names_and_namespaces()
            if not name.startswith((NODE_PREFIX, "_ros2cli"))
        )
        topics = []
        for name, types in self.node.get_topic_names_and_types():
            publishers = self._endpoints(self.node.get_publishers_info_by_topic(name))
            subscribers = self._endpoints(self.node.get_subscriptions_info_by_topic(name))
            if publishers or subscribers:
                topics.append({"name": name, "types": sorted(types), "publishers": publishers, "subscribers": subscribers})
        return {"nodes": nodes, "topics": topics}

    def _endpoints(self, endpoints: list[Any]) -> list[dict[str, Any]]:
        from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

        return [
            {
                "node": f"{end.node_namespace.rstrip('/')}/{end.node_name}",
                "type": end.topic_type,
                "reliable": end.qos_profile.reliability == ReliabilityPolicy.RELIABLE,
                "latched": end.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
            }
            for end in endpoints
            if not end.node_name.startswith(NODE_PREFIX)
        ]

    def subscribe(self, topics: Mapping[str, dict[str, Any]]) -> None:
        """Subscribe to probed topics that have a publisher, requesting no more than the publishers offer."""
        decoders = {row.name: decoder for row, decoder in _STATE_DECODERS.items()}
        for row in PROBED_TOPICS:
            publishers = topics.get(row.name, {}).get("publishers", [])
            if not publishers or row.name in self.samples:
                continue
            if row is graph.CLOCK and not topics[row.name]["subscribers"]:
                continue  # no node of this graph uses simulated time
            self.samples[row.name] = {"count": 0, "first_s": -1.0, "last_s": -1.0}
            self._since_s[row.name] = time.monotonic()
            offered = graph.Qos(all(p["reliable"] for p in publishers), all(p["latched"] for p in publishers), depth=5)
            requested = offered if row.qos.latched else graph.Qos(reliable=False, depth=QUEUE)
            decoder = decoders.get(row.name)
            if decoder is None:
                received = self._count if row.frame is None else self._count_with_header
                received = self._count_odometry if row is graph.ODOM else received
                self.node.subscription(row, partial(received, row.name), qos=requested, raw=True)
            else:
                self.node.subscription(row, partial(self._keep_state, row.name, decoder), qos=requested)
        if self._drive is None and topics.get(graph.CMD_VEL_MANUAL.name, {}).get("subscribers"):
            self._drive = self.node.publisher(graph.CMD_VEL_MANUAL)
        for source, row in DRIVE_INPUTS.items():
            if topics.get(row.name, {}).get("publishers") and row.name not in self.inputs:
                self.inputs[row.name] = {"count": 0, "moving": 0}
                self.node.subscription(row, partial(self._count_command, row.name, source), qos=graph.BEST5, raw=True)

    def _count(self, name: str, _: Any) -> None:
        sample = self.samples[name]
        sample["last_s"] = round(time.monotonic() - self._started_s, 3)
        if not sample["count"]:
            sample["first_s"] = sample["last_s"]
        sample["count"] += 1

    def _count_with_header(self, name: str, message: bytes) -> None:
        self._count(name, message)
        header, sample = read_header(message), self.samples[name]
        if header is None:
            return
        # On a busy machine a message may wait here: the newest one is closest to the truth.
        age_s = round(time.time() - header.stamp_s, 3)
        sample["frame"] = header.frame
        sample["stamp_age_s"] = min(age_s, sample.get("stamp_age_s", age_s), key=abs)

    def _count_odometry(self, name: str, message: bytes) -> None:
        self._count_with_header(name, message)
        self.wheels.odometry(message, time.monotonic())

    def add_timings(self) -> None:
        """Add to every topic with samples the age of the last one, the time since the first, and the rate.

        The rate is None for fewer than three samples.
        """
        now_s = time.monotonic() - self._started_s
        for sample in self.samples.values():
            if sample["count"]:
                sample["age_s"] = round(now_s - sample["last_s"], 3)
                sample["listened_s"] = round(now_s - sample["first_s"], 3)
                span_s = sample["last_s"] - sample["first_s"]
                sample["rate_hz"] = round((sample["count"] - 1) / span_s, 2) if sample["count"] > 2 and span_s > 0 else None

    def matched_drive_inputs(self) -> int | None:
        """Return how many subscriptions would receive a drive command of this machine; None if none is listed."""
        return None if self._drive is None else self._drive.get_subscription_count()

    def _keep_state(self, name: str, decode_state: Callable[[Any], Any], message: Any) -> None:
        self._count(name, message)
        self.states[name] = state = decode_state(message)
        if name == graph.DRIVE_STATUS.name and isinstance(state, dict):
            self.wheels.bus(str(state.get("winner") or ""), bool(state.get("locks")))

    def _count_command(self, name: str, source: str, data: bytes) -> None:
        twist = decode(data)
        self.wheels.command(source, twist, time.monotonic())
        self.inputs[name]["count"] += 1
        self.inputs[name]["moving"] += int(twist is not None and not twist.is_neutral())

    def wait(self) -> None:
        """Wait until every topic has delivered and every service has answered, or until the timeout of each has expired.

        A topic or service that appeared too late for its timeout is moved to `late`. The wait ends early if a working robot has
        been observed, and the names have not changed.
        """
        started_s = scanned_s = time.monotonic()
        before, self._names = self._names, self.names()
        changed_s = started_s - SETTLE_S if self._names == before else started_s  # `join` has waited for so long
        self._subscribe_and_call()

        def done() -> bool:
            nonlocal scanned_s, changed_s
            now_s = time.monotonic()
            if now_s - scanned_s > RESCAN_S:
                # Under load, service names arrive seconds after topic names.
                scanned_s, before, self._names = now_s, self._names, self.names()
                changed_s = changed_s if self._names == before else now_s
                self._subscribe_and_call()
            self.calls.advance()
            empty = not self._names["topics"]
            # On a busy machine, services may answer before any topic is known.
            has_topics = bool(self.samples) or not self.calls.is_any_answered
            all_called = self.calls.is_complete or empty or now_s - started_s > CALL_TIMEOUT_S
            if changed_s < scanned_s and self._is_observed():
                return True
            return (
                all_called
                and has_topics
                and now_s - started_s > LISTEN_S
                and now_s - changed_s > LATE_S
                and all(now_s - since_s > timeout_s for since_s, timeout_s in self._waited_for())
            )

        self.until(done, WAIT_TIMEOUT_S)
        end_s = time.monotonic()
        for name, since_s in self._since_s.items():
            if not self.samples[name]["count"] and end_s - since_s < SAMPLE_TIMEOUT_S:
                del self.samples[name]
                self.late.append(name)
        self.late += self.calls.drop_late(end_s)

    def _is_observed(self) -> bool:
        """Return whether all topics and services of a working robot have answered, and its drive bus is matched and idle."""
        has_interfaces = all(row.name in self.samples for row in ROBOT_TOPICS) and self.calls.is_complete
        return has_interfaces and bool(self.matched_drive_inputs()) and not self.inputs and not self._waited_for()

    def _waited_for(self) -> list[tuple[float, float]]:
        """Return (start, timeout in seconds) of everything that has not answered yet."""
        return [*self._topics_waited_for(), *self.calls.waited_for(), *self._rates_waited_for()]

    def _topics_waited_for(self) -> list[tuple[float, float]]:
        """Return (start of the wait, timeout in seconds) of every subscribed topic without a sample."""
        timeout_s = SAMPLE_TIMEOUT_S if any(sample["count"] for sample in self.samples.values()) else SILENCE_TIMEOUT_S
        return [(self._since_s[name], timeout_s) for name, sample in self.samples.items() if not sample["count"]]

    def _rates_waited_for(self) -> list[tuple[float, float]]:
        """Return (time of the first sample, timeout in seconds) of every topic that has not yet shown a usable rate."""
        waiting, now_s = [], time.monotonic()
        for name, nominal_hz in NOMINAL_HZ.items():
            sample = self.samples.get(name)
            if not sample or not sample["count"] or not nominal_hz:
                continue
            since_s = self._started_s + sample["first_s"]
            if now_s - since_s < RATE_WINDOW_S and not _is_fast(sample["count"], now_s - since_s, nominal_hz):
                waiting.append((since_s, RATE_WINDOW_S))
        return waiting

    def elapsed_s(self) -> float:
        """Return the seconds since the start of this visit."""
        return round(time.monotonic() - self._started_s, 3)

    def busy_fraction(self) -> float | None:
        """Return the share of its time in which this process computed, or waited for a processor; None if it is not known."""
        now_s = _processor_time_s()
        return None if now_s is None or self._begun is None else round((now_s - self._begun) / max(self.elapsed_s(), 0.001), 2)


def _is_fast(count: int, listened_s: float, nominal_hz: float) -> bool:
    """Return whether at least three samples arrived, with a usable rate over the whole time since the first."""
    return listened_s >= RATE_AFTER_S and count > 2 and count - 1 >= graph.MIN_RATE * nominal_hz * listened_s


def _processor_time_s() -> float | None:
    """Return how long the main thread has run or waited for a processor, as the kernel counts it (proc(5), schedstat)."""
    with suppress(OSError, ValueError):
        running_ns, waiting_ns = Path("/proc/self/schedstat").read_text(encoding="ascii").split()[:2]
        return (int(running_ns) + int(waiting_ns)) / 1e9
    return None


_STATE_DECODERS: dict[graph.Topic, Callable[[Any], Any]] = {
    graph.BATTERY: lambda message: {"percentage": _finite(message.percentage), "voltage": _finite(message.voltage)},
    graph.ESTOP_STATE: lambda message: bool(message.data),
    graph.ESTOP_STATUS: lambda message: _json(message.data),
    graph.DRIVE_STATUS: lambda message: _json(message.data),
}


def _finite(value: float) -> float | None:
    """Return the value, or None for NaN and infinity, which JSON cannot hold."""
    return float(value) if value - value == 0.0 else None


def _json(text: str) -> Any:
    try:
        return parse_json(text)
    except ValueError:
        return None


def probe_graph() -> dict[str, Any]:
    """Probe the graph of this process's environment."""
    session = GraphSession()
    try:
        joined_s = session.join()
        session.wait()
        session.add_timings()
        busy, visit_s = session.busy_fraction(), session.elapsed_s()
        # Names again: a healthy stack that has just started has gained endpoints meanwhile.
        names = session.names()
        drive_matched = session.matched_drive_inputs()
    finally:
        session.close()
    return {
        "joined_s": joined_s,
        "visit_s": visit_s,
        **names,
        "drive_matched": drive_matched,
        "samples": session.samples,
        "inputs": session.inputs,
        "idle_wheels_s": round(session.wheels.idle_s, 3),
        "said": session.states,
        "calls": session.calls.outcomes,
        "late": session.late,
        "busy": busy,
        "controllers": session.calls.controllers,
    }
