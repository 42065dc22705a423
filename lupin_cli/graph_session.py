"""A command's short visit to the graph of a live run: join, call a service, leave."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer

from lupin_runtime.graph import Service

SERVER_BOUND_S = 5.0
ANSWER_BOUND_S = 10.0


class Visit:
    """A node on the run's graph."""

    def __init__(self, node: Any, executor: Any) -> None:
        self.node = node
        self._executor = executor

    def wait(self, condition: Any, bound_s: float) -> bool:
        """Spin until `condition()` holds; False after the bound."""
        deadline = time.monotonic() + bound_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def call(self, service: Service, request: Any) -> Any:
        """The service's answer; ends the command with status 1 where nobody serves it or it does not answer."""
        client = self.node.client(service)
        if not self.wait(client.service_is_ready, SERVER_BOUND_S):
            typer.echo(f"nobody serves {service.name} ({SERVER_BOUND_S:.0f} s); what runs: lupin status", err=True)
            raise typer.Exit(1)
        future = client.call_async(request)
        if not self.wait(future.done, ANSWER_BOUND_S):
            typer.echo(f"{service.name} did not answer within {ANSWER_BOUND_S:.0f} s", err=True)
            raise typer.Exit(1)
        return future.result()


@contextmanager
def visit(run: str | None) -> Iterator[Visit]:
    """Join the graph of the live run `run` (or the only one). Ends the command with status 3 where there is none."""
    from lupin_runtime.stack.runs import RunError, find_live_run

    try:
        os.environ.update(find_live_run(run).info()["environment"])
    except RunError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(3) from error
    # rclpy reads the environment when it is first initialised.
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from lupin_runtime.ros.node import LupinNode

    rclpy.init(args=[])
    node = LupinNode(f"lupin_visit_{os.getpid()}", enable_rosout=False)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        yield Visit(node, executor)
    finally:
        executor.shutdown(timeout_sec=1.0)
        node.destroy_node()
        rclpy.try_shutdown()
