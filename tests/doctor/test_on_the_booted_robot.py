"""Faults of the link and of discovery, made for real on a robot that boots: each is named as the one cause, and healed again.

Only the network's checks run here: a robot of the test has no release on it, and other tests look at the rest.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

from lupin_sim.host import Host
from lupin_sim.host.checkout import LOSE_MEMORY
from lupin_sim.host.fixtures import until
from lupin_sim.host.host import PROJECT

from .laptop import Laptop, bounded, profile, robot_node, strike

pytestmark = pytest.mark.host


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
