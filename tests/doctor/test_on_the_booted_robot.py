"""Faults of the link and of discovery, made for real on a robot that boots: each is named as the one cause, and healed again.

Only the network's checks run here: a robot of the test has no release on it, and other tests look at the rest.
"""

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

import pytest

from lupin_cli.checks.discovery import STARTING_S
from lupin_cli.facts.dds_profiles import SERVER_PREFIX
from lupin_sim.host import Host
from lupin_sim.host.checkout import LOSE_MEMORY, keep_memory
from lupin_sim.host.fixtures import until, until_it_serves
from lupin_sim.host.host import PROJECT

pytestmark = pytest.mark.host

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


@pytest.fixture
def laptop(request: pytest.FixtureRequest, tmp_path: Path) -> Laptop:
    host: Host = request.getfixturevalue("fresh_host" if "fresh_host" in request.fixturenames else "host")
    until_it_serves(host.robot)
    until(lambda: vendor_age_s(host) > STARTING_S, "a stack that has been up for a while", 30.0)
    keep_memory(host.robot)
    found = Laptop(host, tmp_path / "home")
    found.set_up()
    return found


def vendor_age_s(host: Host) -> float:
    """How long ago the vendor's service came up: before a while has passed, a missing server may only be late."""
    show = "systemctl show -p ActiveEnterTimestampMonotonic --value mirte-ros; cat /proc/uptime"
    words = host.ssh(show).stdout.split()  # logged in: the time that the robot has been up is told to its own sessions only
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


def test_a_healthy_robot_gives_nothing_however_often_it_is_asked(laptop: Laptop) -> None:
    with laptop.node(laptop.sourced), robot_node(laptop.host):
        for _ in range(3):
            assert laptop.named() == []
        assert laptop.named(address="") == []  # this machine alone


def test_one_diagnosis_takes_one_connection(laptop: Laptop) -> None:
    def logins() -> int:
        return laptop.host.robot.inside("journalctl", "-q", "-o", "cat", "-u", "ssh").stdout.count("Accepted publickey")

    before = logins()
    assert laptop.named() == []
    until(lambda: logins() > before, "the journal's line of the login")
    assert logins() == before + 1


@pytest.mark.parametrize(
    ("fault", "settings", "words"),
    [
        ("server-not-started", {"cause": "port"}, "wlan0 came late"),
        ("server-not-started", {"cause": "path"}, "PATH was not filled"),
        ("server-killed", {}, "no discovery server listens"),
    ],
)
def test_a_missing_discovery_server_is_the_one_cause(fresh_host: Host, laptop: Laptop, fault, settings, words) -> None:
    fresh_host.robot.fault(fault, **settings)
    _, told = laptop.doctor()
    assert told["unknown"] == []
    assert [finding["id"] for finding in told["findings"]] == ["discovery-server-missing"], told
    (finding,) = told["findings"]
    assert words in finding["cause"]
    if fault == "server-not-started":
        assert any("allocate" in line or "not found" in line for line in finding["evidence"])
    # A person types what the finding says, and it is healed.
    done = laptop.host.ssh(finding["fix"]["command"].split(" ", 2)[2].strip("'").replace("'\"'\"'", "'"))
    assert done.returncode == 0, done.stderr
    # The dead server's memory is what remains, and is named now that it is nobody's consequence.
    until(lambda: set(laptop.named()) <= {"shared-memory-orphans"}, "health after the cure", 30.0)


def test_a_vendor_stack_on_multicast_is_the_one_cause(fresh_host: Host, laptop: Laptop) -> None:
    with fresh_host.robot.broken("dds-off"):
        assert laptop.named() == ["discovery-server-switched-off"]


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("server-pinned", "discovery-server-pinned"),
        ("server-stopped", "discovery-server-stopped"),
        ("server-port-taken", "discovery-port-taken"),
    ],
)
def test_a_server_that_is_there_and_serves_nobody_is_the_one_cause(fresh_host: Host, laptop: Laptop, fault, cause) -> None:
    with robot_node(fresh_host):
        fresh_host.robot.fault(fault)
        assert set(laptop.named()) - {"shared-memory-orphans"} == {cause}  # the server that ended left its memory


def test_a_process_that_hangs_on_the_graphs_ports_is_the_one_cause(fresh_host: Host, laptop: Laptop) -> None:
    with robot_node(fresh_host) as unit:
        strike(fresh_host, unit, "STOP")
        assert laptop.named() == ["zombie-process"]
        strike(fresh_host, unit, "CONT")
        until(lambda: laptop.named() == [], "health", 30.0)


@pytest.mark.parametrize("user", ["mirte", "root"])
def test_memory_of_a_killed_participant_is_the_one_cause_whoever_it_was(fresh_host: Host, laptop: Laptop, user) -> None:
    with robot_node(fresh_host, user) as unit:
        strike(fresh_host, unit, "KILL")
        until(lambda: fresh_host.robot.inside("systemctl", "is-active", unit).stdout != "active\n", "its end")
        assert laptop.named() == ["shared-memory-orphans"]


