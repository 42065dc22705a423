"""A client on the graph of a run, with its own thread, whose requests wait for their effect."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lupin_runtime import graph
from tests.support.waiting import WAIT_S, wait_until


class GraphClient:
    """A node on the graph of a run; `folder` is the run's directory. A subclass subscribes, and then calls `start`."""

    def __init__(self, folder: Path, name: str) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.task import Future

        from lupin_runtime.ros.node import LupinNode

        self.folder = folder
        self._context = rclpy.Context()
        # The run of a robot's units names no domain: it is on the one of the environment.
        rclpy.init(context=self._context, domain_id=json.loads((folder / "run.json").read_text()).get("domain"))
        self.node = LupinNode(name, context=self._context, enable_rosout=False)
        self._clients: dict[str, Any] = {}
        self._publishers: dict[str, Any] = {}
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._end = Future()
        self._thread = threading.Thread(target=self._executor.spin_until_future_complete, args=(self._end,), daemon=True)

    def start(self) -> None:
        """Spin the node."""
        self._thread.start()

    def close(self) -> None:
        """Leave the graph."""
        self._end.set_result(None)
        self._thread.join()
        self._executor.shutdown(timeout_sec=2.0)
        self.node.destroy_node()
        self._context.try_shutdown()

    def log(self, process: str) -> str:
        """Return the log of a process of the run."""
        return (self.folder / "logs" / f"{process}.log").read_text(errors="replace")

    def until(self, condition: Callable[[], Any], what: str, timeout_s: float = WAIT_S) -> Any:
        """Wait until the condition is true, and return its value. Fails the test with `what`."""
        return wait_until(condition, what, timeout_s, interval_s=0.01)

    def within(self, function: Callable[[], Any]) -> Any:
        """Run a function on the spinning thread, as action clients require, and return its value."""
        task = self._executor.create_task(function)
        # Woken again and again: Fast DDS may lose a wake-up of another thread.
        wait_until(task.done, "free executor", interval_s=0.01, each=self._executor.wake)
        return task.result()

    def publisher(self, row: graph.Topic, number: int = 0) -> Any:
        """Return a publisher that has matched a subscription; `number` distinguishes several publishers of a topic."""
        key = f"{row.name} {number}"
        if key not in self._publishers:
            self._publishers[key] = self.node.publisher(row)
        publisher = self._publishers[key]
        self.until(lambda: publisher.get_subscription_count() > 0, f"subscription of {row.name}")
        return publisher

    def call(self, row: graph.Service, **fields: Any) -> Any:
        """Call a service, and return its response."""
        from lupin_runtime.ros.interfaces import interface

        client = self._clients.setdefault(row.name, None) or self.node.client(row)
        self._clients[row.name] = client
        self.until(client.service_is_ready, f"server of {row.name}")
        future = client.call_async(interface(row.type).Request(**fields))
        self.until(future.done, f"response of {row.name}")
        return future.result()

    def send(self, row: graph.Action, goal: Any) -> Any:
        """Send a goal, and return its handle. Raises RuntimeError if it is rejected."""
        client = self._clients.setdefault(row.name, None) or self.node.action_client(row)
        self._clients[row.name] = client
        self.until(client.server_is_ready, f"server of {row.name}")
        sent = self.within(lambda: client.send_goal_async(goal))
        handle = self.until(lambda: sent.done() and sent.result(), f"response of {row.name}")
        if not handle.accepted:
            raise RuntimeError(f"{row.name} rejected the goal")
        return handle
