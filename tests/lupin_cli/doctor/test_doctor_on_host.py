"""Faults of link and discovery, injected into a booted robot: each is the only root cause, and is gone after its fix.

Only the network checks run: no release is deployed to this robot, and other tests cover the other checks.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest

from lupin_sim.host.checkout import LET_LOGIND_REMOVE_SHM
from lupin_sim.host.host import PROJECT
from tests.support.laptop import Laptop, killed_after, render_profile, running_robot_node, signal_unit
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_sim.host import Host

pytestmark = pytest.mark.host


def test_healthy_robot_has_no_findings_on_repeated_runs(laptop: Laptop) -> None:
    with laptop.running_node(laptop.sourced_env), running_robot_node(laptop.host):
        for _ in range(3):
            assert laptop.root_causes() == []
        assert laptop.root_causes(address="") == []  # the laptop alone


def test_doctor_uses_one_ssh_connection(laptop: Laptop) -> None:
    def logins() -> int:
        return laptop.host.robot.run_as_root("journalctl", "-q", "-o", "cat", "-u", "ssh").stdout.count("Accepted publickey")

    before = logins()
    assert laptop.root_causes() == []
    wait_until(lambda: logins() > before, "the login in the system journal")
    assert logins() == before + 1


@pytest.mark.parametrize(
    ("fault", "settings", "reason"),
    [
        ("server-not-started", {"cause": "port"}, "wlan0 came up late"),
        ("server-not-started", {"cause": "path"}, "PATH was incomplete"),
        ("server-killed", {}, "no discovery server listens"),
    ],
)
def test_missing_discovery_server_is_the_only_root_cause(
    fresh_host: Host, laptop: Laptop, fault: Any, settings: Any, reason: Any
) -> None:
    fresh_host.robot.inject_fault(fault, **settings)
    _, report = laptop.run_doctor()
    assert report["unknown"] == []
    assert [finding["id"] for finding in report["findings"]] == ["discovery-server-missing"], report
    (finding,) = report["findings"]
    assert reason in finding["cause"]
    if fault == "server-not-started":
        assert any("allocate" in line or "not found" in line for line in finding["evidence"])
    # The finding's command fixes it when a person types it.
    program, *words = shlex.split(finding["fix"]["command"])
    assert program == "lupin"
    command = [sys.executable, "-m", "lupin_cli.app", *words]
    done = laptop.host.run(command, env=laptop.bare_env, cwd=str(PROJECT), timeout_s=120.0)
    assert done.returncode == 0, done.stderr
    # The killed server's shared memory remains, and is a root cause now that the missing server no longer explains it.
    wait_until(lambda: set(laptop.root_causes()) <= {"shared-memory-orphans"}, "health after the fix", 30.0)


def test_vendor_stack_on_multicast_is_the_only_root_cause(fresh_host: Host, laptop: Laptop) -> None:
    with fresh_host.robot.with_fault("dds-off"):
        assert laptop.root_causes() == ["discovery-server-switched-off"]


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("server-pinned", "discovery-server-pinned"),
        ("server-stopped", "discovery-server-stopped"),
        ("server-port-taken", "discovery-port-taken"),
    ],
)
def test_unusable_discovery_server_is_the_only_root_cause(fresh_host: Host, laptop: Laptop, fault: Any, cause: Any) -> None:
    with running_robot_node(fresh_host):
        fresh_host.robot.inject_fault(fault)
        assert set(laptop.root_causes()) - {"shared-memory-orphans"} == {cause}  # left by the killed server


def test_stopped_process_on_dds_ports_is_the_only_root_cause(fresh_host: Host, laptop: Laptop) -> None:
    with running_robot_node(fresh_host) as unit:
        signal_unit(fresh_host, unit, "STOP")
        assert laptop.root_causes() == ["zombie-process"]
        signal_unit(fresh_host, unit, "CONT")
        wait_until(lambda: laptop.root_causes() == [], "health", 30.0)


@pytest.mark.parametrize("user", ["mirte", "root"])
def test_memory_of_killed_participant_is_the_only_root_cause(fresh_host: Host, laptop: Laptop, user: Any) -> None:
    with running_robot_node(fresh_host, user) as unit:
        signal_unit(fresh_host, unit, "KILL")
        wait_until(
            lambda: fresh_host.robot.run_as_root("systemctl", "is-active", unit).stdout != "active\n", "the end of the node"
        )
        assert laptop.root_causes() == ["shared-memory-orphans"]


def test_node_of_root_that_shares_no_memory_is_found(laptop: Laptop) -> None:
    with running_robot_node(laptop.host), running_robot_node(laptop.host, "root"):
        assert laptop.root_causes() == ["shared-memory-not-shared"]
    assert laptop.root_causes() == []


def test_logind_removes_shared_memory_until_fixed(fresh_host: Host, laptop: Laptop) -> None:
    def segments() -> str:
        return str(fresh_host.robot.run_as_root("sh", "-c", "ls /dev/shm/fastrtps_* 2>/dev/null || true").stdout)

    def logged_out() -> bool:
        return "mirte" not in fresh_host.robot.run_as_root("loginctl", "list-users").stdout

    wait_until(segments, "the server's shared memory", 30.0)
    assert fresh_host.robot.run_as_root("sh", "-ec", LET_LOGIND_REMOVE_SHM).status == 0
    # Without root, nothing keeps the memory after the last login: it is announced while the login lasts.
    status, report, errors = laptop.run_doctor_with_errors()
    assert [finding["id"] for finding in report["findings"]] == ["shared-memory-at-risk"] and status == 1
    assert "ten seconds after this login ends" in errors and "keep it with: lupin play keep-shared-memory" in errors
    wait_until(lambda: not segments(), "the removal at the end of that login", 30.0)
    assert laptop.root_causes() == ["shared-memory-removed"]
    status, report = laptop.run_doctor("--fix", "--yes")
    assert (status, report["findings"]) == (0, [])
    wait_until(logged_out, "the end of that login", 30.0)
    assert segments() and laptop.root_causes() == []


@pytest.mark.parametrize("fault", ["server-killed", "STOP", "KILL"])
def test_fix_repairs_safe_faults_and_reports_health(fresh_host: Host, laptop: Laptop, fault: Any) -> None:
    with running_robot_node(fresh_host) as unit:
        if fault == "server-killed":
            fresh_host.robot.inject_fault(fault)
        else:
            signal_unit(fresh_host, unit, fault)
        status, report = laptop.run_doctor("--fix")
    assert report["findings"] == []
    assert {fix["state"] for fix in report["fixes"]} == {"healed"}
    assert status == 0


def test_two_faults_are_both_named(fresh_host: Host, laptop: Laptop) -> None:
    laptop.profile.write_text(render_profile(default="false"))
    fresh_host.robot.inject_fault("server-killed")
    assert sorted(laptop.root_causes()) == ["discovery-server-missing", "profile-not-default"]
    with laptop.running_node(laptop.bare_env), running_robot_node(fresh_host):
        assert sorted(laptop.root_causes()) == ["discovery-server-missing", "process-multicast-only", "profile-not-default"]


def test_process_older_than_link_address_is_named(fresh_host: Host, laptop: Laptop) -> None:
    fresh_host.robot.run_as_root("systemctl", "stop", "mirte-wifi-watchdog", "mirte-ap")
    fresh_host.robot.run_as_root("ip", "address", "flush", "dev", "wlan0")
    with running_robot_node(fresh_host):
        fresh_host.robot.run_as_root("systemctl", "start", "mirte-ap", "mirte-wifi-watchdog")
        wait_until(lambda: "192.168.42.1" in fresh_host.robot.run_as_root("ip", "-4", "address").stdout, "the access point")
        known = laptop.home / ".ssh" / "known_hosts"
        known.write_text(known.read_text() + known.read_text().replace("10.42.0.1", "192.168.42.1"))
        wireless = {**laptop.sourced_env, "ROS_DISCOVERY_SERVER": "192.168.42.1:11811"}
        laptop.profile.write_text(render_profile(address="192.168.42.1"))
        exports = (laptop.config_dir / "ros-env.sh").read_text().replace("10.42.0.1", "192.168.42.1")
        (laptop.config_dir / "ros-env.sh").write_text(exports)
        assert laptop.root_causes(env=wireless, address="192.168.42.1") == ["process-older-than-interface"]


def test_announced_address_without_route_is_named(fresh_host: Host, laptop: Laptop) -> None:
    with running_robot_node(fresh_host), fresh_host.robot.with_fault("dual-homed"):
        _, report = laptop.run_doctor()
        (finding,) = report["findings"]
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
def test_unreachable_robot_is_named_by_its_failure(
    fresh_host: Host, laptop: Laptop, fault: Any, settings: Any, cause: Any, kind: Any
) -> None:
    fresh_host.robot.inject_fault(fault, **settings)
    status, report = laptop.run_doctor()
    assert status == 3
    assert [finding["id"] for finding in report["findings"]] == [cause]
    assert report["robot"]["unreachable"] in kind


def test_laptop_off_the_access_point_has_no_route(fresh_host: Host, laptop: Laptop) -> None:
    with fresh_host.robot.with_fault("wifi-roam"):
        status, report = laptop.run_doctor(address="192.168.42.1")
    assert status == 3
    assert [finding["id"] for finding in report["findings"]] == ["robot-unreachable"]
    assert report["robot"]["unreachable"] == "no-route"


def test_foreign_program_on_console_port_is_named(laptop: Laptop) -> None:
    server = laptop.host.popen(
        [sys.executable, "-m", "http.server", "8090"], env=laptop.bare_env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        wait_until(lambda: ":8090" in laptop.host.run(["ss", "-H", "-lnt"]).stdout, "the other program")
        assert laptop.root_causes() == ["port-8090-taken"]
    finally:
        server.kill()
        server.wait()


def test_watch_prints_changes_and_exits_with_last_status(laptop: Laptop) -> None:
    command = [sys.executable, "-u", "-m", "lupin_cli.app", "doctor", "--local", "--only", "ports", "--watch"]
    watching = laptop.host.popen(
        command, env=laptop.bare_env, cwd=str(PROJECT), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert watching.stdout is not None
    with killed_after(watching):
        assert watching.stdout.readline() == "this machine: nothing found, topics were not measured\n"
    server = laptop.host.popen(
        [sys.executable, "-m", "http.server", "9090"], env=laptop.bare_env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        with killed_after(watching):
            assert watching.stdout.readline().startswith("-- ")
            assert watching.stdout.readline() == "this machine: not healthy, topics were not measured\n"
            assert watching.stdout.readline() == "\n"
            assert "[port-9090-taken]" in watching.stdout.readline()
        watching.terminate()
        watching.communicate(timeout=60)
        assert watching.returncode == 1
    finally:
        server.kill()
        server.wait()
        watching.kill()
        watching.communicate()
