"""The robot's computer boots, can be logged into, forgets what it should and keeps what it should."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from lupin_sim.host import Host

pytestmark = pytest.mark.host


def test_systemd_runs_as_the_first_process_and_nothing_has_failed(host: Host) -> None:
    said = host.ssh("cat /proc/1/comm; systemctl is-system-running --wait; systemctl --failed --no-legend")
    assert said.stdout.split() == ["systemd", "running"], said


def test_mirte_is_let_in_over_both_links_and_may_sudo_without_a_password(host: Host) -> None:
    for link in ("eth0", "wlan0"):
        said = host.run(host.ssh_command("sudo -n id -u; hostname", link=link))
        assert said.stdout.split() == ["0", "mirte"], said.stderr


def test_both_interfaces_have_the_robots_addresses(host: Host) -> None:
    said = host.ssh("ip -4 -br address").stdout
    assert "10.42.0.1/24" in said
    assert "192.168.42.1/24" in said


def test_this_machines_interfaces_are_not_seen_in_there_nor_on_the_laptop(host: Host) -> None:
    assert sorted(host.ssh("ls /sys/class/net").stdout.split()) == ["eth0", "lo", "wlan0"]
    assert sorted(host.run(["ls", "/sys/class/net"]).stdout.split()) == ["lan0", "lo", "wifi0"]


def test_the_laptop_has_processes_of_its_own(host: Host) -> None:
    with host.popen(["sleep", "60"]) as sleeper:
        seen = host.run(["sh", "-c", "cat /proc/[0-9]*/comm"]).stdout.split()
        sleeper.kill()
    assert seen == ["sleep", "sleep", "sh"]
    assert sleeper.returncode == -9


def test_a_renewed_robot_has_forgotten_files_and_has_the_same_host_key(fresh_host: Host) -> None:
    fresh_host.ssh("echo kept > ~/note; sync")
    fresh_host.robot.renew()
    said = fresh_host.ssh("ls ~")
    assert (said.returncode, said.stdout) == (0, "mirte_ws\n")


def test_files_and_the_journal_outlive_a_power_cut_but_routes_do_not(fresh_host: Host) -> None:
    robot = fresh_host.robot
    fresh_host.ssh(
        "echo kept > ~/note; sudo ip route add 172.30.0.0/16 via 10.42.0.2; echo x > /dev/shm/x; sudo journalctl --sync"
    )
    robot.power_cut()
    assert not robot.state["running"]
    robot.power_on()
    robot.wait_ready()
    said = fresh_host.ssh("cat ~/note; ip route; ls /dev/shm; sudo journalctl --list-boots --no-pager --quiet | wc -l").stdout
    assert "kept" in said
    assert "172.30" not in said
    assert said.split()[-1] == "2"


def test_a_reboot_comes_back_by_itself_and_is_up_since_then(fresh_host: Host) -> None:
    robot = fresh_host.robot
    boots = robot.state["boots"]
    fresh_host.ssh("sudo systemctl reboot")
    while robot.state["boots"] == boots or fresh_host.ssh("true").returncode:
        robot.wait_ready()
    assert int(fresh_host.ssh("cut -d. -f1 /proc/uptime").stdout) < 60
    assert robot.state["running"]
    assert robot.state["boots"] == boots + 1


def test_several_robots_stand_on_one_wire_under_their_own_addresses(boot_host: Callable[..., Host]) -> None:
    host = boot_host(robots=2)
    names = [host.ssh("hostname", robot=robot).stdout.strip() for robot in host.robots]
    assert names == ["mirte", "mirte-2"]
    assert [robot.eth0 for robot in host.robots] == ["10.42.0.1", "10.42.0.11"]
