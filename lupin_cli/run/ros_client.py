"""Join the graph of a live run for the duration of one command: call a service, then leave."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer

from lupin_cli.exit_codes import FAILURE, UNREACHABLE
from lupin_cli.terminal import echo
from lupin_runtime.graph import Service

SERVER_TIMEOUT_S = 5.0
RESPONSE_TIMEOUT_S = 10.0


class RosSession:
    """A node on the graph of a run."""

    def __init__(self, node: Any, executor: Any) -> None:
        self.node = node
        self._executor = executor

    def wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Spin until `condition()` holds; return False after `timeout_s`."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def handle_waiting(self) -> None:
        """Handle one message that has arrived, without waiting."""
        self._executor.spin_once(timeout_sec=0.0)

    def call(self, service: Service, request: Any) -> Any:
        """Call a service and return its response. Exits with status 1 if it has no server or does not respond."""
        client = self.node.client(service)
        if not self.wait(client.service_is_ready, SERVER_TIMEOUT_S):
            echo(f"{service.name} has no server after {SERVER_TIMEOUT_S:.0f} s; see what runs with: lupin status", err=True)
            raise typer.Exit(FAILURE)
        future = client.call_async(request)
        if not self.wait(future.done, RESPONSE_TIMEOUT_S):
            echo(f"{service.name} did not respond within {RESPONSE_TIMEOUT_S:.0f} s", err=True)
            raise typer.Exit(FAILURE)
        return future.result()


@contextmanager
def join_run(run: str | None) -> Iterator[RosSession]:
    """Join the graph of the live run `run`, or of the only one. Exits with status 3 if there is none."""
    from lupin_runtime.stack.runs import RunError, find_live_run

    try:
        os.environ.update(find_live_run(run).info()["environment"])
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    # Imported here, because rclpy reads the environment when it is initialized.
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from lupin_runtime.ros.leaving import leave_graph
    from lupin_runtime.ros.node import ROS_ARGUMENTS, LupinNode

    rclpy.init(args=ROS_ARGUMENTS)
    node = LupinNode(f"lupin_session_{os.getpid()}", enable_rosout=False)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        yield RosSession(node, executor)
    finally:
        executor.shutdown(timeout_sec=1.0)
        leave_graph(node)
