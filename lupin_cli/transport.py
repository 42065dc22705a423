"""What carries the link to the robot, how good it is, and which transport to take: parsers and judgement, all pure.

The ranking is the project's: a cable for testing, a travel router for the demo, the robot's own access point as the fallback, a
phone's hotspot never. Today's order takes away what doesn't answer or what is measured to be unfit.
"""

from __future__ import annotations

import itertools
import json
import re
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import field
from ipaddress import ip_address, ip_network
from typing import Any

from lupin_cli.config import TRANSPORTS
from lupin_cli.facts.networkmanager import NetworkManager
from lupin_cli.facts.sections import PRELUDE, answers
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

WHY = {
    "wired": "a cable is a link of its own: no access point that drops multicast, no roaming, the least delay and jitter",
    "router": "a private network without isolation, multicast works, more than two devices can join",
    "ap": "needs nothing else, but a small antenna, about two devices, and the robot's own processor carries it",
}
HOTSPOT = ip_network("172.20.10.0/28")  # what a phone hands out
# A drive command counts for 0.5 s and comes at 20 Hz: this much of it may go to waste.
JITTER_LIMIT_MS, LOSS_LIMIT, THROUGHPUT_FLOOR_MBPS = 30.0, 0.02, 4.0  # 4 Mbit/s: one 640 x 480 JPEG stream at 10 Hz
WEAK_SIGNAL_DBM = -70.0


def way_probe(address: str) -> str:
    """sh that tells which interface leads to `address` and how it stands. `address` must be an IPv4 address."""
    ip_address(address)
    return (
        PRELUDE
        + f"""route=$(ip -4 -j route get {address}) || exit 3
echo '@@ route'; echo "$route"
dev=$(ip -4 -o route get {address} | sed -n 's/.* dev \\([^ ]*\\).*/\\1/p')
echo '@@ link'; ip -j -s link show dev "$dev"
if [ -d "/sys/class/net/$dev/wireless" ] || [ -d "/sys/class/net/$dev/phy80211" ]; then
  echo '@@ radio'
  command -v iw >/dev/null && {{ iw dev "$dev" link; iw dev "$dev" get power_save; }}
fi
echo '@@ end'
"""
    )


@dataclass(frozen=True)
class Radio:
    """A wireless interface, as far as `iw` tells; None where it doesn't."""

    ssid: str | None = None
    frequency_mhz: float | None = None
    signal_dbm: float | None = None
    rate_mbps: float | None = None
    power_save: bool | None = None


@dataclass(frozen=True)
class Way:
    """One machine's side of the link."""

    interface: str
    source: str  # the address that it shows
    gateway: str  # empty on one and the same network
    mtu: int
    multicast: bool
    up: bool
    errors: int  # frames lost or spoilt since the interface came up, both ways
    radio: Radio | None  # None: a cable


def parse_way(output: Output) -> Way:
    """Pure parser of `way_probe`. Raises ValueError."""
    if output.status == 3:
        raise ValueError(f"no route: {output.stderr.strip()}")
    said = answers(output)
    if said.maybe("end") is None:
        raise ValueError("the probe ended before its last line")
    route, link = _first(said.lines("route")), _first(said.lines("link"))
    counters = link.get("stats64", {})
    bad = sum(
        int(counters.get(side, {}).get(kind, 0)) for side in ("rx", "tx") for kind in ("errors", "dropped", "carrier_errors")
    )
    flags = link.get("flags", [])
    radio = said.maybe("radio")
    return Way(
        interface=str(route.get("dev", "")),
        source=str(route.get("prefsrc", "")),
        gateway=str(route.get("gateway", "")),
        mtu=int(link.get("mtu", 0)),
        multicast="MULTICAST" in flags,
        up="LOWER_UP" in flags,
        errors=bad,
        radio=None if radio is None else parse_radio("\n".join(radio.lines)),
    )


def _first(lines: Sequence[str]) -> dict[str, Any]:
    found = json.loads("\n".join(lines))
    if not (isinstance(found, list) and found and isinstance(found[0], dict)):
        raise ValueError(f"expected what `ip -j` prints, found {str(found)[:80]!r}")
    return found[0]


def parse_radio(text: str) -> Radio:
    """What `iw dev IF link` and `iw dev IF get power_save` print."""

    def number(pattern: str) -> float | None:
        found = re.search(pattern, text)
        return float(found[1]) if found else None

    ssid = re.search(r"^\s*SSID: (.*)$", text, re.MULTILINE)
    saving = re.search(r"^Power save: (on|off)", text, re.MULTILINE)
    return Radio(
        ssid[1].strip() if ssid else None,
        number(r"freq: ([\d.]+)"),
        number(r"signal: (-?[\d.]+)"),
        number(r"tx bitrate: ([\d.]+)"),
        saving[1] == "on" if saving else None,
    )


# -- measured


@dataclass(frozen=True)
class Ping:
    """What `ping` counted."""

    sent: int
    received: int
    rtts_ms: tuple[float, ...]

    @property
    def loss(self) -> float:
        """The share that did not come back, 0 to 1."""
        return 1.0 - self.received / self.sent if self.sent else 0.0


