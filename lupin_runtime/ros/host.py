"""Runs nodes in one process: each with its own single-threaded executor and thread.

The wheels' MultiThreadedExecutor busy-loops and their EventsExecutor never fires a callback, so neither is used.
"""

from __future__ import annotations

import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from lupin_runtime.ros.node import LupinNode

if TYPE_CHECKING:
    from lupin_runtime.ros.clock import ClockFollower

STOP_GRACE_S = 2.0

NodeFactory = Callable[[], Node]


class _Spinner:
    """One node, one executor, one thread."""

    def __init__(self, node: Node, on_failure: Callable[[], None]) -> None:
        self.node = node
        self._on_failure = on_failure
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self.thread = threading.Thread(target=self._spin, name=node.get_name(), daemon=True)

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            pass
        except BaseException:
            # A callback that raises ends its process, loudly: a half-dead process looks healthy from outside.
            traceback.print_exc()
            self._on_failure()

    def stop(self) -> None:
        self._executor.shutdown(timeout_sec=STOP_GRACE_S)
        if self.thread.is_alive():
            # The shutdown of an executor does not wait for the thread inside it, and the interpreter aborts (134) if it
            # ends while that thread is still in a wait set.
            self.thread.join(STOP_GRACE_S)

    def leave(self) -> None:
        """Say goodbye: a node that only ends is seen by others for its lease of 20 s. After `stop` of all, which may share."""
        if not self.thread.is_alive():
            self.node.destroy_node()


def run(
    factories: Sequence[NodeFactory],
    simulated_time: bool = False,
    ready: Callable[[Sequence[Node]], None] | None = None,
) -> int:
    """Build the nodes and run them until SIGTERM, SIGINT or a failure; returns the exit status (0, or 1 after a failure).

    A node may have `before_shutdown()`, called while the graph still works: that is where motion is stopped.
    With `simulated_time` one subscription to `/clock` serves all nodes of the process.
    """
    stop = threading.Event()
    failed = threading.Event()

    def fail() -> None:
        failed.set()
        stop.set()

    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda *_: stop.set())
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    spinners: list[_Spinner] = []
    follower: ClockFollower | None = None
    try:
        if simulated_time:
            # Only here: the robot's older rclpy lacks what it needs, and a robot has no simulated time.
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
        while not stop.wait(0.5):
            pass
        for node in nodes:
            last_words = getattr(node, "before_shutdown", None)
            if last_words is not None:
                last_words()
    except Exception:
        traceback.print_exc()
        failed.set()
    finally:
        # A wedged middleware must not keep a dead process on the graph.
        threading.Thread(target=_exit_after, args=(2 * STOP_GRACE_S,), daemon=True).start()
        for spinner in spinners:
            spinner.stop()
        for spinner in spinners:
            spinner.leave()
        if follower is not None:
            follower.stop()
        rclpy.try_shutdown()
    return 1 if failed.is_set() else 0


def _exit_after(seconds: float) -> None:
    time.sleep(seconds)
    os._exit(1)
