"""Hands work from the event loop to the thread of a node's executor.

rclpy allows entities to be created and destroyed while another thread waits for them, but has crashed doing so; everything that
touches the graph, except publishing, therefore happens on the executor's thread.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from lupin_runtime.ros.wake import Wake

_TURN_S = 0.02  # how long queued functions run before the executor handles other events, such as timers and messages

_Result = TypeVar("_Result")


class RosThread:
    """Runs functions on the thread that spins the node, in the order in which they were queued."""

    def __init__(self, node: Node) -> None:
        self._lock = threading.Lock()
        self._work: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        # In its own callback group, because a callback that awaits something keeps its group busy.
        self._wake = Wake(node, self._run_some, ReentrantCallbackGroup())

    def run(self, function: Callable[[], _Result]) -> Future[_Result]:
        """Queue a function; the future gets its result or exception. Wait for it only on another thread, with a timeout."""
        future: Future[_Result] = Future()
        with self._lock:
            self._work.append((function, future))
        self._wake.trigger()
        return future

    def _run_some(self) -> None:
        deadline_s = time.monotonic() + _TURN_S
        while True:
            with self._lock:
                if not self._work:
                    return
                if time.monotonic() >= deadline_s:
                    self._wake.trigger()
                    return
                function, future = self._work.popleft()
            if not future.set_running_or_notify_cancel():
                continue
            try:
                result = function()
            except Exception as error:  # reported to the caller, whose request it was
                future.set_exception(error)
            else:
                future.set_result(result)
