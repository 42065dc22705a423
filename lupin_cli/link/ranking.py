"""Which transport to use: problems of the link in use, and the ranking of all transports. Pure.

The project's order is: a cable for tests, a travel router for the demo, the robot's own access point as the fallback, never a
phone's hotspot. A transport that does not answer, or whose measured link has problems, moves down.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from ipaddress import ip_address, ip_network

from lupin_cli.connection.inventory import TRANSPORTS
from lupin_cli.facts.networkmanager import NetworkManager
from lupin_cli.link.quality import Quality
from lupin_cli.link.route import Route
from lupin_cli.printed_commands import lupin

REASONS = {
    "wired": "a cable is a dedicated link: no access point that drops multicast, no roaming, the least delay and jitter",
    "router": "a private network without isolation, multicast works, more than two devices can join",
    "ap": "needs no other device, but has a small antenna, takes about two devices, and loads the robot's processor",
}
HOTSPOT = ip_network("172.20.10.0/28")  # the network of a phone's hotspot
# Drive commands come at 20 Hz and stay valid for 0.5 s, so this much jitter and loss is harmless.
JITTER_LIMIT_MS, LOSS_LIMIT = 30.0, 0.02
MIN_THROUGHPUT_MBPS = 4.0  # one 640 x 480 JPEG stream at 10 Hz
WEAK_SIGNAL_DBM = -70.0


@dataclass(frozen=True)
class RankedTransport:
    """A transport, why it has its place in the project's order, and its problems today."""

    transport: str
    address: str  # empty if the inventory has none
    answers: bool
    reason: str
    problems: tuple[str, ...] = field(default=())


def roaming_risks(manager: NetworkManager | None, interface: str) -> list[str]:
    """Return the saved networks that `interface` may roam to, each as a sentence."""
    if manager is None or not manager.running:
        return []
    device = next((each for each in manager.devices if each.name == interface), None)
    active = next((each for each in manager.profiles if device is not None and each.name == device.connection), None)
    if active is None or not active.wireless:
        return []
    rivals = [p for p in manager.profiles if p.wireless and p.autoconnect and p != active and p.priority >= active.priority]
    return [
        f"{active.name} has autoconnect priority {active.priority}, {rival.name} {rival.priority}: the radio may roam to it"
        for rival in rivals
    ]


def link_problems(laptop: Route | None, robot: Route | None, quality: Quality | None, risks: Sequence[str]) -> list[str]:
    """Return the problems of the link in use, each as a sentence; `risks` come first."""
    found = list(risks)
    for route, machine in ((laptop, "this machine"), (robot, "the robot")):
        if route is not None:
            found += _route_problems(route, machine)
    if laptop is not None and laptop.source and ip_address(laptop.source) in HOTSPOT:
        found.append("this is a phone's hotspot: it drops SSH and multicast, and stalls for 300 ms and more")
    if quality is not None:
        found += _quality_problems(quality)
    return found


def _route_problems(route: Route, machine: str) -> list[str]:
    found = []
    if not route.multicast:
        found.append(f"{machine}'s {route.interface} does not support multicast")
    if route.mtu and route.mtu < 1500:
        found.append(f"{machine}'s {route.interface} has an MTU of {route.mtu}: samples are split into more packets")
    if route.radio is not None and route.radio.power_save:
        found.append(
            f"{machine}'s {route.interface} saves power and delays samples; "
            f"turn it off with: iw dev {route.interface} set power_save off"
        )
    if route.radio is not None and route.radio.signal_dbm is not None and route.radio.signal_dbm < WEAK_SIGNAL_DBM:
        found.append(f"{machine} receives only {route.radio.signal_dbm:g} dBm")
    return found


def _quality_problems(quality: Quality) -> list[str]:
    found = []
    if quality.jitter_ms is not None and quality.jitter_ms > JITTER_LIMIT_MS:
        found.append(f"jitter of {quality.jitter_ms:.0f} ms")
    if quality.loss is not None and quality.loss > LOSS_LIMIT:
        found.append(f"{quality.loss:.0%} of the packets are lost")
    slow = [mbps for mbps in (quality.down_mbps, quality.up_mbps) if mbps is not None and mbps < MIN_THROUGHPUT_MBPS]
    if slow:
        found.append(f"only {min(slow):.1f} Mbit/s")
    if False in (quality.multicast_down, quality.multicast_up):
        found.append("multicast does not pass: discovery needs the server")
    return found


def multihoming_problems(robot: str, transport: str, announced: Sequence[str]) -> list[str]:
    """Return a sentence if the robot is on several networks, since the laptop may have no route to some; none over `ap`."""
    if transport != "ap" and len(announced) > 1:
        return [
            f"the robot is on several networks ({', '.join(announced)}): commands may get lost; "
            f"keep one with: {lupin('play', 'single-home', robot=robot)}"
        ]
    return []


def rank(
    addresses: Mapping[str, str], answering: Mapping[str, bool], problems: Mapping[str, Sequence[str]]
) -> list[RankedTransport]:
    """Return all transports, best first: those that answer before the others, those without problems before those with some,
    and otherwise in the project's order."""
    ranked = [
        RankedTransport(name, addresses.get(name, ""), answering.get(name, False), REASONS[name], tuple(problems.get(name, ())))
        for name in TRANSPORTS
    ]
    return sorted(ranked, key=lambda each: (not each.answers, bool(each.problems)))
