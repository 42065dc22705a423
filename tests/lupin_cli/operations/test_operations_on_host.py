"""Operations on units, groups, the discovery server and the clock, and a reboot, on a booted simulated computer."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.ssh import SshTarget
from lupin_cli.operations import OperationError
from lupin_cli.operations.clock_samples import parse_offset, take_samples
from lupin_cli.operations.clock_step import ClockStep
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
from lupin_sim.host import Host
from tests.support.operation_cycle import apply, apply_and_undo, examine, wait_until_settled

pytestmark = pytest.mark.host

SERVER = "fast-discovery-server"


def target_of(host: Host) -> SshTarget:
    place = Destination(host.robot.eth0, 22, "mirte", (str(host.key),), identities_only=True)
    return SshTarget("robot", place, KnownHosts(Path("/nonexistent"), user_file=Path(host.known_hosts)))


@pytest.fixture
def robot(host: Host) -> Iterator[SshTarget]:
    """Yield a robot that several tests share and leave as it was."""
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


def test_files_of_root_are_written_and_restored(robot: SshTarget) -> None:
    apply_and_undo(File(path="/etc/lupin-test", content="x", mode="0600", owner="root:root", root=True), robot)
    apply_and_undo(File(path="/etc/hostname", content="other\n", root=True), robot)


def test_unit_is_stopped_disabled_masked_and_restored(robot: SshTarget) -> None:
    unit = "mirte-jupyter.service"
    difference = apply_and_undo(Unit(unit=unit, state="stopped", enabled=False), robot)
    assert difference.summary == f"{unit}: disable, stop (now active)"
    apply_and_undo(Unit(unit="chrony.service", masked=True, state="stopped"), robot)
    assert examine(Unit(unit=unit, state="started", enabled=True), robot) is None


def test_missing_unit_is_stopped_and_cannot_be_started(robot: SshTarget) -> None:
    assert examine(Unit(unit="lupin-none.service", state="stopped", enabled=False), robot) is None
    with pytest.raises(OperationError, match=r"robot has no unit lupin-none.service"):
        examine(Unit(unit="lupin-none.service", state="started"), robot)


def test_unit_file_is_installed_verified_and_removed(robot: SshTarget) -> None:
    fill = {"laptop": "10.42.0.2", "script": "/bin/true"}
    apply_and_undo(UnitFile(unit="lupin-clock-sync.service", fill=fill), robot)
    bad = UnitFile(unit="lupin-bad.service", content="[Service]\nExecStart=not-absolute and missing\n")
    difference = examine(bad, robot)
    assert difference is not None
    with pytest.raises(OperationError, match=r"could not verify lupin-bad.service"):
        bad.change(robot, difference)
    assert robot.get("/etc/systemd/system/lupin-bad.service", root=True) is None


def test_failed_oneshot_is_reset_and_started(fresh_robot: SshTarget) -> None:
    content = "[Service]\nType=oneshot\nRemainAfterExit=yes\nExecStart=/bin/sh -c 'test -e /run/allowed'\n"
    installed = UnitFile(unit="lupin-once.service", content=content)
    apply(installed, fresh_robot)
    operation = Unit(unit="lupin-once.service", state="started", reset_failed=True)
    difference = examine(operation, fresh_robot)
    assert difference is not None
    with pytest.raises(OperationError, match=r"could not set lupin-once.service"):
        operation.change(fresh_robot, difference)
    difference = examine(operation, fresh_robot)
    assert difference is not None and "reset its failure" in difference.summary
    fresh_robot.run("touch /run/allowed", root=True)
    operation.change(fresh_robot, difference)
    assert examine(operation, fresh_robot) is None


def test_restart_happens_once_per_step(robot: SshTarget) -> None:
    operation = Restart(unit="mirte-jupyter.service")
    difference = examine(operation, robot)
    assert difference is not None
    operation.change(robot, difference)
    wait_until_settled(operation, robot, difference.before)
    assert examine(Restart(unit="lupin-none.service"), robot) is None


def test_user_is_added_to_a_group_and_removed(robot: SshTarget) -> None:
    apply_and_undo(GroupMembership(user="mirte", group="games"), robot)
    with pytest.raises(OperationError, match="has no group 'nobodys'"):
        examine(GroupMembership(user="mirte", group="nobodys"), robot)
    with pytest.raises(OperationError, match="has no user 'nobody-here'"):
        examine(GroupMembership(user="nobody-here", group="games"), robot)


def test_discovery_server_is_started_once_and_stopped_by_undo(fresh_robot: SshTarget) -> None:
    operation = DiscoveryServer()
    wait_until_settled(WaitFor(listener="udp:11811"), fresh_robot)
    assert examine(operation, fresh_robot) is None  # the vendor's
    no_server = Process(named=SERVER, root=True)
    difference = examine(no_server, fresh_robot)
    assert difference is not None
    no_server.change(fresh_robot, difference)
    apply_and_undo(operation, fresh_robot)
    apply(operation, fresh_robot)
    wait_until_settled(operation, fresh_robot)
    fresh_robot.close()  # it outlives the connection that started it
    assert examine(operation, fresh_robot) is None
    environment = fresh_robot.run("tr '\\0' '\\n' </proc/$(cat ~/.local/state/lupin/discovery-server.log.pid)/environ").stdout
    assert "FASTRTPS_DEFAULT_PROFILES_FILE" not in environment


def test_clock_is_stepped_only_while_no_stack_runs(fresh_host: Host, fresh_robot: SshTarget) -> None:
    fresh_host.robot.inject_fault("clock-wrong", offset_s=-5040.0)
    operation = ClockStep()
    difference = examine(operation, fresh_robot)
    assert difference is not None and "behind this machine's" in difference.summary
    steps = fresh_host.robot.state["clock_steps"]
    with pytest.raises(OperationError, match=r"not stepped under a running stack: mirte-ros.service is active"):
        operation.change(fresh_robot, difference)
    assert fresh_host.robot.state["clock_steps"] == steps
    fresh_robot.run("systemctl stop mirte-ros", root=True)
    operation.change(fresh_robot, difference)
    assert examine(operation, fresh_robot) is None
    found = parse_offset(take_samples(fresh_robot))
    assert abs(found.offset_s) < 1.0 + found.bound_s
    with pytest.raises(ValueError, match="never the laptop's"):
        ClockStep(machine="laptop")


def test_sweep_removes_unheld_segments_and_keeps_held_ones(fresh_robot: SshTarget) -> None:
    hold = (
        "cd /dev/shm; touch fastrtps_0123456789abcdef fastrtps_0123456789abcdef_el fastrtps_fedcba9876543210 "
        "fastrtps_fedcba9876543210_el; setsid flock -s fastrtps_fedcba9876543210_el sleep 100 >/dev/null 2>&1 </dev/null &"
    )
    fresh_robot.run(hold)
    operation = Sweep()
    difference = examine(operation, fresh_robot)
    assert difference is not None and "remove 1 unused segments" in difference.summary
    operation.change(fresh_robot, difference)
    assert examine(operation, fresh_robot) is None
    assert fresh_robot.run("cd /dev/shm; ls fastrtps_0123* fastrtps_fedc* 2>/dev/null").stdout.split() == [
        "fastrtps_fedcba9876543210",
        "fastrtps_fedcba9876543210_el",
    ]


def test_reboot_waits_for_the_new_boot_once_per_step(fresh_robot: SshTarget) -> None:
    operation = Reboot(back_within_s=60.0)
    difference = examine(operation, fresh_robot)
    assert difference is not None
    operation.change(fresh_robot, difference)
    wait_until_settled(operation, fresh_robot, difference.before)
    assert examine(operation, fresh_robot) is not None  # without a baseline it would reboot again


def test_wait_for_ends_when_units_and_listeners_are_up(fresh_robot: SshTarget) -> None:
    assert examine(WaitFor(unit="mirte-jupyter.service"), fresh_robot) is None
    fresh_robot.run("systemctl stop mirte-jupyter", root=True)
    for operation in (WaitFor(unit="mirte-jupyter.service"), WaitFor(listener="tcp:8888")):
        assert examine(operation, fresh_robot) is not None
    fresh_robot.run("systemd-run --on-active=1 systemctl start mirte-jupyter", root=True)
    wait_until_settled(WaitFor(unit="mirte-jupyter.service"), fresh_robot)
    wait_until_settled(WaitFor(listener="tcp:8888"), fresh_robot)


def test_robot_without_networkmanager_is_an_error(robot: SshTarget) -> None:
    with pytest.raises(OperationError, match=r"robot has no NetworkManager"):
        examine(NetworkConnection(connection="x", settings={"ipv4.never-default": "yes"}, machine="robot"), robot)
