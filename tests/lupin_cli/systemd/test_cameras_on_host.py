"""The cameras' unit on the simulated computer, whose cameras are links in /dev and whose driver is a script."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.checks import cameras, ports, services
from lupin_sim.host import Host
from tests.support.examined_robot import ExaminedRobot
from tests.support.onboard_units import TIMEOUT_S
from tests.support.waiting import wait_until

from .test_units_on_host import journal, show, state

pytestmark = pytest.mark.host

UNIT, ONBOARD = "lupin-cameras", "lupin-onboard"
CONFIGURATION = "/etc/lupin/cameras.yaml"
CHECKS = (*services.CHECKS, *cameras.CHECKS, *ports.CHECKS)
PLUG_IN, UNPLUG = "touch /dev/astradepth /dev/astrauvc", "rm -f /dev/astradepth /dev/astrauvc"
ROS2 = "/usr/local/bin/ros2"
END_DRIVER = """for p in /proc/[0-9]*; do
  [ "$(readlink $p/fd/0)" = /dev/astradepth ] && kill "${p#/proc/}"
done"""


def shell(host: Host, script: str) -> str:
    done = host.robot.run_as_root("sh", "-ec", script, timeout_s=TIMEOUT_S)
    assert done.status == 0, done.stderr
    return done.stdout


def list_streams(host: Host) -> str:
    """Return what the video server lists, as text."""
    program = "import urllib.request as u; print(u.urlopen('http://127.0.0.1:8091/streams', timeout=60).read().decode())"
    done = host.robot.run_as_root("/opt/lupin/current/venv/bin/python3", "-c", program, timeout_s=TIMEOUT_S)
    return done.stdout.strip()


def video_stage(host: Host) -> dict[str, Any]:
    """Return the state of the video server, as the camera service describes it."""
    stages = json.loads(shell(host, "cat /run/lupin-cameras/lupin/runs/*/state.json"))["stages"]
    (video,) = [stage for stage in stages if stage["name"] == "video"]
    return dict(video)


@contextmanager
def configured(host: Host, text: str) -> Iterator[None]:
    """Set another configuration for the duration of the block; then restore the old one and stop the unit."""
    shell(host, f"cp {CONFIGURATION} /run/cameras.yaml; echo '{text}' > {CONFIGURATION}")
    try:
        yield
    finally:
        shell(host, f"systemctl stop {UNIT}; systemctl reset-failed; mv /run/cameras.yaml {CONFIGURATION}")


def test_cameras_are_served_waited_for_and_restarted(robot_host: Host) -> None:
    with configured(robot_host, "{}"):
        shell(robot_host, f"systemctl start {ONBOARD} {UNIT}")
        onboard = show(robot_host, ONBOARD, "MainPID")
        assert state(robot_host, UNIT) == "active"
        assert show(robot_host, UNIT, "StatusText") == "up: body-camera, gripper-camera, video"
        assert json.loads(list_streams(robot_host)) == []
        log = journal(robot_host, UNIT)
        assert "no body camera is connected" in log and "no gripper camera is connected" in log

        killed = video_stage(robot_host)["pid"]
        shell(robot_host, f"kill -9 {killed}")
        wait_until(
            lambda: (now := video_stage(robot_host))["phase"] == "up" and now["pid"] != killed,
            lambda: journal(robot_host, UNIT),
            TIMEOUT_S,
        )
        wait_until(lambda: list_streams(robot_host) == "[]", lambda: journal(robot_host, UNIT), TIMEOUT_S)
        assert show(robot_host, UNIT, "NRestarts") == "0"

        first = show(robot_host, UNIT, "MainPID")
        shell(robot_host, f"kill -9 {first}")
        wait_until(
            lambda: show(robot_host, UNIT, "MainPID") not in (first, "0") and state(robot_host, UNIT) == "active",
            lambda: journal(robot_host, UNIT),
            TIMEOUT_S,
        )
        shell(robot_host, f"systemctl stop {UNIT}")
        assert "lupin_runtime.cameras" not in shell(robot_host, "cat /proc/[0-9]*/cmdline 2>/dev/null | tr '\\0' ' ' || true")
        assert show(robot_host, ONBOARD, "MainPID") == onboard and state(robot_host, ONBOARD) == "active"


def test_malformed_configuration_is_named_in_the_journal(robot_host: Host, tmp_path: Path) -> None:
    wrong = f"{CONFIGURATION}: color.fps must be a whole number from 1 to 60, not 'fast'"
    with configured(robot_host, "color: {fps: fast}"):
        shell(robot_host, f"systemctl start {ONBOARD}")
        assert robot_host.robot.run_as_root("systemctl", "start", UNIT, timeout_s=TIMEOUT_S).status != 0
        assert wrong in journal(robot_host, UNIT)
        robot = ExaminedRobot(robot_host, tmp_path, CHECKS)
        (finding,) = robot.findings()
        assert finding.id == "unit-restarting" and any(wrong in line for line in finding.evidence)
        robot.target.close()
        shell(robot_host, f"echo 'gripper: {{enabled: false}}' > {CONFIGURATION}; systemctl restart {UNIT}")
        wait_until(
            lambda: f"the gripper camera is switched off in {CONFIGURATION}" in journal(robot_host, UNIT),
            lambda: journal(robot_host, UNIT),
            TIMEOUT_S,
        )


def test_vendors_restart_restarts_the_cameras(robot_host: Host) -> None:
    shell(robot_host, f"systemctl start {UNIT}")
    first = show(robot_host, UNIT, "MainPID")
    shell(robot_host, "systemctl restart mirte-ros")
    wait_until(
        lambda: show(robot_host, UNIT, "MainPID") not in (first, "0") and state(robot_host, UNIT) == "active",
        lambda: journal(robot_host, UNIT),
        TIMEOUT_S,
    )
    shell(robot_host, f"systemctl stop {UNIT}")


@pytest.fixture
def robot(robot_host: Host, tmp_path: Path) -> Iterator[ExaminedRobot]:
    """Start all units, and yield the robot, in which the checks find nothing."""
    shell(robot_host, f"systemctl start {ONBOARD} {UNIT} lupin-auto-home")
    examined = ExaminedRobot(robot_host, tmp_path, CHECKS)
    assert examined.root_causes() == []
    yield examined
    examined.target.close()


def test_each_fault_of_a_camera_is_named_alone(robot: ExaminedRobot) -> None:
    def wait_for_causes(*expected: str) -> None:
        wait_until(lambda: robot.root_causes() == sorted(expected), lambda: f"{expected}, but {robot.root_causes()}", TIMEOUT_S)

    host = robot.host
    try:
        with configured(host, "gripper: {enabled: false}"):
            shell(host, f"systemctl restart {UNIT}")
            wait_for_causes("camera-absent")
            shell(host, PLUG_IN)
            wait_for_causes("camera-driver-missing")
            shell(host, f"printf '#!/bin/sh\\nexit 3\\n' > {ROS2}; chmod +x {ROS2}")
            wait_for_causes("camera-driver-failing")
            (finding,) = robot.findings()
            assert "status 3" in finding.evidence[0]
            shell(host, f"printf '#!/bin/sh\\nexec sleep infinity < /dev/astradepth\\n' > {ROS2}")
            wait_for_causes()
            shell(host, f"{END_DRIVER}; {UNPLUG}")
            wait_for_causes("camera-absent")

            person = "systemd-run -q --unit=stray --uid=mirte sh -c 'exec sleep 300 < /dev/astradepth'"
            shell(host, f"systemctl stop {UNIT}; {PLUG_IN}; chmod a+r /dev/astradepth; {person}; systemctl start {UNIT}")
            wait_for_causes("camera-held")
            (finding,) = robot.findings()
            assert "sleep (process" in finding.cause
            shell(host, "systemctl stop stray")
            wait_for_causes()

            shell(host, f"systemctl disable -q {UNIT}")
            wait_for_causes("unit-not-enabled")
            shell(host, f"systemctl enable -q {UNIT}; systemctl stop {UNIT}")
            wait_for_causes("unit-not-running")
            shell(host, f"systemctl start {UNIT}")
            wait_for_causes()
    finally:
        shell(host, f"systemctl stop stray 2>/dev/null || true; {UNPLUG}; rm -f {ROS2}")


def test_program_on_camera_port_is_named(robot: ExaminedRobot) -> None:
    host = robot.host
    server = "systemd-run -q --unit=stray --uid=mirte python3 -m http.server 8091"
    shell(host, f"systemctl stop {UNIT}; {server}; sleep 1; systemctl start --no-block {UNIT}")
    try:
        (finding,) = robot.findings()
        assert finding.id == "port-8091-taken" and "python3" in finding.cause
        wait_until(lambda: "8091 is in use" in journal(host, UNIT), lambda: journal(host, UNIT), TIMEOUT_S)
        wait_until(lambda: show(host, UNIT, "NRestarts") != "0", "a restart of the unit", 90.0)
        assert robot.root_causes() == ["port-8091-taken"]
    finally:
        shell(host, "systemctl stop stray")
    wait_until(lambda: state(host, UNIT) == "active", "the start of the unit", 90.0)
    assert robot.root_causes() == []