def test_a_node_of_root_that_shares_its_memory_with_nobody_is_the_one_cause(laptop: Laptop) -> None:
    with robot_node(laptop.host), robot_node(laptop.host, "root"):
        assert laptop.named() == ["shared-memory-not-shared"]
    assert laptop.named() == []


def test_the_end_of_a_login_takes_shared_memory_along_until_logind_is_told_to_leave_it(
    fresh_host: Host, laptop: Laptop
) -> None:
    def segments() -> str:
        return str(fresh_host.robot.inside("sh", "-c", "ls /dev/shm/fastrtps_* 2>/dev/null || true").stdout)

    def logged_out() -> bool:
        return "mirte" not in fresh_host.robot.inside("loginctl", "list-users").stdout

    until(segments, "the server's shared memory", 30.0)
    assert fresh_host.robot.inside("sh", "-ec", LOSE_MEMORY).status == 0
    assert laptop.named() == ["shared-memory-at-risk"]
    until(lambda: not segments(), "what the end of that very login does", 30.0)
    assert laptop.named() == ["shared-memory-removed"]
    status, told = laptop.doctor("--fix", "--yes")
    assert (status, told["findings"]) == (0, [])
    until(logged_out, "the end of that login", 30.0)
    assert segments() and laptop.named() == []


@pytest.mark.parametrize("blow", ["server", "STOP", "KILL"])
def test_fix_heals_what_is_safe_to_heal_and_finds_health_after_it(fresh_host: Host, laptop: Laptop, blow) -> None:
    with robot_node(fresh_host) as unit:
        if blow == "server":
            fresh_host.robot.fault("server-killed")
        else:
            strike(fresh_host, unit, blow)
        status, told = laptop.doctor("--fix")
    assert told["findings"] == []
    assert {treatment["state"] for treatment in told["treatments"]} == {"done"}
    assert status == 0


def test_two_faults_at_once_are_both_named(fresh_host: Host, laptop: Laptop) -> None:
    (laptop.own / "fastdds_super_client.xml").write_text(profile(default="false"))
    fresh_host.robot.fault("server-killed")
    assert sorted(laptop.named()) == ["discovery-server-missing", "profile-not-default"]
    with laptop.node(laptop.plain), robot_node(fresh_host):
        assert sorted(laptop.named()) == ["discovery-server-missing", "process-multicast-only", "profile-not-default"]


def test_an_address_that_came_after_the_nodes_is_named_where_it_carries_the_link(fresh_host: Host, laptop: Laptop) -> None:
    fresh_host.robot.inside("systemctl", "stop", "mirte-wifi-watchdog", "mirte-ap")
    fresh_host.robot.inside("ip", "address", "flush", "dev", "wlan0")
    with robot_node(fresh_host):
        fresh_host.robot.inside("systemctl", "start", "mirte-ap", "mirte-wifi-watchdog")
        until(lambda: "192.168.42.1" in fresh_host.robot.inside("ip", "-4", "address").stdout, "the access point")
        known = laptop.home / ".ssh" / "known_hosts"
        known.write_text(known.read_text() + known.read_text().replace("10.42.0.1", "192.168.42.1"))
        wireless = {**laptop.sourced, "ROS_DISCOVERY_SERVER": "192.168.42.1:11811"}
        (laptop.own / "fastdds_super_client.xml").write_text(profile(address="192.168.42.1"))
        exports = (laptop.own / "ros-env.sh").read_text().replace("10.42.0.1", "192.168.42.1")
        (laptop.own / "ros-env.sh").write_text(exports)
        assert laptop.named(env=wireless, address="192.168.42.1") == ["process-older-than-interface"]


def test_an_announced_address_without_a_route_from_here_is_named(fresh_host: Host, laptop: Laptop) -> None:
    with robot_node(fresh_host), fresh_host.robot.broken("dual-homed"):
        _, told = laptop.doctor()
        (finding,) = told["findings"]
        assert finding["id"] == "robot-multi-homed"
        assert "192.168.42.1" in finding["cause"]
        assert "mirte-ap.service: active" in finding["evidence"]


@pytest.mark.parametrize(
    ("fault", "settings", "cause", "kind"),
    [
        ("cable-cut", {"link": "eth0"}, "no-carrier", ("no-route", "timeout")),
        ("switch-dead", {"link": "eth0"}, "robot-unreachable", ("no-route", "timeout")),
        ("sshd-hung", {}, "robot-unreachable", ("silent",)),
        ("sshd-down", {}, "robot-unreachable", ("refused",)),
        ("host-key-changed", {}, "robot-unreachable", ("host-key-changed",)),
    ],
)
def test_a_robot_that_cannot_be_reached_is_told_by_the_way_it_fails(
    fresh_host: Host, laptop: Laptop, fault, settings, cause, kind
) -> None:
    fresh_host.robot.fault(fault, **settings)
    status, told = laptop.doctor()
    assert status == 3
    assert [finding["id"] for finding in told["findings"]] == [cause]
    assert told["robot"]["unreachable"] in kind


