"""`python -m lupin_runtime.stack.probe`: what is to be seen on each graph that this machine has to do with, as JSON.

Every graph is joined by a process of its own, since a process's DDS mode is fixed when it starts. A visitor changes nothing: it
listens, and calls only services that answer and do nothing else. Every wait is bounded.

* Names: nodes, topics, and for each topic who publishes and who subscribes, with the QoS of each.
* Samples: whether anything arrives on the topics that a working robot always has. A visitor is the latest of late joiners:
  names without samples is what it finds where the data's channel is broken and the discovery server's is not.
* Round trips: a service call is the one thing that needs the way to the robot and back.
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
from lupin_runtime.stack.graphs import KnownGraph, known_graphs

# Nothing is concluded from a picture of names that still grows: it must have stood still for so long.
SETTLE_S = 0.6
JOIN_BOUND_S = 4.0
# Console and bus repeat themselves at 20 and 1 Hz: who holds the bus is seen within this time.
LISTEN_S = 1.2
SAMPLE_BOUND_S = 4.0
# A first sample takes up to 3.3 s through a discovery server; where none has come at all, twice that long is waited.
SILENCE_BOUND_S = 8.0
CALL_BOUND_S = 3.0
WAIT_BOUND_S = 10.0
LOOK_S, LOOK_AGAIN_S = 0.1, 0.4
# Two visits, one after the other, on a busy machine.
VISIT_BOUND_S = 35.0

# A working robot always says these. Where one is missing, nobody knows whether it is late or gone.
ROBOTS: tuple[graph.Topic, ...] = (
    graph.SCAN,
    graph.ODOM,
    graph.IMU,
    graph.BATTERY,
    graph.JOINT_STATES,
    graph.ESTOP_BUTTON,
    graph.TF,
)
WATCHED: tuple[graph.Topic, ...] = (
    graph.CLOCK,
    *ROBOTS,
    graph.ESTOP_STATE,
    graph.ESTOP_STATUS,
    graph.DRIVE_STATUS,
    graph.MISSION_STATE,
    graph.TWIN_STATE,
)
INPUTS: tuple[graph.Topic, ...] = (graph.CMD_VEL_JOY, graph.CMD_VEL_MANUAL, graph.CMD_VEL_AUTO)
# Each is answered by another process of the robot: the controllers', the motor board's, the onboard stack's.
CALLED: tuple[graph.Service, ...] = (graph.LIST_CONTROLLERS, graph.servo_range(graph.SERVOS[-1]), graph.ARM_LIBRARY_LIST)


class Visit:
    """A short stay on the graph that this process's environment names."""

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
        self.said: dict[str, Any] = {}
        self.calls: dict[str, dict[str, Any]] = {}
        self.controllers: list[dict[str, str]] | None = None
        self._pending: dict[str, Any] = {}
        self._picture: dict[str, Any] = {}
        self._since_s: dict[str, float] = {}  # when each topic was subscribed to and each service looked for

    def close(self) -> None:
        """Leave, so that the others know it at once."""
        self._executor.shutdown(timeout_sec=1.0)
        self.node.destroy_node()
        self._rclpy.try_shutdown()

    def until(self, condition: Callable[[], bool], bound_s: float) -> bool:
        """Take what arrives until `condition()` holds; False after the bound."""
        deadline = time.monotonic() + bound_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.02)
        return True

    def join(self) -> float:
        """Wait until the picture of who is there stands still, and begin to listen and to ask meanwhile; seconds that took."""
        since_s, looked_s = time.monotonic(), 0.0

        def settled() -> bool:
            nonlocal since_s, looked_s
            self._advance_calls()
            now_s = time.monotonic()
            if now_s - looked_s < LOOK_S:
                return False
            looked_s, seen = now_s, self.names()
            if seen != self._picture:
                self._picture, since_s = seen, now_s
                self._approach()
            # Names of nodes come over the data's way, those of topics with discovery: either may be all that there is.
            return bool(seen["nodes"] or seen["topics"]) and now_s - since_s > SETTLE_S

        self.until(settled, JOIN_BOUND_S)
        return round(time.monotonic() - self._started_s, 3)

    def _approach(self) -> None:
        """Listen to and ask what the picture shows and hasn't been listened to or asked yet."""
        self.listen({topic["name"]: topic for topic in self._picture["topics"]})
        self.call()

    def names(self) -> dict[str, Any]:
        """Nodes, and topics with their ends; this visitor itself is left out."""
        own = self.node.get_name()
        nodes = sorted(
            f"{namespace.rstrip('/')}/{name}"
            for name, namespace in self.node.get_node_names_and_namespaces()
            if name != own and not name.startswith("_ros2cli")
        )
        topics = []
        for name, types in self.node.get_topic_names_and_types():
            publishers = self._ends(self.node.get_publishers_info_by_topic(name))
            subscribers = self._ends(self.node.get_subscriptions_info_by_topic(name))
            if publishers or subscribers:
                topics.append({"name": name, "types": sorted(types), "publishers": publishers, "subscribers": subscribers})
        return {"nodes": nodes, "topics": topics}

    def _ends(self, endpoints: list[Any]) -> list[dict[str, Any]]:
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

    def listen(self, topics: Mapping[str, dict[str, Any]]) -> None:
        """Subscribe to what is watched and published, and isn't yet, asking for no more than its publishers offer."""
        decoded = {row.name: keep for row, keep in _KEPT.items()}
        for row in WATCHED:
            ends = topics.get(row.name, {}).get("publishers", [])
            if not ends or row.name in self.samples:
                continue
            if row is graph.CLOCK and not topics[row.name]["subscribers"]:
                continue  # on a robot that lives by its own clock nobody misses it
            self.samples[row.name] = {"count": 0, "first_s": -1.0}
            self._since_s[row.name] = time.monotonic()
            offered = graph.Qos(all(e["reliable"] for e in ends), all(e["latched"] for e in ends), depth=5)
            asked = offered if row.qos.latched else graph.BEST5
            keep = decoded.get(row.name)
            if keep is None:
                self.node.subscription(row, partial(self._count, row.name), qos=asked, raw=True)
            else:
                self.node.subscription(row, partial(self._keep, row.name, keep), qos=asked)
        for row in INPUTS:
            if topics.get(row.name, {}).get("publishers") and row.name not in self.inputs:
                self.inputs[row.name] = {"count": 0, "moving": 0}
                self.node.subscription(row, partial(self._input, row.name), qos=graph.BEST5, raw=True)

    def _count(self, name: str, _: Any) -> None:
        sample = self.samples[name]
        if not sample["count"]:
            sample["first_s"] = round(time.monotonic() - self._started_s, 3)
        sample["count"] += 1

    def _keep(self, name: str, keep: Callable[[Any], Any], message: Any) -> None:
        self._count(name, message)
        self.said[name] = keep(message)

    def _input(self, name: str, data: bytes) -> None:
        twist = decode(data)
        self.inputs[name]["count"] += 1
        self.inputs[name]["moving"] += int(twist is not None and not twist.is_neutral())

    def call(self) -> None:
        """Ask every service that the graph shows a server of, without waiting for the answers."""
        from lupin_runtime.ros.node import interface

        served = dict(self.node.get_service_names_and_types())
        for row in CALLED:
            if row.name not in served or row.name in self.calls:
                continue
            self.calls[row.name] = {"answered": False, "round_trip_s": None}
            self._since_s[row.name] = time.monotonic()
            client = self.node.client(row)
            self._pending[row.name] = (client, interface(row.type).Request(), None, 0.0)

    def _advance_calls(self) -> None:
        """Send what can be sent, take what was answered."""
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
        """Until everything has been heard and answered, or its own bound; what came too late for its bound is left out.

        Where a whole robot has been heard, nothing is told to the drive bus, and the picture of who is there still stands,
        nothing more is waited for.
        """
        started_s = looked_s = time.monotonic()
        before, self._picture = self._picture, self.names()
        stands = self._picture == before
        self._approach()

        def done() -> bool:
            nonlocal looked_s, stands
            now_s = time.monotonic()
            if now_s - looked_s > LOOK_AGAIN_S:
                # Under load the names of services trail those of topics by seconds.
                looked_s, before, self._picture = now_s, self._picture, self.names()
                stands = self._picture == before
                self._approach()
            self._advance_calls()
            asked = len(self.calls) == len(CALLED) or now_s - started_s > CALL_BOUND_S
            waiting = [*self._unheard(), *self._unanswered()]
            if stands and not waiting and not self.inputs and self._whole():
                return True
            return asked and now_s - started_s > LISTEN_S and all(now_s - since_s > bound_s for since_s, bound_s in waiting)

        self.until(done, WAIT_BOUND_S)
        end_s = time.monotonic()
        for name, since_s in self._since_s.items():
            bound_s = CALL_BOUND_S if name in self.calls else SAMPLE_BOUND_S
            answered = self.calls[name]["answered"] if name in self.calls else self.samples[name]["count"]
            # A server that was listed and never found was not asked: that it is silent nobody knows.
            unasked = name in self._pending and self._pending[name][2] is None
            if not answered and (end_s - since_s < bound_s or unasked):
                (self.calls if name in self.calls else self.samples).pop(name)

    def _whole(self) -> bool:
        """Whether all that a working robot has is there: then what is not there isn't late."""
        return all(row.name in self.samples for row in ROBOTS) and len(self.calls) == len(CALLED)

    def _unheard(self) -> list[tuple[float, float]]:
        """Since when, and how long at most, each topic is waited for that said nothing yet."""
        bound_s = SAMPLE_BOUND_S if any(sample["count"] for sample in self.samples.values()) else SILENCE_BOUND_S
        return [(self._since_s[name], bound_s) for name, sample in self.samples.items() if not sample["count"]]

    def _unanswered(self) -> list[tuple[float, float]]:
        """Since when, and how long at most, each answer is waited for that did not come yet."""
        return [(self._since_s[name], CALL_BOUND_S) for name, call in self.calls.items() if not call["answered"]]


