"""`lupin transport` against a simulated computer, over good and bad links."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from lupin_sim.host import Host
from lupin_sim.host.operator import create_home, environment_without_ros

pytestmark = pytest.mark.host


def transport(host: Host, home: Path, *words: str, both: bool = True) -> tuple[int, Any]:
    kept = environment_without_ros()
    command = [sys.executable, "-m", "lupin_cli.app", "transport", *words, "--json"]
    environment = create_home(host, home)
    if both:
        with (home / ".config" / "lupin" / "lupin.toml").open("a") as inventory:
            inventory.write(f'ap = "{host.robot.wlan0}"\n')
    done = host.run(command, env={**kept, **environment}, timeout_s=120)
    assert done.stdout, done.stderr
    return done.returncode, json.loads(done.stdout)


def test_good_cable_ranks_first_with_multicast(host: Host, tmp_path: Path) -> None:
    status, seen = transport(host, tmp_path, "show")
    assert status == 0 and seen["transport"] == "wired" and seen["unknown"] == []
    assert (seen["laptop"]["interface"], seen["laptop"]["source"]) == ("lan0", "10.42.0.2")
    assert (seen["far"]["interface"], seen["far"]["source"]) == ("eth0", "10.42.0.1")
    quality = seen["quality"]
    assert 0.0 < quality["rtt_ms"] < 2000.0 and quality["loss"] < 0.5  # a busy machine answers late
    assert quality["down_mbps"] > 0.1 and quality["up_mbps"] > 0.1
    assert quality["multicast_down"] is True and quality["multicast_up"] is True
    answering = {choice["transport"]: choice["answers"] for choice in seen["ranking"]}
    assert answering["wired"]


def test_link_without_multicast_has_that_problem(fresh_host: Host, tmp_path: Path) -> None:
    fresh_host.robot.inject_fault("no-multicast")
    _, seen = transport(fresh_host, tmp_path, "show")
    assert False in (seen["quality"]["multicast_down"], seen["quality"]["multicast_up"])
    wired = next(choice for choice in seen["ranking"] if choice["transport"] == "wired")
    assert any("multicast does not pass" in trouble for trouble in wired["troubles"])


def test_lossy_link_has_that_problem(fresh_host: Host, tmp_path: Path) -> None:
    fresh_host.robot.inject_fault("lossy-link", loss=0.12)
    # This is the only transport: otherwise a link that loses the first packet of a connection would not even be chosen.
    # A connection may fail at first, or no packet of a ping may be lost, so several attempts are made.
    for attempt in range(5):
        _, seen = transport(fresh_host, tmp_path / str(attempt), "show", both=False)
        if seen["quality"] and seen["quality"]["loss"]:
            break
    assert 0.02 < seen["quality"]["loss"] < 0.9
    wired = next(choice for choice in seen["ranking"] if choice["transport"] == "wired")
    assert any("of the packets are lost" in trouble for trouble in wired["troubles"])


def test_access_point_ranks_first_without_cable(fresh_host: Host, tmp_path: Path) -> None:
    fresh_host.robot.inject_fault("cable-cut", link="eth0")
    status, seen = transport(fresh_host, tmp_path, "show", "--quick")
    assert status == 0 and seen["transport"] == "ap"
    assert [choice["transport"] for choice in seen["ranking"] if choice["answers"]] == ["ap"]


def test_robot_that_is_off_answers_over_no_transport(fresh_host: Host, tmp_path: Path) -> None:
    fresh_host.robot.power_off()
    status, seen = transport(fresh_host, tmp_path, "show", "--quick")
    assert status == 3 and seen["transport"] == "" and not any(choice["answers"] for choice in seen["ranking"])