def test_a_laptop_that_left_the_access_point_has_no_route_there(fresh_host: Host, laptop: Laptop) -> None:
    with fresh_host.robot.broken("wifi-roam"):
        status, told = laptop.doctor(address="192.168.42.1")
    assert status == 3
    assert [finding["id"] for finding in told["findings"]] == ["robot-unreachable"]
    assert told["robot"]["unreachable"] == "no-route"


def test_a_node_started_from_a_bare_shell_is_the_one_cause(laptop: Laptop) -> None:
    with laptop.node(laptop.plain) as pid:
        _, told = laptop.doctor()
    (finding,) = told["findings"]
    assert finding["id"] == "process-multicast-only"
    assert "talker" in finding["cause"]
    assert pid > 0
    assert laptop.named() == []


def test_a_node_that_asks_an_address_that_the_robot_does_not_have_is_the_one_cause(laptop: Laptop) -> None:
    with laptop.node({**laptop.sourced, "ROS_DISCOVERY_SERVER": "10.42.0.7:11811"}):
        causes = laptop.named()
    # The profile that the node names points elsewhere than its variable: both lines are wrong for it, and both are told.
    assert causes == ["process-wrong-server"]


@pytest.mark.parametrize(
    ("fields", "cause"),
    [
        ({"default": "false"}, "profile-not-default"),
        ({"protocol": "CLIENT"}, "profile-not-super-client"),
        ({"prefix": "44.53.07.5f.45.50.52.4f.53.49.4d.41"}, "profile-wrong-prefix"),
        ({"address": "192.168.42.1"}, "profile-wrong-address"),
    ],
)
def test_each_fault_of_the_profile_is_the_one_cause(laptop: Laptop, fields, cause) -> None:
    (laptop.own / "fastdds_super_client.xml").write_text(profile(**fields))
    assert laptop.named() == [cause]


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (profile()[:400], "profile-unreadable"),
        (profile().replace("RemoteServer", "OtherServer"), "profile-without-server"),
    ],
    ids=["torn", "without a server"],
)
def test_a_profile_that_names_no_server_is_the_one_cause(laptop: Laptop, text, cause) -> None:
    (laptop.own / "fastdds_super_client.xml").write_text(text)
    assert laptop.named() == [cause]


def test_each_fault_of_the_shell_is_the_one_cause(laptop: Laptop) -> None:
    assert laptop.named(env=laptop.plain) == ["shell-multicast-only"]
    assert laptop.named(env={**laptop.sourced, "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}) == ["shell-rmw-mismatch"]
    for file in laptop.own.iterdir():
        file.unlink()
    (laptop.home / ".bashrc").write_text("# a shell\n")
    assert laptop.named(env=laptop.plain) == ["dds-not-set-up"]


def test_a_daemon_of_an_older_set_up_is_the_one_cause(laptop: Laptop) -> None:
    # No ros2 command comes with the wheels: a node under the daemon's arguments.
    with laptop.node({**laptop.sourced, "ROS_DISCOVERY_SERVER": "192.168.42.1:11811"}, "ros2cli.daemon"):
        assert laptop.named() == ["stale-daemon"]
    assert laptop.named() == []


def test_the_wrong_source_order_is_the_one_cause(laptop: Laptop) -> None:
    hooks = laptop.home / "mirte_ws" / "install" / "share" / "mirte_bringup" / "environment"
    hooks.mkdir(parents=True)
    (hooks / "fastdds.sh").write_text("unset ROS_DISCOVERY_SERVER FASTRTPS_DEFAULT_PROFILES_FILE\n")
    (hooks.parents[2] / "setup.bash").write_text(". ~/mirte_ws/install/share/mirte_bringup/environment/fastdds.sh\n")
    (laptop.home / ".bashrc").write_text(". ~/.config/lupin/ros-env.sh\nsource ~/mirte_ws/install/setup.bash\n")
    wiped = {**laptop.plain, "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
    assert laptop.named(env=wiped) == ["source-order"]


def test_a_stranger_on_the_pages_port_is_the_one_cause(laptop: Laptop) -> None:
    server = laptop.host.popen(
        [sys.executable, "-m", "http.server", "8090"], env=laptop.plain, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        until(lambda: ":8090" in laptop.host.run(["ss", "-H", "-lnt"]).stdout, "the stranger")
        assert laptop.named() == ["port-8090-taken"]
    finally:
        server.kill()
        server.wait()


def test_watch_tells_what_changes_and_ends_with_how_it_stands(laptop: Laptop) -> None:
    command = [sys.executable, "-u", "-m", "lupin_cli.app", "doctor", "--only", "ports", "--watch"]
    watching = laptop.host.popen(
        command, env=laptop.plain, cwd=str(PROJECT), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert watching.stdout is not None
    with bounded(watching):
        assert watching.stdout.readline() == "healthy; 1 check\n"
    server = laptop.host.popen(
        [sys.executable, "-m", "http.server", "9090"], env=laptop.plain, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        with bounded(watching):
            assert watching.stdout.readline().startswith("-- ")
            assert "[port-9090-taken]" in watching.stdout.readline()
        watching.terminate()
        watching.communicate(timeout=30.0)
        assert watching.returncode == 1
    finally:
        server.kill()
        server.wait()
        watching.kill()
        watching.communicate()
