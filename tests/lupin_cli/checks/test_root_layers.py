"""Layer and machine of the root cause, for each layer of the path × the end at fault × the kind of fault.

Each row has what both ends show: addresses, interfaces, packets that were sent and counted, as kernels count such a fault.
tests/lupin_cli/link/test_path.py measures the same where a network namespace can have the fault.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from lupin_cli.checks.base import Severity, Snapshot
from lupin_cli.checks.drive import CHECKS as DRIVE
from lupin_cli.checks.drive import SILENT_BUTTON
from lupin_cli.checks.ground_truth import CHECKS as GROUND_TRUTH
from lupin_cli.checks.ground_truth import State
from lupin_cli.checks.link import CHECKS as LINK
from lupin_cli.checks.path import CHECKS as PATH
from lupin_cli.checks.path import find_path_faults
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts.addresses import Address, Addresses
from lupin_cli.facts.base import Facts
from lupin_cli.facts.clock import Offset
from lupin_cli.facts.graph import Graph, Graphs
from lupin_cli.facts.link import Link
from lupin_cli.facts.routes import RouteEntry, RoutingTable
from lupin_cli.link.path import DOWN, UP, Burst, End, Knock, Path
from lupin_cli.link.quality import Ping
from lupin_runtime.safety.expected_sources import BUTTON, UNHEARD
from tests.lupin_cli.checks.test_ground_truth import received
from tests.support.findings import assert_findings_match_rows
from tests.support.optional import present

LAPTOP, ROBOT, AP_LAPTOP, AP_ROBOT = "10.42.0.2", "10.42.0.1", "192.168.42.7", "192.168.42.1"
LAN0 = Address("lan0", LAPTOP, 24, "global", up=True, carrier=True)
WIFI0 = Address("wifi0", AP_LAPTOP, 24, "global", up=True, carrier=True)
ETH0 = Address("eth0", ROBOT, 24, "global", up=True, carrier=True)
WLAN0 = Address("wlan0", AP_ROBOT, 24, "global", up=True, carrier=True)
TAIL0 = replace(LAN0, interface="tailscale0")
LAPTOP_END = End("laptop", "lan0", LAPTOP, "", 1500)
ROBOT_END = End("robot", "eth0", ROBOT, "", 1500)
NO_ROUTE = "RTNETLINK answers: Network is unreachable"
PORTS = tuple(range(7410, 7418))
ALIVE, DEAD = Ping(6, 6, (0.4,) * 6), Ping(6, 0, ())
RULE = 'oifname "lan0" meta l4proto udp numgen random mod 100 < 60 counter packets 58 bytes 9 @th,64,32 set 0xdeadbeef'


def burst(direction: str, **fields: Any) -> Burst:
    """96 small packets to eight ports, all of which arrived."""
    return replace(Burst(direction, PORTS, 200, 96, 96, left=96, reached=96, filtered=0), **fields)


def lost(at: str, number: int) -> dict[str, Any]:
    """Return the counts if `number` of the 96 packets are lost: at the sender, the link or the receiver."""
    left = 96 - number
    if at == "kernel":  # its own packet filter refuses to send them
        return {"sent": left, "errors": {"Operation not permitted": number}, "arrived": left, "left": left, "reached": left}
    if at == "sender":
        return {"arrived": left, "left": left, "reached": left}
    if at == "link":
        return {"arrived": left, "left": 96, "reached": left}
    return {"arrived": left, "left": 96, "reached": 96, "filtered": number}


@dataclass(frozen=True)
class Row:
    """What both ends show, and the layers and machines of the roots. `robot` is None if nobody can log in there."""

    name: str
    expected: set[tuple[str, str]]
    up: Mapping[str, Any] = field(default_factory=dict)
    down: Mapping[str, Any] = field(default_factory=dict)
    more: tuple[Burst, ...] = ()
    laptop: tuple[Address, ...] = (LAN0, WIFI0)
    robot: tuple[Address, ...] | None = (ETH0, WLAN0)
    laptop_end: End = LAPTOP_END
    robot_end: End | None = ROBOT_END
    ping: Ping = ALIVE
    large_ping: Ping | None = None
    kind: str = ""  # of the failed login
    answers: Mapping[int, str] = field(default_factory=dict)
    knock: Knock | None = None
    filters: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    transport: str = "wired"
    address: str = ROBOT  # of the failed login
    addresses: Mapping[str, str] = field(default_factory=dict)  # of the robot in the inventory

    @property
    def snapshot(self) -> Snapshot:
        """The input of the checks: nothing of the robot arrives at the laptop."""
        measured = self.robot_end is not None and not self.robot_end.error and not self.laptop_end.error
        bursts = (burst(UP, **self.up), burst(DOWN, **self.down), *self.more) if measured else ()
        path = Path(
            ROBOT,
            self.laptop_end,
            self.robot_end,
            bursts,
            self.ping,
            answers=self.answers,
            large_ping=self.large_ping,
            knock=self.knock,
            filters=self.filters,
        )
        live = [each for each in self.laptop if each.up and each.carrier]
        networks = {LAN0.interface: "10.42.0.0/24", TAIL0.interface: "10.42.0.0/24", WIFI0.interface: "192.168.42.0/24"}
        live = [each for each in live if not each.address.startswith("10.42.188.")]
        routes = RoutingTable(tuple(RouteEntry(networks[each.interface], each.interface) for each in live))
        laptop = {"addresses": Addresses(self.laptop), "routes": routes, "graph": Graphs((Graph("robot", "robot", ()),))}
        robot = None if self.robot is None else Facts("robot", {"addresses": Addresses(self.robot)})
        link = Link(
            "greenhouse",
            self.address,
            addresses=self.addresses,
            kind=self.kind,
            message=f"{ROBOT}: {self.kind}",
            next_command="ping -c 3 10.42.0.1" if self.kind == "timeout" else "",
            login="ssh mirte@10.42.0.1",
            transport=self.transport,
        )
        return Snapshot(Facts("laptop", laptop), robot, link, path)


UNASKED: dict[str, Any] = {"robot": None, "robot_end": None}
BY_TUNNEL: dict[str, Any] = {
    "laptop": (TAIL0,),
    "laptop_end": End("laptop", "tailscale0", LAPTOP, "", 1280),
    "robot": (replace(ETH0, interface="tailscale0"),),
    "robot_end": End("robot", "tailscale0", ROBOT, "", 1280),
}
DOWN_LAN0, PULLED_LAN0 = replace(LAN0, up=False, carrier=False), replace(LAN0, carrier=False)
DOWN_ETH0, PULLED_ETH0 = replace(ETH0, up=False, carrier=False), replace(ETH0, carrier=False)
OTHER_LAN0, OTHER_ETH0 = replace(LAN0, address="10.42.188.134"), replace(ETH0, address="10.42.188.1")
NETEM = "qdisc netem 8001: root refcnt 2 limit 1000 delay 300ms"
WRONG = f"{ROBOT} lladdr 02:00:00:00:00:99 PERMANENT"
LOST_ROUTE = End("laptop", error=NO_ROUTE)
CLOSED, SERVER, FREE = 7399, 11811, 7599
REFUSED = dict.fromkeys((CLOSED, FREE, SERVER), "refused")
NO_LOGIN = {**UNASKED, "kind": "refused"}
LOGIN = ("login", "robot")


def paced(direction: str, arrived: int, silent: tuple[int, ...] = ()) -> Burst:
    """24 packets that are sent slowly."""
    return burst(direction, sent=24, arrived=arrived, left=24, reached=24, silent_ports=silent, paced=True)


def one_way(direction: str, counts: dict[str, Any]) -> dict[str, Any]:
    """Return the field of a row with the counts of one direction."""
    return {direction: counts}


def large(direction: str, arrived: int, **fields: Any) -> Burst:
    """20 packets of the size of Ethernet's MTU."""
    return burst(
        direction, ports=PORTS[:2], size=1472, sent=20, **{"arrived": arrived, "left": 20, "reached": arrived, **fields}
    )


