"""The node runner: simulated time from one subscription, an orderly end, and an exit after a failure."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

TWO_NODES = """
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
    code = TWO_NODES.replace("{fail}", str(fail))
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_nodes_follow_clock_and_run_before_shutdown() -> None:
    process = start(fail=False)
    assert process.stdout is not None
    began = time.monotonic()
    assert process.stdout.readline().split() == ["five", "simulated", "seconds", "True", "True"]
    assert time.monotonic() - began < 20.0
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=10)
    assert (out.strip(), process.returncode) == ("last words", 0), err


def test_callback_exception_ends_the_process_with_a_traceback() -> None:
    process = start(fail=True)
    _, err = process.communicate(timeout=20)
    assert process.returncode == 1
    assert "RuntimeError: a defect" in err


LEAVER = """
import os
from lupin_runtime import graph
from lupin_runtime.ros import LupinNode, run

class Leaver(LupinNode):
    def __init__(self):
        super().__init__('leaver')
        self.create_timer(0.1, self.tick)
        self.navigation = self.action_client(graph.NAVIGATE_TO_POSE)
    def tick(self):
        pass

os._exit(run([Leaver]))
"""


def test_ended_process_leaves_the_graph_at_once(graph_host: GraphHost) -> None:
    from lupin_runtime.ros import LupinNode

    looker = graph_host.add(LupinNode("looker"))
    process = subprocess.Popen([sys.executable, "-c", LEAVER])
    graph_host.until(lambda: "leaver" in looker.get_node_names(), what="the node")
    process.send_signal(signal.SIGTERM)
    assert process.wait(10) == 0
    # A process that vanishes without leaving stays visible for its lease of 20 s.
    graph_host.until(lambda: "leaver" not in looker.get_node_names(), 10.0, "the node's goodbye")


def test_environment_of_tests_is_private() -> None:
    assert int(os.environ["ROS_DOMAIN_ID"]) > 0
