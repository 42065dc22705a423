"""What a deploy and the setting of a clock survive, on a robot that boots: nothing is half-way, and everything goes on."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from bigger import enlarge
from cables import Pulled

from lupin_cli.operations.release import built
from lupin_cli.release import contents, transfer
from lupin_cli.release.transfer import installed
from lupin_cli.runbook import load, play
from lupin_cli.runbook.lease import Lease
from lupin_cli.target.destination import Destination
from lupin_cli.target.ssh import SshTarget
from lupin_cli.target.trust import Trust

pytestmark = pytest.mark.host
ID = "basename $(readlink /opt/lupin/current)"
SET_UP = "source ~/mirte_ws/install/setup.bash"


def said(host, *command: str) -> str:
    return host.robot.inside("sh", "-c", " ".join(command)).stdout.strip()


def runs_from(host) -> str:
    """The release that the onboard half's main process was started from; it is running, or just being restarted."""
    look = "systemctl is-active lupin-onboard; tr '\\0' ' ' < /proc/$(systemctl show -p MainPID --value lupin-onboard)/cmdline"
    deadline = time.monotonic() + 60
    while not (found := said(host, look)).startswith("active\n") or "/opt/lupin/releases/" not in found:
        assert time.monotonic() < deadline, found
        time.sleep(0.1)
    return found.split("/opt/lupin/releases/")[1].split("/")[0]


@pytest.fixture
def deployed(robot_host, lupin) -> str:
    """The id of the release that runs there."""
    if not said(robot_host, "readlink /opt/lupin/current"):
        done = lupin("deploy", "robot", "--no-check")
        assert done.exit_code == 0, done.output
    return runs_from(robot_host)


@pytest.fixture
def target(robot_host, lupin, monkeypatch) -> Iterator[SshTarget]:
    """The robot over a link whose end is noticed soon."""
    monkeypatch.setattr("lupin_cli.target.reach.UNACKNOWLEDGED_MS", 500)
    monkeypatch.setattr("lupin_cli.target.keepalive.ASK_AFTER_S", 0.3)
    place = Destination(robot_host.robot.eth0, 22, "mirte", (str(robot_host.key),), identities_only=True)
    trust = Trust(Path("/nonexistent"), users=Path(robot_host.known_hosts))
    target = SshTarget("mirte", place, trust, connect_timeout_s=0.6)
    with robot_host.on_laptop():
        yield target
        target.close()


@pytest.fixture
def another_release(monkeypatch, request) -> Iterator[None]:
    """This machine has a release that no test before has deployed."""
    monkeypatch.setattr(contents, "__version__", request.node.name)
    built.cache_clear()
    yield
    built.cache_clear()


@pytest.fixture
def large_release(monkeypatch, tmp_path) -> Iterator[Path]:
    """This machine's release has four large files more; the folder that they are in."""
    folder = tmp_path / "large"
    folder.mkdir()
    for number in range(4):
        (folder / f"{number}.bin").write_bytes(os.urandom(5_000_000))
    monkeypatch.setattr("lupin_cli.operations.release.files", enlarge(folder))
    built.cache_clear()
    yield folder
    built.cache_clear()


def test_a_cable_pulled_in_every_step_of_a_deploy_leaves_a_release_running_and_resume_ends_it(
    robot_host, deployed, another_release, target
):
    new = built(installed(target).robot).id
    assert new != deployed

    def survived(_) -> None:
        assert said(robot_host, ID) in (deployed, new)
        assert runs_from(robot_host) in (deployed, new)

    given = {"set_up": [SET_UP, "export LUPIN_TEST=1"]}  # so the units differ too
    result, cuts = Pulled(robot_host, target).plays("deploy-robot", given, survived)
    assert result.state == "done", result.message
    # Some looks were answered before their step's turn: a cut in one of those meets the next. So were all that logind is told.
    assert cuts >= len(load("deploy-robot").steps) - len(load("keep-shared-memory").steps) - 3
    assert (said(robot_host, ID), runs_from(robot_host)) == (new, new)
    assert "LUPIN_TEST=1" in said(robot_host, "cat /etc/systemd/system/lupin-onboard.service")
    # A cut behind the last word leaves the lease there: it keeps its operator's next run out of nothing, and goes with that.
    lease = Lease(target, "the next run")
    assert lease.take()
    lease.end()
    assert said(robot_host, "ls -d /run/lupin-lease*") == ""


def test_a_cable_pulled_in_every_change_of_a_clocks_setting_is_told_and_resume_ends_with_the_stack_up(
    robot_host, deployed, target
):
    said(robot_host, "rm /etc/systemd/system/lupin-auto-home.service; systemctl daemon-reload")  # the arm's way takes long
    robot_host.robot.fault("clock-wrong", offset_s=-16_440.0)
    steps = int(robot_host.robot.state["clock_steps"])
    result, cuts = Pulled(robot_host, target).plays("sync-clock", {"controllers": False}, lambda _: None, changes_only=True)
    assert result.state == "done", result.message
    assert cuts >= 5, "two units and the vendor's stack are stopped, the clock is set, the stack is started"
    assert abs(float(robot_host.robot.state["clock_offset_s"])) < 1.0
    assert int(robot_host.robot.state["clock_steps"]) in (steps + 1, steps + 2)  # the last word of the first may be lost
    assert said(robot_host, "systemctl is-active mirte-ros lupin-onboard").split() == ["active", "active"]


