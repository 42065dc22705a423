"""Bounded waits in coroutines of service callbacks, for a single-threaded executor.

A coroutine awaits futures that timers or responses complete, and the executor runs other callbacks meanwhile. All entities
involved must be in a reentrant callback group: in an exclusive group the waiting service would block the response that it waits
for.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import Any

from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.task import Future

from lupin_runtime.ros import LupinNode

READY_S = 0.5
ANSWER_S = 2.0
_POLL_S = 0.05

# Waits for other processes use real time, so that they also end while the simulated time stands still.
_STEADY = Clock(clock_type=ClockType.STEADY_TIME)


async def sleep(node: LupinNode, duration_s: float, steady: bool = False) -> None:
    """Wait for `duration_s` of ROS time, or of real time with `steady`."""
    gate = Future()
    timer = node.create_timer(duration_s, lambda: gate.set_result(None), clock=_STEADY if steady else None)
    try:
        await gate
    finally:
        node.destroy_timer(timer)


async def ready(node: LupinNode, is_ready: Callable[[], bool], within_s: float = READY_S) -> bool:
    """Wait until `is_ready()` is true, for at most `within_s` of real time; return whether it is."""
    for _ in range(max(1, round(within_s / _POLL_S))):
        if is_ready():
            return True
        await sleep(node, _POLL_S, steady=True)
    return is_ready()


async def answer(node: LupinNode, future: Future, within_s: float = ANSWER_S) -> Any:
    """Return the result of `future`; None if it is not done after `within_s` of real time."""
    gate = Future()

    def open_gate(*_: object) -> None:
        if not gate.done():
            gate.set_result(None)

    timer = node.create_timer(within_s, open_gate, clock=_STEADY)
    future.add_done_callback(open_gate)
    try:
        await gate
    finally:
        node.destroy_timer(timer)
    if not future.done():
        future.cancel()
        return None
    return future.result()


async def call(node: LupinNode, client: Client, request: Any, answer_s: float = ANSWER_S) -> Any:
    """Return the response of a service; None without a server within READY_S, or without a response within `answer_s`."""
    if not await ready(node, client.service_is_ready):
        return None
    return await answer(node, client.call_async(request), answer_s)


class AsyncMutex:
    """A first-come, first-served lock for the coroutines of a node: `async with mutex: ...`."""

    def __init__(self) -> None:
        self._taken = False
        self._waiting: deque[Future] = deque()

    async def __aenter__(self) -> None:
        if self._taken:
            turn = Future()
            self._waiting.append(turn)
            await turn
        self._taken = True

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._waiting:
            self._waiting.popleft().set_result(None)  # the lock passes to the next coroutine and stays taken
        else:
            self._taken = False
