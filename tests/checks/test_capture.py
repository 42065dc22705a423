"""Packets of both ends in lines: what left, what arrived, and who may not look."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from lupin_cli.checks import Evidence
from lupin_cli.checks.capture import packet_lines
from lupin_cli.checks.samples import CHECKS
from lupin_cli.diagnosis import diagnose
from lupin_cli.facts import Facts
from lupin_cli.facts.graph import parse as parse_graph
from lupin_cli.facts.packets import CAPTURE_S, PACKETS, Flow, Packets
from lupin_cli.target import Output

HERE, THERE, UNREACHED = "10.42.0.2", "10.42.0.1", "192.168.42.1"
LOST = Packets((HERE,), (Flow(HERE, THERE, 7411, 40), Flow(HERE, THERE, 7410, 9), Flow(HERE, THERE, 11811, 12)))
DEAF = Packets((THERE, UNREACHED), (Flow(HERE, THERE, 7410, 9), Flow(THERE, HERE, 7413, 300)))


def evidence(here: Packets | None, there: Packets | None) -> Evidence:
    robot = Facts("robot", {} if there is None else {"packets": there})
    return Evidence(Facts("laptop", {} if here is None else {"packets": here}), robot)


@pytest.mark.parametrize(
    ("port", "is_data"),
    [(7400, False), (7409, False), (7410, False), (7411, True), (7412, False), (7447, True), (7661, True), (11811, False)],
)
def test_data_goes_to_odd_unicast_ports_of_each_domain(port: int, is_data: bool) -> None:
    assert Flow(HERE, THERE, port, 1).is_data == is_data


def test_what_left_and_never_arrived_is_told_from_both_ends() -> None:
    assert packet_lines(evidence(LOST, DEAF)) == (
        f"captured here for {CAPTURE_S:.0f} s: data sent to the robot: 40 to 10.42.0.1:7411",
        "captured here: 12 packets to its server at 10.42.0.1:11811",
        "captured on the robot: data that arrived from here: none",
        "captured on the robot: data that it sent here: 300 to 10.42.0.2:7413",
    )


def test_an_end_that_may_not_be_looked_at_says_so_and_the_other_is_told() -> None:
    lines = packet_lines(evidence(Packets((HERE,), refused="anna may not capture"), DEAF))
    assert lines[0] == "laptop: packets were not captured: anna may not capture"
    assert "captured on the robot: data that arrived from here: none" in lines


def test_where_nobody_looked_closer_nothing_is_said() -> None:
    assert packet_lines(evidence(None, None)) == ()


def test_packets_are_evidence_of_one_way_data() -> None:
    graph = {
        "name": "robot", "kind": "robot", "environment": {}, "joined_s": 1.0, "nodes": ["/robot"], "topics": [],
        "samples": {"/scan": {"count": 9}}, "inputs": {}, "said": {}, "controllers": None,
        "calls": {name: {"round_trip_s": None} for name in ("/a", "/b")},
    }  # fmt: skip
    seen = parse_graph(Output(0, json.dumps({"graphs": [graph]})))
    found = evidence(LOST, DEAF)
    told = Evidence(Facts("laptop", {**found.laptop.values, "graph": seen}), found.robot)
    (root,) = diagnose(CHECKS, told).roots
    assert root.finding.id == "one-way-data"
    assert set(packet_lines(told)) <= set(root.finding.evidence)
    # Where data does arrive the way is open, and whoever doesn't answer is busy.
    hears = Packets(DEAF.own, (*DEAF.flows, Flow(HERE, THERE, 7413, 20)))
    busy = evidence(LOST, hears)
    assert diagnose(CHECKS, Evidence(Facts("laptop", {**busy.laptop.values, "graph": seen}), busy.robot)).roots == ()


def test_lines_of_tcpdump_are_counted_by_place() -> None:
    said = (
        "@@ own\n10.42.0.1\n@@ tcpdump\n"
        "eth0  In  IP 10.42.0.2.40123 > 10.42.0.1.7411: UDP, length 64\n"
        "IP 10.42.0.2.40123 > 10.42.0.1.7411: UDP, length 80\n"
        "IP6 fe80::1.5353 > ff02::fb.5353: UDP, length 80\n@@ end\n"
    )
    assert PACKETS.parse(Output(0, said)).flows == (Flow(HERE, THERE, 7411, 2),)


def test_the_probe_counts_or_says_why_not_on_this_very_machine() -> None:
    probe = PACKETS.probe.replace(f"monotonic() + {CAPTURE_S}", "monotonic() + 0.2")
    shell = shutil.which("dash") or "/bin/sh"
    done = subprocess.run([shell, "-c", probe], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
    assert done.stderr == ""
    seen = PACKETS.parse(Output(done.returncode, done.stdout))
    assert all(flow.count > 0 for flow in seen.flows)
