"""The graph of a robot that boots, seen from the laptop across its cable through its discovery server, healthy and broken."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from bench.rig import ACTOR
from lupin_cli.checks import board, controllers, drive, samples
from lupin_cli.checks.base import Evidence
from lupin_cli.diagnosis import Diagnosis, diagnose
from lupin_cli.facts.base import Facts
from lupin_cli.facts.graph import GRAPH, Graph
from lupin_cli.target.base import Output
from lupin_sim.host import Host
from lupin_sim.host.fixtures import start
from lupin_sim.host.host import PROJECT

pytestmark = pytest.mark.host

CHECKS = (*controllers.CHECKS, *drive.CHECKS, *samples.CHECKS, *board.CHECKS)
PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<dds><profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
<participant profile_name="super_client" is_default_profile="true"><rtps><builtin><discovery_config>
<discoveryProtocol>SUPER_CLIENT</discoveryProtocol>
<discoveryServersList><RemoteServer prefix="44.53.00.5f.45.50.52.4f.53.49.4d.41"><metatrafficUnicastLocatorList>
<locator><udpv4><address>10.42.0.1</address><port>11811</port></udpv4></locator>
</metatrafficUnicastLocatorList></RemoteServer></discoveryServersList>
</discovery_config></builtin></rtps></participant></profiles></dds>
"""


class Laptop:
    """An operator's machine that is set up for the robot."""

    def __init__(self, host: Host, home: Path) -> None:
        self.host, self.home = host, home
        own = home / ".config" / "lupin"
        own.mkdir(parents=True)
        (own / "super_client.xml").write_text(PROFILE)
        (own / "ros-env.sh").write_text(
            f"export FASTRTPS_DEFAULT_PROFILES_FILE={own}/super_client.xml\n"
            "export ROS_DISCOVERY_SERVER=10.42.0.1:11811\n"
            "export RMW_IMPLEMENTATION=rmw_fastrtps_cpp\n"
        )

    def look(self) -> tuple[Graph, Diagnosis]:
        """What a visitor sees, and what the checks make of it."""
        env = {"PATH": "/usr/bin:/bin", "HOME": str(self.home)}
        command = [sys.executable, "-m", "lupin_runtime.stack.probe"]
        done = self.host.run(command, env=env, cwd=str(PROJECT), timeout_s=60.0)
        graphs = GRAPH.parse(Output(done.returncode, done.stdout, done.stderr))
        (seen,) = graphs.graphs
        assert (seen.name, seen.kind, seen.error) == ("robot", "robot", "")
        diagnosis = diagnose(CHECKS, Evidence(Facts("laptop", {"graph": graphs}), None))
        assert diagnosis.broken == ()
        return seen, diagnosis

    @contextmanager
    def part(self, *words: str) -> Iterator[None]:
        """A participant of the graph on the laptop, or an order given through one, as `bench.rig` has them."""
        process: subprocess.Popen[str] = self.host.popen(
            [sys.executable, "-c", ACTOR, *words], self.sourced, cwd=str(PROJECT), stdout=subprocess.PIPE, text=True
        )
        bound = threading.Timer(60.0, process.kill)
        bound.start()
        try:
            assert process.stdout is not None and process.stdout.readline() == "up\n", words
            yield
        finally:
            bound.cancel()
            process.terminate()
            process.communicate(timeout=20.0)

    def order(self, *words: str) -> None:
        """Give an order to the simulated robot."""
        with self.part(*words):
            pass

    @property
    def sourced(self) -> dict[str, str]:
        """The environment of a shell that sourced ros-env.sh."""
        lines = (self.home / ".config" / "lupin" / "ros-env.sh").read_text().splitlines()
        exports = dict(line.removeprefix("export ").split("=", 1) for line in lines)
        return {"PATH": "/usr/bin:/bin:/usr/sbin:/sbin", "HOME": str(self.home), **exports}

    def doctor(self, *checks: str) -> Any:
        """What `lupin doctor --json` says of the robot, asked for these checks only."""
        ssh = self.home / ".ssh"
        if not ssh.exists():
            ssh.mkdir(mode=0o700)
            shutil.copy(self.host.key, ssh / "id_ed25519")
            shutil.copy(self.host.known_hosts, ssh / "known_hosts")
        only = [word for check in checks for word in ("--only", check)]
        command = [sys.executable, "-m", "lupin_cli.app", "doctor", "--host", "mirte@10.42.0.1", "--json", *only]
        done = self.host.run(command, env=self.sourced, cwd=str(PROJECT), timeout_s=120.0)
        assert done.stdout, done.stderr
        return json.loads(done.stdout)

    def comes_to(self, *expected: str, limit_s: float = 90.0) -> Graph:
        """Look until these are the causes that are named; a robot whose stack starts needs its time."""
        deadline = time.monotonic() + limit_s
        while True:
            seen, diagnosis = self.look()
            ids = sorted(root.finding.id for root in diagnosis.roots)
            if ids == sorted(expected) and seen.calls:
                return seen
            assert time.monotonic() < deadline, f"named {ids}, expected {list(expected)}; {seen.samples} {seen.calls}"


