"""What the two machines print, read and judged."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lupin_cli.facts.networkmanager import Device, NetworkManager, Profile
from lupin_cli.target.base import Output
from lupin_cli.transport import (
    Ping,
    Quality,
    Radio,
    Way,
    homing_trouble,
    jitter_ms,
    parse_ping,
    parse_radio,
    parse_way,
    rank,
    roam_risk,
    troubles_of,
    way_probe,
)

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
WAY = Way("enx0", "10.42.0.2", "", 1500, True, True, 0, None)


def test_a_cable_is_read_from_what_ip_prints() -> None:
    way = parse_way(Output(0, CABLE))
    assert way == Way("enx00e04c680001", "10.42.0.2", "", 1500, True, True, 6, None)


def test_a_radio_is_read_from_what_iw_prints() -> None:
    radio = Radio("Mirte-247264", 2437.0, -58.0, 72.2, True)
    assert parse_radio(IW) == radio
    assert parse_way(Output(0, CABLE.replace("@@ end", f"@@ radio\n{IW}@@ end"))).radio == radio
    assert parse_radio("Not connected.\n") == Radio()
    assert parse_way(Output(0, CABLE.replace("@@ end", "@@ radio\n@@ end"))).radio == Radio()  # no iw there


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
def test_what_tells_nothing_is_refused(output: Output) -> None:
    with pytest.raises(ValueError, match=r".+"):
        parse_way(output)


def test_only_an_address_gets_into_the_probe() -> None:
    with pytest.raises(ValueError, match="IPv4 or IPv6"):
        way_probe("10.42.0.1; reboot")


def test_ping_is_read_in_both_its_dialects() -> None:
    assert parse_ping(IPUTILS) == Ping(4, 3, (0.5, 1.5, 1.0)) and parse_ping(IPUTILS).loss == 0.25
    assert parse_ping(BUSYBOX) == Ping(1, 1, (0.512,))
    with pytest.raises(ValueError, match="ping"):
        parse_ping("ping: socket: Operation not permitted")


def test_jitter_is_the_mean_step_between_neighbours() -> None:
    assert jitter_ms([1.0, 3.0, 2.0]) == 1.5
    assert jitter_ms([1.0]) is None


def manager(*profiles: Profile) -> NetworkManager:
    return NetworkManager(True, (Device("wlp2s0", "wifi", "connected", "Mirte-247264", ""),), profiles)


def wifi(name: str, priority: int, autoconnect: bool = True) -> Profile:
    return Profile(name, True, autoconnect, priority, name.startswith("Mirte"), "")


def test_a_saved_network_of_equal_priority_is_a_risk_and_a_lower_or_manual_one_is_not() -> None:
    assert len(roam_risk(manager(wifi("Mirte-247264", 0), wifi("eduroam", 0)), "wlp2s0")) == 1
    assert roam_risk(manager(wifi("Mirte-247264", 100), wifi("eduroam", 0)), "wlp2s0") == []
    assert roam_risk(manager(wifi("Mirte-247264", 0), wifi("eduroam", 0, autoconnect=False)), "wlp2s0") == []
    assert roam_risk(manager(wifi("Mirte-247264", 0), wifi("eduroam", 0)), "enx0") == []
    assert roam_risk(None, "wlp2s0") == roam_risk(NetworkManager(False), "wlp2s0") == []


@pytest.mark.parametrize(
    ("way", "quality", "says"),
    [
        (replace(WAY, multicast=False), None, "takes no multicast"),
        (replace(WAY, mtu=1280), None, "MTU of 1280"),
        (replace(WAY, source="172.20.10.4"), None, "hotspot"),
        (replace(WAY, radio=Radio(power_save=True)), None, "saves power"),
        (replace(WAY, radio=Radio(signal_dbm=-78.0)), None, "-78 dBm"),
        (WAY, Quality(jitter_ms=80.0), "jitter of 80 ms"),
        (WAY, Quality(loss=0.1), "10% of the packets"),
        (WAY, Quality(down_mbps=50.0, up_mbps=1.5), "only 1.5 Mbit/s"),
        (WAY, Quality(multicast_down=True, multicast_up=False), "multicast does not pass"),
    ],
)
def test_each_trouble_of_a_link_is_said(way: Way, quality: Quality | None, says: str) -> None:
    (trouble,) = troubles_of(way, WAY, quality, [])
    assert says in trouble


def test_a_good_link_has_no_trouble() -> None:
    good = Quality(1.0, 2.0, 0.2, 0.0, 90.0, 90.0, True, True)
    assert troubles_of(WAY, WAY, good, []) == [] == troubles_of(None, None, None, [])


def test_a_robot_on_two_networks_troubles_all_but_its_own_access_point() -> None:
    assert "single-home" in homing_trouble("wired", ["10.42.0.1", "192.168.42.1"])[0]
    assert homing_trouble("wired", ["10.42.0.1"]) == homing_trouble("ap", ["10.42.0.1", "192.168.42.1"]) == []


def test_transports_rank_by_answer_then_trouble_then_the_projects_order() -> None:
    addresses = {"wired": "a", "router": "b", "ap": "c"}
    everything = dict.fromkeys(addresses, True)

    def order(answering: dict[str, bool], troubles: dict[str, list[str]]) -> list[str]:
        return [choice.transport for choice in rank(addresses, answering, troubles)]

    assert order(everything, {}) == ["wired", "router", "ap"]
    assert order({"ap": True}, {}) == ["ap", "wired", "router"]
    assert order(everything, {"wired": ["10% of the packets are lost"]}) == ["router", "ap", "wired"]
    assert order({"wired": True}, {"wired": ["jitter"]}) == ["wired", "router", "ap"]
