"""Faults between laptop and robot that no list of causes knows, on a booted robot with the vendor's stack and Lupin's units.

The doctor names layer and machine, and never calls the robot healthy while the laptop lacks its data.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from bench.fault_rig import AP_ADDRESS, ROBOT, WIRED_ADDRESS, FaultRig, RigError
from lupin_cli.exit_codes import FAILURE, NO_RESULT, SUCCESS, UNREACHABLE
from lupin_cli.facts.dds_profiles import OWN_PROFILE
from lupin_sim.host.host import HostUnavailable
from tests.support.waiting import wait_until

pytestmark = pytest.mark.host

PORT = "11811"
NFT = "nft add table inet {table}; nft add chain inet {table} input '{{ type filter hook input priority 0; }}'\n"
PID_OF = """
for file in $(grep -ls '/{unit}.service' /proc/[0-9]*/cgroup); do
  pid=$(echo $file | cut -d/ -f3)
  tr '\\0' ' ' </proc/$pid/cmdline | grep -q -e '{pattern}' && echo $pid
done 2>/dev/null | tail -n 1
"""


@pytest.fixture(scope="module")
def rig() -> Iterator[FaultRig]:
    try:
        rig = FaultRig.start()
    except HostUnavailable as missing:
        pytest.skip(str(missing))
    try:
        rig.wait_until_healthy()
        yield rig
    finally:
        rig.stop()


def recover(rig: FaultRig, attempts: int = 3) -> None:
    """Wait until the robot is healthy. On a busy machine auto-home may fail after a fault, and nothing retries it."""
    for attempt in range(attempts):
        rig.restore()
        try:
            rig.wait_until_healthy(timeout_s=60.0)
        except RigError:
            if attempt == attempts - 1:
                raise
        else:
            return


@contextmanager
def fault(rig: FaultRig, inject: Callable[[], object], undo: Callable[[], object]) -> Iterator[None]:
    """Inject a fault for the block; afterwards the robot is healthy again."""
    try:
        inject()
        yield
    finally:
        undo()
        recover(rig)


@contextmanager
def robot_firewall(rig: FaultRig, rule: str) -> Iterator[None]:
    """Add a rule to the robot's packet filter for the block."""
    table = NFT.format(table="lupintest")
    with fault(
        rig,
        lambda: rig.run_as_root(f"{table}nft add rule inet lupintest input {rule}"),
        lambda: rig.run_as_root("nft delete table inet lupintest"),
    ):
        yield


@contextmanager
def laptop_firewall(rig: FaultRig) -> Iterator[None]:
    """Let the laptop drop all UDP that comes in, as a firewall that denies incoming traffic does."""

    def ip(*words: str) -> None:
        assert rig.machines.run(["ip", *words]).returncode == 0, words

    def deny() -> None:
        ip("rule", "add", "pref", "100", "lookup", "local")
        ip("rule", "delete", "pref", "0")
        for pref, interface in (("50", "lan0"), ("51", "wifi0")):
            ip("rule", "add", "pref", pref, "ipproto", "udp", "iif", interface, "blackhole")

    def allow() -> None:
        ip("rule", "add", "pref", "0", "lookup", "local")
        for pref in ("50", "51", "100"):
            ip("rule", "delete", "pref", pref)

    with fault(rig, deny, allow):
        yield


