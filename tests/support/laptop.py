"""An operator's laptop beside a booted robot, and ROS nodes on both machines."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_cli.facts.dds_profiles import SERVER_PREFIX
from lupin_sim.host import Host
from lupin_sim.host.host import PROJECT, Robot
from tests.support.waiting import wait_until

NETWORK_CHECKS = ("link.*", "discovery.*", "dds.*", "ports")
PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<dds><profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
<participant profile_name="super_client" is_default_profile="{default}"><rtps><builtin><discovery_config>
<discoveryProtocol>{protocol}</discoveryProtocol>
<discoveryServersList><RemoteServer prefix="{prefix}"><metatrafficUnicastLocatorList><locator><udpv4>
<address>{address}</address><port>11811</port>
</udpv4></locator></metatrafficUnicastLocatorList></RemoteServer></discoveryServersList>
</discovery_config></builtin></rtps></participant></profiles></dds>
"""
# A node that prints `up`, waits for SIGTERM and shuts down cleanly, so that it leaves nothing behind for the next test.
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
VENDOR_ENV = {
    "ROS_DISCOVERY_SERVER": "127.0.0.1",
    "FASTRTPS_DEFAULT_PROFILES_FILE": VENDOR_PROFILE,
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
}


def render_profile(**fields: str) -> str:
    """Return the XML of a super client's profile, correct except for `fields` of the template."""
    defaults = {"default": "true", "protocol": "SUPER_CLIENT", "prefix": SERVER_PREFIX, "address": "10.42.0.1"}
    return PROFILE.format(**{**defaults, **fields})


@dataclass
class Laptop:
    """An operator's laptop in the network of the simulated computer; `configure` sets it up for the robot."""

    host: Host
    home: Path

    @property
    def config_dir(self) -> Path:
        return self.home / ".config" / "lupin"

    @property
    def profile(self) -> Path:
        """The DDS profile that `lupin dds setup` writes."""
        return self.config_dir / "fastdds_super_client.xml"

    @property
    def bare_env(self) -> dict[str, str]:
        """The environment of a shell that has sourced nothing."""
        return {"PATH": "/usr/bin:/bin:/usr/sbin:/sbin", "HOME": str(self.home)}

    @property
    def sourced_env(self) -> dict[str, str]:
        """The environment of a shell that has sourced ros-env.sh."""
        return {
            **self.bare_env,
            "FASTRTPS_DEFAULT_PROFILES_FILE": str(self.profile),
            "ROS_DISCOVERY_SERVER": "10.42.0.1:11811",
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        }

    def configure(self) -> None:
        """Install the SSH key and the DDS settings for the robot."""
        ssh = self.home / ".ssh"
        ssh.mkdir(mode=0o700, parents=True)
        shutil.copy(self.host.key, ssh / "id_ed25519")
        (ssh / "id_ed25519").chmod(0o600)
        shutil.copy(self.host.known_hosts, ssh / "known_hosts")
        self.config_dir.mkdir(parents=True)
        self.profile.write_text(render_profile())
        (self.config_dir / "ros-env.sh").write_text(
            'export FASTRTPS_DEFAULT_PROFILES_FILE="$HOME/.config/lupin/fastdds_super_client.xml"\n'
            'export ROS_DISCOVERY_SERVER="10.42.0.1:11811"\n'
            "export RMW_IMPLEMENTATION=rmw_fastrtps_cpp\n"
        )
        (self.home / ".bashrc").write_text("# the operator's settings\n. ~/.config/lupin/ros-env.sh\n")

    def run_doctor(
        self,
        *arguments: str,
        checks: Sequence[str] = NETWORK_CHECKS,
        env: dict[str, str] | None = None,
        address: str = "10.42.0.1",
    ) -> tuple[int, Any]:
        """Run `lupin doctor`; return its exit status and JSON report. If `address` is empty, it examines only the laptop."""
        return self.run_doctor_with_errors(*arguments, checks=checks, env=env, address=address)[:2]

    def run_doctor_with_errors(
        self,
        *arguments: str,
        checks: Sequence[str] = NETWORK_CHECKS,
        env: dict[str, str] | None = None,
        address: str = "10.42.0.1",
    ) -> tuple[int, Any, str]:
        """Do the same; return also what it printed on standard error."""
        only = [word for check in checks for word in ("--only", check)]
        robot = ["--host", f"mirte@{address}"] if address else []
        command = [sys.executable, "-m", "lupin_cli.app", "doctor", *robot, "--json", *only, *arguments]
        done = self.host.run(command, env=env or self.sourced_env, cwd=str(PROJECT), timeout_s=120.0)
        assert done.stdout, done.stderr
        return done.returncode, json.loads(done.stdout), done.stderr

    def root_causes(self, **options: Any) -> list[str]:
        """Run the doctor; return the ids of the root causes. Fails the test if a check could not examine everything."""
        status, report = self.run_doctor(**options)
        assert report["broken"] == [], report["broken"]
        assert report["unknown"] == [] or status == 3, report["unknown"]
        causes = [finding["id"] for finding in report["findings"]]
        assert (status == 0) == (causes == [])
        return causes

    @contextmanager
    def running_node(self, env: dict[str, str], *arguments: str) -> Iterator[int]:
        """Run a node on the laptop in the environment `env` during the block, and yield its pid."""
        process = self.host.popen(
            [sys.executable, "-c", NODE, *arguments],
            env=env,
            cwd=str(PROJECT),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        try:
            with killed_after(process):
                assert process.stdout is not None
                assert process.stdout.readline().strip() == b"up"
            yield process.pid
        finally:
            process.terminate()
            process.communicate(timeout=60)


def vendor_age_s(host: Host, robot: Robot | None = None) -> float:
    """Return the seconds since the vendor's service started: the doctor reports a missing server only after some time."""
    # Over SSH, since only a login session sees the uptime of the robot instead of that of this machine.
    show = "systemctl show -p ActiveEnterTimestampMonotonic --value mirte-ros; cat /proc/uptime"
    words = host.ssh(show, robot=robot).stdout.split()
    return float(words[1]) - int(words[0]) / 1e6 if len(words) == 3 and words[0] != "0" else 0.0


@contextmanager
def killed_after(process: subprocess.Popen[Any], timeout_s: float = 60.0) -> Iterator[None]:
    """Kill `process` if the block takes longer than `timeout_s`, so that reading its output cannot block forever."""
    timer = threading.Timer(timeout_s, process.kill)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextmanager
def running_robot_node(host: Host, user: str = "mirte") -> Iterator[str]:
    """Run a node on the robot in the vendor's environment during the block, and yield its systemd unit."""
    settings = [f"--setenv={name}={value}" for name, value in VENDOR_ENV.items()]
    unit = f"lupin-test-talker-of-{user}"
    started = host.robot.run_as_root(
        "systemd-run", "--quiet", "--collect", f"--unit={unit}", f"--uid={user}", *settings, sys.executable, "-c", NODE
    )
    assert started.status == 0, started.stderr
    try:
        wait_until(
            lambda: "up" in host.robot.run_as_root("journalctl", "-q", "-o", "cat", "-u", unit).stdout.split(),
            "the robot's node",
            30.0,
        )
        yield unit
    finally:
        host.robot.run_as_root("systemctl", "stop", unit)


def signal_unit(host: Host, unit: str, signal: str) -> None:
    """Send a signal to the processes of a unit on the robot."""
    done = host.robot.run_as_root("systemctl", "kill", f"--signal={signal}", unit)
    assert done.status == 0, done.stderr