def too_long(direction: str) -> Burst:
    """20 packets of the size of Ethernet's MTU that the sender's own interface is too small for."""
    return replace(large(direction, 0), sent=0, left=0, errors={"Message too long": 20})


def fragmented(direction: str, arrived: int) -> Burst:
    """20 packets that the sender may fragment."""
    return replace(large(direction, arrived), size=8000, left=140, reached=7 * arrived)


def in_use(direction: str, port: int, at: str) -> Burst:
    """40 packets to a port of a running program, all lost at the sender, the link or the receiver."""
    counts: dict[str, dict[str, Any]] = {
        "kernel": {"sent": 0, "errors": {"Operation not permitted": 40}, "left": 2, "reached": 2},
        "link": {"left": 42, "reached": 2},
        "receiver": {"left": 42, "reached": 42, "filtered": 40},
    }
    return burst(direction, ports=(port,), **{"sent": 40, "arrived": None, **counts[at]})


ROWS = (
    # -- carrier: switched off is its machine's fault; no carrier is that of what is between
    Row("carrier, laptop off", {("carrier", "laptop")}, laptop=(DOWN_LAN0,), laptop_end=LOST_ROUTE, kind="no-route", **UNASKED),
    Row("carrier, cable out", {("carrier", "link")}, laptop=(PULLED_LAN0,), laptop_end=LOST_ROUTE, kind="no-route", **UNASKED),
    Row("carrier, cable out beside wifi", {("carrier", "link")}, laptop=(PULLED_LAN0, WIFI0), robot=(PULLED_ETH0, WLAN0),
        laptop_end=LOST_ROUTE, robot_end=None),
    Row("carrier, robot off", {("carrier", "robot")}, laptop=(PULLED_LAN0, WIFI0), robot=(DOWN_ETH0, WLAN0),
        laptop_end=LOST_ROUTE, robot_end=None),
    Row("carrier, robot off behind a switch", {("carrier", "robot")}, robot=(DOWN_ETH0, WLAN0), ping=DEAD,
        robot_end=End("robot", error=NO_ROUTE)),
    Row("carrier, robot unplugged behind a switch", {("carrier", "link")}, robot=(PULLED_ETH0, WLAN0), ping=DEAD,
        robot_end=End("robot", error=NO_ROUTE)),
    Row("carrier, dead switch", {("carrier", "link")}, lost("link", 96), lost("link", 96), ping=DEAD),
    Row("carrier, dead switch and ARP", {("carrier", "link")}, {**lost("sender", 96), "unresolved": True},
        {**lost("sender", 96), "unresolved": True}, ping=DEAD),
    Row("carrier, nothing answers", {("carrier", "link")}, ping=DEAD, kind="timeout", **UNASKED),
    # -- address
    Row("address, laptop lost it", {("address", "laptop")}, laptop=(WIFI0,), laptop_end=LOST_ROUTE, kind="no-route", **UNASKED),
    Row("address, laptop has another", {("address", "laptop")}, laptop=(OTHER_LAN0,), laptop_end=LOST_ROUTE, kind="no-route",
        **UNASKED),
    Row("address, laptop leaves by its gateway", {("address", "laptop")}, laptop=(WIFI0,), ping=DEAD, kind="timeout",
        laptop_end=End("laptop", "wifi0", AP_LAPTOP, "192.168.42.254", 1500), **UNASKED),
    Row("carrier, nothing answers behind a gateway", {("carrier", "link")}, laptop=(WIFI0,), ping=DEAD, kind="timeout",
        laptop_end=End("laptop", "wifi0", AP_LAPTOP, "192.168.42.254", 1500), transport="", **UNASKED),
    Row("carrier, nothing answers at its other address", {("carrier", "link")}, laptop=(WIFI0,), ping=DEAD, kind="timeout",
        laptop_end=End("laptop", "wifi0", AP_LAPTOP, "192.168.42.254", 1500), address=AP_ROBOT, transport="ap",
        addresses={"ap": AP_ROBOT, "router": ROBOT}, **UNASKED),
    Row("address, robot lost it", {("address", "robot")}, robot=(WLAN0,), robot_end=End("robot", error=NO_ROUTE), ping=DEAD),
    Row("address, robot has another", {("address", "robot")}, robot=(OTHER_ETH0, WLAN0), ping=DEAD,
        robot_end=End("robot", error=NO_ROUTE)),
    Row("address, both lost it", {("address", "robot"), ("address", "laptop")}, laptop=(WIFI0,), robot=(WLAN0,),
        laptop_end=LOST_ROUTE, robot_end=ROBOT_END, ping=DEAD),
    # Packets arrive there: the address is link-local, or something in between translates it.
    Row("address, link-local", {("samples", "link")}, robot=(replace(ETH0, scope="link"), WLAN0)),
    Row("address, translated on the way", {("samples", "link")}, robot=(OTHER_ETH0, WLAN0)),
    Row("login, beside closed ports that do not answer", {LOGIN, ("samples", "link")}, kind="authentication",
        answers={CLOSED: "silent", FREE: "refused", SERVER: "refused"}, **UNASKED),
    # -- route
    Row("route, laptop has none", {("route", "laptop")}, laptop_end=LOST_ROUTE, kind="no-route", **UNASKED),
    Row("route, laptop leaves by wifi", {("route", "laptop")}, lost("link", 96), lost("link", 96), ping=DEAD,
        laptop_end=End("laptop", "wifi0", AP_LAPTOP, "", 1500)),
    Row("route, robot has none", {("route", "robot")}, robot_end=End("robot", error=NO_ROUTE)),
    Row("route, robot leaves by wlan0", {("route", "robot")}, lost("link", 96), lost("link", 20), ping=DEAD,
        robot_end=End("robot", "wlan0", AP_ROBOT, "", 1500)),
    Row("route, rp_filter of the robot", {("route", "robot")}, {**lost("receiver", 96), "reverse_path": 96}),
    # -- mtu
    Row("mtu, robot", {("mtu", "robot")}, more=(large(UP, 0),), robot_end=replace(ROBOT_END, mtu=600)),
    Row("mtu, laptop", {("mtu", "laptop")}, more=(large(DOWN, 0),), laptop_end=replace(LAPTOP_END, mtu=600)),
    Row("mtu, a filter of the robot by length", {("mtu", "robot")}, more=(large(UP, 0, reached=20, filtered=20),)),
    Row("mtu, in between", {("mtu", "link")}, more=(large(UP, 0),)),
    Row("mtu, in between, and fragments pass", {("mtu", "link")}, more=(large(UP, 0), fragmented(UP, 20))),
    # What DDS sends is fragmented by the machine whose MTU is too small for it.
    Row("mtu, of a tunnel", {("samples", "link")}, **BY_TUNNEL,
        more=(too_long(UP), fragmented(UP, 20), too_long(DOWN), fragmented(DOWN, 20))),
    Row("mtu, of a tunnel to a gateway", {("samples", "link")}, **{**BY_TUNNEL, "robot": (ETH0,), "robot_end": ROBOT_END},
        more=(too_long(UP), fragmented(UP, 20), large(DOWN, 0), fragmented(DOWN, 20))),
    Row("mtu, of a laptop whose fragments pass", {("samples", "link")}, laptop_end=replace(LAPTOP_END, mtu=600),
        more=(too_long(UP), fragmented(UP, 20))),
    Row("loss, fragments that arrive twice are not joined", {("loss", "link")},
        more=(large(UP, 20), replace(fragmented(UP, 0), left=120, reached=155))),
    Row("mtu, fragments lost in a tunnel", {("mtu", "link")}, **BY_TUNNEL,
        more=(too_long(UP), fragmented(UP, 0))),
    # -- loss: packets to any port
    Row("loss, link at random", {("loss", "link")}, lost("link", 29), lost("link", 33)),
    Row("loss, one packet in fourteen, damaged", {("loss", "link")}, {**lost("receiver", 7), "filtered": 0, "damaged": 7}),
    Row("loss, three of 96 packets are no cause", {("samples", "link")}, lost("link", 3)),
    Row("loss, link one way", {("loss", "link")}, lost("link", 29)),
    Row("loss, flipped bits", {("loss", "link")}, {**lost("receiver", 25), "filtered": 0, "damaged": 25},
        {**lost("receiver", 27), "filtered": 0, "damaged": 27}),
    Row("loss, damaged frames", {("loss", "link")}, {**lost("link", 60), "damaged": 60}),
    Row("loss, most bits flipped", {("loss", "link")}, {**lost("receiver", 94), "filtered": 0, "damaged": 94}),
    Row("loss, nobody answers ARP", {("loss", "link")}, {**lost("sender", 96), "unresolved": True}),
    *(
        Row(f"loss, a share of {machine}'s {at}", {("loss", machine)}, **one_way(direction, lost(at, 40)))
        for direction, at, machine in (
            ("up", "kernel", "laptop"), ("up", "sender", "laptop"), ("up", "receiver", "robot"),
            ("down", "kernel", "robot"), ("down", "sender", "robot"), ("down", "receiver", "laptop"),
        )
    ),
    *(
        Row(f"loss, a rate of {machine}'s {at}", {("loss", machine)},
            more=(paced(direction, 22, PORTS[:1]), in_use(direction, 7430, at)),
            **one_way(direction, {**lost(at, 91), "silent_ports": PORTS[3:]}))
        for direction, at, machine in (
            ("up", "kernel", "laptop"), ("up", "receiver", "robot"), ("down", "kernel", "robot"), ("down", "receiver", "laptop")
        )
    ),
    Row("loss, a rate that nothing of a burst passes", {("loss", "robot")}, lost("receiver", 96),
        more=(paced(UP, 6, PORTS[2:]),)),
    Row("loss, a limit of bytes", {("loss", "laptop")}, lost("sender", 40), more=(paced(UP, 24), large(UP, 2, left=2))),
    Row("mtu, beside loss at random", {("loss", "link"), ("mtu", "robot")}, lost("link", 20),
        more=(paced(UP, 19), large(UP, 0)), robot_end=replace(ROBOT_END, mtu=600)),
    Row("loss, a rate that other traffic uses up", {("loss", "robot")}, down=lost("kernel", 96), more=(paced(DOWN, 0),),
        filters={"robot": ('oifname "eth0" meta l4proto udp limit rate over 10/second burst 5 packets counter drop',)}),
    Row("ports, beside a limit of logins", {("ports", "robot")}, lost("receiver", 96), more=(paced(UP, 0),),
        filters={"robot": ("tcp dport 22 ct state new limit rate over 10/minute drop",)}),
    Row("loss, overwritten by the laptop", {("loss", "laptop")}, {**lost("receiver", 58), "filtered": 0, "changed": 58},
        filters={"laptop": (RULE,)}),
    Row("loss, overwritten by the robot", {("loss", "robot")}, {**lost("receiver", 96), "filtered": 0, "changed": 96},
        filters={"robot": (RULE,)}),
    Row("loss, overwritten somewhere", {("loss", "link")}, {**lost("receiver", 58), "filtered": 0, "changed": 58}),
    Row("loss, delay", {("loss", "link")}, ping=Ping(6, 6, (300.0,) * 6)),
    Row("loss, delay by a discipline of the laptop", {("loss", "laptop")}, ping=Ping(6, 6, (300.0,) * 6),
        laptop_end=replace(LAPTOP_END, shaping=[NETEM])),
    Row("loss, delay by a discipline of the robot", {("loss", "robot")}, ping=Ping(6, 6, (300.0,) * 6),
        robot_end=replace(ROBOT_END, shaping=[NETEM])),
    Row("loss, disciplines of both ends", {("loss", "link")}, ping=Ping(6, 6, (300.0,) * 6),
        laptop_end=replace(LAPTOP_END, shaping=["qdisc tbf"]), robot_end=replace(ROBOT_END, shaping=["qdisc tbf"])),
    Row("address, wrong neighbor of the laptop", {("address", "laptop")}, laptop_end=replace(LAPTOP_END, neighbor=[WRONG]),
        robot_end=replace(ROBOT_END, hardware="02:00:00:00:00:01")),
    Row("address, wrong neighbor without a login", {("address", "laptop")}, ping=DEAD, kind="timeout",
        laptop_end=replace(LAPTOP_END, neighbor=[WRONG]), **UNASKED),
    Row("loss, right neighbor", {("loss", "link")}, ping=Ping(6, 6, (300.0,) * 6),
        laptop_end=replace(LAPTOP_END, neighbor=[WRONG]), robot_end=replace(ROBOT_END, hardware="02:00:00:00:00:99")),
    Row("loss, delay without a login", {("loss", "link")}, ping=Ping(12, 12, (3010.0,) * 12), kind="timeout",
        answers=dict.fromkeys(REFUSED, "silent"), **UNASKED),
    Row("loss, without a login", {("loss", "link")}, ping=Ping(6, 3, (0.5,) * 3), kind="timeout",
        answers={CLOSED: "silent", FREE: "refused", SERVER: "silent"}, **UNASKED),
    # -- ports: nothing to a port arrives, fast or slowly
    *(
        Row(f"ports, all UDP at {machine}'s {at}", {("ports", machine)}, **one_way(direction, lost(at, 96)),
            more=(paced(direction, 0),))
        for direction, at, machine in (
            ("up", "kernel", "laptop"), ("up", "link", "link"), ("up", "receiver", "robot"),
            ("down", "kernel", "robot"), ("down", "link", "link"), ("down", "receiver", "laptop"),
        )
    ),
    *(
        Row(f"ports, odd ones at {machine}'s {at}", {("ports", machine)},
            **one_way(direction, {**lost(at, 48), "silent_ports": PORTS[1::2]}),
            more=(paced(direction, 12, PORTS[1::2]),))
        for direction, at, machine in (("up", "kernel", "laptop"), ("up", "receiver", "robot"), ("down", "receiver", "laptop"))
    ),
    *(
        Row(f"ports, the server's at {at}", {("ports", machine)}, more=(in_use(UP, SERVER, at),))
        for at, machine in (("kernel", "laptop"), ("link", "link"), ("receiver", "robot"))
    ),
    Row("ports, filters of both ends", {("ports", "robot"), ("ports", "laptop")},
        more=(in_use(UP, SERVER, "receiver"), in_use(DOWN, 7412, "receiver"))),
    # -- ports without a login: what the laptop alone can know
    Row("ports, the server's, no login", {("ports", "link"), LOGIN}, answers={**REFUSED, SERVER: "silent"}, **NO_LOGIN),
    Row("ports, participants', no login", {("ports", "link"), LOGIN}, answers={**REFUSED, FREE: "silent"}, **NO_LOGIN),
    Row("ports, all UDP, no login", {("ports", "link"), LOGIN}, answers=dict.fromkeys(REFUSED, "silent"), **NO_LOGIN),
    Row("ports, laptop's own filter, no login", {("ports", "laptop"), LOGIN},
        answers={**REFUSED, SERVER: "Operation not permitted"}, **NO_LOGIN),
    # -- login: the files that decide it lie on one machine
    *(
        Row(f"login, {kind}", {("login", where), ("samples", "link")}, kind=kind, answers=REFUSED, **UNASKED)
        for kind, where in (
            ("refused", "robot"), ("silent", "robot"), ("authentication", "robot"), ("root", "robot"), ("timeout", "robot"),
            ("login-shell", "robot"),
            ("private-key", "laptop"), ("no-key", "laptop"), ("host-key-unknown", "laptop"), ("ssh-config", "laptop"),
            ("jump", "laptop"), ("name", "laptop"), ("lost", "link"), ("host-key-changed", "link"),
        )
    ),
    *(
        Row(f"login, timeout, {knock}", {("login", where), ("samples", "link")}, kind="timeout", answers=REFUSED, knock=knock,
            **UNASKED)
        for knock, where in (
            (Knock(), "robot"), (Knock(unsent=3), "laptop"), (Knock(taken=6), "laptop"), (Knock(0, 9, 3), "robot"),
        )
    ),
    Row("login, jump host and nothing else answers", {("login", "link"), ("samples", "link")}, kind="jump", ping=DEAD,
        **UNASKED),
    *(
        Row(f"carrier, nothing answers, beside {kind}", {("login", where), ("carrier", "link")}, kind=kind, ping=DEAD,
            answers=dict.fromkeys(REFUSED, "silent"), knock=Knock(), **UNASKED)
        for kind, where in (("ssh-config", "laptop"), ("jump", "link"), ("private-key", "laptop"), ("no-key", "laptop"))
    ),
    *(
        Row(f"mtu, {name}, large pings lost beside {kind}", {("mtu", machine)}, kind=kind, large_ping=Ping(6, 0, ()),
            answers=REFUSED, laptop_end=end, **UNASKED)
        for kind in ("silent", "timeout")
        for name, machine, end in (
            ("in between", "link", LAPTOP_END), ("of the laptop", "laptop", replace(LAPTOP_END, mtu=576)),
        )
    ),
    Row("login, large pings answered", {("login", "robot"), ("samples", "link")}, kind="silent", answers=REFUSED,
        large_ping=Ping(6, 6, (1.0,) * 6), **UNASKED),
    Row("login, sshd answers and ping does not, beside ssh-config", {("login", "laptop"), ("samples", "link")}, ping=DEAD,
        kind="ssh-config", answers=dict.fromkeys(REFUSED, "silent"), knock=Knock(answered=3), **UNASKED),
    Row("login, laptop's own counters beside ssh-config", {("login", "laptop"), ("samples", "link")}, kind="ssh-config",
        answers=REFUSED, knock=Knock(taken=6), **UNASKED),
)  # fmt: skip


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_root_has_layer_and_machine_of_the_fault(row: Row) -> None:
    diagnosis = diagnose((*GROUND_TRUTH, *LINK, *PATH), row.snapshot)
    assert_findings_match_rows(diagnosis)
    roots = [root.finding for root in diagnosis.roots if root.finding.severity is Severity.PROBLEM]
    assert {(finding.layer, finding.where) for finding in roots} == row.expected, [finding.cause for finding in roots]
    assert all(finding.evidence and all(finding.evidence) for finding in roots)


