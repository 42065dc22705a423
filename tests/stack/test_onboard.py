"""The robot's own half of the stack: real processes on a private graph, and a socket in systemd's place."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lupin_runtime.stack.onboard import onboard_options
from lupin_runtime.stack.table import rows

BOUND_S = 60.0


def test_it_is_the_drive_bus_the_e_stop_and_the_body_and_waits_for_nothing_of_the_vendors() -> None:
    chosen = rows(onboard_options())
    assert [row.name for row in chosen] == ["estop", "drive", "body"]
    assert all(row.needs == () and row.ready and row.on_death == "restart" for row in chosen)
    nodes = [node.path.split(":")[1] for row in chosen for node in row.nodes]
    assert {
        "TwistMux",
        "EstopBridge",
        "ArmPresetServer",
        "ArmCalibrateServer",
        "GripperActionBridge",
        "LightStripBridge",
    } <= set(nodes)


def test_its_drive_bus_ends_at_the_robots_sink_and_its_strip_has_the_robots_colour_order() -> None:
    options = onboard_options()
    parameters = {node.path.split(":")[1]: dict(node.parameters(options)) for row in rows(options) for node in row.nodes}
    assert parameters["TwistMux"]["sink"] == "robot"
    assert parameters["LightStripBridge"] == {"color_order": "BRG"}


@pytest.mark.graph
def test_it_says_ready_when_all_is_up_mends_what_dies_and_ends_with_nothing_left(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(BOUND_S)
        service = subprocess.Popen(
            [sys.executable, "-m", "lupin_runtime.stack.onboard"],
            env={**os.environ, "XDG_STATE_HOME": str(tmp_path), "NOTIFY_SOCKET": str(tmp_path / "notify")},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            said = [manager.recv(4096).decode()]
            while said[-1] != "READY=1":
                said.append(manager.recv(4096).decode())
            assert any("waiting for: estop (/e_stop_state: " in line for line in said)
            state = stages(tmp_path)
            os.kill(state["drive"]["pid"], signal.SIGKILL)
            until(lambda: stages(tmp_path)["drive"]["restarts"] == 1 and stages(tmp_path)["drive"]["phase"] == "up")
            assert stages(tmp_path)["estop"]["pid"] == state["estop"]["pid"]
            pids = [stage["pid"] for stage in stages(tmp_path).values()]
        finally:
            service.send_signal(signal.SIGTERM)
            text, _ = service.communicate(timeout=BOUND_S)
    assert service.returncode == 0, text
    assert "drive ended by SIGKILL: restarted" in text
    assert not [pid for pid in pids if Path(f"/proc/{pid}").exists()]


@pytest.mark.graph
def test_a_reader_that_hears_nothing_is_made_anew_and_then_hears(graph_host, monkeypatch) -> None:
    from lupin_runtime import graph
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.stack import watch as module
    from lupin_runtime.stack.sentinels import Heard

    monkeypatch.setattr(module, "LISTEN_ANEW_S", 0.2)
    monkeypatch.setattr(module.rclpy, "init", lambda **_: None)  # the test's own context serves
    watch, sentinel, made = module.GraphWatch(rated=()), Heard(graph.ESTOP_STATE), []
    make = watch._make_probe
    monkeypatch.setattr(watch, "_make_probe", lambda wanted: made.append(wanted) or make(wanted))
    deadline = time.monotonic() + BOUND_S
    while len(made) < 3 and time.monotonic() < deadline:
        assert not watch.satisfied(sentinel)
        watch.spin(0.05)
    assert made == [sentinel] * 3
    monkeypatch.setattr(module, "LISTEN_ANEW_S", BOUND_S)
    node = LupinNode("speaker")
    publisher = node.publisher(graph.ESTOP_STATE)
    message = publisher.msg_type()
    node.create_timer(0.1, lambda: publisher.publish(message))
    graph_host.add(node)
    while not watch.satisfied(sentinel):
        assert time.monotonic() < deadline + BOUND_S
        watch.spin(0.05)
    watch._executor.shutdown(timeout_sec=1.0)
    watch.node.destroy_node()


def stages(home: Path) -> dict[str, dict]:
    (path,) = (home / "lupin" / "runs").glob("*/state.json")
    return {stage["name"]: stage for stage in json.loads(path.read_text())["stages"]}


def until(condition) -> None:
    deadline = time.monotonic() + BOUND_S
    while not condition():
        assert time.monotonic() < deadline, "the drive bus did not come back"
        time.sleep(0.05)
