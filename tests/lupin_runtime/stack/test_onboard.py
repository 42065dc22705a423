"""The robot's part of the stack: real processes on a private graph, and a socket in place of systemd."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime.stack.onboard import onboard_options
from lupin_runtime.stack.options import ONBOARD, Options
from lupin_runtime.stack.table import rows
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from tests.conftest import GraphHost

TIMEOUT_S = 60.0


def test_onboard_rows_need_nothing_and_only_the_pad_is_optional() -> None:
    chosen = rows(Options(target=ONBOARD))
    assert [row.name for row in chosen] == ["estop", "drive", "body", "joystick"]
    assert all(row.needs == () and row.on_death == "restart" for row in chosen)
    assert all(row.optional if row.name == "joystick" else row.ready and not row.optional for row in chosen)
    nodes = [node.path.split(":")[1] for row in chosen for node in row.nodes]
    assert {
        "TwistMux",
        "EstopBridge",
        "ArmPresetServer",
        "ArmCalibrateServer",
        "GripperActionBridge",
        "LightStripBridge",
        "PadTeleop",
    } <= set(nodes)


def test_onboard_nodes_use_the_robots_sink_and_color_order() -> None:
    options = Options(target=ONBOARD)
    parameters = {node.path.split(":")[1]: dict(node.parameters(options)) for row in rows(options) for node in row.nodes}
    assert parameters["TwistMux"]["sink"] == "robot"
    assert parameters["LightStripBridge"] == {"color_order": "BRG", "onboard": True}


@pytest.mark.parametrize(
    ("environment", "expected"),
    [({}, "button witness"), ({"LUPIN_ESTOP_BUTTON": "yes"}, "button witness"), ({"LUPIN_ESTOP_BUTTON": "No "}, "witness")],
)
def test_robot_without_a_button_expects_none(environment: dict[str, str], expected: str) -> None:
    options = onboard_options(environment)
    (estop,) = (node for row in rows(options) if row.name == "estop" for node in row.nodes)
    assert options.target == ONBOARD and estop.parameters(options)["expected_sources"] == expected


@pytest.mark.graph
def test_onboard_notifies_ready_restarts_and_stops_cleanly(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(TIMEOUT_S)
        service = subprocess.Popen(
            [sys.executable, "-m", "lupin_runtime.stack.onboard"],
            env={**os.environ, "XDG_STATE_HOME": str(tmp_path), "NOTIFY_SOCKET": str(tmp_path / "notify")},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            notifications = [manager.recv(4096).decode()]
            while notifications[-1] != "READY=1":
                notifications.append(manager.recv(4096).decode())
            assert any("waiting for: estop (/e_stop_state: " in line for line in notifications)
            state = stages(tmp_path)
            os.kill(state["drive"]["pid"], signal.SIGKILL)
            wait_until(
                lambda: stages(tmp_path)["drive"]["restarts"] == 1 and stages(tmp_path)["drive"]["phase"] == "up",
                "the restart of the drive bus",
                TIMEOUT_S,
            )
            assert stages(tmp_path)["estop"]["pid"] == state["estop"]["pid"]
            pids = [stage["pid"] for stage in stages(tmp_path).values()]
        finally:
            service.send_signal(signal.SIGTERM)
            text, _ = service.communicate(timeout=TIMEOUT_S)
    assert service.returncode == 0, text
    assert "drive was killed by SIGKILL: restarted" in text
    assert not [pid for pid in pids if Path(f"/proc/{pid}").exists()]


@pytest.mark.graph
def test_onboard_runs_where_nothing_can_be_written(tmp_path: Path) -> None:
    nowhere = tmp_path / "file"
    nowhere.touch()  # nobody, not even root, can write below a file
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(TIMEOUT_S)
        service = subprocess.Popen(
            [sys.executable, "-m", "lupin_runtime.stack.onboard"],
            env={
                **os.environ,
                "HOME": str(nowhere),
                "XDG_STATE_HOME": str(nowhere),
                "NOTIFY_SOCKET": str(tmp_path / "notify"),
            },
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            while manager.recv(4096).decode() != "READY=1":
                assert service.poll() is None
        finally:
            service.send_signal(signal.SIGTERM)
            text, _ = service.communicate(timeout=TIMEOUT_S)
    assert service.returncode == 0, text
    assert "cannot make the run directory" in text


@pytest.mark.graph
def test_monitor_resubscribes_until_a_sample_arrives(graph_host: GraphHost, monkeypatch: pytest.MonkeyPatch) -> None:
    from lupin_runtime import graph
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.stack import graph_monitor as module
    from lupin_runtime.stack.readiness import TopicSample

    monkeypatch.setattr(module, "RESUBSCRIBE_AFTER_S", 0.2)
    monkeypatch.setattr("rclpy.init", lambda **_: None)  # the test's context is initialized already
    monitor, condition, created = module.GraphMonitor(rated=()), TopicSample(graph.ESTOP_STATE), []

    def estop_subscriptions() -> list[object]:
        return [each for each in monitor.node.subscriptions if each.topic_name == graph.ESTOP_STATE.name]

    make_probe = monitor._make_probe
    monkeypatch.setattr(monitor, "_make_probe", lambda needed: created.append(needed) or make_probe(needed))  # type: ignore[func-returns-value]

    def ask_in_vain() -> None:
        assert not monitor.satisfied(condition)
        monitor.spin(0.05)

    wait_until(lambda: len(created) >= 3, "three subscriptions", interval_s=0.0, each=ask_in_vain)
    assert created == [condition] * 3
    assert len(estop_subscriptions()) == module.MAX_SUBSCRIPTIONS, "a first sample may be under way to an earlier one"
    monkeypatch.setattr(module, "RESUBSCRIBE_AFTER_S", TIMEOUT_S)
    node = LupinNode("speaker")
    publisher = node.publisher(graph.ESTOP_STATE)
    message = publisher.msg_type()
    node.create_timer(0.1, lambda: publisher.publish(message))
    graph_host.add(node)
    wait_until(lambda: monitor.satisfied(condition), "a sample", interval_s=0.0, each=lambda: monitor.spin(0.05))
    assert estop_subscriptions() == []
    monitor._executor.shutdown(timeout_sec=1.0)
    monitor.node.destroy_node()


def stages(home: Path) -> dict[str, dict[str, Any]]:
    (path,) = (home / "lupin" / "runs").glob("*/state.json")
    return {stage["name"]: stage for stage in json.loads(path.read_text())["stages"]}
