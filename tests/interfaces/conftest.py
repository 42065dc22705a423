"""Fixtures: a node in this process, and peers in other processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.paths import ROOT
from tests.support.waiting import WAIT_S

PEER = ROOT / "tests/support/ros_peer.py"

StartPeer = Callable[..., None]


@pytest.fixture
def start_peer() -> Iterator[StartPeer]:
    """Return a function that starts a peer in a role, with any Python and environment, and waits until it prints `ready`."""
    started: list[subprocess.Popen[str]] = []

    def start(role: str, python: str | Path = sys.executable, env: dict[str, str] | None = None) -> None:
        process = subprocess.Popen(
            [str(python), str(PEER), role], env=env or dict(os.environ), stdout=subprocess.PIPE, text=True
        )
        started.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n", f"the peer exited with {process.wait(60)}; its error output is above"

    yield start
    for process in started:
        process.send_signal(signal.SIGTERM)
    for process in started:
        try:
            assert process.wait(WAIT_S) == 0
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        finally:
            assert process.stdout is not None
            process.stdout.close()


@pytest.fixture
def node_and_executor() -> Iterator[tuple[Any, ...]]:
    """A node, and a single-threaded executor that can spin it."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    context = rclpy.context.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("interfaces_test", context=context, start_parameter_services=False, enable_rosout=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node, executor
    executor.shutdown()  # before the context, or the process aborts
    node.destroy_node()
    rclpy.shutdown(context=context)
