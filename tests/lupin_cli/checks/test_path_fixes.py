"""Commands that mend an end of the path: which rule of a packet filter, which route, which address, which process."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.checks import Snapshot
from lupin_cli.checks.packet_filter import let_packets_pass, parse_rule
from lupin_cli.checks.path_fixes import accept_other_route, add_address, correct_route, resume_or_restart
from lupin_cli.connection import Output
from lupin_cli.facts import Facts
from lupin_cli.facts.addresses import ADDRESSES, Address, Addresses
from lupin_cli.facts.link import Link
from lupin_cli.link.path import End
from lupin_cli.link.path import Path as MeasuredPath
from lupin_cli.link.path_agent import Agent, _place_iptables, _place_nft
from tests.support.findings import mistake_in_line

ROBOT, LAPTOP, SERVER = "10.42.0.1", "10.42.0.2", 11811
LAN0 = Address("lan0", LAPTOP, 24, "global", up=True, carrier=True)
WLAN0 = Address("wlan0", "192.168.42.1", 24, "global", up=True, carrier=True)
RULESET = """table inet lupintest { # handle 1
	chain input { # handle 1
		type filter hook input priority filter; policy accept;
		iifname "eth0" udp dport 11811 counter packets 9 bytes 700 drop # handle 4
		tcp dport 22 ct state new limit rate over 10/minute drop # handle 5
	}
	chain output { # handle 2
		type filter hook output priority filter; policy drop;
	}
}
table ip filter { # handle 2
	chain ufw-user-input { # handle 3
		udp dport 7400-7600 drop # handle 8
	}
}
"""
SAVED = """*filter
:INPUT DROP [3:180]
:ufw6-user-input - [0:0]
-A INPUT -p udp -m udp --dport 11811 -j DROP
-A INPUT -p tcp -m tcp --dport 22 -j REJECT --reject-with tcp-reset
COMMIT
"""
# What Tailscale adds on every machine: the packets of its own program, which carry a mark, take no route of its tunnel.
TAILSCALE = (
    "0: from all lookup local",
    "5210: from all fwmark 0x80000/0xff0000 lookup main",
    "5230: from all fwmark 0x80000/0xff0000 lookup default",
    "5250: from all fwmark 0x80000/0xff0000 unreachable",
    "5270: from all lookup 52",
)


def snapshot(**laptop: Any) -> Snapshot:
    robot = Facts("robot", {"addresses": Addresses((WLAN0,))})
    facts = {"addresses": Addresses((LAN0,)), **laptop}
    return Snapshot(Facts("laptop", facts), robot, Link("pot", ROBOT, login=f"ssh mirte@{ROBOT}"))


def test_rules_are_reported_with_place_and_handle() -> None:
    assert _place_nft(RULESET.splitlines()) == [
        'nft inet lupintest input input: iifname "eth0" udp dport 11811 counter packets 9 bytes 700 drop # handle 4',
        "nft inet lupintest input input: tcp dport 22 ct state new limit rate over 10/minute drop # handle 5",
        "nft inet lupintest output output: type filter hook output priority filter; policy drop;",
        "nft ip filter ufw-user-input -: udp dport 7400-7600 drop # handle 8",
    ]
    assert _place_iptables(SAVED.splitlines()) == [
        "iptables filter: :INPUT DROP [3:180]",
        "iptables filter: -A INPUT -p udp -m udp --dport 11811 -j DROP",
        "iptables filter: -A INPUT -p tcp -m tcp --dport 22 -j REJECT --reject-with tcp-reset",
    ]


@pytest.mark.parametrize(
    ("rules", "ports", "incoming", "script"),
    [
        (_place_nft(RULESET.splitlines()), [SERVER], True, "sudo nft delete rule inet lupintest input handle 4"),
        (_place_nft(RULESET.splitlines()), [7400], False, "sudo ufw allow out to 10.42.0.2"),
        (
            _place_nft(RULESET.splitlines())[:3],
            [7400],
            False,
            "sudo nft insert rule inet lupintest output ip daddr 10.42.0.2 meta l4proto udp accept",
        ),
        (_place_nft(RULESET.splitlines()), [7410], True, "sudo ufw allow from 10.42.0.2"),
        (
            ["nft inet firewalld filter_INPUT input: reject with icmpx admin-prohibited # handle 9"],
            [SERVER],
            True,
            "--add-source",
        ),
        (_place_iptables(SAVED.splitlines())[1:], [SERVER], True, "-D INPUT -p udp -m udp --dport 11811 -j DROP"),
        (_place_iptables(SAVED.splitlines()), [7410], True, "iptables -t filter -I INPUT -s 10.42.0.2 -p udp -j ACCEPT"),
        (_place_iptables(SAVED.splitlines()), [22], True, "iptables -t filter -I INPUT -s 10.42.0.2 -p tcp -j ACCEPT"),
        (["nft ip t in input: ip saddr { 10.42.0.0/24, 10.9.9.9 } drop # handle 3"], [7410], True, "t in handle 3"),
        (["nft ip t in input: ip saddr != 10.42.9.0/24 drop # handle 3"], [7410], True, "t in handle 3"),
        ([], [SERVER], True, "sudo nft -a list ruleset"),
        (["nft inet a b input: udp dport { 11811, 7400-7500 } drop # handle 2"] * 5, [SERVER], True, "nft -a list ruleset"),
    ],
)
def test_rule_that_drops_is_removed_on_its_machine(rules: list[str], ports: list[int], incoming: bool, script: str) -> None:
    fix = let_packets_pass(snapshot(), "robot", rules, ports, "eth0", LAPTOP, incoming=incoming)
    assert fix["instruction"]
    local = let_packets_pass(snapshot(), "laptop", rules, ports, "eth0", LAPTOP, incoming=incoming)["command"]
    assert script in local and fix["command"].startswith(f"ssh -t mirte@{ROBOT} ")
    assert mistake_in_line(fix["command"]) == mistake_in_line(local) == ""


def test_beside_a_policy_only_rules_elsewhere_are_removed() -> None:
    rules = [*_place_iptables(SAVED.splitlines()), "nft inet own input input: udp dport 11811 drop # handle 4"]
    command = let_packets_pass(snapshot(), "laptop", rules, [SERVER], "eth0", LAPTOP, incoming=True)["command"]
    exception = "sudo iptables -t filter -I INPUT -s 10.42.0.2 -p udp -j ACCEPT"
    assert command == f"{exception} && sudo nft delete rule inet own input handle 4"


@pytest.mark.parametrize(
    "text",
    [
        "nft ip6 filter input input: udp dport 11811 drop # handle 2",
        "nft inet a b input: ip protocol sctp drop # handle 2",
        'nft inet a b input: iifname "wlan0" udp dport 11811 drop # handle 2',
        "nft inet a b output: udp dport 11811 drop # handle 2",
        "nft inet a b input: udp dport 5353 drop # handle 2",
        "nft inet a b forward: type filter hook forward priority filter; policy drop;",
        "nft ip a b input: ip saddr 203.0.113.0/24 drop # handle 2",
        "nft ip a b input: ip saddr { 203.0.113.1, 203.0.113.8/29 } drop # handle 2",
        "nft ip a b input: ip saddr != 10.42.0.0/24 drop # handle 2",
        "iptables filter: :FORWARD DROP [0:0]",
        "iptables filter: -A OUTPUT -p udp -m udp --dport 11811 -j DROP",
        "iptables filter: -A INPUT -s 203.0.113.0/24 -j DROP",
        "iptables filter: -A INPUT ! -s 10.42.0.0/24 -j DROP",
        # Docker's own, for the addresses of its containers.
        'nft ip raw PREROUTING prerouting: ip daddr 172.17.0.2 iifname != "docker0" counter packets 0 bytes 0 drop # handle 5',
        "iptables raw: -A PREROUTING -d 172.17.0.2/32 ! -i docker0 -j DROP",
        'nft inet a b input: iifname != "eth0" drop # handle 2',
        'nft inet a b input: iifname { "wlan0", "eth1" } drop # handle 2',
        "iptables filter: -A INPUT ! -i eth+ -j DROP",
        "iptables filter: -A INPUT -i eth -j DROP",
    ],
)
def test_rule_for_other_packets_is_left_alone(text: str) -> None:
    rule = parse_rule(text)
    assert rule is not None and not rule.may_take([SERVER], "eth0", incoming=True, other=LAPTOP, own=[ROBOT])
    command = let_packets_pass(snapshot(), "robot", [text], [SERVER], "eth0", LAPTOP, incoming=True, own=[ROBOT])["command"]
    assert command.endswith("'sudo nft -a list ruleset; sudo iptables-legacy-save || sudo iptables-save'")


@pytest.mark.parametrize(
    "text",
    [
        "nft ip a b prerouting: ip daddr { 10.42.0.1, 172.17.0.2 } drop # handle 2",
        'nft inet a b input: iifname "eth*" drop # handle 2',
        'nft inet a b input: iifname { "wlan0", "eth0" } drop # handle 2',
        'nft inet a b input: iifname != "docker0" drop # handle 2',
        "nft inet a b input: iifname @cables drop # handle 2",
        "iptables filter: -A INPUT -d 10.42.0.0/24 -i eth+ -j DROP",
    ],
)
def test_rule_for_these_packets_may_take_them(text: str) -> None:
    rule = parse_rule(text)
    assert rule is not None and rule.may_take([SERVER], "eth0", incoming=True, other=LAPTOP, own=[ROBOT])


@pytest.mark.parametrize(
    ("manager", "allow"),
    [
        ("nft ip filter ufw-user-input -: udp dport 7400-7600 drop # handle 8", "sudo ufw allow from 10.42.0.2"),
        ("nft inet firewalld filter_INPUT input: reject with icmpx admin-prohibited # handle 9", "--permanent"),
    ],
)
def test_beside_a_manager_what_aims_at_the_packets_goes(manager: str, allow: str) -> None:
    culprit = "nft inet mine in input: udp dport 7400-7650 drop # handle 9"
    of_all = "nft inet other in input: meta l4proto udp limit rate over 9/second drop # handle 3"
    fix = let_packets_pass(snapshot(), "laptop", [manager, culprit, of_all], [7410], "lan0", LAPTOP, incoming=True)
    assert allow in fix["command"] and fix["command"].endswith(" && sudo nft delete rule inet mine in handle 9")
    assert "udp dport 7400-7650 drop" in fix["instruction"] and mistake_in_line(fix["command"]) == ""


def test_rules_of_the_older_packet_filter_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def install(name: str, *lines: str) -> None:
        (tmp_path / name).write_text("\n".join(("#!/bin/sh", *(f"echo '{line}'" for line in lines), "")))
        (tmp_path / name).chmod(0o755)

    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    install("sudo")
    (tmp_path / "sudo").write_text('#!/bin/sh\nshift\nexec "$@"\n')
    install("nft")
    install("iptables-save", "*filter", "-A INPUT -p udp -j DROP")
    assert Agent().firewall() == ["iptables filter: -A INPUT -p udp -j DROP"]
    install("iptables-legacy-save", "*filter", "-A INPUT -p udp -m udp --dport 11811 -j DROP")
    found = Agent().firewall()
    assert found == ["iptables-legacy filter: -A INPUT -p udp -m udp --dport 11811 -j DROP"]
    install("nft", "table inet mine { # handle 1", "udp dport 7411 drop # handle 2")
    assert [line.split()[0] for line in Agent().firewall()] == ["nft", "iptables-legacy"]
    command = let_packets_pass(snapshot(), "laptop", found, [SERVER], "lan0", ROBOT, incoming=True)["command"]
    assert command == "sudo iptables-legacy -t filter -D INPUT -p udp -m udp --dport 11811 -j DROP"


@pytest.mark.parametrize(
    ("routes", "rules", "command"),
    [
        (("blackhole 10.42.0.1", "10.42.0.0/24 dev lan0 src 10.42.0.2"), (), "sudo ip route del blackhole 10.42.0.1"),
        (
            ("10.42.0.1 dev wlan1 scope link", "default via 192.168.1.1 dev wlan1"),
            (),
            "sudo ip route del 10.42.0.1 dev wlan1 scope link",
        ),
        (
            ("10.42.0.0/24 dev wlan1 proto kernel scope link src 10.42.0.9 dead linkdown", "10.42.0.0/24 dev lan0"),
            (),
            "sudo ip route del 10.42.0.0/24 dev wlan1 proto kernel scope link src 10.42.0.9",
        ),
        (
            ("10.42.0.0/24 dev lan0",),
            ("0: from all lookup local", "32765: from all to 10.42.0.1 prohibit"),
            "sudo ip rule del priority 32765",
        ),
        (("default via 192.168.1.1 dev wlan1",), (), "sudo ip route add 10.42.0.0/24 dev lan0 src 10.42.0.2"),
        (("default via 192.168.1.1 dev wlan1",), TAILSCALE, "sudo ip route add 10.42.0.0/24 dev lan0 src 10.42.0.2"),
        (("10.42.0.0/24 dev lan0",), TAILSCALE, "ip route get 10.42.0.1"),
        (
            ("10.42.0.0/24 dev lan0",),
            (*TAILSCALE, "9: from 10.42.0.2 to 10.42.0.0/24 iif lo blackhole"),
            "sudo ip rule del priority 9",
        ),
        (
            ("10.42.0.0/24 dev lan0",),
            ("9: from 192.168.7.0/24 prohibit", "10: from all to 10.9.0.0/16 unreachable", "11: from all oif eth9 prohibit"),
            "ip route get 10.42.0.1",
        ),
        (("10.42.0.0/24 dev lan0",), (), "ip route get 10.42.0.1"),
    ],
)
def test_what_leads_elsewhere_is_deleted(routes: tuple[str, ...], rules: tuple[str, ...], command: str) -> None:
    end = End("laptop", error="unreachable", routes=routes, rules=rules)
    assert correct_route(snapshot(), end, ROBOT, [LAN0])["command"] == command


def test_lost_address_is_added_to_the_unused_interface() -> None:
    path = MeasuredPath(ROBOT, End("laptop", "lan0", LAPTOP))
    seen = snapshot()
    assert add_address(seen, path, "robot", LAPTOP)["command"].endswith("'sudo ip address add 10.42.0.1/24 dev eth0'")
    seen = snapshot(addresses=Addresses((), ("lan0",)))
    assert add_address(seen, path, "laptop", ROBOT)["command"] == "sudo ip address add 10.42.0.2/24 dev lan0"
    fix = add_address(snapshot(addresses=Addresses(())), path, "laptop", ROBOT)
    assert fix["command"] == "ip -brief address" and "get an address" in fix["instruction"]


@pytest.mark.parametrize(("address", "transport"), [("192.168.0.50", "router"), ("192.168.0.50", ""), (ROBOT, "router")])
def test_address_of_a_router_is_not_guessed(address: str, transport: str) -> None:
    seen = replace(snapshot(addresses=Addresses((), ("wlp2s0",))), link=Link("pot", address, transport=transport))
    for machine in ("laptop", "robot"):
        fix = add_address(seen, MeasuredPath(address, End("laptop", error="unreachable")), machine, address)
        assert "ip -brief address" in fix["command"] and "let the router give" in fix["instruction"]


def test_route_back_is_accepted_on_an_interface_with_dots() -> None:
    fix = accept_other_route(snapshot(), MeasuredPath(ROBOT, End("laptop", "eth0.10", LAPTOP)), "laptop")
    assert fix["command"] == "sudo sysctl -w net/ipv4/conf/eth0.10/rp_filter=2"


def test_ports_of_bridges_and_parents_of_vlans_are_in_use() -> None:
    def link(name: str, **fields: Any) -> dict[str, Any]:
        return {"ifname": name, "flags": ["UP", "LOWER_UP"], "link_type": "ether", "addr_info": [], **fields}

    vlan = link("enp4s0.10", link="enp4s0", addr_info=[{"family": "inet", "local": "10.9.0.2", "prefixlen": 24}])
    links = [link("vnet0", master="virbr0"), link("enp4s0"), vlan, link("podman1"), link("enp3s0")]
    assert ADDRESSES.parse(Output(0, json.dumps(links))).unused == ("enp3s0",)


def test_stopped_owner_of_a_socket_goes_on() -> None:
    assert resume_or_restart(snapshot(), "robot", 5, 7411)["command"] == "lupin play resume-process --robot pot -v pid=5"
    assert resume_or_restart(snapshot(), "laptop", 5, 7411)["command"] == "kill -CONT 5"
    assert "the command names it" in resume_or_restart(snapshot(), "laptop", 0, 7411)["instruction"]