def parse_ping(text: str) -> Ping:
    """What `ping -n` of iputils or busybox prints. Raises ValueError."""
    counted = re.search(r"(\d+) packets transmitted, (\d+) (?:packets )?received", text)
    if counted is None:
        raise ValueError(f"expected what ping prints, found {text.strip()[:80]!r}")
    rtts = tuple(float(found) for found in re.findall(r"\btime=([\d.]+) ?ms", text))
    return Ping(int(counted[1]), int(counted[2]), rtts)


def jitter_ms(rtts_ms: Sequence[float]) -> float | None:
    """Mean difference between neighbours, as RFC 3550 (6.4.1) understands jitter; None of fewer than two."""
    if len(rtts_ms) < 2:
        return None
    return statistics.fmean(abs(after - before) for before, after in itertools.pairwise(rtts_ms))


@dataclass(frozen=True)
class Quality:
    """The link as it was measured; None where it could not be."""

    rtt_ms: float | None = None  # median, a request of some bytes over the open connection
    rtt_p95_ms: float | None = None
    jitter_ms: float | None = None
    loss: float | None = None
    down_mbps: float | None = None  # robot → laptop
    up_mbps: float | None = None
    multicast_down: bool | None = None
    multicast_up: bool | None = None


# -- judged


def roam_risk(manager: NetworkManager | None, interface: str) -> list[str]:
    """Saved networks that may take the radio away from the one that it is on now, each as a sentence."""
    if manager is None or not manager.running:
        return []
    device = next((each for each in manager.devices if each.name == interface), None)
    active = next((each for each in manager.profiles if device is not None and each.name == device.connection), None)
    if active is None or not active.wireless:
        return []
    rivals = [p for p in manager.profiles if p.wireless and p.autoconnect and p != active and p.priority >= active.priority]
    return [
        f"{active.name} has autoconnect priority {active.priority}, {rival.name} {rival.priority}: the radio may roam there"
        for rival in rivals
    ]


@dataclass(frozen=True)
class Choice:
    """A transport, as it stands today. `troubles` lower it behind those that have none."""

    transport: str
    address: str
    answers: bool
    why: str
    troubles: tuple[str, ...] = field(default=())


def troubles_of(way: Way | None, far: Way | None, quality: Quality | None, risks: Sequence[str]) -> list[str]:
    """What speaks against the link that is in use, each as a sentence."""
    found = list(risks)
    for side, name in ((way, "this machine"), (far, "the robot")):
        if side is None:
            continue
        if not side.multicast:
            found.append(f"{name}'s {side.interface} takes no multicast")
        if side.mtu and side.mtu < 1500:
            found.append(f"{name}'s {side.interface} has an MTU of {side.mtu}: samples are cut into more pieces")
        if side.radio is not None and side.radio.power_save:
            found.append(
                f"{name}'s {side.interface} saves power: samples wait for it (iw dev {side.interface} set power_save off)"
            )
        if side.radio is not None and side.radio.signal_dbm is not None and side.radio.signal_dbm < WEAK_SIGNAL_DBM:
            found.append(f"{name} hears only {side.radio.signal_dbm:g} dBm")
    if way is not None and way.source and ip_address(way.source) in HOTSPOT:
        found.append("this is a phone's hotspot: it drops SSH and multicast, and stalls for 300 ms and more")
    if quality is not None:
        if quality.jitter_ms is not None and quality.jitter_ms > JITTER_LIMIT_MS:
            found.append(f"jitter of {quality.jitter_ms:.0f} ms")
        if quality.loss is not None and quality.loss > LOSS_LIMIT:
            found.append(f"{quality.loss:.0%} of the packets are lost")
        slow = [mbps for mbps in (quality.down_mbps, quality.up_mbps) if mbps is not None and mbps < THROUGHPUT_FLOOR_MBPS]
        if slow:
            found.append(f"only {min(slow):.1f} Mbit/s")
        if False in (quality.multicast_down, quality.multicast_up):
            found.append("multicast does not pass: discovery needs the server")
    return found


def homing_trouble(transport: str, announced: Sequence[str]) -> list[str]:
    """A robot on several networks announces an address that the laptop has no way to: commands go nowhere."""
    if transport != "ap" and len(announced) > 1:
        return [f"the robot is on several networks ({', '.join(announced)}): commands may go nowhere (lupin play single-home)"]
    return []


def rank(addresses: Mapping[str, str], answering: Mapping[str, bool], troubles: Mapping[str, Sequence[str]]) -> list[Choice]:
    """Every transport, best first: those that answer before those that don't, the untroubled before the troubled, and within
    that the project's order."""
    choices = [
        Choice(name, addresses.get(name, ""), answering.get(name, False), WHY[name], tuple(troubles.get(name, ())))
        for name in TRANSPORTS
    ]
    return sorted(choices, key=lambda choice: (not choice.answers, bool(choice.troubles)))
