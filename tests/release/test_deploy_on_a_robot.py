"""`lupin deploy robot` on a computer that boots: there, there again, replaced, taken back, removed."""

from __future__ import annotations

import pytest

from lupin_cli.operations.release import built
from lupin_cli.release import contents

pytestmark = pytest.mark.host
ID = "basename $(readlink /opt/lupin/current)"
REMOVES_IPC = "busctl get-property org.freedesktop.login1 /org/freedesktop/login1 org.freedesktop.login1.Manager RemoveIPC"
OURS = (
    "/etc/systemd/system/lupin-* /etc/udev/rules.d/70-lupin* /etc/sysctl.d/60-lupin* /etc/systemd/logind.conf.d/60-lupin* "
    "/opt/lupin/*"
)


def said(host, *command: str) -> str:
    return host.robot.inside("sh", "-c", " ".join(command)).stdout.strip()


def runs_from(host) -> str:
    """The release that the onboard half's main process was started from."""
    line = said(host, "tr '\\0' ' ' < /proc/$(systemctl show -p MainPID --value lupin-onboard)/cmdline")
    return line.split("/opt/lupin/releases/")[1].split("/")[0]


@pytest.fixture
def next_release(monkeypatch):
    """From here on this machine has another release than before."""

    def make(version: str) -> None:
        monkeypatch.setattr(contents, "__version__", version)
        built.cache_clear()

    yield make
    built.cache_clear()


def test_a_release_is_deployed_once_replaced_taken_back_and_removed(robot_host, lupin, next_release):
    host = robot_host
    dry = lupin("deploy", "robot", "--dry-run", "--diff")
    assert dry.exit_code == 0, dry.output
    assert "+venv/pyvenv.cfg" in dry.output
    assert said(host, "ls -d /opt/lupin /etc/systemd/system/lupin-*") == ""

    first = lupin("deploy", "robot", "--no-check")
    assert first.exit_code == 0, first.output
    assert said(host, "systemctl is-active lupin-onboard; systemctl is-enabled lupin-onboard lupin-auto-home").split() == [
        "active",
        "enabled",
        "enabled",
    ]
    assert said(host, "systemctl is-active lupin-auto-home") == "inactive", "it moves the arm: at the next boot, not now"
    assert said(host, REMOVES_IPC) == "b false"
    old = said(host, ID)
    assert runs_from(host) == old
    again = lupin("deploy", "robot")
    assert (again.exit_code, "nothing to do" in again.output) == (0, True), again.output

    next_release("0.2.0")
    replaced = lupin("deploy", "robot", "--no-check")
    assert replaced.exit_code == 0, replaced.output
    new = said(host, ID)
    assert new != old
    assert runs_from(host) == new

    # What waits for a laptop that is gone can't fill the buffers of the robot's own processes.
    assert said(host, "cat /proc/sys/net/ipv4/neigh/eth0/unres_qlen_bytes") == "65536"

    back = lupin("deploy", "robot", "--rollback", "--no-check")
    assert back.exit_code == 0, back.output
    assert said(host, ID) == old
    assert runs_from(host) == old

    removed = lupin("deploy", "robot", "--remove")
    assert removed.exit_code == 0, removed.output
    assert said(host, f"ls {OURS}") == ""
    assert said(host, "systemctl is-active mirte-ros") == "active"
    nothing = lupin("deploy", "robot", "--remove")
    assert "nothing to do" in nothing.output, nothing.output


def test_going_back_where_there_is_nothing_to_go_back_to_says_so(robot_host, lupin):
    result = lupin("deploy", "robot", "--rollback")
    assert result.exit_code == 1
    assert "no release before the first" in result.output


def test_a_machine_that_cannot_be_reached_is_status_3(robot_host, lupin):
    assert lupin("deploy", "robot", "--robot", "mirte@10.42.0.77", "--dry-run").exit_code == 3
