"""Deploys and clock setting on the simulated computer under faults: no partial state, and every run can be resumed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from typer.testing import Result

from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.ssh import SshTarget
from lupin_cli.operations import release_transfer
from lupin_cli.operations.release import build_release
from lupin_cli.operations.release_transfer import read_installed
from lupin_cli.playbook import play
from lupin_cli.playbook.lease import Lease
from lupin_cli.release import contents
from lupin_cli.release.manifest import Entry
from tests.support import large_release as large_release_module
from tests.support.cables import CableCutter
from tests.support.large_release import with_large_files
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_sim.host import Host

Lupin = Callable[..., Result]
pytestmark = pytest.mark.host
CURRENT_ID = "basename $(readlink /opt/lupin/current)"
SETUP_LINE = "source ~/mirte_ws/install/setup.bash"


def output_of(host: Host, *command: str) -> str:
    return host.robot.run_as_root("sh", "-c", " ".join(command)).stdout.strip()


def running_release(host: Host) -> str:
    """Wait for the end of a restart, and return the id of the release that lupin-onboard was started from."""
    script = (
        "systemctl is-active lupin-onboard; tr '\\0' ' ' < /proc/$(systemctl show -p MainPID --value lupin-onboard)/cmdline"
    )

    def active_command_line() -> str:
        output = output_of(host, script)
        return output if output.startswith("active\n") and "/opt/lupin/releases/" in output else ""

    found = wait_until(active_command_line, lambda: output_of(host, script), timeout_s=60.0)
    return found.split("/opt/lupin/releases/")[1].split("/")[0]


@pytest.fixture
def deployed(robot_host: Host, lupin: Lupin) -> str:
    """Deploy a release if there is none, and return the id of the running one."""
    if not output_of(robot_host, "readlink /opt/lupin/current"):
        done = lupin("deploy", "robot", "--no-check")
        assert done.exit_code == 0, done.output
    return running_release(robot_host)


@pytest.fixture
def target(
    robot_host: Host,
    lupin: Lupin,  # noqa: ARG001 -- the fixture must have run
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[SshTarget]:
    """Yield the robot, over a connection that soon notices a cut link."""
    monkeypatch.setattr("lupin_cli.connection.connect.UNACKNOWLEDGED_MS", 500)
    monkeypatch.setattr("lupin_cli.connection.keepalive.KEEPALIVE_AFTER_S", 0.3)
    place = Destination(robot_host.robot.eth0, 22, "mirte", (str(robot_host.key),), identities_only=True)
    trust = KnownHosts(Path("/nonexistent"), user_file=Path(robot_host.known_hosts))
    target = SshTarget("mirte", place, trust, connect_timeout_s=0.6)
    with robot_host.on_laptop():
        yield target
        target.close()


@pytest.fixture
def another_release(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[None]:
    """Give this machine a release that no other test has deployed."""
    monkeypatch.setattr(contents, "__version__", request.node.name)
    build_release.cache_clear()
    yield
    build_release.cache_clear()


@pytest.fixture
def large_release(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """Add four large files to this machine's release, and yield the folder with them."""
    folder = tmp_path / "large"
    folder.mkdir()
    for number in range(4):
        (folder / f"{number}.bin").write_bytes(os.urandom(5_000_000))
    monkeypatch.setattr("lupin_cli.operations.release.release_files", with_large_files(folder))
    build_release.cache_clear()
    yield folder
    build_release.cache_clear()


