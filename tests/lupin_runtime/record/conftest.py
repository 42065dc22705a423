"""Nodes that spin in this process until the test ends."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_runtime.record.node import Recorder
    from lupin_runtime.ros.node import LupinNode


class Spinning:
    """Nodes, each on its own single-threaded executor."""

    def __init__(self) -> None:
        self._running: list[tuple[Any, ...]] = []

    def add(self, node: LupinNode | Recorder) -> LupinNode | Recorder:
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
def spinning(private_graph: int) -> Iterator[Spinning]:  # noqa: ARG001 -- the fixture must have run
    import rclpy

    rclpy.init(args=[])
    running = Spinning()
    yield running
    running.stop()
    rclpy.try_shutdown()


@pytest.fixture
def until() -> Callable[..., None]:
    """`wait_until` with a limit of 15 s."""
    return partial(wait_until, timeout_s=15.0)