@pytest.fixture(scope="module")
def laptop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Laptop]:
    with start(vendor_robot=True) as host:
        found = Laptop(host, tmp_path_factory.mktemp("graph") / "home")
        found.comes_to()
        yield found


def test_a_healthy_robot_gives_nothing_and_answers_from_across_the_cable(laptop: Laptop) -> None:
    seen = laptop.comes_to()
    assert [controller.state for controller in seen.controllers or ()] == ["active"] * 5
    assert all(call.round_trip_s is not None for call in seen.calls) and len(seen.calls) == 2
    assert all(count for _, count in seen.samples) and len(seen.samples) >= 6


def test_a_dual_homed_robot_shows_itself_by_its_asymmetry(laptop: Laptop) -> None:
    with laptop.host.robot.broken("dual-homed"):
        seen = laptop.comes_to("one-way-data")
        assert any(count for _, count in seen.samples)
        assert [call.round_trip_s for call in seen.calls] == [None, None]
        # The whole doctor looks closer: its own requests left, and none of them arrived.
        told = laptop.doctor("dds.multi-homed", "graph.*")
        (root,) = told["findings"]
        assert root["id"] == "robot-multi-homed"
        assert "one-way-data" in [each["id"] for each in root["consequences"]]
        sent, arrived = (
            next(line for line in root["evidence"] if line.startswith(start))
            for start in (
                "captured here for 6 s: data sent to the robot: ",
                "captured on the robot: data that arrived from here: ",
            )
        )
        assert " to 10.42.0.1:74" in sent
        assert arrived.endswith(": none")
    laptop.comes_to()


def test_faults_of_the_graph_that_stand_together_are_each_named(laptop: Laptop) -> None:
    laptop.order("battery", "0.1")
    with laptop.part("reader"), laptop.part("sink"), laptop.part("page"):
        laptop.comes_to("battery-low", "drive-sink-unheard", "page-holds-bus", "qos-mismatch")
    laptop.order("battery", "0.85")
    laptop.comes_to()


def test_a_pad_that_is_never_silent_and_a_reader_of_another_type_are_named(laptop: Laptop) -> None:
    with laptop.part("pad"), laptop.part("mistyped"):
        laptop.comes_to("pad-holds-bus", "type-mismatch")
    laptop.comes_to()


def test_a_silent_sensor_and_a_silent_board_are_told_apart(laptop: Laptop) -> None:
    laptop.order("sim", "scan", "silent")
    laptop.comes_to("topic-silent")
    laptop.order("sim", "board", "silent")
    laptop.comes_to("board-wedged", "topic-silent")
    laptop.order("sim", "scan", "none")
    laptop.order("sim", "board", "none")
    laptop.comes_to()


def test_controllers_that_boot_unconfigured_explain_what_is_silent_for_them(laptop: Laptop) -> None:
    with laptop.host.robot.broken("controllers-stuck"):
        seen = laptop.comes_to("controllers-not-active")
        assert {controller.state for controller in seen.controllers or ()} == {"unconfigured"}
    laptop.comes_to()