def test_deploy_with_cable_cut_in_every_step_resumes_to_the_end(
    robot_host: Host,
    deployed: str,
    another_release: None,  # noqa: ARG001 -- must run after `deployed`
    target: SshTarget,
) -> None:
    new = build_release(read_installed(target).robot).id
    assert new != deployed

    def assert_a_release_runs(_: Any) -> None:
        assert output_of(robot_host, CURRENT_ID) in (deployed, new)
        assert running_release(robot_host) in (deployed, new)

    given = {"set_up": [SETUP_LINE, "export LUPIN_TEST=1"]}  # so the units differ too
    cutter = CableCutter(robot_host, target)
    result, cuts = cutter.play("deploy-robot", given, assert_a_release_runs)
    assert result.state == "done", result.message
    # A probe may be answered before its step begins, so not every step can be cut; every change can.
    assert cuts > 5 and cutter.uncut_changes == set()
    assert (output_of(robot_host, CURRENT_ID), running_release(robot_host)) == (new, new)
    assert "LUPIN_TEST=1" in output_of(robot_host, "cat /etc/systemd/system/lupin-onboard.service")
    # A cut after the last step leaves the lease on the robot. The same operator's next run takes it over and releases it.
    lease = Lease(target, "the next run")
    assert lease.take()
    lease.end()
    assert output_of(robot_host, "ls -d /run/lupin-lease*") == ""


@pytest.mark.usefixtures("deployed")
def test_clock_setting_with_cable_cut_in_every_change_resumes(robot_host: Host, target: SshTarget) -> None:
    output_of(robot_host, "rm /etc/systemd/system/lupin-auto-home.service; systemctl daemon-reload")
    robot_host.robot.inject_fault("clock-wrong", offset_s=-16_440.0)
    steps = int(robot_host.robot.state["clock_steps"])
    result, cuts = CableCutter(robot_host, target).play("sync-clock", {"controllers": False}, lambda _: None, changes_only=True)
    assert result.state == "done", result.message
    assert cuts >= 5, "two units and the vendor's stack stop, the clock is set, the stack starts"
    assert abs(float(robot_host.robot.state["clock_offset_s"])) < 1.0
    assert int(robot_host.robot.state["clock_steps"]) in (steps + 1, steps + 2)  # the reply to the first step may be lost
    assert output_of(robot_host, "systemctl is-active mirte-ros lupin-onboard").split() == ["active", "active"]


