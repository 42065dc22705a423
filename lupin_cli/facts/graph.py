"""The ROS graphs that this machine can join: nodes, endpoints with their QoS, samples, controllers, service round trips.

The probe runs in its own processes (`lupin_runtime.stack.graph_probe`): a process's DDS mode is fixed when it starts, and this
process must stay without one.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.routes import ROBOT_ADDRESSES
from lupin_runtime.graph import BATTERY, CLOCK, DRIVE_STATUS, ESTOP_STATE, ESTOP_STATUS
from lupin_runtime.interpreter import PYTHON
from lupin_runtime.json_text import parse_json

WALL_TIME_S = 86_400.0  # stamps that are so close to a clock are taken from one
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # the name that rmw reports for an unknown node
# With a robot selected, the graph that programs of this shell join is probed even if it is not the robot's.
PROBE = f"exec {shlex.join(PYTHON)} -m lupin_runtime.stack.graph_probe ${{{ROBOT_ADDRESSES}:+--shell}}"


@dataclass(frozen=True)
class Endpoint:
    """A publisher or subscription of a topic."""

    node: str
    type: str
    reliable: bool
    latched: bool

    @property
    def is_stale(self) -> bool:
        """Whether its node is unknown: the discovery server still lists endpoints of processes that have exited."""
        return self.node.endswith(UNKNOWN_NODE)

    @property
    def qos(self) -> str:
        """Reliability and durability, in DDS terms."""
        return f"{'RELIABLE' if self.reliable else 'BEST_EFFORT'} {'TRANSIENT_LOCAL' if self.latched else 'VOLATILE'}"


@dataclass(frozen=True)
class ObservedTopic:
    """A topic with its endpoints."""

    name: str
    publishers: tuple[Endpoint, ...]
    subscribers: tuple[Endpoint, ...]


@dataclass(frozen=True)
class Controller:
    """A controller that the controller manager lists."""

    name: str
    state: str

    def line(self) -> str:
        """Return the controller as `ros2 control list_controllers` prints it."""
        return f"{self.name} {self.state}"


@dataclass(frozen=True)
class ServiceCall:
    """A call of a service that has a server in the graph. `round_trip_s` is None if no answer came.

    A server that is listed but never matches the client is sent no request.
    """

    service: str
    round_trip_s: float | None
    sent: bool = True

    def line(self) -> str:
        """Return the result in one line."""
        if not self.sent:
            return f"{self.service}: its server is listed, but does not become ready for requests"
        result = "no answer" if self.round_trip_s is None else f"answered after {self.round_trip_s * 1e3:.1f} ms"
        return f"{self.service}: {result}"


@dataclass(frozen=True)
class DriveInput:
    """The messages on an input of the drive bus while the probe listened."""

    topic: str
    count: int
    moving: int  # number of messages with a non-zero command


@dataclass(frozen=True)
class Timing:
    """When samples of a topic arrived: their rate (None for fewer than three), and the age of the last one.

    `stamp_age_s` is how old the samples were by their stamp and this machine's clock when they arrived, and `frame` the frame
    in their header; None if the message has no header. `listened_s` is the time from the first sample to the end of the visit.
    """

    topic: str
    rate_hz: float | None
    age_s: float | None
    stamp_age_s: float | None = None
    frame: str | None = None
    listened_s: float | None = None


@dataclass(frozen=True)
class Graph:
    """One graph. If it could not be joined, `error` says why, and nothing else is known."""

    name: str  # a run's id, `robot`, or `shell`
    kind: str  # sim, robot, or shell: what programs of the operator's shell join, if that is not a known graph
    environment: tuple[tuple[str, str], ...]
    error: str = ""
    joined_s: float = 0.0
    visit_s: float = 0.0  # from the start until everything had answered or timed out
    nodes: tuple[str, ...] = ()
    topics: tuple[ObservedTopic, ...] = ()
    samples: tuple[tuple[str, int], ...] = ()  # number of samples received, for each topic with a publisher
    inputs: tuple[DriveInput, ...] = ()
    idle_wheels_s: float = 0.0  # for how long the odometry did not change while an input commanded the wheels
    controllers: tuple[Controller, ...] | None = None  # None if the controller manager did not answer
    calls: tuple[ServiceCall, ...] = ()
    battery: tuple[float | None, float | None] | None = None  # percentage and voltage; None for a value that is not a number
    estop: bool | None = None
    estop_reasons: tuple[str, ...] = ()
    drive_bus_holder: str = ""  # the input that controls the drive bus; empty without Lupin's drive bus
    drive_bus_locks: tuple[str, ...] = ()
    sink_subscriptions: tuple[tuple[str, int], ...] = ()  # topic, and how many subscriptions the drive bus sees
    # If no sample was received on any topic: the number of topics that a second probe received without shared memory.
    udp_heard: int | None = None
    timings: tuple[Timing, ...] = ()
    drive_matched: int | None = None  # subscriptions that would get a drive command of this machine; None if none is listed
    late: tuple[str, ...] = ()  # topics and services that appeared too late to be observed
    busy: float | None = None  # share of the time in which the probe computed, or waited for a processor

    def topic(self, name: str) -> ObservedTopic | None:
        """Return the topic of that name, or None."""
        return next((topic for topic in self.topics if topic.name == name), None)

    @property
    def uses_simulated_time(self) -> bool:
        """Whether stamps and rates are those of simulated time, which begins at zero.

        A node may listen for it without a publisher, and a simulated robot may publish it and stamp its data by the clock.
        """
        clock = self.topic(CLOCK.name)
        if clock is None or not clock.publishers:
            return False
        ages = [timing.stamp_age_s for timing in self.timings if timing.stamp_age_s is not None]
        return self.kind == "sim" or not any(abs(age_s) < WALL_TIME_S for age_s in ages)

    def sample_count(self, name: str) -> int | None:
        """Return how many samples arrived on a topic; None if it has no publisher or the probe does not subscribe to it."""
        return dict(self.samples).get(name)

    def timing(self, name: str) -> Timing:
        """Return when samples of a topic arrived."""
        return next((timing for timing in self.timings if timing.topic == name), Timing(name, None, None))

    @property
    def machine(self) -> str:
        """The machine that findings about this graph name; the simulator's graph belongs to the laptop."""
        return "robot" if self.kind == "robot" else "laptop"


