"""Parsers of route, radio and ping; problems of a link; ranking of transports."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import icmplib
import pytest

from lupin_cli.connection.base import Output, Script
from lupin_cli.connection.local import LocalTarget
from lupin_cli.facts.networkmanager import Device, NetworkManager, Profile
from lupin_cli.link.quality import Ping, Quality, jitter_ms, parse_ping, ping
from lupin_cli.link.ranking import link_problems, multihoming_problems, rank, roaming_risks
from lupin_cli.link.route import Radio, Route, parse_radio, parse_route, route_probe

CABLE = """\
@@ route
[{"dst":"10.42.0.1","dev":"enx00e04c680001","prefsrc":"10.42.0.2","flags":[],"uid":1000,"cache":[]}]
@@ link
[{"ifindex":3,"ifname":"enx00e04c680001","flags":["BROADCAST","MULTICAST","UP","LOWER_UP"],"mtu":1500,"qdisc":"fq_codel",
"operstate":"UP","stats64":{"rx":{"bytes":1,"packets":1,"errors":2,"dropped":3,"over_errors":0,"multicast":9},
"tx":{"bytes":1,"packets":1,"errors":0,"dropped":0,"carrier_errors":1,"collisions":0}}}]
@@ end
"""
IW = """\
Connected to 0a:1b:2c:3d:4e:5f (on wlp2s0)
\tSSID: Mirte-247264
\tfreq: 2437
\tRX: 48211 bytes (312 packets)
\tsignal: -58 dBm
\trx bitrate: 65.0 MBit/s MCS 7
\ttx bitrate: 72.2 MBit/s MCS 7 short GI
Power save: on
"""
IPUTILS = """\
PING 10.42.0.1 (10.42.0.1) 56(84) bytes of data.
64 bytes from 10.42.0.1: icmp_seq=1 ttl=64 time=0.5 ms
64 bytes from 10.42.0.1: icmp_seq=2 ttl=64 time=1.5 ms
64 bytes from 10.42.0.1: icmp_seq=4 ttl=64 time=1 ms

--- 10.42.0.1 ping statistics ---
4 packets transmitted, 3 received, 25% packet loss, time 3005ms
rtt min/avg/max/mdev = 0.500/1.000/1.500/0.400 ms
"""
BUSYBOX = """\
PING 10.42.0.1 (10.42.0.1): 56 data bytes
64 bytes from 10.42.0.1: seq=0 ttl=64 time=0.512 ms