@pytest.mark.parametrize("number", [0, 12, 29, 60])
def test_data_that_comes_through_by_chance_is_not_healthy(number: int) -> None:
    """A program that joins meets the others with a burst of packets: it may hear nothing where the doctor heard all."""
    snapshot = Row("", set(), lost("sender", number)).snapshot
    laptop = replace(snapshot.laptop, values={**snapshot.laptop.values, "graph": Graphs((received(),))})
    link = replace(present(snapshot.link), kind="", message="")
    diagnosis = diagnose((*GROUND_TRUTH, *LINK, *PATH), replace(snapshot, laptop=laptop, link=link))
    truth = present(diagnosis.ground_truth)
    severities = [root.finding.severity for root in diagnosis.roots if root.finding.id == "packets-lost"]
    most, often = number > 48, number > 19
    assert severities == ([Severity.PROBLEM] if most else [Severity.WARNING] if number else [])
    assert truth.state is (State.UNOBSERVED if often else State.HEALTHY)
    assert any(f"{number / 96:.0%} of the packets" in line for line in truth.unobserved) is often


@pytest.mark.parametrize(("bound_s", "expected"), [(1.5, {("loss", "link")}), (0.1, {("samples", "link")})])
def test_delay_beyond_the_patience_of_ping_shows_over_ssh(bound_s: float, expected: set[tuple[str, str]]) -> None:
    snapshot = Row("", set(), ping=DEAD, robot_end=None).snapshot
    link = replace(present(snapshot.link), kind="", message="", clock=Offset(0.0, bound_s))
    diagnosis = diagnose((*GROUND_TRUTH, *LINK, *PATH), replace(snapshot, link=link))
    assert {(root.finding.layer, root.finding.where) for root in diagnosis.roots} == expected


