"""The node runner: simulated time from one subscription, a clean shutdown, and an exit after a failure."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.support.waiting import WAIT_S, wait_for_nothing, wait_until

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"

THREE_NODES = """
import os, sys
from lupin_runtime.ros import LupinNode, run
from rosgraph_msgs.msg import Clock
from lupin_runtime import graph

class Simulator(LupinNode):
    def __init__(self):
        super().__init__('simulator')
        self.out = self.publisher(graph.CLOCK)
        from rclpy.clock import Clock as SteadyClock, ClockType
        self.t = 0
        self.create_timer(0.01, self.tick, clock=SteadyClock(clock_type=ClockType.STEADY_TIME))
    def tick(self):
        self.t += 100_000_000   # ten simulated seconds per second
        m = Clock(); m.clock.sec, m.clock.nanosec = divmod(self.t, 10**9)
        self.out.publish(m)

class Follower(LupinNode):
    def __init__(self):
        super().__init__('follower')
        self.count = 0
        self.create_timer(1.0, self.tick)
    def tick(self):
        self.count += 1
        if self.count == 5:
            print('five simulated seconds', self.now_ns() > 4 * 10**9, self.elapsed_clock_ns() == self.now_ns(), flush=True)
    def before_shutdown(self):
        print('last words', flush=True)

FAIL = {fail}
class Failing(LupinNode):
    def __init__(self):
        super().__init__('failing')
        from rclpy.clock import Clock as SteadyClock, ClockType
        self.create_timer(0.2, self.tick, clock=SteadyClock(clock_type=ClockType.STEADY_TIME))
    def tick(self):
        if FAIL:
            raise RuntimeError('a defect')

status = run([Simulator, Follower, Failing], simulated_time=True)
sys.stdout.flush(); sys.stderr.flush()
os._exit(status)
"""


def start(fail: bool) -> subprocess.Popen[str]:
    code = THREE_NODES.replace("{fail}", str(fail))
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_nodes_follow_clock_and_call_before_shutdown() -> None:
    process = start(fail=False)
    assert process.stdout is not None
    assert process.stdout.readline().split() == ["five", "simulated", "seconds", "True", "True"]
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=WAIT_S)
    assert (out.strip(), process.returncode) == ("last words", 0), err


def test_callback_exception_exits_with_a_traceback() -> None:
    process = start(fail=True)
    _, err = process.communicate(timeout=WAIT_S)
    assert process.returncode == 1
    assert "RuntimeError: a defect" in err


ONE_NODE = """
import os
from lupin_runtime import graph
from lupin_runtime.ros import LupinNode, run

class Node(LupinNode):
    def __init__(self):
        super().__init__('terminated')
        self.create_timer(0.1, self.tick)
        # An action client that is not destroyed would keep the node visible after the exit.
        self.navigation = self.action_client(graph.NAVIGATE_TO_POSE)
    def tick(self):
        pass

os._exit(run([Node]))
"""

# A command that joins a graph, and goes on when it has left.
VISITOR = """
import os, signal, threading
import rclpy
from lupin_runtime.ending import STUCK
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.leaving import leave_graph
from lupin_runtime.ros.node import ROS_ARGUMENTS

over = threading.Event()
rclpy.init(args=ROS_ARGUMENTS, signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
signal.signal(signal.SIGTERM, lambda *_: over.set())
node = LupinNode('terminated', enable_rosout=False)
over.wait()
leave_graph(node)
os._exit(int(rclpy.ok() or STUCK.is_set()))
"""

# A process that exits without leaving the graph stays visible until its DDS lease expires.
LONG_LEASE = "<builtin><discovery_config><leaseDuration><sec>600</sec></leaseDuration></discovery_config></builtin>"


@pytest.mark.parametrize("program", [ONE_NODE, VISITOR], ids=["node runner", "visitor"])
def test_terminated_process_leaves_the_graph_at_once(graph_host: GraphHost, tmp_path: Path, program: str) -> None:
    from lupin_runtime.ros import LupinNode

    profile = tmp_path / "profile.xml"
    profile.write_text(Path(os.environ[PROFILE]).read_text().replace("</rtps>", f"{LONG_LEASE}</rtps>"))
    observer = graph_host.add(LupinNode("observer"))
    process = subprocess.Popen([sys.executable, "-c", program], env={**os.environ, PROFILE: str(profile)})
    graph_host.until(lambda: "terminated" in observer.get_node_names(), what="the node")
    process.send_signal(signal.SIGTERM)
    assert process.wait(WAIT_S) == 0
    graph_host.until(lambda: "terminated" not in observer.get_node_names(), what="the node's disappearance")


@pytest.mark.usefixtures("graph_host")
def test_stop_waits_until_a_callback_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    from lupin_runtime.ros import LupinNode, node_runner

    monkeypatch.setattr(node_runner, "STOP_GRACE_S", WAIT_S)
    node, failures = LupinNode("busy"), []
    spinner = node_runner._Spinner(node, lambda: failures.append("a callback failed"))
    handling = threading.Event()
    make_handler = spinner._executor._make_handler

    def make_handler_late(*arguments: Any) -> Any:
        handling.set()
        wait_until(lambda: spinner._stopping, "the stop")
        wait_for_nothing(0.2, "a shutdown that does not wait for the thread")
        return make_handler(*arguments)

    monkeypatch.setattr(spinner._executor, "_make_handler", make_handler_late)
    timer = node.create_timer(0.001, lambda: None)
    wait_until(timer.is_ready, "a timer that is due, which rclpy looks at first")
    spinner.thread.start()
    assert handling.wait(WAIT_S)
    spinner.stop()
    assert not failures and not spinner.thread.is_alive()
    spinner.destroy_node()


def test_environment_of_tests_is_private() -> None:
    assert int(os.environ["ROS_DOMAIN_ID"]) > 0