_KEPT: dict[graph.Topic, Callable[[Any], Any]] = {
    graph.BATTERY: lambda message: {"percentage": _finite(message.percentage), "voltage": _finite(message.voltage)},
    graph.ESTOP_STATE: lambda message: bool(message.data),
    graph.ESTOP_STATUS: lambda message: _json(message.data),
    graph.DRIVE_STATUS: lambda message: _json(message.data),
}


def _finite(value: float) -> float | None:
    """JSON has no NaN."""
    return float(value) if value - value == 0.0 else None


def _json(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return None


def look() -> dict[str, Any]:
    """Visit the graph of this process's environment and say what was there."""
    visit = Visit()
    try:
        joined_s = visit.join()
        visit.wait()
        # Ends that came up meanwhile count: a healthy stack that has just started is not to be seen half.
        names = visit.names()
    finally:
        visit.close()
    return {
        "joined_s": joined_s,
        **names,
        "samples": visit.samples,
        "inputs": visit.inputs,
        "said": visit.said,
        "calls": visit.calls,
        "controllers": visit.controllers,
    }


def _start(environment: Mapping[str, str]) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "lupin_runtime.stack.probe", "--here"]
    return subprocess.Popen(command, env=dict(environment), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def _finish(process: subprocess.Popen[str], deadline_s: float) -> dict[str, Any]:
    try:
        out, err = process.communicate(timeout=max(0.1, deadline_s - time.monotonic()))
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return {"error": f"the visit to the graph did not end within {VISIT_BOUND_S:.0f} s"}
    with suppress(ValueError):
        seen = json.loads(out)
        if isinstance(seen, dict):
            return seen
    last = (err.strip().splitlines() or ["it said nothing"])[-1]
    return {"error": f"the visit to the graph ended with {process.returncode}: {last}"}


def _silent(seen: Mapping[str, Any]) -> bool:
    samples = seen.get("samples") or {}
    return bool(samples) and not any(sample["count"] for sample in samples.values())


def visit_all(graphs: tuple[KnownGraph, ...]) -> list[dict[str, Any]]:
    """Visit all graphs at once. Where names were seen and no sample came, a second visitor without shared memory tells
    whether that is the reason."""
    deadline_s = time.monotonic() + VISIT_BOUND_S
    processes = [_start(known.environment) for known in graphs]
    told = []
    try:
        for known, process in zip(graphs, processes):
            seen = _finish(process, deadline_s)
            if _silent(seen) and "FASTDDS_BUILTIN_TRANSPORTS" not in known.environment:
                again = _start({**known.environment, "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"})
                processes.append(again)
                udp = _finish(again, deadline_s)
                if "error" not in udp:
                    seen["udp_heard"] = sum(bool(s["count"]) for s in udp["samples"].values())
            told.append(
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
    return told


SHOWN = (
    "ROS_DOMAIN_ID",
    "ROS_DISCOVERY_SERVER",
    "RMW_IMPLEMENTATION",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_BUILTIN_TRANSPORTS",
)


def main(argv: list[str] | None = None) -> int:
    """Print one JSON object; `--here` visits the graph of the own environment only."""
    arguments = sys.argv[1:] if argv is None else argv
    if arguments == ["--here"]:
        print(json.dumps(look()), flush=True)
        return 0
    if arguments:
        print(f"probe: unknown arguments {arguments}; it takes --here or nothing", file=sys.stderr)
        return 2
    print(json.dumps({"graphs": visit_all(known_graphs())}), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