def test_every_layer_of_the_path_has_rows() -> None:
    assert {row.name.partition(",")[0] for row in ROWS} == {"carrier", "address", "route", "mtu", "loss", "ports", "login"}


def test_silent_server_is_no_fault_while_no_program_asks_it() -> None:
    row = Row("ports", set(), answers={**REFUSED, SERVER: "silent"}, **NO_LOGIN)
    failed = {"graph": Graphs((Graph("robot", "robot", (), error="the graph probe exited with status 1"),))}
    laptop = replace(row.snapshot.laptop, values={**row.snapshot.laptop.values, **failed})
    diagnosis = diagnose((*GROUND_TRUTH, *LINK, *PATH), replace(row.snapshot, laptop=laptop))
    assert "udp-lost" not in [root.finding.id for root in diagnosis.roots]


@pytest.mark.parametrize(("at", "explains"), [("receiver", True), ("link", False)])
@pytest.mark.parametrize("reason", [f"{SILENT_BUTTON} for more than 2 s", UNHEARD[BUTTON], "the button is pressed"])
def test_filter_of_the_robot_explains_a_silent_button(at: str, explains: bool, reason: str) -> None:
    row = Row("ports", set(), more=(in_use(UP, SERVER, at),))
    facts = {"graph": Graphs((Graph("robot", "robot", (), nodes=("/estop_bridge",), estop=True, estop_reasons=(reason,)),))}
    laptop = replace(row.snapshot.laptop, values={**row.snapshot.laptop.values, **facts})
    diagnosis = diagnose((*GROUND_TRUTH, *LINK, *PATH, *DRIVE), replace(row.snapshot, laptop=laptop))
    roots = [root.finding.id for root in diagnosis.roots]
    assert ("estop-engaged" in roots) != (explains and reason != "the button is pressed")


