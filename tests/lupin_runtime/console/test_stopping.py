"""The console's process ends in time, whatever its clients do, and leaves nothing behind."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from websockets.exceptions import ConnectionClosed

from lupin_runtime import graph
from lupin_runtime.console.description import read_description
from tests.support.console_browser import Browser
from tests.support.raw_websocket import open_raw_websocket, text_frame
from tests.support.rosbridge_client import RosbridgeClient
from tests.support.waiting import WAIT_S

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

# The limit of the console for its connections, 2 s, is longer here, for slow machines. A WebSocket of aiohttp waits 10 s for
# a client, and a request 60 s.
SERVE = """
import sys
from lupin_runtime.console import server
from lupin_runtime.console.node import Console
from lupin_runtime.ros import run

def announce(nodes):
    print(nodes[0].port, nodes[0].rosbridge_port, flush=True)

server._STOP_TIMEOUT_S = 8.0
files = {"folder": sys.argv[1], "sessions_file": sys.argv[1] + "/sessions.json"}
sys.exit(run([lambda: Console({"port": 0, "rosbridge_port": 0, **files})], ready=announce))
"""


@dataclass
class Process:
    """A console in its own process."""

    process: subprocess.Popen[str]
    folder: Path
    port: int
    rosbridge_port: int

    def stop(self) -> None:
        """Terminate it. Fails the test unless it closes all connections in time and exits with status 0."""
        self.process.send_signal(signal.SIGTERM)
        _, errors = self.process.communicate(timeout=WAIT_S)
        assert self.process.returncode == 0, errors
        assert "Traceback" not in errors and "not closed within" not in errors, errors


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Process]:
    command = [sys.executable, "-c", SERVE, str(tmp_path)]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True)
    assert process.stdout is not None
    port, rosbridge_port = map(int, process.stdout.readline().split())
    yield Process(process, tmp_path, port, rosbridge_port)
    if process.poll() is None:
        process.kill()
        process.communicate(timeout=WAIT_S)


def test_console_stops_in_time_while_a_client_drives(graph_host: GraphHost, console: Process) -> None:
    from lupin_runtime.ros import LupinNode

    speeds: list[float] = []
    robot = graph_host.add(LupinNode("robot"))
    robot.subscription(graph.CMD_VEL_MANUAL, lambda message: speeds.append(message.linear.x))
    driver, browser = RosbridgeClient(console.rosbridge_port), Browser(console.port)
    sockets = [browser.socket("/_ros"), browser.socket("/_api/events")]
    assert read_description(console.folder) is not None

    def drive() -> list[float]:
        driver.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
        return speeds

    graph_host.until(drive, what="motion")
    console.stop()
    assert read_description(console.folder) is None
    graph_host.until(lambda: speeds[-1] == 0.0, what="zero")
    with pytest.raises(ConnectionClosed, match="1001"):
        driver.take(5.0)
    for each in (driver, *sockets):
        each.close()


@pytest.fixture
def silent(console: Process) -> Iterator[list[socket.socket]]:
    """Clients that answer nothing; the last one does not even read what it asks for."""
    with ExitStack() as opened:
        targets = ((console.rosbridge_port, "/"), (console.port, "/_ros"), (console.port, "/_api/events"))
        clients = [opened.enter_context(open_raw_websocket(port, path)) for port, path in targets]
        clients.append(opened.enter_context(socket.create_connection(("127.0.0.1", console.port), timeout=60)))
        clients.append(opened.enter_context(open_raw_websocket(console.rosbridge_port, "/", receive_buffer=4096)))
        yield clients


def test_console_stops_in_time_although_clients_do_not_respond(console: Process, silent: list[socket.socket]) -> None:
    silent[-1].settimeout(0.5)
    with suppress(TimeoutError):
        for _ in range(200):
            silent[-1].sendall(text_frame("call_service", service="/rosapi/interfaces"))
    console.stop()