def problems(report: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Return finding, layer and machine of each root cause that is a problem."""
    return [(each["id"], each["layer"], each["machine"]) for each in report["findings"] if each["severity"] == "problem"]


def assert_not_healthy(report: dict[str, Any]) -> None:
    assert report["status"] in (FAILURE, UNREACHABLE)
    assert report["ground_truth"]["state"] == "broken"


@pytest.mark.smoke
def test_health_is_observed_from_the_laptop(rig: FaultRig) -> None:
    # On a busy machine the doctor's participant may not discover the whole graph in its time, which it says: NO_RESULT.
    reports = [rig.run_doctor()]
    while reports[-1]["status"] == NO_RESULT and len(reports) < 3:
        assert reports[-1]["ground_truth"]["state"] == "unobserved" and reports[-1]["ground_truth"]["unobserved"]
        reports.append(rig.run_doctor())
    report = reports[-1]
    truth = report["ground_truth"]
    assert problems(report) == []
    assert (report["status"], truth["state"], truth["drive"], truth["unobserved"]) == (SUCCESS, "healthy", "reaches", [])
    assert all(topic["samples"] for topic in truth["topics"] if topic["required"])
    assert truth["environment"]["ROS_DISCOVERY_SERVER"] == f"{WIRED_ADDRESS}:{PORT}"


@pytest.mark.parametrize(
    ("rule", "cause"),
    [
        (f"iifname eth0 udp dport {PORT} drop", f"UDP {PORT} from the laptop to the robot is lost on the robot"),
        ("ip saddr 10.42.0.2 meta l4proto udp drop", "every UDP packet from the laptop to the robot is lost on the robot"),
    ],
)
def test_packet_filter_of_the_robot_is_found_by_packets(rig: FaultRig, rule: str, cause: str) -> None:
    with robot_firewall(rig, rule):
        report = rig.run_doctor()
        script = shlex.split(report["findings"][0]["fix"]["command"])[-1]
        assert script.startswith("sudo nft delete rule inet lupintest input handle ")
        rig.run_as_root(script)
        assert "drop" not in rig.run_as_root("nft list table inet lupintest")
    assert problems(report) == [("udp-lost", "ports", "robot")]
    assert report["findings"][0]["cause"].startswith(cause)
    assert any("drop" in line for line in report["findings"][0]["evidence"])  # the rule itself
    assert_not_healthy(report)


def test_laptop_firewall_is_named_also_with_a_killed_server(rig: FaultRig) -> None:
    with laptop_firewall(rig):
        report = rig.run_doctor()
        assert problems(report) == [("udp-lost", "ports", "laptop")]
        assert_not_healthy(report)
        rig.machines.robot.inject_fault("server-killed")
        report = rig.run_doctor()
        assert sorted(problems(report)) == [
            ("discovery-server-missing", "discovery", "robot"),
            ("udp-lost", "ports", "laptop"),
        ]
        report = rig.run_doctor("--fix")
        assert_not_healthy(report)
        assert problems(report) == [("udp-lost", "ports", "laptop")]
        rig.machines.robot.undo_fault("server-killed")


def test_wrong_port_is_named(rig: FaultRig) -> None:
    profile = rig.config_dir / OWN_PROFILE
    rig.write_file(profile, profile.read_text().replace(PORT, "11812"))
    try:
        report = rig.run_doctor()
        assert problems(report) == [("profile-wrong-address", "profile", "laptop")]
        assert "11812" in report["findings"][0]["cause"]
        assert_not_healthy(report)
        rig.machines.robot.inject_fault("server-killed")
        assert_not_healthy(rig.run_doctor("--fix"))
        rig.machines.robot.undo_fault("server-killed")
        # The same port in profile and shell: they agree, and nothing listens there.
        report = rig.run_doctor(env={**rig.sourced_env, "ROS_DISCOVERY_SERVER": f"{WIRED_ADDRESS}:11812"})
        assert ("shell-wrong-server", "environment", "laptop") in problems(report)
        assert_not_healthy(report)
    finally:
        recover(rig)


@pytest.mark.smoke
def test_cut_cable_is_named_while_the_access_point_works(rig: FaultRig) -> None:
    inventory = rig.config_dir / "lupin.toml"
    rig.write_file(
        inventory,
        inventory.read_text().replace(f'wired = "{WIRED_ADDRESS}"', f'wired = "{WIRED_ADDRESS}"\nap = "{AP_ADDRESS}"'),
    )
    known = rig.home / ".ssh" / "known_hosts"
    rig.write_file(known, known.read_text() + known.read_text().replace(WIRED_ADDRESS, AP_ADDRESS))
    with fault(
        rig,
        lambda: rig.machines.robot.inject_fault("cable-cut", link="eth0"),
        lambda: rig.machines.robot.undo_fault("cable-cut", link="eth0"),
    ):
        report = rig.run_doctor()
        assert report["robot"] == {"name": ROBOT, "address": AP_ADDRESS, "unreachable": None}
        assert problems(report) == [("no-carrier", "carrier", "link")]
        assert_not_healthy(report)
        rig.run_as_root("systemctl stop lupin-onboard")
        report = rig.run_doctor()
        assert sorted(problems(report)) == [
            ("no-carrier", "carrier", "link"),
            ("unit-not-running", "processes", "robot"),
        ]


@pytest.mark.parametrize("offset_s", [1.6, -1.4])
def test_clock_off_by_seconds_is_not_healthy(rig: FaultRig, offset_s: float) -> None:
    robot = rig.machines.robot
    with fault(rig, lambda: robot.inject_fault("clock-wrong", offset_s=offset_s), lambda: robot.undo_fault("clock-wrong")):
        report = rig.run_doctor()
    assert problems(report) == [("clock-drift", "clock", "robot")]
    assert_not_healthy(report)
    assert "current stamps" in report["ground_truth"]["lost"]


def test_topics_at_a_tenth_of_their_rate_are_not_healthy(rig: FaultRig) -> None:
    robot = PID_OF.format(unit="mirte-ros", pattern="-m lupin_sim")
    pid = rig.run_as_root(robot).strip()
    loop = f"while :; do kill -STOP {pid}; sleep 0.9; kill -CONT {pid}; sleep 0.1; done"
    with fault(
        rig,
        lambda: rig.run_as_root(f"systemd-run -q --unit=throttle sh -c '{loop}'"),
        lambda: rig.run_as_root(f"systemctl stop throttle; kill -CONT {pid}"),
    ):
        report = rig.run_doctor()
    assert_not_healthy(report)
    assert {"slow"} <= {topic["state"] for topic in report["ground_truth"]["topics"]}
    assert {(layer, machine) for _, layer, machine in problems(report)} == {("processes", "robot")}


def test_permanent_neighbor_entry_of_the_laptop_is_named(rig: FaultRig) -> None:
    def neighbor(*words: str) -> None:
        assert rig.machines.run(["ip", "neigh", *words, "dev", "lan0"], timeout_s=20.0).returncode == 0

    with fault(
        rig,
        lambda: neighbor("replace", WIRED_ADDRESS, "lladdr", "02:00:00:00:00:99", "nud", "permanent"),
        lambda: neighbor("del", WIRED_ADDRESS),
    ):
        report = rig.run_doctor()
    assert problems(report) == [("neighbor-wrong", "address", "laptop")]
    assert_not_healthy(report)


def test_login_shell_that_runs_nothing_is_the_robots(rig: FaultRig) -> None:
    with fault(
        rig,
        lambda: rig.run_as_root("cp -a /etc/passwd /etc/passwd.kept; sed -i '/^mirte:/s,/bin/bash,/bin/false,' /etc/passwd"),
        lambda: rig.run_as_root("mv /etc/passwd.kept /etc/passwd"),
    ):
        report = rig.run_doctor()
    assert problems(report) == [("robot-unreachable", "login", "robot")]
    assert report["status"] == UNREACHABLE


@pytest.mark.smoke
def test_small_mtu_of_the_robot_is_named(rig: FaultRig) -> None:
    with fault(rig, lambda: rig.run_as_root("ip link set eth0 mtu 600"), lambda: rig.run_as_root("ip link set eth0 mtu 1500")):
        report = rig.run_doctor()
    if report["ground_truth"]["state"] == "broken":
        assert problems(report) == [("large-packets-lost", "mtu", "robot")]
        assert "MTU of 600" in report["findings"][0]["cause"]


@pytest.mark.smoke
def test_stopped_process_of_a_service_is_the_only_root(rig: FaultRig) -> None:
    pid = rig.run_as_root(PID_OF.format(unit="mirte-ros", pattern="-m lupin_sim")).strip()
    with fault(rig, lambda: rig.run_as_root(f"kill -STOP {pid}"), lambda: rig.run_as_root(f"kill -CONT {pid} || true")):
        report = rig.run_doctor()
    assert problems(report) == [("process-stopped", "processes", "robot")]
    assert pid in report["findings"][0]["cause"]
    assert_not_healthy(report)


def test_stopped_estop_is_healed(rig: FaultRig) -> None:
    pid = rig.run_as_root(PID_OF.format(unit="lupin-onboard", pattern="/estop.json")).strip()
    with fault(rig, lambda: rig.run_as_root(f"kill -STOP {pid}"), lambda: rig.run_as_root(f"kill -CONT {pid} || true")):
        # Its supervisor replaces it too, within seconds: whoever comes first, nothing else is named, and all is well then.
        assert problems(rig.run_doctor("--fix")) in ([], [("process-stopped", "processes", "robot")])
        wait_until(lambda: rig.run_doctor("--fix")["status"] == SUCCESS, "health after the fix", 90.0)


def test_rejected_ssh_is_no_fault_of_the_robots_data(rig: FaultRig) -> None:
    with robot_firewall(rig, "tcp dport 22 reject with tcp reset"):
        report = rig.run_doctor()
    assert problems(report) == [("robot-unreachable", "login", "robot")]
    assert report["status"] == UNREACHABLE and report["ground_truth"]["state"] != "broken"
    assert any("arrives here" in line for line in report["findings"][0]["evidence"])


def test_lossy_late_link_is_no_dead_robot(rig: FaultRig) -> None:
    robot = rig.machines.robot
    with robot.with_fault("slow-link", link="eth0", delay_ms=150.0), robot.with_fault("lossy-link", link="eth0", loss=0.3):
        report = rig.run_doctor()
    recover(rig)
    # Data also takes the access point, so nothing is missing; only the link in use is bad, which is a warning. A login may fail
    # on such a link: then the loss is the problem that explains it.
    lost = ("packets-lost", "loss", "link")
    assert lost in [(each["id"], each["layer"], each["machine"]) for each in report["findings"]]
    is_unreachable = report["robot"]["unreachable"] is not None
    assert problems(report) == ([lost] if is_unreachable else [])
    assert report["status"] == (UNREACHABLE if is_unreachable else FAILURE)


def test_loss_that_no_check_explains_is_a_finding(rig: FaultRig) -> None:
    # The filter takes packets by their length: no port, process or profile is at fault, and probes of other lengths pass.
    with robot_firewall(rig, "iifname eth0 udp length 260-1300 drop"):
        report = rig.run_doctor()
    assert problems(report) == [("unexplained", "samples", "link")]
    assert report["findings"][0]["evidence"]
    assert_not_healthy(report)
