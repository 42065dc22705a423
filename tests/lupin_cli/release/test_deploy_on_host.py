"""`lupin deploy robot` on the simulated computer: first deploy, repetition, replacement, rollback, removal."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest
from typer.testing import Result

from lupin_cli.operations.release import build_release
from lupin_cli.release import contents

if TYPE_CHECKING:
    from lupin_sim.host import Host

Lupin = Callable[..., Result]
pytestmark = pytest.mark.host
READ_CURRENT_ID = "basename $(readlink /opt/lupin/current)"
READ_REMOVE_IPC = "busctl get-property org.freedesktop.login1 /org/freedesktop/login1 org.freedesktop.login1.Manager RemoveIPC"
DEPLOYED_FILES = (
    "/etc/systemd/system/lupin-* /etc/udev/rules.d/70-lupin* /etc/sysctl.d/60-lupin* /etc/systemd/logind.conf.d/60-lupin* "
    "/opt/lupin/* /usr/local/lib/lupin/verify-release /etc/lupin/release-signers"
)


def output_of(host: Host, *command: str) -> str:
    return host.robot.run_as_root("sh", "-c", " ".join(command)).stdout.strip()


def running_releases(host: Host) -> set[str]:
    """Return the ids of the releases that the main processes of lupin-onboard and lupin-cameras were started from."""
    lines = [
        output_of(host, f"tr '\\0' ' ' < /proc/$(systemctl show -p MainPID --value {unit})/cmdline")
        for unit in ("lupin-onboard", "lupin-cameras")
    ]
    return {line.split("/opt/lupin/releases/")[1].split("/")[0] for line in lines}


@pytest.fixture
def next_release(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Yield a function that gives the release of this machine another version."""

    def make(version: str) -> None:
        monkeypatch.setattr(contents, "__version__", version)
        build_release.cache_clear()

    yield make
    build_release.cache_clear()


@pytest.mark.smoke
def test_deploy_repeat_replace_rollback_remove(robot_host: Host, lupin: Lupin, next_release: Callable[[str], None]) -> None:
    host = robot_host
    dry = lupin("deploy", "robot", "--dry-run", "--diff")
    assert dry.exit_code == 0, dry.output
    assert re.search(r"\+\d+ files in venv/lib/python[0-9.]+/site-packages/lupin_runtime, [0-9.]+ MB", dry.stdout)
    assert len(re.findall(r"\d+ files? in ", dry.stdout)) < 250, "one line per package, not per file"
    assert output_of(host, "ls -d /opt/lupin /etc/systemd/system/lupin-*") == ""

    first = lupin("deploy", "robot", "--no-check")
    assert first.exit_code == 0, first.output
    states = output_of(host, "systemctl is-active lupin-onboard lupin-cameras").split()
    assert states == ["active", "active"]
    states = output_of(host, "systemctl is-enabled lupin-onboard lupin-cameras lupin-auto-home").split()
    assert states == ["enabled", "enabled", "enabled"]
    wanted = output_of(host, "ls /etc/systemd/system/mirte-ros.service.wants").split()
    assert wanted == ["lupin-cameras.service", "lupin-onboard.service"], "they start whenever the vendor's stack starts"
    assert output_of(host, "systemctl is-active lupin-auto-home") == "inactive", (
        "auto-home moves the arm, so it starts at the next boot only"
    )
    assert output_of(host, READ_REMOVE_IPC) == "b false"
    old = output_of(host, READ_CURRENT_ID)
    assert running_releases(host) == {old}
    assert output_of(host, "find /opt/lupin ! -user root -o -perm /022 ! -type l") == "", "only root may change a release"
    again = lupin("deploy", "robot")
    assert (again.exit_code, "nothing to do" in again.output) == (0, True), again.output

    next_release("0.2.0")
    replaced = lupin("deploy", "robot", "--no-check")
    assert replaced.exit_code == 0, replaced.output
    new = output_of(host, READ_CURRENT_ID)
    assert new != old
    assert running_releases(host) == {new}

    # Packets queued for a laptop that is gone cannot fill the buffers of the robot's own processes.
    assert output_of(host, "cat /proc/sys/net/ipv4/neigh/eth0/unres_qlen_bytes") == "65536"

    back = lupin("deploy", "robot", "--rollback", "--no-check")
    assert back.exit_code == 0, back.output
    assert output_of(host, READ_CURRENT_ID) == old
    assert running_releases(host) == {old}

    removed = lupin("deploy", "robot", "--remove")
    assert removed.exit_code == 0, removed.output
    assert output_of(host, f"ls {DEPLOYED_FILES}") == ""
    assert output_of(host, "systemctl is-active mirte-ros") == "active"
    nothing = lupin("deploy", "robot", "--remove")
    assert "nothing to do" in nothing.output, nothing.output


@pytest.mark.usefixtures("robot_host")
def test_rollback_without_earlier_release_is_refused(lupin: Lupin) -> None:
    # The robot has no release: either no test has deployed one, or the test above has removed it.
    result = lupin("deploy", "robot", "--rollback")
    assert result.exit_code == 1
    assert "no release before the first" in result.output


@pytest.mark.usefixtures("robot_host")
def test_unreachable_robot_exits_with_status_3(lupin: Lupin) -> None:
    assert lupin("deploy", "robot", "--robot", "mirte@10.42.0.77", "--dry-run").exit_code == 3