@dataclass(frozen=True)
class Graphs:
    """All graphs that this machine can join; empty if no run is up and no robot is set up."""

    graphs: tuple[Graph, ...] = ()

    @property
    def alive(self) -> tuple[Graph, ...]:
        """The graphs that could be joined and are not empty."""
        # If data does not arrive, topic names are known but node names, which are sent as data, are not.
        return tuple(graph for graph in self.graphs if not graph.error and (graph.nodes or graph.topics))


def parse(output: Output) -> Graphs:
    """Parse the probe's JSON. Raises ValueError."""
    try:
        document = parse_json(output.stdout)
        return Graphs(tuple(_graph(each) for each in document["graphs"]))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        last = (output.stderr.strip().splitlines() or ["nothing on stderr"])[-1]
        raise ValueError(f"expected JSON of the graph probe, found {output.stdout[:60]!r} ({error}); {last[:200]}") from error


def _graph(document: Mapping[str, Any]) -> Graph:
    environment = tuple(sorted((str(key), str(value)) for key, value in document.get("environment", {}).items()))
    if document.get("error"):
        return Graph(str(document["name"]), str(document["kind"]), environment, error=str(document["error"]))
    messages = document.get("said", {})
    battery = messages.get(BATTERY.name)
    estop_status = messages.get(ESTOP_STATUS.name) or {}
    drive = messages.get(DRIVE_STATUS.name) or {}
    sink = drive.get("sink")
    controllers = document.get("controllers")
    return Graph(
        name=str(document["name"]),
        kind=str(document["kind"]),
        environment=environment,
        joined_s=float(document["joined_s"]),
        visit_s=float(document.get("visit_s", 0.0)),
        nodes=tuple(document["nodes"]),
        topics=tuple(
            ObservedTopic(t["name"], _endpoints(t["publishers"]), _endpoints(t["subscribers"])) for t in document["topics"]
        ),
        samples=tuple((name, int(sample["count"])) for name, sample in document["samples"].items()),
        inputs=tuple(DriveInput(name, seen["count"], seen["moving"]) for name, seen in document["inputs"].items()),
        idle_wheels_s=float(document.get("idle_wheels_s", 0.0)),
        controllers=None if controllers is None else tuple(Controller(c["name"], c["state"]) for c in controllers),
        calls=tuple(
            ServiceCall(name, call["round_trip_s"], call.get("sent", True)) for name, call in document["calls"].items()
        ),
        battery=(battery["percentage"], battery["voltage"]) if battery else None,
        estop=estop_status.get("engaged", messages.get(ESTOP_STATE.name)),
        estop_reasons=tuple(estop_status.get("reasons", ())),
        drive_bus_holder=str(drive.get("winner") or ""),
        drive_bus_locks=tuple(drive.get("locks", ())),
        sink_subscriptions=((str(sink["topic"]), int(sink["listeners"])),) if sink else (),
        udp_heard=document.get("udp_heard"),
        timings=tuple(
            Timing(name, s.get("rate_hz"), s.get("age_s"), s.get("stamp_age_s"), s.get("frame"), s.get("listened_s"))
            for name, s in document["samples"].items()
        ),
        drive_matched=document.get("drive_matched"),
        late=tuple(document.get("late", ())),
        busy=document.get("busy"),
    )


def _endpoints(endpoints: list[dict[str, Any]]) -> tuple[Endpoint, ...]:
    return tuple(Endpoint(end["node"], end["type"], end["reliable"], end["latched"]) for end in endpoints)


# The probe limits its own duration; on two busy cores its processes take seconds to start.
GRAPH = Fact("graph", PROBE, parse, timeout_s=40.0)
