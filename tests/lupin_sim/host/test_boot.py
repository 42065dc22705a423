"""The simulated computer boots, accepts logins, and keeps or loses state over reset, power cut and reboot as a robot does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from lupin_sim.host import Host
from lupin_sim.host.checkout import link_checkout
from tests.support.waiting import wait_until

pytestmark = pytest.mark.host


@pytest.mark.smoke
def test_systemd_is_pid_1_and_no_unit_failed(host: Host) -> None:
    result = host.ssh("cat /proc/1/comm; systemctl is-system-running --wait; systemctl --failed --no-legend")
    assert result.stdout.split() == ["systemd", "running"], result


@pytest.mark.smoke
def test_mirte_logs_in_on_both_links_and_may_sudo(host: Host) -> None:
    for link in ("eth0", "wlan0"):
        result = host.run(host.ssh_command("sudo -n id -u; hostname", link=link))
        assert result.stdout.split() == ["0", "mirte"], result.stderr


def test_interfaces_have_the_robots_addresses(host: Host) -> None:
    output = host.ssh("ip -4 -br address").stdout
    assert "10.42.0.1/24" in output
    assert "192.168.42.1/24" in output


def test_robot_and_laptop_see_only_their_own_interfaces(host: Host) -> None:
    assert sorted(host.ssh("ls /sys/class/net").stdout.split()) == ["eth0", "lo", "wlan0"]
    assert sorted(host.run(["ls", "/sys/class/net"]).stdout.split()) == ["lan0", "lo", "wifi0"]


def test_laptop_sees_only_its_own_processes(host: Host) -> None:
    with host.popen(["sleep", "60"]) as sleeper:
        wait_until(lambda: Path(f"/proc/{sleeper.pid}/comm").read_text() == "sleep\n", "nsenter to execute the program")

        def sees_only_its_own() -> bool:
            # A process that enters the laptop is seen as Python until it executes its program.
            return bool(host.run(["sh", "-c", "cat /proc/[0-9]*/comm"]).stdout.split() == ["sleep", "sleep", "sh"])

        wait_until(sees_only_its_own, "the laptop to see its own processes only")
        sleeper.kill()
    assert sleeper.returncode == -9


def test_units_see_a_checkout_below_tmp(fresh_host: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    unit = "/etc/systemd/system/lupin-onboard.service"
    fresh_host.robot.run_as_root("sh", "-ec", f"printf '[Service]\\nExecStart=/bin/true\\nPrivateTmp=yes\\n' > {unit}")
    monkeypatch.setattr("sys.prefix", "/tmp/checkout/.venv")
    link_checkout(fresh_host.robot)
    shown = fresh_host.robot.run_as_root("sh", "-ec", "systemctl daemon-reload; systemctl show -P PrivateTmp lupin-onboard")
    assert shown.stdout == "no\n", shown.stderr


def test_factory_reset_removes_files_and_keeps_the_host_key(fresh_host: Host) -> None:
    fresh_host.ssh("echo kept > ~/note; sync")
    fresh_host.robot.factory_reset()
    result = fresh_host.ssh("ls ~")
    assert (result.returncode, result.stdout) == (0, "mirte_ws\n")


def test_power_cut_keeps_files_and_journal_but_not_routes(fresh_host: Host) -> None:
    robot = fresh_host.robot
    fresh_host.ssh(
        "echo kept > ~/note; sudo ip route add 172.30.0.0/16 via 10.42.0.2; echo x > /dev/shm/x; sudo journalctl --sync"
    )
    robot.power_cut()
    assert not robot.state["running"]
    robot.power_on()
    robot.wait_ready()
    output = fresh_host.ssh("cat ~/note; ip route; ls /dev/shm; sudo journalctl --list-boots --no-pager --quiet | wc -l").stdout
    assert "kept" in output
    assert "172.30" not in output
    assert output.split()[-1] == "2"


def test_robot_comes_back_after_a_reboot_with_a_new_uptime(fresh_host: Host) -> None:
    robot = fresh_host.robot
    boots = robot.state["boots"]
    fresh_host.ssh("sudo systemctl reboot")
    while robot.state["boots"] == boots or fresh_host.ssh("true").returncode:
        robot.wait_ready()
    assert int(fresh_host.ssh("cut -d. -f1 /proc/uptime").stdout) < 60
    assert robot.state["running"]
    assert robot.state["boots"] == boots + 1


def test_several_robots_share_a_network_with_own_addresses(boot_host: Callable[..., Host]) -> None:
    host = boot_host(robots=2)
    names = [host.ssh("hostname", robot=robot).stdout.strip() for robot in host.robots]
    assert names == ["mirte", "mirte-2"]
    assert [robot.eth0 for robot in host.robots] == ["10.42.0.1", "10.42.0.11"]
