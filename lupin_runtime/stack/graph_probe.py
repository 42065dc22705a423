"""Prints what each graph known to this machine contains, as JSON: `python -m lupin_runtime.stack.graph_probe`.

Each graph is joined by a separate process, because a process's DDS mode is fixed when it starts. A probe changes nothing: it
subscribes, and calls only services without side effects. Every wait has a timeout. It collects

* names: nodes, topics, and for each topic the publishers and subscriptions with their QoS;
* samples: whether messages arrive on the topics that a working robot always publishes. A probe joins later than every other
  process, so it sees names without samples if the data path is broken and the discovery server still works;
* round trips: only a service call needs the route to the robot and back.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

from lupin_runtime import graph
from lupin_runtime.drive.twist import decode
from lupin_runtime.exit_codes import SUCCESS, USAGE_ERROR
from lupin_runtime.stack.known_graphs import KnownGraph, known_graphs

# Names are complete once they have not changed for this long.
SETTLE_S = 0.6
JOIN_TIMEOUT_S = 4.0
# Console and drive bus repeat at 20 and 1 Hz: this is long enough to see which source is active.
LISTEN_S = 1.2
SAMPLE_TIMEOUT_S = 4.0
# A first sample takes up to 3.3 s through a discovery server. Until any topic has delivered, the timeout is twice as long.
SILENCE_TIMEOUT_S = 8.0
CALL_TIMEOUT_S = 3.0
WAIT_TIMEOUT_S = 10.0
POLL_S, RESCAN_S = 0.1, 0.4
# Two probes, one after the other, on a busy machine.
PROBE_TIMEOUT_S = 35.0

# Published by every working robot: until all of them are seen, a missing one may be late.
ROBOT_TOPICS = tuple(topic for topic in graph.topics() if topic.repeats and topic.from_vendor)
PROBED_TOPICS = tuple(topic for topic in graph.topics() if topic.repeats or topic.probed)
DRIVE_INPUTS = (graph.CMD_VEL_JOY, graph.CMD_VEL_MANUAL, graph.CMD_VEL_AUTO)
# Three servers in three processes of the robot: the controller manager, the motor board and the onboard stack.
PROBED_SERVICES: tuple[graph.Service, ...] = (
    graph.LIST_CONTROLLERS,
    graph.servo_range(graph.SERVOS[-1]),
    graph.ARM_LIBRARY_LIST,
)


class GraphSession:
    """A node that joins the graph of this process's environment for one probe."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        from lupin_runtime.ros.node import LupinNode

        self._rclpy = rclpy
        rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        self.node = LupinNode(f"lupin_probe_{os.getpid()}", enable_rosout=False)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._started_s = time.monotonic()
        self.samples: dict[str, dict[str, float]] = {}
        self.inputs: dict[str, dict[str, int]] = {}
        self.states: dict[str, Any] = {}
        self.calls: dict[str, dict[str, Any]] = {}
        self.controllers: list[dict[str, str]] | None = None
        self._pending: dict[str, Any] = {}
        self._names: dict[str, Any] = {}
        self._since_s: dict[str, float] = {}  # when each topic was subscribed and each service call was started

    def close(self) -> None:
        """Leave the graph, so that its other nodes are informed at once."""
        self._executor.shutdown(timeout_sec=1.0)
        self.node.destroy_node()
        self._rclpy.try_shutdown()

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
            self._advance_calls()
            now_s = time.monotonic()
            if now_s - polled_s < POLL_S:
                return False
            polled_s, seen = now_s, self.names()
            if seen != self._names:
                self._names, since_s = seen, now_s
                self._subscribe_and_call()
            # Node names are sent as data, topic names by discovery: one of the two may never arrive.
            return bool(seen["nodes"] or seen["topics"]) and now_s - since_s > SETTLE_S

        self.until(settled, JOIN_TIMEOUT_S)
        return round(time.monotonic() - self._started_s, 3)

    def _subscribe_and_call(self) -> None:
        """Subscribe to the topics and call the services that have appeared since the last time."""
        self.subscribe({topic["name"]: topic for topic in self._names["topics"]})
        self.call()

    def names(self) -> dict[str, Any]:
        """Return the nodes, and the topics with their endpoints, without those of this probe."""
        own = self.node.get_name()
        nodes = sorted(
            f"{namespace.rstrip('/')}/{name}"
            for name, namespace in self.node.get_node_names_and_namespaces()
            if name != own and not name.startswith("_ros2cli")
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
            if end.node_name != self.node.get_name()
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
            self.samples[row.name] = {"count": 0, "first_s": -1.0}
            self._since_s[row.name] = time.monotonic()
            offered = graph.Qos(all(p["reliable"] for p in publishers), all(p["latched"] for p in publishers), depth=5)
            requested = offered if row.qos.latched else graph.BEST5
            decoder = decoders.get(row.name)
            if decoder is None:
                self.node.subscription(row, partial(self._count, row.name), qos=requested, raw=True)
            else:
                self.node.subscription(row, partial(self._keep_state, row.name, decoder), qos=requested)
        for row in DRIVE_INPUTS:
            if topics.get(row.name, {}).get("publishers") and row.name not in self.inputs:
                self.inputs[row.name] = {"count": 0, "moving": 0}
                self.node.subscription(row, partial(self._count_command, row.name), qos=graph.BEST5, raw=True)

    def _count(self, name: str, _: Any) -> None:
        sample = self.samples[name]
        if not sample["count"]:
            sample["first_s"] = round(time.monotonic() - self._started_s, 3)
        sample["count"] += 1

    def _keep_state(self, name: str, decode_state: Callable[[Any], Any], message: Any) -> None:
        self._count(name, message)
        self.states[name] = decode_state(message)

    def _count_command(self, name: str, data: bytes) -> None:
        twist = decode(data)
        self.inputs[name]["count"] += 1
        self.inputs[name]["moving"] += int(twist is not None and not twist.is_neutral())

    def call(self) -> None:
        """Call every probed service that has a server, without waiting for the responses."""
        from lupin_runtime.ros.node import interface

        served = dict(self.node.get_service_names_and_types())
        for row in PROBED_SERVICES:
            if row.name not in served or row.name in self.calls:
                continue
            self.calls[row.name] = {"answered": False, "round_trip_s": None}
            self._since_s[row.name] = time.monotonic()
            client = self.node.client(row)
            self._pending[row.name] = (client, interface(row.type).Request(), None, 0.0)

    def _advance_calls(self) -> None:
        """Send the requests whose server is ready, and take the responses that have arrived."""
        for name, (client, request, future, sent_s) in list(self._pending.items()):
            if future is None:
                if client.service_is_ready():
                    self._since_s[name] = sent_s = time.monotonic()
                    self._pending[name] = (client, request, client.call_async(request), sent_s)
            elif future.done():
                self.calls[name] = {"answered": True, "round_trip_s": round(time.monotonic() - sent_s, 4)}
                if name == graph.LIST_CONTROLLERS.name:
                    self.controllers = [{"name": c.name, "state": c.state, "type": c.type} for c in future.result().controller]
                del self._pending[name]

    def wait(self) -> None:
        """Wait until every topic has delivered and every service has answered, or until the timeout of each has expired.

        A topic or service that appeared too late for its timeout is removed from the results. The wait ends early if all of a
        robot's topics and services have answered, no source commands the drive bus, and the names have not changed.
        """
        started_s = scanned_s = time.monotonic()
        before, self._names = self._names, self.names()
        unchanged = self._names == before
        self._subscribe_and_call()

        def done() -> bool:
            nonlocal scanned_s, unchanged
            now_s = time.monotonic()
            if now_s - scanned_s > RESCAN_S:
                # Under load, service names arrive seconds after topic names.
                scanned_s, before, self._names = now_s, self._names, self.names()
                unchanged = self._names == before
                self._subscribe_and_call()
            self._advance_calls()
            all_called = len(self.calls) == len(PROBED_SERVICES) or now_s - started_s > CALL_TIMEOUT_S
            waiting = [*self._topics_waited_for(), *self._calls_waited_for()]
            if unchanged and not waiting and not self.inputs and self._is_complete():
                return True
            return (
                all_called
                and now_s - started_s > LISTEN_S
                and all(now_s - since_s > timeout_s for since_s, timeout_s in waiting)
            )

        self.until(done, WAIT_TIMEOUT_S)
        end_s = time.monotonic()
        for name, since_s in self._since_s.items():
            timeout_s = CALL_TIMEOUT_S if name in self.calls else SAMPLE_TIMEOUT_S
            answered = self.calls[name]["answered"] if name in self.calls else self.samples[name]["count"]
            # A server that was listed but never became ready was sent no request, so whether it answers is unknown.
            not_sent = name in self._pending and self._pending[name][2] is None
            if not answered and (end_s - since_s < timeout_s or not_sent):
                (self.calls if name in self.calls else self.samples).pop(name)

    def _is_complete(self) -> bool:
        """Return whether every topic and service of a working robot has appeared, so that none of them is merely late."""
        return all(row.name in self.samples for row in ROBOT_TOPICS) and len(self.calls) == len(PROBED_SERVICES)

    def _topics_waited_for(self) -> list[tuple[float, float]]:
        """Return (start of the wait, timeout in seconds) of every subscribed topic without a sample."""
        timeout_s = SAMPLE_TIMEOUT_S if any(sample["count"] for sample in self.samples.values()) else SILENCE_TIMEOUT_S
        return [(self._since_s[name], timeout_s) for name, sample in self.samples.items() if not sample["count"]]

    def _calls_waited_for(self) -> list[tuple[float, float]]:
        """Return (start of the wait, timeout in seconds) of every call without a response."""
        return [(self._since_s[name], CALL_TIMEOUT_S) for name, call in self.calls.items() if not call["answered"]]


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
        return json.loads(text)
    except ValueError:
        return None


def probe_graph() -> dict[str, Any]:
    """Probe the graph of this process's environment."""
    session = GraphSession()
    try:
        joined_s = session.join()
        session.wait()
        # Names again: a healthy stack that has just started has gained endpoints meanwhile.
        names = session.names()
    finally:
        session.close()
    return {
        "joined_s": joined_s,
        **names,
        "samples": session.samples,
        "inputs": session.inputs,
        "said": session.states,
        "calls": session.calls,
        "controllers": session.controllers,
    }


def _start(environment: Mapping[str, str]) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "lupin_runtime.stack.graph_probe", "--here"]
    return subprocess.Popen(command, env=dict(environment), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def _finish(process: subprocess.Popen[str], deadline_s: float) -> dict[str, Any]:
    try:
        out, err = process.communicate(timeout=max(0.1, deadline_s - time.monotonic()))
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return {"error": f"the graph probe did not finish within {PROBE_TIMEOUT_S:.0f} s"}
    with suppress(ValueError):
        seen = json.loads(out)
        if isinstance(seen, dict):
            return seen
    last = (err.strip().splitlines() or ["no error output"])[-1]
    return {"error": f"the graph probe exited with status {process.returncode}: {last}"}


def _is_silent(seen: Mapping[str, Any]) -> bool:
    samples = seen.get("samples") or {}
    return bool(samples) and not any(sample["count"] for sample in samples.values())


def probe_all(graphs: tuple[KnownGraph, ...]) -> list[dict[str, Any]]:
    """Probe all graphs at the same time.

    If names were seen but no sample arrived, a second probe without shared memory shows whether shared memory is the cause.
    """
    deadline_s = time.monotonic() + PROBE_TIMEOUT_S
    processes = [_start(known.environment) for known in graphs]
    results = []
    try:
        for known, process in zip(graphs, processes):
            seen = _finish(process, deadline_s)
            if _is_silent(seen) and "FASTDDS_BUILTIN_TRANSPORTS" not in known.environment:
                again = _start({**known.environment, "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"})
                processes.append(again)
                udp = _finish(again, deadline_s)
                if "error" not in udp:
                    seen["udp_heard"] = sum(bool(s["count"]) for s in udp["samples"].values())
            results.append(
                {
                    "name": known.name,
                    "kind": known.kind,
                    "environment": {key: known.environment[key] for key in SHOWN if key in known.environment},
                    **seen,
                }
            )
    finally:
        for process in processes:
            if process.poll() is None:
                process.kill()
                process.wait()
    return results


SHOWN = (
    "ROS_DOMAIN_ID",
    "ROS_DISCOVERY_SERVER",
    "RMW_IMPLEMENTATION",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_BUILTIN_TRANSPORTS",
)


def main(argv: list[str] | None = None) -> int:
    """Print one JSON object; `--here` probes only the graph of this process's environment."""
    arguments = sys.argv[1:] if argv is None else argv
    if arguments == ["--here"]:
        print(json.dumps(probe_graph()), flush=True)
        return SUCCESS
    if arguments:
        print(f"graph_probe: unknown arguments {arguments}; the only argument is --here", file=sys.stderr)
        return USAGE_ERROR
    print(json.dumps({"graphs": probe_all(known_graphs())}), flush=True)
    return SUCCESS


if __name__ == "__main__":
    sys.exit(main())
