"""A process ends although its middleware never returns, also while that holds the lock without which Python runs nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from tests.support.waiting import WAIT_S

pytestmark = pytest.mark.graph

# A function of a PyDLL runs with Python's global lock held.
HANG = "import ctypes; hang = ctypes.PyDLL(None).pause\n"

ORPHAN = f"""{HANG}
import signal
from lupin_runtime.ros import supervision
supervision.ORPHAN_GRACE_S = 0.3
signal.signal(signal.SIGTERM, lambda *_: hang())
supervision.end_with_parent()
print("up", flush=True)
signal.pause()
"""

STOPPED = f"""{HANG}
import os
from lupin_runtime.ros import LupinNode, node_runner
node_runner.STOP_GRACE_S = 0.3

class Node(LupinNode):
    def destroy_node(self):
        hang()

os._exit(node_runner.run([lambda: Node("stopped")], ready=lambda _: print("up", flush=True)))
"""


def start(program: str) -> subprocess.Popen[str]:
    """Start a program that prints "up", and wait for it."""
    pipe = subprocess.PIPE
    process = subprocess.Popen([sys.executable, "-c", program], stdin=pipe, stdout=pipe, stderr=pipe, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "up\n"
    return process


def test_orphan_ends_although_nothing_of_python_runs() -> None:
    process = start(ORPHAN)
    _, said = process.communicate(timeout=WAIT_S)  # closes the standard input, as the death of a supervisor does
    assert process.returncode == 1
    assert "Timeout" in said and "most recent call first" in said


@pytest.mark.usefixtures("graph_host")
def test_stopped_nodes_end_although_nothing_of_python_runs() -> None:
    process = start(STOPPED)
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=WAIT_S)
    assert process.returncode == 1
    assert "in destroy_node" in said


# A middleware that never returns, and an interpreter that would not shut down.
STUCK_COMMAND = """
import atexit, ctypes, os, sys, threading, types
import rclpy
from lupin_cli import app
from lupin_runtime.ros import LupinNode, leaving
from lupin_runtime.ros.node import ROS_ARGUMENTS

deleted = []
def delete(node):
    deleted.append(node)
    threading.Event().wait()

leaving.LEAVE_TIMEOUT_S = 0.3
leaving.ctypes = types.SimpleNamespace(c_void_p=ctypes.c_void_p, CDLL=lambda name: types.SimpleNamespace(rcl_node_fini=delete))
rclpy.init(args=ROS_ARGUMENTS)
leaving.leave_graph(LupinNode("stuck", enable_rosout=False))
assert len(deleted) == 1
atexit.register(os._exit, 99)
app.main()
"""


@pytest.mark.usefixtures("graph_host")
@pytest.mark.parametrize(("argument", "status"), [("--version", 0), ("no-such-command", 2)])
def test_command_that_cannot_leave_the_graph_ends_as_it_would(argument: str, status: int) -> None:
    command = [sys.executable, "-c", STUCK_COMMAND, argument]
    done = subprocess.run(command, env=dict(os.environ), capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert done.returncode == status, done.stderr
    assert "lupin" in done.stdout + done.stderr
