"""A laptop that boots: what configures the laptop itself is rehearsed to the end, and this machine stays as it is."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from lupin_sim.host import Host
from lupin_sim.host.booted_laptop import in_new_terminal

pytestmark = pytest.mark.host
SERVING = "ls /etc/chrony/conf.d; ss -H -lnu 'sport = :123' | wc -l"


class Laptop:
    """The account of a laptop that boots, beside one robot."""

    def __init__(self, host: Host) -> None:
        self.host = host

    def run(self, script: str, *statuses: int) -> str:
        """Run a script in a new terminal, which must exit with 0 or one of `statuses`; return what it printed."""
        done: subprocess.CompletedProcess[str] = self.host.run(in_new_terminal(["sh", "-c", script]), timeout_s=180.0)
        assert done.returncode in (0, *statuses), f"{script}: {done.stdout}{done.stderr}"
        return done.stdout + done.stderr


@pytest.fixture
def laptop(boot_host: Callable[..., Host]) -> Laptop:
    return Laptop(boot_host(boot_laptop=True))


def test_laptop_boots_with_an_account_that_reaches_the_robot(laptop: Laptop) -> None:
    assert laptop.run("cat /proc/1/comm; hostname; id -un; sudo -n id -un").split() == ["systemd", "laptop", "student", "root"]
    assert laptop.run("systemctl --failed --no-legend") == ""
    assert sorted(laptop.run("ls /sys/class/net").split()) == ["lan0", "lo", "wifi0"]
    assert laptop.run("ssh mirte@10.42.0.1 hostname").strip() == "mirte"
    assert "wired 10.42.0.1, ap 192.168.42.1" in laptop.run("lupin robots list")


def test_laptop_is_deployed_serves_time_and_is_removed(laptop: Laptop) -> None:
    machine = sorted(Path("/etc").rglob("*chrony*"))
    before = laptop.run(SERVING)
    laptop.run("lupin deploy laptop --dry-run")
    assert laptop.run(SERVING) == before
    laptop.run("lupin deploy laptop --yes")
    assert "lupin-server.conf" in laptop.run(SERVING)
    assert laptop.run("echo $ROS_DISCOVERY_SERVER").strip() == "10.42.0.1:11811"
    assert "nothing to do" in laptop.run("lupin deploy laptop --yes")
    laptop.run("lupin play serve-clock -v network=192.168.42.0/24 --yes")  # the other networks stay allowed
    allowed = laptop.run("grep -rh '^allow' /etc/chrony/conf.d").split()
    assert allowed == ["allow", "10.42.0.0/24", "allow", "192.168.42.0/24"]
    assert "nothing to do" in laptop.run("lupin deploy laptop --yes")

    laptop.run("lupin sync-clock --install")
    robot = laptop.host.robot
    # The robot's chrony has an answer of the laptop's.
    wait = "for _ in $(seq 100); do chronyc -n sources | grep -q '^^[*] 10.42.0.2' && exit; sleep 0.2; done; exit 1"
    assert robot.run_as_root("sh", "-c", wait, timeout_s=30.0).status == 0, robot.run_as_root("chronyc", "-n", "sources").stdout
    assert robot.run_as_root("systemctl", "is-enabled", "lupin-clock-sync").stdout.strip() == "enabled"

    laptop.run("lupin play remove-laptop --yes")
    assert laptop.run(SERVING) == before
    assert laptop.run("echo $ROS_DISCOVERY_SERVER").strip() == ""
    assert sorted(Path("/etc").rglob("*chrony*")) == machine
