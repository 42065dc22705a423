"""The graph of a robot that boots, seen from the laptop across its cable through its discovery server, healthy and broken."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

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

    def comes_to(self, *expected: str, limit_s: float = 90.0) -> Graph:
        """Look until these are the causes that are named; a robot whose stack starts needs its time."""
        deadline = time.monotonic() + limit_s
        while True:
            seen, diagnosis = self.look()
            ids = [root.finding.id for root in diagnosis.roots]
            if ids == list(expected) and seen.calls:
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
    laptop.comes_to()


def test_controllers_that_boot_unconfigured_explain_what_is_silent_for_them(laptop: Laptop) -> None:
    with laptop.host.robot.broken("controllers-stuck"):
        seen = laptop.comes_to("controllers-not-active")
        assert {controller.state for controller in seen.controllers or ()} == {"unconfigured"}
    laptop.comes_to()
