"""Runs nodes in one process, each with its own single-threaded executor and thread.

In the ROS wheels (the Python packages of ROS 2) the MultiThreadedExecutor busy-loops and the EventsExecutor never calls a
callback, so neither is used.
"""

from __future__ import annotations

import signal
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from lupin_runtime.ending import exit_within
from lupin_runtime.heartbeat import PROCESS_PERIOD_S
from lupin_runtime.ros.node import ROS_ARGUMENTS, LupinNode
from lupin_runtime.ros.node_executor import NodeExecutor
from lupin_runtime.ros.wake import Wake

if TYPE_CHECKING:
    from lupin_runtime.ros.clock import ClockFollower
    from lupin_runtime.ros.supervision import Supervision

STOP_GRACE_S = 2.0
IDLE_S = 0.5  # waking an idle executor more often would cost more than it finds

NodeFactory = Callable[[], Node]


class _Spinner:
    """Spins one node with its own executor and thread."""

    def __init__(self, node: Node, on_failure: Callable[[], None]) -> None:
        self.node = node
        self._on_failure = on_failure
        self._executor = NodeExecutor()
        self._executor.add_node(node)
        self._stopping = False
        self._handled_ns = time.monotonic_ns()  # when the executor last handled an event
        self._woken_ns = 0
        # In its own callback group, because a callback that awaits something keeps its group busy.
        self._wake = Wake(node, lambda: None, ReentrantCallbackGroup())
        self.thread = threading.Thread(target=self._spin, name=node.get_name(), daemon=True)

    def _spin(self) -> None:
        try:
            while rclpy.ok() and not self._stopping:
                self._executor.spin_once()
                self._handled_ns = time.monotonic_ns()
        except ExternalShutdownException:
            pass
        except BaseException:
            # A callback that raises must terminate the process: with one dead node it would look healthy from outside.
            traceback.print_exc()
            self._on_failure()

    def responded_ns(self) -> int:
        """Return the time up to which the executor responds: now, or when it was given an event that it has not handled yet.

        An executor that has been idle for IDLE_S is given an event.
        """
        now_ns, handled_ns = time.monotonic_ns(), self._handled_ns
        if handled_ns < self._woken_ns:
            return self._woken_ns
        if now_ns - handled_ns > IDLE_S * 1e9:
            self._woken_ns = now_ns
            self._wake.trigger()
        return now_ns

    def stop(self) -> None:
        """End the thread, within STOP_GRACE_S, and then the executor.

        rclpy's shutdown destroys what a running callback still needs; it does not wait for the thread. The interpreter aborts
        (status 134) if it exits while that thread is still in a wait set.
        """
        self._stopping = True
        deadline = time.monotonic() + STOP_GRACE_S
        while self.thread.is_alive() and time.monotonic() < deadline:
            self._executor.wake()
            self.thread.join(0.1)
        if not self.thread.is_alive():
            self._executor.shutdown()

    def destroy_node(self) -> None:
        """Destroy the node, which else stays visible until its DDS lease of 20 s expires. Call it once all spinners stopped."""
        if not self.thread.is_alive():
            self.node.destroy_node()


def run(
    factories: Sequence[NodeFactory],
    simulated_time: bool = False,
    ready: Callable[[Sequence[Node]], None] | None = None,
    supervision: Supervision | None = None,
) -> int:
    """Create the nodes and run them until SIGTERM, SIGINT, SIGHUP or a failure; return 0, or 1 after a failure.

    `before_shutdown()` of a LupinNode is called while the graph still works, so that it can stop motion. With `simulated_time`
    one subscription to `/clock` serves all nodes of the process. `ready` is called with the nodes once they spin. `supervision`
    receives heartbeats, and can forbid motion.
    """
    stop = threading.Event()
    failed = threading.Event()

    def fail() -> None:
        failed.set()
        stop.set()

    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda *_: stop.set())
    rclpy.init(args=ROS_ARGUMENTS, signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    spinners: list[_Spinner] = []
    follower: ClockFollower | None = None
    if supervision is not None:
        LupinNode.motion_hold = staticmethod(supervision.motion_hold)
    try:
        if simulated_time:
            # Imported only here: the robot's older rclpy lacks what it needs, and the robot has no simulated time.
            from lupin_runtime.ros.clock import ClockFollower

            LupinNode.simulated_time = True
            follower = ClockFollower(fail)
            follower.start()
        nodes = []
        for factory in factories:
            node = factory()
            if follower is not None:
                follower.attach(node)
            nodes.append(node)
        spinners += [_Spinner(node, fail) for node in nodes]
        for spinner in spinners[-len(nodes) :]:
            spinner.thread.start()
        if ready is not None:
            ready(nodes)
        while not stop.wait(PROCESS_PERIOD_S):
            if supervision is not None:
                _beat(supervision, spinners)
        for node in nodes:
            if isinstance(node, LupinNode):
                node.before_shutdown()
    except Exception:
        traceback.print_exc()
        failed.set()
    finally:
        exit_within(2 * STOP_GRACE_S)  # a middleware that hangs must not keep this process on the graph
        for spinner in spinners:
            spinner.stop()
        for spinner in spinners:
            spinner.destroy_node()
        if follower is not None:
            follower.stop()
        rclpy.try_shutdown()
    return 1 if failed.is_set() else 0


def _beat(supervision: Supervision, spinners: Sequence[_Spinner]) -> None:
    responded_ns, node = min((spinner.responded_ns(), spinner.node.get_name()) for spinner in spinners)
    supervision.beat(responded_ns, node)