def test_deploy_resumes_after_power_cut_and_kill_under_its_lease(
    robot_host: Host,
    deployed: str,
    large_release: Path,
    target: SshTarget,
    lupin: Lupin,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    archives = release_transfer._archives

    def archives_with_power_cut(entries: Sequence[Entry]) -> Iterator[tuple[int, bytes]]:
        for number, archive in enumerate(archives(entries)):
            if number == 1:
                robot_host.robot.power_cut()
            yield archive

    with monkeypatch.context() as patch:
        patch.setattr(release_transfer, "_archives", archives_with_power_cut)
        lost = play("deploy-robot", {"robot": target}, {"set_up": [SETUP_LINE]})
    assert (lost.state, lost.exit_code) == ("unreachable", 3), lost.message
    assert lost.message.startswith("Install the release: ") and lost.next_command
    assert lost.resume == "lupin play deploy-robot --robot mirte --resume"
    robot_host.robot.power_on()
    robot_host.robot.wait_ready()
    assert output_of(robot_host, CURRENT_ID) == deployed

    program = [sys.executable, large_release_module.__file__, str(large_release)]
    resume = ("play", "deploy-robot", "--resume")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with robot_host.popen([*program, "SIGSTOP", *resume], env=dict(os.environ), **quiet) as first:
        try:
            stat = Path(f"/proc/{first.pid}/stat")
            wait_until(
                lambda: stat.read_text().rpartition(")")[2].split()[0] == "T", "the stop of the first run", timeout_s=150.0
            )
            assert first.poll() is None
            for words in (("deploy", "robot", "--no-check"), ("play", "deploy-robot", "-v", "set_up=true")):
                monkeypatch.setenv("XDG_STATE_HOME", os.environ["HOME"] + "/another-operators")
                second = lupin(*words)
                assert second.exit_code == 1, second.output
                assert "mirte is being changed by" in second.output
                assert "(lupin play deploy-robot --robot mirte --resume), for" in second.output
                assert "next: lupin wait free --robot mirte && lupin " in second.output and "1/" not in second.output
            waited = lupin("wait", "free", "--timeout", "0")
            assert waited.exit_code == 1 and "it is being changed by" in waited.output, waited.output
        finally:
            first.kill()
    # The laptop's own next run takes the lease of the dead one over, so for it the robot is free.
    wait_free = [sys.executable, "-m", "lupin_cli.app", "wait", "free", "--timeout", "30"]
    freed = robot_host.run(wait_free, env=dict(os.environ))
    assert freed.returncode == 0 and "mirte is free" in freed.stdout, freed.stderr
    monkeypatch.delenv("XDG_STATE_HOME")
    assert output_of(robot_host, CURRENT_ID) == deployed
    arrived = int(output_of(robot_host, "cat /opt/lupin/incoming/*/share/*.bin | wc -c"))
    assert 10_000_000 <= arrived < 20_000_000, "expected the kill in the middle of the copy"
    again = robot_host.run([*program, "", *resume], timeout_s=150.0, env=dict(os.environ))  # a whole deploy, on a busy machine
    assert again.returncode == 0, again.stderr
    new = output_of(robot_host, CURRENT_ID)
    assert new != deployed and running_release(robot_host) == new
    assert output_of(robot_host, "ls -d /run/lupin-lease* /opt/lupin/incoming/*") == ""


REFUSALS = [
    # fault, its settings, exit status, message, next command
    ("disk-full", {}, 1, "MB free below /opt/lupin", "sudo du -xh"),
    ("disk-read-only", {}, 1, "read-only file system below /opt/lupin; nothing was copied", "dmesg"),
    ("program-missing", {"program": "python3"}, 1, "the robot has no python3", "apt install python3"),
    ("sudo-password", {}, 1, "a password is required", "lupin deploy robot --robot mirte --ask-sudo-password"),
    ("sudo-refused", {}, 1, "mirte cannot run commands as root", "--ask-sudo-password"),
    ("host-key-changed", {}, 3, "a key other than", "lupin robots forget mirte"),
    ("frozen", {}, 3, "accepts connections but does not answer", "lupin doctor"),
    ("sshd-down", {}, 3, "no sshd listens on that port", "ping"),
]


def test_refusal_is_reported_with_next_command_and_no_change(
    robot_host: Host,
    deployed: str,
    another_release: None,  # noqa: ARG001 -- must run after `deployed`
    lupin: Lupin,
) -> None:
    for fault, settings, status, words, command in REFUSALS:
        with robot_host.robot.with_fault(fault, **settings):
            result = lupin("deploy", "robot", "--no-check")
        assert result.exit_code == status, f"{fault}: {result.output}"
        assert words in result.output, f"{fault}: {result.output}"
        next_lines = [line for line in result.output.splitlines() if line.startswith("  next: ")]
        assert next_lines and command in next_lines[0], f"{fault}: {result.output}"
    wrong_user = lupin("deploy", "robot", "--no-check", "--robot", "nobody-here@10.42.0.1")
    assert wrong_user.exit_code == 3, wrong_user.output
    assert f"next: ssh-copy-id -i {robot_host.key} nobody-here@10.42.0.1" in wrong_user.output, wrong_user.output
    assert (output_of(robot_host, CURRENT_ID), running_release(robot_host)) == (deployed, deployed)


def test_robot_without_chrony_is_reported_and_its_clock_measured(robot_host: Host, lupin: Lupin) -> None:
    with robot_host.robot.with_fault("program-missing", program="chronyc"):
        refused = lupin("play", "install-clock-sync", "-v", "laptop_serves=false")
        measured = lupin("sync-clock", "--dry-run", "--json")
    assert refused.exit_code == 1 and "chrony is not installed on the robot" in refused.output, refused.output
    assert "next: lupin sync-clock --robot mirte" in refused.output
    assert measured.exit_code == 0, measured.output
    assert abs(json.loads(measured.stdout)["before"]["offset_s"]) < 1.0