--- 10.42.0.1 ping statistics ---
1 packets transmitted, 1 packets received, 0% packet loss
round-trip min/avg/max = 0.512/0.512/0.512 ms
"""
ROUTE = Route("enx0", "10.42.0.2", "", 1500, True, True, 0, None)


def test_cable_route_is_parsed_from_ip_output() -> None:
    route = parse_route(Output(0, CABLE))
    assert route == Route("enx00e04c680001", "10.42.0.2", "", 1500, True, True, 6, None)


def test_radio_is_parsed_from_iw_output() -> None:
    radio = Radio("Mirte-247264", 2437.0, -58.0, 72.2, True)
    assert parse_radio(IW) == radio
    assert parse_route(Output(0, CABLE.replace("@@ end", f"@@ radio\n{IW}@@ end"))).radio == radio
    assert parse_radio("Not connected.\n") == Radio()
    assert parse_route(Output(0, CABLE.replace("@@ end", "@@ radio\n@@ end"))).radio == Radio()  # iw is not installed


@pytest.mark.parametrize(
    "output",
    [
        Output(3, "", "RTNETLINK answers: Network is unreachable"),
        Output(None, ""),
        Output(0, CABLE.removesuffix("@@ end\n")),
        Output(0, CABLE.replace('[{"dst"', '{"dst"')),
        Output(0, "@@ route\n[]\n@@ link\n[]\n@@ end\n"),
    ],
)
def test_unusable_route_output_is_rejected(output: Output) -> None:
    with pytest.raises(ValueError, match=r".+"):
        parse_route(output)


def test_route_probe_accepts_only_addresses() -> None:
    with pytest.raises(ValueError, match="IPv4 or IPv6"):
        route_probe("10.42.0.1; reboot")


def test_ping_of_iputils_and_busybox_is_parsed() -> None:
    assert parse_ping(IPUTILS) == Ping(4, 3, (0.5, 1.5, 1.0)) and parse_ping(IPUTILS).loss == 0.25
    assert parse_ping(BUSYBOX) == Ping(1, 1, (0.512,))
    with pytest.raises(ValueError, match="ping"):
        parse_ping("ping: socket: Operation not permitted")


class PingProgram(LocalTarget):
    """This machine, with a ping(1) that prints IPUTILS."""

    def batch(self, scripts: Sequence[Script], timeout_s: float = 10.0) -> dict[str, Output]:  # noqa: ARG002 -- Target's signature
        return {script.name: Output(0, IPUTILS) for script in scripts}


class ScriptedSocket:
    """An ICMP socket without a network: each request gets the replies that `replies` returns for it."""

    error: Exception | None = None
    replies: Callable[[icmplib.ICMPRequest], list[icmplib.ICMPReply]] = staticmethod(lambda _: [])

    def __init__(self, *, privileged: bool) -> None:
        if isinstance(self.error, icmplib.SocketPermissionError):
            raise self.error
        self.privileged, self.waiting = privileged, list[icmplib.ICMPReply]()

    def __enter__(self) -> ScriptedSocket:
        return self

    def __exit__(self, *_: object) -> None:
        return

    def send(self, request: icmplib.ICMPRequest) -> None:
        if self.error is not None:
            raise self.error
        request._time = time.time()
        self.waiting += self.replies(request)

    def receive(self, _: None, timeout: float) -> icmplib.ICMPReply:
        if not self.waiting:
            time.sleep(timeout)
            raise icmplib.TimeoutExceeded(timeout)
        return self.waiting.pop(0)


def test_ping_counts_each_reply_to_its_own_requests_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def reply(request: icmplib.ICMPRequest, ms: float, type: int = 0, **other: Any) -> icmplib.ICMPReply:
        fields = {"source": request.destination, "id": request.id, "sequence": request.sequence, **other}
        return icmplib.ICMPReply(family=4, type=type, code=0, bytes_received=64, time=request.time + ms / 1e3, **fields)

    def replies(request: icmplib.ICMPRequest) -> list[icmplib.ICMPReply]:
        right = reply(request, 1.0)
        other_program, elsewhere = reply(request, 1.0, id=request.id ^ 1), reply(request, 1.0, source="10.0.0.9")
        unreachable, late = reply(request, 1.0, type=3), reply(request, 80.0)
        return [[other_program, right, right], [unreachable, elsewhere], [right], [late]][request.sequence]

    monkeypatch.setattr(ScriptedSocket, "replies", staticmethod(replies))
    monkeypatch.setattr(icmplib, "ICMPv4Socket", ScriptedSocket)
    found = ping(PingProgram(), "10.42.0.1", 4, 0.01, 0.05)
    assert found is not None and (found.sent, found.received) == (4, 2)
    assert found.rtts_ms == pytest.approx((1.0, 1.0), abs=0.01)


@pytest.mark.parametrize(
    "error", [icmplib.SocketPermissionError(True), icmplib.ICMPSocketError("unreachable")], ids=["no permission", "no route"]
)
def test_ping_falls_back_to_ping_program(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    monkeypatch.setattr(ScriptedSocket, "error", error)
    monkeypatch.setattr(icmplib, "ICMPv4Socket", ScriptedSocket)
    assert ping(PingProgram(), "10.42.0.1", 4, 0.01, 0.05) == Ping(4, 3, (0.5, 1.5, 1.0))


def test_jitter_is_mean_difference_of_consecutive_round_trips() -> None:
    assert jitter_ms([1.0, 3.0, 2.0]) == 1.5
    assert jitter_ms([1.0]) is None


def manager(*profiles: Profile) -> NetworkManager:
    return NetworkManager(True, (Device("wlp2s0", "wifi", "connected", "Mirte-247264", ""),), profiles)


def wifi(name: str, priority: int, autoconnect: bool = True) -> Profile:
    return Profile(name, True, autoconnect, priority, name.startswith("Mirte"), "")


def test_saved_network_of_equal_priority_is_roaming_risk() -> None:
    assert len(roaming_risks(manager(wifi("Mirte-247264", 0), wifi("eduroam", 0)), "wlp2s0")) == 1
    assert roaming_risks(manager(wifi("Mirte-247264", 100), wifi("eduroam", 0)), "wlp2s0") == []
    assert roaming_risks(manager(wifi("Mirte-247264", 0), wifi("eduroam", 0, autoconnect=False)), "wlp2s0") == []
    assert roaming_risks(manager(wifi("Mirte-247264", 0), wifi("eduroam", 0)), "enx0") == []
    assert roaming_risks(None, "wlp2s0") == roaming_risks(NetworkManager(False), "wlp2s0") == []


@pytest.mark.parametrize(
    ("route", "quality", "words"),
    [
        (replace(ROUTE, multicast=False), None, "does not support multicast"),
        (replace(ROUTE, mtu=1280), None, "MTU of 1280"),
        (replace(ROUTE, source="172.20.10.4"), None, "hotspot"),
        (replace(ROUTE, radio=Radio(power_save=True)), None, "saves power"),
        (replace(ROUTE, radio=Radio(signal_dbm=-78.0)), None, "-78 dBm"),
        (ROUTE, Quality(jitter_ms=80.0), "jitter of 80 ms"),
        (ROUTE, Quality(loss=0.1), "10% of the packets"),
        (ROUTE, Quality(down_mbps=50.0, up_mbps=1.5), "only 1.5 Mbit/s"),
        (ROUTE, Quality(multicast_down=True, multicast_up=False), "multicast does not pass"),
    ],
)
def test_each_problem_of_link_is_named(route: Route, quality: Quality | None, words: str) -> None:
    (problem,) = link_problems(route, ROUTE, quality, [])
    assert words in problem


def test_good_link_has_no_problem() -> None:
    good = Quality(1.0, 2.0, 0.2, 0.0, 90.0, 90.0, True, True)
    assert link_problems(ROUTE, ROUTE, good, []) == [] == link_problems(None, None, None, [])


def test_multihoming_is_problem_except_on_access_point() -> None:
    assert "lupin play single-home --robot pot-1" in multihoming_problems("pot-1", "wired", ["10.42.0.1", "192.168.42.1"])[0]
    assert (
        multihoming_problems("pot-1", "wired", ["10.42.0.1"])
        == multihoming_problems("pot-1", "ap", ["10.42.0.1", "192.168.42.1"])
        == []
    )


def test_rank_is_by_answer_then_problems_then_project_order() -> None:
    addresses = {"wired": "a", "router": "b", "ap": "c"}
    everything = dict.fromkeys(addresses, True)

    def order(answering: dict[str, bool], problems: dict[str, list[str]]) -> list[str]:
        return [choice.transport for choice in rank(addresses, answering, problems)]

    assert order(everything, {}) == ["wired", "router", "ap"]
    assert order({"ap": True}, {}) == ["ap", "wired", "router"]
    assert order(everything, {"wired": ["10% of the packets are lost"]}) == ["router", "ap", "wired"]
    assert order({"wired": True}, {"wired": ["jitter"]}) == ["wired", "router", "ap"]
