"""A run's DDS domain: claimed while its process lives, on loopback, without shared memory."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from lupin_runtime.stack.dds import (
    NoFreeDomain,
    NoRobotEnvironment,
    claim_domain,
    discovery_mode,
    loopback_environment,
    robot_environment,
)


def test_claimed_domain_is_exclusive_until_released() -> None:
    first = claim_domain()
    with pytest.raises(NoFreeDomain, match=f"domain {first.domain} is"):
        claim_domain(first.domain)
    assert claim_domain_and_release() != first.domain
    first.release()
    again = claim_domain(first.domain)
    again.release()


def claim_domain_and_release() -> int:
    claim = claim_domain()
    claim.release()
    return claim.domain


def test_domain_claim_ends_with_its_process() -> None:
    code = "from lupin_runtime.stack.dds import claim_domain; import os; print(claim_domain().domain, flush=True); os.abort()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    domain = int(done.stdout)
    claim_domain(domain).release()


def test_loopback_environment_drops_foreign_dds_variables(tmp_path: Path) -> None:
    foreign = {"ROS_DISCOVERY_SERVER": "10.42.0.1:11811", "FASTDDS_BUILTIN_TRANSPORTS": "SHM", "KEEP": "1"}
    environment = loopback_environment(7, tmp_path, foreign)
    assert environment["KEEP"] == "1" and environment["ROS_DOMAIN_ID"] == "7"
    assert "ROS_DISCOVERY_SERVER" not in environment and "FASTDDS_BUILTIN_TRANSPORTS" not in environment
    assert "127.0.0.1" in Path(environment["FASTRTPS_DEFAULT_PROFILES_FILE"]).read_text()


def test_robot_environment_comes_from_ros_env_sh(tmp_path: Path) -> None:
    base = {"HOME": str(tmp_path), "PATH": "/bin"}
    with pytest.raises(NoRobotEnvironment, match=r"ros-env\.sh"):
        robot_environment(base)
    folder = tmp_path / ".config" / "lupin"
    folder.mkdir(parents=True)
    (folder / "ros-env.sh").write_text(
        '# comment\nexport FASTRTPS_DEFAULT_PROFILES_FILE="$HOME/.config/lupin/client.xml"\n'
        'export ROS_DISCOVERY_SERVER="10.42.0.1:11811"\nexport RMW_IMPLEMENTATION=rmw_fastrtps_cpp\nrm -rf nothing\n'
    )
    environment, applied = robot_environment(base)
    assert applied == ["FASTRTPS_DEFAULT_PROFILES_FILE", "ROS_DISCOVERY_SERVER", "RMW_IMPLEMENTATION"]
    assert environment["ROS_DISCOVERY_SERVER"] == "10.42.0.1:11811"
    assert environment["FASTRTPS_DEFAULT_PROFILES_FILE"] == f"{tmp_path}/.config/lupin/client.xml"


@pytest.mark.graph
def test_node_uses_only_loopback_and_no_shared_memory() -> None:
    code = """
import os, subprocess, rclpy
before = set(os.listdir('/dev/shm'))
rclpy.init(); node = rclpy.create_node('quiet')
import psutil
addresses = {c.laddr.ip for c in psutil.Process().net_connections('udp') if c.laddr}
made = {name for name in set(os.listdir('/dev/shm')) - before if 'fastrtps' in name}
print(sorted(addresses), sorted(made), flush=True)
os._exit(0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    addresses, made = done.stdout.strip().rsplit(" ", 1)
    assert made == "[]"
    # Multicast sockets bind the wildcard address and join on loopback; no address of a real interface may appear.
    assert set(eval(addresses)) <= {"127.0.0.1", "0.0.0.0", "239.255.0.1"}
    assert os.environ["ROS_DOMAIN_ID"]


def test_discovery_mode_names_the_server_or_warns(tmp_path: Path) -> None:
    robot = discovery_mode({"ROS_DISCOVERY_SERVER": "10.42.0.1:11811", "ROS_DOMAIN_ID": "3"})
    assert (robot.sentence, robot.warning) == ("discovery server 10.42.0.1:11811, domain 3", "")
    simulated = discovery_mode(loopback_environment(7, tmp_path, {}))
    assert (simulated.sentence, simulated.warning) == ("this machine only, domain 7", "")
    plain = discovery_mode({"ROS_DISCOVERY_SERVER": ""})
    assert plain.sentence == "multicast, domain 0: no discovery server"
    assert "lupin dds setup" in plain.warning
