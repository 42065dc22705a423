"""One line for each area of laptop, link and robot: what was observed there, or what is wrong. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from lupin_cli.checks.base import Finding, Severity, Snapshot
from lupin_cli.checks.controllers import observed_graphs
from lupin_cli.checks.ground_truth import GroundTruth, State
from lupin_cli.checks.robot_address import robot_address
from lupin_cli.facts.routes import ROUTES
from lupin_cli.facts.storage import STORAGE
from lupin_cli.facts.units import UNIT_STATES
from lupin_cli.facts.versions import VERSIONS
from lupin_runtime.graph import CONTROLLERS

OK, FAILED, WARNED, FOLLOWS, UNKNOWN = "✓", "✗", "▲", "-", "?"


@dataclass(frozen=True)
class Area:
    """An area, its mark, and one line about it."""

    name: str
    mark: str
    detail: str

    def line(self) -> str:
        """Return the area as it is printed."""
        return f"{self.mark} {self.name:12} {self.detail}"


def _link(snapshot: Snapshot, _: GroundTruth) -> str:
    address, routes = robot_address(snapshot), snapshot.laptop.get(ROUTES)
    route = routes.best(address) if routes is not None and address else None
    return f"{route.device} {route.source} to {address}".replace("  ", " ") if route is not None else ""


def _login(snapshot: Snapshot, _: GroundTruth) -> str:
    return f"SSH to {snapshot.link.address} works" if snapshot.link is not None and snapshot.link.reachable else ""


def _clock(snapshot: Snapshot, _: GroundTruth) -> str:
    return f"{snapshot.link.clock}" if snapshot.link is not None and snapshot.link.clock is not None else ""


def _disk(snapshot: Snapshot, _: GroundTruth) -> str:
    storage = snapshot.robot_fact(STORAGE)
    root = next((mount for mount in storage.mounts if mount.path == "/"), None) if storage is not None else None
    return f"{root.available_kb / 1e6:.1f} GB free" if root is not None else ""


def _services(snapshot: Snapshot, _: GroundTruth) -> str:
    units = snapshot.robot_fact(UNIT_STATES)
    running = [unit.name.removesuffix(".service") for unit in units.units if unit.running] if units is not None else []
    return f"{', '.join(running)} run" if running else ""


def _discovery(snapshot: Snapshot, truth: GroundTruth) -> str:
    server, nodes = (
        truth.environment.get("ROS_DISCOVERY_SERVER", ""),
        max((len(g.nodes) for g in observed_graphs(snapshot)), default=0),
    )
    return f"{f'server {server} answers, ' if server else ''}{nodes} nodes" if nodes else ""


def _controllers(snapshot: Snapshot, _: GroundTruth) -> str:
    for graph in observed_graphs(snapshot):
        if graph.controllers is not None:
            active = sum(each.state == "active" for each in graph.controllers if each.name in CONTROLLERS)
            return f"{active} of {len(CONTROLLERS)} active"
    return ""


def _drive(snapshot: Snapshot, truth: GroundTruth) -> str:
    released = any(graph.estop is False for graph in observed_graphs(snapshot))
    reaches = "a command would reach the wheels" if truth.drive == "reaches" else ""
    return f"{reaches}{'; e-stop released' if released else ''}" if reaches else ""


def _release(snapshot: Snapshot, _: GroundTruth) -> str:
    versions = snapshot.robot_fact(VERSIONS)
    release = versions.release if versions is not None else None
    return f"Lupin {release.version}" if release is not None and release.current else ""


def _topics(_: Snapshot, truth: GroundTruth) -> str:
    answers = [round_trip_s for _, round_trip_s in truth.services if round_trip_s is not None]
    if truth.state is not State.HEALTHY or not answers:
        return ""
    delivered = f"{truth.required} of {truth.required} required topics deliver samples"
    return f"{delivered}; a service answers in {min(answers) * 1e3:.0f} ms"


@dataclass(frozen=True)
class _Row:
    """An area: the layers that it covers, and what it says if nothing is wrong; empty if that was not observed."""

    name: str
    layers: frozenset[str]
    describe: Callable[[Snapshot, GroundTruth], str]
    of_robot: bool = True  # it is only there if a robot was selected


# In the order of the path.
_ROWS = (
    _Row("link", frozenset({"carrier", "address", "route", "mtu", "loss", "ports"}), _link),
    _Row("login", frozenset({"login"}), _login),
    _Row("clock", frozenset({"clock"}), _clock),
    _Row("disk, memory", frozenset({"machine"}), _disk),
    _Row("release", frozenset({"release"}), _release),
    _Row("services", frozenset({"processes", "shared-memory"}), _services),
    _Row("discovery", frozenset({"discovery", "profile", "environment"}), _discovery, of_robot=False),
    _Row("controllers", frozenset({"devices"}), _controllers, of_robot=False),
    _Row("drive", frozenset({"endpoints"}), _drive, of_robot=False),
    _Row("topics", frozenset({"samples"}), _topics, of_robot=False),
)


def judge_areas(
    snapshot: Snapshot, truth: GroundTruth, roots: Iterable[Finding], consequences: Iterable[Finding]
) -> tuple[Area, ...]:
    """Return one line for each area: its root cause, that it follows from another, what was observed, or that nothing was."""
    causes, followers = tuple(roots), tuple(consequences)
    if not truth.graph and snapshot.link is None:
        return ()
    areas = []
    for row in _ROWS:
        if row.of_robot and snapshot.link is None:
            continue
        cause = min(
            (each for each in causes if each.layer in row.layers),
            key=lambda each: each.severity is Severity.WARNING,
            default=None,
        )
        detail = row.describe(snapshot, truth)
        if cause is not None:
            areas.append(Area(row.name, FAILED if cause.severity is Severity.PROBLEM else WARNED, cause.cause))
        elif any(each.layer in row.layers for each in followers):
            areas.append(Area(row.name, FOLLOWS, "follows from the cause"))
        else:
            areas.append(Area(row.name, OK if detail else UNKNOWN, detail or "not observed"))
    return tuple(areas)
