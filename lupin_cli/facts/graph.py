"""What a visitor sees on the graphs of this machine: names, ends with their QoS, samples, controllers, round trips.

The visit runs in processes of its own (`lupin_runtime.stack.probe`), since a process's DDS mode is fixed when it starts and
this one must not carry any.
"""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Mapping
from typing import Any

from lupin_cli.facts.base import Fact
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

GHOST = "_NODE_NAME_UNKNOWN_"  # as rmw has it
PROBE = f"exec {shlex.quote(sys.executable)} -m lupin_runtime.stack.probe"


@dataclass(frozen=True)
class End:
    """A publisher or a subscriber."""

    node: str
    type: str
    reliable: bool
    latched: bool

    @property
    def is_ghost(self) -> bool:
        """Whether its node is not, or no longer, there: what is left of a process that ended stays on the server's list."""
        return self.node.endswith(GHOST)

    @property
    def qos(self) -> str:
        """In the field's words."""
        return f"{'RELIABLE' if self.reliable else 'BEST_EFFORT'} {'TRANSIENT_LOCAL' if self.latched else 'VOLATILE'}"


@dataclass(frozen=True)
class SeenTopic:
    """A topic with its ends."""

    name: str
    publishers: tuple[End, ...]
    subscribers: tuple[End, ...]


@dataclass(frozen=True)
class Controller:
    """A controller that the controller manager lists."""

    name: str
    state: str

    def line(self) -> str:
        """As `ros2 control list_controllers` would say it."""
        return f"{self.name} {self.state}"


@dataclass(frozen=True)
class Call:
    """A call of a service that the graph shows a server of. `round_trip_s` is None where no answer came."""

    service: str
    round_trip_s: float | None

    def line(self) -> str:
        """What came of it."""
        took = "no answer" if self.round_trip_s is None else f"answered after {self.round_trip_s * 1e3:.1f} ms"
        return f"{self.service}: {took}"


@dataclass(frozen=True)
class Input:
    """What came in on an input of the drive bus while the visitor listened."""

    topic: str
    count: int
    moving: int  # how many of them were not zero


@dataclass(frozen=True)
class Graph:
    """One graph. `error` says why it could not be visited; then nothing else is known."""

    name: str  # a run's id, or `robot`
    kind: str  # sim or robot
    environment: tuple[tuple[str, str], ...]
    error: str = ""
    joined_s: float = 0.0
    nodes: tuple[str, ...] = ()
    topics: tuple[SeenTopic, ...] = ()
    samples: tuple[tuple[str, int], ...] = ()  # of the topics that have a publisher: how many arrived
    inputs: tuple[Input, ...] = ()
    controllers: tuple[Controller, ...] | None = None  # None where nobody answered
    calls: tuple[Call, ...] = ()
    battery: tuple[float | None, float | None] | None = None  # percentage and voltage; None within: not a number
    estop: bool | None = None
    estop_reasons: tuple[str, ...] = ()
    bus_winner: str = ""  # input that holds the drive bus; empty where our bus isn't there
    bus_locks: tuple[str, ...] = ()
    bus_listeners: tuple[tuple[str, int], ...] = ()  # the topic of the bus's sink, and how many it knows to listen there
    udp_heard: int | None = None  # topics with samples for a second visitor without shared memory, where the first heard none

    def topic(self, name: str) -> SeenTopic | None:
        """A topic with its ends, or None."""
        return next((topic for topic in self.topics if topic.name == name), None)

    def heard(self, name: str) -> int | None:
        """How many samples of a topic arrived; None where it has no publisher or wasn't listened to."""
        return dict(self.samples).get(name)

    @property
    def where(self) -> str:
        """For findings: the simulator's graph is this machine's."""
        return "robot" if self.kind == "robot" else "laptop"


@dataclass(frozen=True)
class Graphs:
    """Every graph that this machine has to do with; none where nothing runs and no robot is set up."""

    graphs: tuple[Graph, ...] = ()

    @property
    def alive(self) -> tuple[Graph, ...]:
        """Those that could be visited and have somebody on them."""
        # Where data reaches nobody, names of topics are there and those of nodes, which are data, are not.
        return tuple(graph for graph in self.graphs if not graph.error and (graph.nodes or graph.topics))


def parse(output: Output) -> Graphs:
    """Pure parser of the visit's JSON. Raises ValueError."""
    try:
        told = json.loads(output.stdout)
        return Graphs(tuple(_graph(each) for each in told["graphs"]))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        last = (output.stderr.strip().splitlines() or ["nothing on stderr"])[-1]
        raise ValueError(f"expected the visit's JSON, found {output.stdout[:60]!r} ({error}); {last[:200]}") from error


def _graph(told: Mapping[str, Any]) -> Graph:
    environment = tuple(sorted((str(key), str(value)) for key, value in told.get("environment", {}).items()))
    if told.get("error"):
        return Graph(str(told["name"]), str(told["kind"]), environment, error=str(told["error"]))
    said = told.get("said", {})
    battery = said.get("/io/power/power_watcher")
    estop_status = said.get("/lupin/estop/status") or {}
    drive = said.get("/lupin/drive/status") or {}
    sink = drive.get("sink")
    controllers = told.get("controllers")
    return Graph(
        name=str(told["name"]),
        kind=str(told["kind"]),
        environment=environment,
        joined_s=float(told["joined_s"]),
        nodes=tuple(told["nodes"]),
        topics=tuple(SeenTopic(t["name"], _ends(t["publishers"]), _ends(t["subscribers"])) for t in told["topics"]),
        samples=tuple((name, int(sample["count"])) for name, sample in told["samples"].items()),
        inputs=tuple(Input(name, seen["count"], seen["moving"]) for name, seen in told["inputs"].items()),
        controllers=None if controllers is None else tuple(Controller(c["name"], c["state"]) for c in controllers),
        calls=tuple(Call(name, call["round_trip_s"]) for name, call in told["calls"].items()),
        battery=(battery["percentage"], battery["voltage"]) if battery else None,
        estop=estop_status.get("engaged", said.get("/e_stop_state")),
        estop_reasons=tuple(estop_status.get("reasons", ())),
        bus_winner=str(drive.get("winner") or ""),
        bus_locks=tuple(drive.get("locks", ())),
        bus_listeners=((str(sink["topic"]), int(sink["listeners"])),) if sink else (),
        udp_heard=told.get("udp_heard"),
    )


def _ends(told: list[dict[str, Any]]) -> tuple[End, ...]:
    return tuple(End(end["node"], end["type"], end["reliable"], end["latched"]) for end in told)


# The visit bounds itself; on two busy cores its processes take seconds to start.
GRAPH = Fact("graph", PROBE, parse, timeout_s=40.0)