def test_mtu_of_a_tunnel_hides_no_missing_part() -> None:
    tunnel = next(row for row in ROWS if row.name == "mtu, of a tunnel to a gateway")
    between = next(row for row in ROWS if row.name == "mtu, in between, and fragments pass")
    found = [[each for each in find_path_faults(row.snapshot) if each.layer == "mtu"] for row in (tunnel, between)]
    assert found[0] == []
    assert [(each.severity, "part-missing" in each.explains) for each in found[1]] == [(Severity.WARNING, False)]
    lost = next(row for row in ROWS if row.name == "mtu, fragments lost in a tunnel")
    assert not any("mtu 1500" in each.fix.command for each in find_path_faults(lost.snapshot))


@pytest.mark.parametrize(("arrived", "severity"), [(30, Severity.PROBLEM), (60, Severity.WARNING)])
def test_loss_of_most_packets_is_a_problem_whatever_arrives(arrived: int, severity: Severity) -> None:
    row = Row("loss", set(), {"arrived": arrived, "left": 96, "reached": arrived})
    laptop = replace(row.snapshot.laptop, values={**row.snapshot.laptop.values, "graph": Graphs((received(),))})
    diagnosis = diagnose((*GROUND_TRUTH, *LINK, *PATH), replace(row.snapshot, laptop=laptop))
    assert [(root.finding.id, root.finding.severity) for root in diagnosis.roots] == [("packets-lost", severity)]