def test_a_deploy_outlives_a_power_cut_keeps_a_second_operator_out_and_goes_on_where_it_was_killed(
    robot_host, deployed, large_release, target, lupin, monkeypatch
):
    archives = transfer._archives

    def unplugged(entries):
        for number, archive in enumerate(archives(entries)):
            if number == 1:
                robot_host.robot.power_cut()
            yield archive

    with monkeypatch.context() as patch:
        patch.setattr(transfer, "_archives", unplugged)
        lost = play("deploy-robot", {"robot": target}, {"set_up": [SET_UP]})
    assert (lost.state, lost.exit_code) == ("unreachable", 3), lost.message
    assert lost.message.startswith("Bring the release there: ") and lost.next_command
    assert lost.resume == "lupin play deploy-robot --robot mirte --resume"
    robot_host.robot.power_on()
    robot_host.robot.wait_ready()
    assert said(robot_host, ID) == deployed

    program = [sys.executable, str(Path(__file__).with_name("bigger.py")), str(large_release)]
    resume = ("play", "deploy-robot", "--resume")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with robot_host.popen([*program, "SIGSTOP", *resume], env=dict(os.environ), **quiet) as first:
        try:
            deadline = time.monotonic() + 60
            while Path(f"/proc/{first.pid}/stat").read_text().rpartition(")")[2].split()[0] != "T":
                assert first.poll() is None and time.monotonic() < deadline
                time.sleep(0.02)
            for words in (("deploy", "robot", "--no-check"), ("play", "deploy-robot", "-v", "set_up=true")):
                monkeypatch.setenv("XDG_STATE_HOME", os.environ["HOME"] + "/another-operators")
                second = lupin(*words)
                assert second.exit_code == 1, second.output
                assert "mirte is being changed by" in second.output and "(lupin play deploy-robot)" in second.output
                assert "--break-lease" in second.output
        finally:
            first.kill()
    monkeypatch.delenv("XDG_STATE_HOME")
    assert said(robot_host, ID) == deployed
    arrived = int(said(robot_host, "cat /opt/lupin/incoming/*/share/*.bin | wc -c"))
    assert 10_000_000 <= arrived < 20_000_000, "it was killed in the middle of the copy"
    again = robot_host.run([*program, "", *resume], env=dict(os.environ))
    assert again.returncode == 0, again.stderr
    new = said(robot_host, ID)
    assert new != deployed and runs_from(robot_host) == new
    assert said(robot_host, "ls -d /run/lupin-lease* /opt/lupin/incoming/*") == ""


REFUSALS = [
    # fault, what is broken, status, what is said, what is typed next
    ("disk-full", {}, 1, "MB free below /opt/lupin", "sudo du -xh"),
    ("disk-read-only", {}, 1, "read-only file system below /opt/lupin; nothing was copied", "dmesg"),
    ("program-missing", {"program": "python3"}, 1, "mirte has no python3", "apt install python3"),
    ("sudo-password", {}, 1, "a password is required", "lupin play deploy-robot --robot mirte --resume --ask-sudo-password"),
    ("sudo-refused", {}, 1, "root is refused to mirte", "--ask-sudo-password"),
    ("host-key-changed", {}, 3, "another key", "lupin robots forget mirte"),
    ("frozen", {}, 3, "accepts connections and says nothing", "lupin doctor"),
    ("sshd-down", {}, 3, "no sshd listens there", "ping"),
]


def test_what_a_robot_refuses_is_told_with_a_status_and_the_next_command_and_costs_nothing(
    robot_host, deployed, another_release, lupin
):
    for fault, settings, status, words, command in REFUSALS:
        with robot_host.robot.broken(fault, **settings):
            result = lupin("deploy", "robot", "--no-check")
        assert result.exit_code == status, f"{fault}: {result.output}"
        assert words in result.output, f"{fault}: {result.output}"
        told = [line for line in result.output.splitlines() if line.startswith("  next: ")]
        assert told and command in told[0], f"{fault}: {result.output}"
    wrong_user = lupin("deploy", "robot", "--no-check", "--robot", "nobody-here@10.42.0.1")
    assert wrong_user.exit_code == 3 and "next: ssh-copy-id nobody-here@10.42.0.1" in wrong_user.output, wrong_user.output
    assert (said(robot_host, ID), runs_from(robot_host)) == (deployed, deployed)


def test_a_robot_without_chrony_is_told_so_and_its_clock_is_measured_all_the_same(robot_host, lupin):
    with robot_host.robot.broken("program-missing", program="chronyc"):
        refused = lupin("play", "install-clock-sync", "-v", "laptop_serves=false")
        measured = lupin("sync-clock", "--dry-run", "--json")
    assert refused.exit_code == 1 and "chrony is not installed on the robot" in refused.output, refused.output
    assert "next: lupin sync-clock" in refused.output
    assert measured.exit_code == 0, measured.output
    assert abs(json.loads(measured.stdout)["before"]["offset_s"]) < 1.0
