"""Operations on units, groups, the discovery server, the clock and the power of a robot's computer that really boots."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from cycle import settled, there_and_back

from lupin_cli.operations import OperationError
from lupin_cli.operations.clock_step import ClockStep, offset
from lupin_cli.operations.discovery_server import DiscoveryServer
from lupin_cli.operations.file import File
from lupin_cli.operations.group_membership import GroupMembership
from lupin_cli.operations.network_connection import NetworkConnection
from lupin_cli.operations.process import Process
from lupin_cli.operations.reboot import Reboot
from lupin_cli.operations.restart import Restart
from lupin_cli.operations.sweep import Sweep
from lupin_cli.operations.unit import Unit
from lupin_cli.operations.unit_file import UnitFile
from lupin_cli.operations.wait_for import WaitFor
from lupin_cli.target.destination import Destination
from lupin_cli.target.ssh import SshTarget
from lupin_cli.target.trust import Trust
from lupin_sim.host import Host

pytestmark = pytest.mark.host

SERVER = "fast-discovery-server"


def target_of(host: Host) -> SshTarget:
    place = Destination(host.robot.eth0, 22, "mirte", (str(host.key),), identities_only=True)
    return SshTarget("robot", place, Trust(Path("/nonexistent"), users=Path(host.known_hosts)))


@pytest.fixture
def robot(host: Host) -> Iterator[SshTarget]:
    """For tests that leave it as it was."""
    target = target_of(host)
    with host.on_laptop():
        yield target
        target.close()


@pytest.fixture
def fresh_robot(fresh_host: Host) -> Iterator[SshTarget]:
    target = target_of(fresh_host)
    with fresh_host.on_laptop():
        yield target
        target.close()


def test_roots_files_are_written_and_put_back(robot: SshTarget) -> None:
    there_and_back(File(path="/etc/lupin-test", content="x", mode="0600", owner="root:root", root=True), robot)
    there_and_back(File(path="/etc/hostname", content="other\n", root=True), robot)


def test_a_unit_is_stopped_disabled_and_masked_and_comes_back(robot: SshTarget) -> None:
    unit = "mirte-jupyter.service"
    difference = there_and_back(Unit(unit=unit, state="stopped", enabled=False), robot)
    assert difference.summary == f"{unit} no longer starts at boot and is stopped (active)"
    there_and_back(Unit(unit="chrony.service", masked=True, state="stopped"), robot)
    assert Unit(unit=unit, state="started", enabled=True).differs(robot) is None


def test_a_unit_that_isn_t_there_is_stopped_and_can_t_be_started(robot: SshTarget) -> None:
    assert Unit(unit="lupin-none.service", state="stopped", enabled=False).differs(robot) is None
    with pytest.raises(OperationError, match=r"robot has no unit lupin-none.service"):
        Unit(unit="lupin-none.service", state="started").differs(robot)


def test_a_unit_file_is_installed_verified_and_removed(robot: SshTarget) -> None:
    fill = {"laptop": "10.42.0.2", "script": "/bin/true"}
    there_and_back(UnitFile(unit="lupin-clock-sync.service", fill=fill), robot)
    bad = UnitFile(unit="lupin-bad.service", content="[Service]\nExecStart=not-absolute and missing\n")
    difference = bad.differs(robot)
    assert difference is not None
    with pytest.raises(OperationError, match=r"could not verify lupin-bad.service"):
        bad.change(robot, difference)
    assert robot.get("/etc/systemd/system/lupin-bad.service", root=True) is None


def test_a_oneshot_that_failed_is_reset_and_started(fresh_robot: SshTarget) -> None:
    content = "[Service]\nType=oneshot\nRemainAfterExit=yes\nExecStart=/bin/sh -c 'test -e /run/allowed'\n"
    installed = UnitFile(unit="lupin-once.service", content=content)
    installed.change(fresh_robot, installed.differs(fresh_robot))  # type: ignore[arg-type]
    operation = Unit(unit="lupin-once.service", state="started", reset_failed=True)
    difference = operation.differs(fresh_robot)
    assert difference is not None
    with pytest.raises(OperationError, match=r"could not set lupin-once.service"):
        operation.change(fresh_robot, difference)
    failed = operation.differs(fresh_robot)
    assert failed is not None and "is no longer failed" in failed.summary
    fresh_robot.run("touch /run/allowed", root=True)
    operation.change(fresh_robot, failed)
    assert operation.differs(fresh_robot) is None


def test_a_restart_happens_once_a_step(robot: SshTarget) -> None:
    operation = Restart(unit="mirte-jupyter.service")
    difference = operation.differs(robot)
    assert difference is not None
    operation.change(robot, difference)
    settled(operation, robot, difference.before)
    assert Restart(unit="lupin-none.service").differs(robot) is None


def test_a_user_joins_a_group_and_leaves_it(robot: SshTarget) -> None:
    there_and_back(GroupMembership(user="mirte", group="games"), robot)
    with pytest.raises(OperationError, match="has no group 'nobodys'"):
        GroupMembership(user="mirte", group="nobodys").differs(robot)
    with pytest.raises(OperationError, match="has no user 'nobody-here'"):
        GroupMembership(user="nobody-here", group="games").differs(robot)


def test_a_discovery_server_is_started_once_and_ended_by_undo(fresh_robot: SshTarget) -> None:
    operation = DiscoveryServer()
    settled(WaitFor(listener="udp:11811"), fresh_robot, {})
    assert operation.differs(fresh_robot) is None  # the vendor's
    ended = Process(named=SERVER, root=True)
    difference = ended.differs(fresh_robot)
    assert difference is not None
    ended.change(fresh_robot, difference)
    there_and_back(operation, fresh_robot)
    operation.change(fresh_robot, operation.differs(fresh_robot))  # type: ignore[arg-type]
    settled(operation, fresh_robot, {})
    fresh_robot.close()  # it outlives the connection that started it
    assert operation.differs(fresh_robot) is None
    environment = fresh_robot.run("tr '\\0' '\\n' </proc/$(cat /tmp/lupin-disc.log.pid)/environ").stdout
    assert "FASTRTPS_DEFAULT_PROFILES_FILE" not in environment


def test_the_clock_is_stepped_only_while_nothing_of_the_stack_runs(fresh_host: Host, fresh_robot: SshTarget) -> None:
    fresh_host.robot.fault("clock-wrong", offset_s=-5040.0)
    operation = ClockStep()
    difference = operation.differs(fresh_robot)
    assert difference is not None and "behind this machine's" in difference.summary
    steps = fresh_host.robot.state["clock_steps"]
    with pytest.raises(OperationError, match=r"not stepped under a running stack: mirte-ros.service is active"):
        operation.change(fresh_robot, difference)
    assert fresh_host.robot.state["clock_steps"] == steps
    fresh_robot.run("systemctl stop mirte-ros", root=True)
    operation.change(fresh_robot, difference)
    assert operation.differs(fresh_robot) is None
    found = offset(fresh_robot)
    assert abs(found.offset_s) < 1.0 + found.bound_s
    with pytest.raises(ValueError, match="never the laptop's"):
        ClockStep(machine="laptop")


def test_segments_that_nobody_holds_are_swept_and_held_ones_stay(fresh_robot: SshTarget) -> None:
    hold = (
        "cd /dev/shm; touch fastrtps_0123456789abcdef fastrtps_0123456789abcdef_el fastrtps_fedcba9876543210 "
        "fastrtps_fedcba9876543210_el; setsid flock -s fastrtps_fedcba9876543210_el sleep 100 >/dev/null 2>&1 </dev/null &"
    )
    fresh_robot.run(hold)
    operation = Sweep()
    difference = operation.differs(fresh_robot)
    assert difference is not None and "1 segments removed" in difference.summary
    operation.change(fresh_robot, difference)
    assert operation.differs(fresh_robot) is None
    assert fresh_robot.run("cd /dev/shm; ls fastrtps_0123* fastrtps_fedc* 2>/dev/null").stdout.split() == [
        "fastrtps_fedcba9876543210",
        "fastrtps_fedcba9876543210_el",
    ]


def test_a_reboot_waits_for_the_new_boot_and_happens_once_a_step(fresh_robot: SshTarget) -> None:
    operation = Reboot(back_within_s=60.0)
    difference = operation.differs(fresh_robot)
    assert difference is not None
    operation.change(fresh_robot, difference)
    settled(operation, fresh_robot, difference.before)
    assert operation.differs(fresh_robot) is not None  # another step's reboot would be another one


def test_waiting_for_units_and_listeners_ends_when_they_come(fresh_robot: SshTarget) -> None:
    assert WaitFor(unit="mirte-jupyter.service").differs(fresh_robot) is None
    fresh_robot.run("systemctl stop mirte-jupyter", root=True)
    for operation in (WaitFor(unit="mirte-jupyter.service"), WaitFor(listener="tcp:8888")):
        assert operation.differs(fresh_robot) is not None
    began = time.monotonic()
    fresh_robot.run("systemd-run --on-active=1 systemctl start mirte-jupyter", root=True)
    settled(WaitFor(unit="mirte-jupyter.service"), fresh_robot, {})
    settled(WaitFor(listener="tcp:8888"), fresh_robot, {})
    assert time.monotonic() - began < 30


def test_a_robot_without_networkmanager_says_so(robot: SshTarget) -> None:
    with pytest.raises(OperationError, match=r"robot has no NetworkManager"):
        NetworkConnection(connection="x", settings={"ipv4.never-default": "yes"}, machine="robot").differs(robot)
