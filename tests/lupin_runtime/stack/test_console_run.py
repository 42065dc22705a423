"""A run with its console: pictures, clients that drive, and a console that is killed or suspended meanwhile."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from lupin_runtime import graph
from lupin_runtime.console.description import read_description
from tests.lupin_runtime.stack.conftest import Up
from tests.support.console_browser import Browser
from tests.support.image_messages import decoded
from tests.support.rosbridge_client import RosbridgeClient
from tests.support.video_client import VideoClient
from tests.support.waiting import wait_until

pytestmark = [pytest.mark.mission, pytest.mark.sim, pytest.mark.graph]

SUPPORT = Path(__file__).parents[2] / "support"
ROSLIBPY = SUPPORT / "roslibpy.lock"
ROSLIBPY_PROGRAM = SUPPORT / "roslibpy_program.py"
INSTALL_TIMEOUT_S = 300.0
PROGRAM_TIMEOUT_S = 120.0
STREAM_PERIOD_S = 0.1
# Messages. A process that does not respond for a moment stops the robot, and then the stick must be let go of.
LET_GO_EVERY = 15
REST = 0.01  # m/s and rad/s
MOVING_RAD_S = 0.05
LOST = "the console was lost while a browser was driving"


def drive(run: Up, client: RosbridgeClient, condition: Callable[[], Any], what: str) -> None:
    """Stream a velocity until the condition holds, or until the console is gone."""
    sent = itertools.count(1)

    def step() -> Any:
        speed = 0.8 if next(sent) % LET_GO_EVERY else 0.0
        client.send("publish", topic=graph.CMD_VEL_MANUAL.name, msg={"linear": {"x": 0.0}, "angular": {"z": speed}})
        time.sleep(STREAM_PERIOD_S)
        return condition()

    run.wait(step, what)


def take_stick(client: RosbridgeClient) -> None:
    """Hold the stick at rest until the drive bus would let it drive: motion that comes right after a stop stays at zero."""
    client.send("subscribe", topic=graph.DRIVE_STATUS.name)

    def is_free() -> bool:
        client.send("publish", topic=graph.CMD_VEL_MANUAL.name, msg={})
        with suppress(TimeoutError):
            message = client.take(STREAM_PERIOD_S)
            if message.get("topic") == graph.DRIVE_STATUS.name:
                why: str = json.loads(message["msg"]["data"])["inputs"]["manual"]["why"]
                return why == "wins the bus"
        return False

    wait_until(is_free, lambda: f"a stick that is free: {client.received[-1:]}", interval_s=0.0)


def turning(run: Up) -> bool:
    twist = run.simulator().get("twist") or [0.0, 0.0, 0.0]
    return abs(float(twist[2])) > MOVING_RAD_S


def at_rest(run: Up) -> bool:
    twist = run.simulator().get("twist") or [1.0]
    return max(abs(float(value)) for value in twist) < REST


def stopped(run: Up, times: int) -> bool:
    """Return whether lost consoles have engaged the e-stop this many times."""
    return run.log("estop").count(LOST) == times


def release(browser: Browser) -> bool:
    """Release the stop; return False while the console does not answer yet."""
    with suppress(OSError):
        return bool(browser.post("/_api/stop", engaged=False)["stop"] == [])
    return False


def replaced(before: dict[str, Any], state: dict[str, Any]) -> bool:
    """Return whether a process other than `before` is up."""
    stage = next(stage for stage in state["stages"] if stage["name"] == "console")
    return bool(stage["phase"] == "up" and stage["pid"] != before["pid"])


@pytest.fixture
def roslibpy_python(tmp_path: Path) -> Path:
    """Return the interpreter of a virtual environment that contains roslibpy, and nothing of Lupin."""
    python = tmp_path / "roslibpy" / "bin" / "python"
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    subprocess.run([sys.executable, "-m", "venv", python.parents[1]], env=environment, check=True, timeout=INSTALL_TIMEOUT_S)
    install = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps", "--require-hashes"]
    subprocess.run([*install, "-r", str(ROSLIBPY)], env=environment, check=True, timeout=INSTALL_TIMEOUT_S)
    return python


@pytest.mark.usefixtures("console_ports")
def test_console_serves_a_run_and_its_loss_stops_the_robot(launch: Callable[..., Up], roslibpy_python: Path) -> None:
    run = launch("--headless", "--json", "--world", "walled", "--no-record", "--web")
    run.wait_up()
    folder = run.folder()
    assert folder is not None
    described = read_description(folder)
    assert described is not None
    assert json.loads(run.lupin("console", "code", "--json").stdout)["url"] == described.url

    # A second console says which process has the port.
    refused = run.lupin("console")
    assert refused.returncode == 2 and f"port {described.port} is in use by process" in refused.stderr

    pictures = VideoClient(described.port, "/_video")
    cameras = {graph.BODY_IMAGE_SIM.name, graph.GRIPPER_IMAGE.name}
    run.wait(lambda: cameras <= {row["topic"] for row in pictures.json("/streams")}, "both cameras")
    assert decoded(pictures.get(f"/snapshot?topic={graph.BODY_IMAGE_SIM.name}")[1]).shape == (480, 640, 3)

    # A program of somebody else drives, reads and stops the robot.
    program = [str(roslibpy_python), "-I", str(ROSLIBPY_PROGRAM), str(described.rosbridge_port)]
    done = subprocess.run(program, capture_output=True, text=True, timeout=PROGRAM_TIMEOUT_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    seen = json.loads(done.stdout)
    assert seen["fastest_m_s"] > 0.1 and seen["driven_m"] > 0.02
    assert seen["was_stopped"] and seen["speed_while_stopped_m_s"] < REST and not seen["is_stopped"]
    assert graph.ODOM.name in seen["topics"]
    run.wait(lambda: at_rest(run), "rest after the program")

    browser = Browser(described.port)
    browser.get("/")
    for losses, number in enumerate((signal.SIGKILL, signal.SIGSTOP), 1):
        client = RosbridgeClient(described.rosbridge_port)
        take_stick(client)
        drive(run, client, lambda: turning(run), "motion")
        before = run.stage("console")
        os.kill(before["pid"], number)
        with suppress(ConnectionClosed, OSError):
            for _ in range(5):
                client.send("publish", topic=graph.CMD_VEL_MANUAL.name, msg={"angular": {"z": 0.8}})
        run.wait(lambda: at_rest(run), f"rest after {number.name}")
        run.until(partial(replaced, before), "another console")
        client.close()
        # The next console may be up before the e-stop counts the former as lost, and an earlier release has no effect.
        run.wait(partial(stopped, run, losses), f"the stop after {number.name}")
        run.wait(lambda: release(browser), "release by the browser, which is still paired")

    run.process.send_signal(signal.SIGINT)
    assert run.result()[0] == 130
    assert read_description(folder) is None
