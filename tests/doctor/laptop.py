"""An operator's laptop beside a robot that boots, and nodes on both."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_cli.facts.dds_profiles import SERVER_PREFIX
from lupin_sim.host import Host
from lupin_sim.host.fixtures import until
from lupin_sim.host.host import PROJECT, Robot

CHECKS = ("link.*", "discovery.*", "dds.*", "ports")
PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<dds><profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
<participant profile_name="super_client" is_default_profile="{default}"><rtps><builtin><discovery_config>
<discoveryProtocol>{protocol}</discoveryProtocol>
<discoveryServersList><RemoteServer prefix="{prefix}"><metatrafficUnicastLocatorList><locator><udpv4>
<address>{address}</address><port>11811</port>
</udpv4></locator></metatrafficUnicastLocatorList></RemoteServer></discoveryServersList>
</discovery_config></builtin></rtps></participant></profiles></dds>
"""
# It ends in good order, so that nothing of it is left for the next test to find.
NODE = """
import signal
import rclpy
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
rclpy.init(args=["--ros-args", "-r", "__node:=talker"], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
node = rclpy.create_node("talker")
print("up", flush=True)
signal.sigwait({signal.SIGTERM})
node.destroy_node()
rclpy.shutdown()
"""
VENDOR_PROFILE = "/home/mirte/mirte_ws/install/super_client.xml"
ROBOT_NODE = {
    "ROS_DISCOVERY_SERVER": "127.0.0.1",
    "FASTRTPS_DEFAULT_PROFILES_FILE": VENDOR_PROFILE,
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
}


def profile(**fields: str) -> str:
    good = {"default": "true", "protocol": "SUPER_CLIENT", "prefix": SERVER_PREFIX, "address": "10.42.0.1"}
    return PROFILE.format(**{**good, **fields})


@dataclass
class Laptop:
    """An operator's machine that is set up for the robot, on the network of the test."""

    host: Host
    home: Path

    @property
    def own(self) -> Path:
        return self.home / ".config" / "lupin"

    @property
    def plain(self) -> dict[str, str]:
        """The environment of a shell that has sourced nothing."""
        return {"PATH": "/usr/bin:/bin:/usr/sbin:/sbin", "HOME": str(self.home)}

    @property
    def sourced(self) -> dict[str, str]:
        return {
            **self.plain,
            "FASTRTPS_DEFAULT_PROFILES_FILE": str(self.own / "fastdds_super_client.xml"),
            "ROS_DISCOVERY_SERVER": "10.42.0.1:11811",
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        }

    def set_up(self) -> None:
        ssh = self.home / ".ssh"
        ssh.mkdir(mode=0o700, parents=True)
        shutil.copy(self.host.key, ssh / "id_ed25519")
        (ssh / "id_ed25519").chmod(0o600)
        shutil.copy(self.host.known_hosts, ssh / "known_hosts")
        self.own.mkdir(parents=True)
        (self.own / "fastdds_super_client.xml").write_text(profile())
        (self.own / "ros-env.sh").write_text(
            'export FASTRTPS_DEFAULT_PROFILES_FILE="$HOME/.config/lupin/fastdds_super_client.xml"\n'
            'export ROS_DISCOVERY_SERVER="10.42.0.1:11811"\n'
            "export RMW_IMPLEMENTATION=rmw_fastrtps_cpp\n"
        )
        (self.home / ".bashrc").write_text("# nothing but\n. ~/.config/lupin/ros-env.sh\n")

    def doctor(self, *arguments: str, env: dict[str, str] | None = None, address: str = "10.42.0.1") -> tuple[int, Any]:
        """Exit status and what `lupin doctor --json` says."""
        only = [word for check in CHECKS for word in ("--only", check)]
        where = ["--host", f"mirte@{address}"] if address else []
        command = [sys.executable, "-m", "lupin_cli.app", "doctor", *where, "--json", *only, *arguments]
        done = self.host.run(command, env=env or self.sourced, cwd=str(PROJECT), timeout_s=90.0)
        assert done.stdout, done.stderr
        return done.returncode, json.loads(done.stdout)

    def named(self, **options: Any) -> list[str]:
        """The causes that the doctor names. Nothing may be left unexamined."""
        status, told = self.doctor(**options)
        assert told["broken"] == [], told["broken"]
        assert told["unknown"] == [] or status == 3, told["unknown"]
        causes = [finding["id"] for finding in told["findings"]]
        assert (status == 0) == (causes == [])
        return causes

    @contextmanager
    def node(self, env: dict[str, str], *arguments: str) -> Iterator[int]:
        """A node here, in that environment."""
        process = self.host.popen(
            [sys.executable, "-c", NODE, *arguments],
            env=env,
            cwd=str(PROJECT),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        try:
            with bounded(process):
                assert process.stdout is not None
                assert process.stdout.readline().strip() == b"up"
            yield process.pid
        finally:
            process.terminate()
            process.communicate(timeout=20.0)


def vendor_age_s(host: Host, robot: Robot | None = None) -> float:
    """How long ago the vendor's service came up: before a while has passed, a missing server may only be late."""
    # Logged in: the time that the robot has been up is told to its own sessions only.
    show = "systemctl show -p ActiveEnterTimestampMonotonic --value mirte-ros; cat /proc/uptime"
    words = host.ssh(show, robot=robot).stdout.split()
    return float(words[1]) - int(words[0]) / 1e6 if len(words) == 3 and words[0] != "0" else 0.0


@contextmanager
def bounded(process: subprocess.Popen[Any], limit_s: float = 60.0) -> Iterator[None]:
    """Within the block nobody waits for `process` longer than that: it is killed, and what it says ends."""
    timer = threading.Timer(limit_s, process.kill)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextmanager
def robot_node(host: Host, user: str = "mirte") -> Iterator[str]:
    """A node on the robot under the vendor's environment, up until the block ends; gives its unit."""
    settings = [f"--setenv={name}={value}" for name, value in ROBOT_NODE.items()]
    unit = f"lupin-test-talker-of-{user}"
    started = host.robot.inside(
        "systemd-run", "--quiet", "--collect", f"--unit={unit}", f"--uid={user}", *settings, sys.executable, "-c", NODE
    )
    assert started.status == 0, started.stderr
    try:
        until(
            lambda: "up" in host.robot.inside("journalctl", "-q", "-o", "cat", "-u", unit).stdout.split(),
            "the robot's node",
            30.0,
        )
        yield unit
    finally:
        host.robot.inside("systemctl", "stop", unit)


def strike(host: Host, unit: str, signal: str) -> None:
    """Send a unit's processes a signal."""
    struck = host.robot.inside("systemctl", "kill", f"--signal={signal}", unit)
    assert struck.status == 0, struck.stderr
