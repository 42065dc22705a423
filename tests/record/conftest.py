"""A graph in this process: nodes of a test spin until it ends."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

import pytest


class Spinning:
    """Nodes on single-threaded executors of their own."""

    def __init__(self) -> None:
        self._running: list[tuple] = []

    def add(self, node):
        """Spin a node in the background; returns it."""
        from rclpy.executors import SingleThreadedExecutor

        executor = SingleThreadedExecutor()
        executor.add_node(node)
        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        self._running.append((executor, thread, node))
        return node

    def stop(self) -> None:
        for executor, thread, _ in self._running:
            executor.shutdown(timeout_sec=2.0)
            thread.join(2.0)
        for _, _, node in self._running:
            node.destroy_node()


@pytest.fixture
def spinning(private_graph) -> Iterator[Spinning]:
    import rclpy

    rclpy.init(args=[])
    running = Spinning()
    yield running
    running.stop()
    rclpy.try_shutdown()


@pytest.fixture
def until() -> Callable[..., None]:
    """Wait for a condition; fail with what was missing when it does not come."""

    def wait(condition: Callable[[], object], what: str, patience_s: float = 15.0) -> None:
        give_up = time.monotonic() + patience_s
        while not condition():
            assert time.monotonic() < give_up, f"within {patience_s} s: {what}"
            time.sleep(0.02)

    return wait