@pytest.mark.parametrize(
    ("received_pings", "severity"), [(20, Severity.PROBLEM), (30, Severity.WARNING), (36, None), (0, None)]
)
@pytest.mark.parametrize("shaped", [False, True])
@pytest.mark.parametrize("robot_end", [None, ROBOT_END])
def test_lost_pings_that_were_sent_at_once_tell_of_a_limit(
    received_pings: int, severity: Severity | None, shaped: bool, robot_end: End | None
) -> None:
    end = replace(LAPTOP_END, shaping=("qdisc tbf 8001: root rate 384Kbit",)) if shaped else LAPTOP_END
    row = Row("loss", set(), robot_end=robot_end, laptop_end=end)
    laptop = replace(row.snapshot.laptop, values={**row.snapshot.laptop.values, "graph": Graphs((received(),))})
    path = replace(present(row.snapshot.path), burst_ping=Ping(40, received_pings, (5.0,) * received_pings))
    link = replace(present(row.snapshot.link), kind="", message="")
    diagnosis = diagnose((*GROUND_TRUTH, *LINK, *PATH), replace(row.snapshot, laptop=laptop, path=path, link=link))
    where = "laptop" if shaped else "link"
    found = [(root.finding.id, root.finding.where, root.finding.severity) for root in diagnosis.roots]
    assert found == ([("packets-lost", where, severity)] if severity is not None else [])
    assert (present(diagnosis.ground_truth).state is State.UNOBSERVED) == (severity is Severity.PROBLEM)


@pytest.mark.parametrize(("received_pings", "severity"), [(3, Severity.PROBLEM), (8, Severity.WARNING)])
def test_ping_over_a_lossy_link_counts_both_ways(received_pings: int, severity: Severity) -> None:
    row = Row("loss", set(), robot_end=None, ping=Ping(20, received_pings, (150.0,) * received_pings))
    laptop = replace(row.snapshot.laptop, values={**row.snapshot.laptop.values, "graph": Graphs((received(),))})
    diagnosis = diagnose((*GROUND_TRUTH, *LINK, *PATH), replace(row.snapshot, laptop=laptop))
    assert [(root.finding.id, root.finding.severity) for root in diagnosis.roots] == [("packets-lost", severity)]
