"""Evidence lines of captured packets: what left, what arrived, and which machine may not capture."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from lupin_cli.checks import Snapshot
from lupin_cli.checks.packet_evidence import packet_lines
from lupin_cli.checks.topic_delivery import CHECKS
from lupin_cli.connection import Output
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts import Facts
from lupin_cli.facts.graph import parse as parse_graph
from lupin_cli.facts.packets import CAPTURE_S, PACKETS, Flow, Packets

LAPTOP, ROBOT, UNROUTABLE = "10.42.0.2", "10.42.0.1", "192.168.42.1"
LAPTOP_SENDS = Packets((LAPTOP,), (Flow(LAPTOP, ROBOT, 7411, 40), Flow(LAPTOP, ROBOT, 7410, 9), Flow(LAPTOP, ROBOT, 11811, 12)))
ROBOT_GETS_NO_DATA = Packets((ROBOT, UNROUTABLE), (Flow(LAPTOP, ROBOT, 7410, 9), Flow(ROBOT, LAPTOP, 7413, 300)))


def snapshot(laptop: Packets | None, robot: Packets | None) -> Snapshot:
    of_laptop, of_robot = ({} if packets is None else {"packets": packets} for packets in (laptop, robot))
    return Snapshot(Facts("laptop", of_laptop), Facts("robot", of_robot))


@pytest.mark.parametrize(
    ("port", "is_data"),
    [(7400, False), (7409, False), (7410, False), (7411, True), (7412, False), (7447, True), (7661, True), (11811, False)],
)
def test_data_flow_is_recognized_by_its_port(port: int, is_data: bool) -> None:
    assert Flow(LAPTOP, ROBOT, port, 1).is_data == is_data


def test_lost_packets_are_shown_from_both_machines() -> None:
    assert packet_lines(snapshot(LAPTOP_SENDS, ROBOT_GETS_NO_DATA)) == (
        f"captured on the laptop for {CAPTURE_S:.0f} s: data sent to the robot: 40 to 10.42.0.1:7411",
        "captured on the laptop: 12 packets to the robot's discovery server at 10.42.0.1:11811",
        "captured on the robot: data that arrived from the laptop: none",
        "captured on the robot: data sent to the laptop: 300 to 10.42.0.2:7413",
    )


def test_refused_capture_is_shown_beside_the_other() -> None:
    lines = packet_lines(snapshot(Packets((LAPTOP,), refused="anna may not capture"), ROBOT_GETS_NO_DATA))
    assert lines[0] == "laptop: packets were not captured: anna may not capture"
    assert "captured on the robot: data that arrived from the laptop: none" in lines


def test_missing_captures_give_no_lines() -> None:
    assert packet_lines(snapshot(None, None)) == ()


def test_packets_are_evidence_of_one_way_data() -> None:
    graph = {
        "name": "robot", "kind": "robot", "environment": {}, "joined_s": 1.0, "nodes": ["/robot"], "topics": [],
        "samples": {"/scan": {"count": 9}}, "inputs": {}, "stdout": {}, "controllers": None,
        "calls": {name: {"round_trip_s": None} for name in ("/a", "/b")},
    }  # fmt: skip
    seen = parse_graph(Output(0, json.dumps({"graphs": [graph]})))
    found = snapshot(LAPTOP_SENDS, ROBOT_GETS_NO_DATA)
    with_graph = Snapshot(Facts("laptop", {**found.laptop.values, "graph": seen}), found.robot)
    (root,) = diagnose(CHECKS, with_graph).roots
    assert root.finding.id == "one-way-data"
    assert set(packet_lines(with_graph)) <= set(root.finding.evidence)
    # If data arrives, the link is open, and the servers are only busy.
    robot_gets_data = Packets(ROBOT_GETS_NO_DATA.own, (*ROBOT_GETS_NO_DATA.flows, Flow(LAPTOP, ROBOT, 7413, 20)))
    busy = snapshot(LAPTOP_SENDS, robot_gets_data)
    assert diagnose(CHECKS, Snapshot(Facts("laptop", {**busy.laptop.values, "graph": seen}), busy.robot)).roots == ()


def test_tcpdump_lines_are_counted_by_flow() -> None:
    stdout = (
        "@@ own\n10.42.0.1\n@@ tcpdump\n"
        "eth0  In  IP 10.42.0.2.40123 > 10.42.0.1.7411: UDP, length 64\n"
        "IP 10.42.0.2.40123 > 10.42.0.1.7411: UDP, length 80\n"
        "IP6 fe80::1.5353 > ff02::fb.5353: UDP, length 80\n@@ end\n"
    )
    assert PACKETS.parse(Output(0, stdout)).flows == (Flow(LAPTOP, ROBOT, 7411, 2),)


def test_packet_probe_counts_or_is_refused_on_this_machine() -> None:
    probe = PACKETS.probe.replace(f"monotonic() + {CAPTURE_S}", "monotonic() + 0.2")
    shell = shutil.which("dash") or "/bin/sh"
    done = subprocess.run([shell, "-c", probe], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
    assert done.stderr == ""
    seen = PACKETS.parse(Output(done.returncode, done.stdout))
    assert all(flow.count > 0 for flow in seen.flows)
