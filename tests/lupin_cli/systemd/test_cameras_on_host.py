"""The cameras' unit on the simulated computer, which has no cameras: pictures are served, and nothing else is disturbed."""

from __future__ import annotations

import json

import pytest

from lupin_sim.host import Host
from tests.support.waiting import wait_until

from .test_units_on_host import LIMIT_S, journal, show, state

pytestmark = pytest.mark.host

UNIT, ONBOARD = "lupin-cameras", "lupin-onboard"
CONFIGURATION = "/etc/lupin/cameras.yaml"


def shell(host: Host, script: str) -> str:
    done = host.robot.inside("sh", "-ec", script, timeout_s=LIMIT_S)
    assert done.status == 0, done.stderr
    return done.stdout


def pictures(host: Host) -> str:
    """What the video server lists, as text."""
    program = "import urllib.request as u; print(u.urlopen('http://127.0.0.1:8091/streams', timeout=10).read().decode())"
    done = host.robot.inside("/opt/lupin/current/venv/bin/python3", "-c", program, timeout_s=LIMIT_S)
    return done.stdout.strip()


def test_cameras_are_served_waited_for_and_restarted(robot_host: Host) -> None:
    shell(robot_host, f"systemctl start {ONBOARD} {UNIT}")
    onboard = show(robot_host, ONBOARD, "MainPID")
    assert state(robot_host, UNIT) == "active"
    assert show(robot_host, UNIT, "StatusText") == "up: body-camera, gripper-camera, video"
    assert json.loads(pictures(robot_host)) == []
    log = journal(robot_host, UNIT)
    assert "no body camera is connected" in log and "no gripper camera is connected" in log

    stages = json.loads(shell(robot_host, "cat /run/lupin-cameras/lupin/runs/*/state.json"))["stages"]
    (video,) = [stage for stage in stages if stage["name"] == "video"]
    shell(robot_host, f"kill -9 {video['pid']}")
    wait_until(lambda: "video" in journal(robot_host, UNIT).split("restarted")[0], lambda: journal(robot_host, UNIT), LIMIT_S)
    wait_until(lambda: pictures(robot_host) == "[]", lambda: journal(robot_host, UNIT), LIMIT_S)
    assert show(robot_host, UNIT, "NRestarts") == "0"

    first = show(robot_host, UNIT, "MainPID")
    shell(robot_host, f"kill -9 {first}")
    wait_until(
        lambda: show(robot_host, UNIT, "MainPID") not in (first, "0") and state(robot_host, UNIT) == "active",
        lambda: journal(robot_host, UNIT),
        LIMIT_S,
    )
    shell(robot_host, f"systemctl stop {UNIT}")
    assert "lupin_runtime.cameras" not in shell(robot_host, "cat /proc/[0-9]*/cmdline 2>/dev/null | tr '\\0' ' ' || true")
    assert show(robot_host, ONBOARD, "MainPID") == onboard and state(robot_host, ONBOARD) == "active"


def test_malformed_configuration_is_named_in_the_journal(robot_host: Host) -> None:
    shell(robot_host, f"mkdir -p /etc/lupin; echo 'color: {{fps: fast}}' > {CONFIGURATION}")
    try:
        assert robot_host.robot.inside("systemctl", "start", UNIT, timeout_s=LIMIT_S).status != 0
        assert f"{CONFIGURATION}: color.fps is a whole number from 1 to 60, not 'fast'" in journal(robot_host, UNIT)
        shell(robot_host, f"echo 'gripper: {{enabled: false}}' > {CONFIGURATION}; systemctl restart {UNIT}")
        wait_until(
            lambda: f"the gripper camera is switched off in {CONFIGURATION}" in journal(robot_host, UNIT),
            lambda: journal(robot_host, UNIT),
            LIMIT_S,
        )
    finally:
        shell(robot_host, f"systemctl stop {UNIT}; rm -f {CONFIGURATION}")


def test_vendors_restart_restarts_the_cameras(robot_host: Host) -> None:
    shell(robot_host, f"systemctl start {UNIT}")
    first = show(robot_host, UNIT, "MainPID")
    shell(robot_host, "systemctl restart mirte-ros")
    wait_until(
        lambda: show(robot_host, UNIT, "MainPID") not in (first, "0") and state(robot_host, UNIT) == "active",
        lambda: journal(robot_host, UNIT),
        LIMIT_S,
    )
    shell(robot_host, f"systemctl stop {UNIT}")
