"""Bounded waiting inside a service's coroutine, on a single-threaded executor.

A coroutine awaits futures that timers or answers complete; the executor goes on serving everything else meanwhile. All
entities taking part must be in a reentrant callback group: in an exclusive one the waiting service would lock out the very
answer that it waits for.
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

# Whether another process answers is a matter of real time: a simulation that stands still must not make us wait for ever.
_STEADY = Clock(clock_type=ClockType.STEADY_TIME)


async def sleep(node: LupinNode, duration_s: float, steady: bool = False) -> None:
    """Let `duration_s` of ROS time pass (with `steady`, of real time)."""
    gate = Future()
    timer = node.create_timer(duration_s, lambda: gate.set_result(None), clock=_STEADY if steady else None)
    try:
        await gate
    finally:
        node.destroy_timer(timer)


async def ready(node: LupinNode, is_ready: Callable[[], bool], within_s: float = READY_S) -> bool:
    """Wait until `is_ready()`, for at most `within_s` of real time; returns whether it is."""
    for _ in range(max(1, round(within_s / _POLL_S))):
        if is_ready():
            return True
        await sleep(node, _POLL_S, steady=True)
    return is_ready()


async def answer(node: LupinNode, future: Future, within_s: float = ANSWER_S) -> Any:
    """The result of `future`; None where it has none after `within_s` of real time."""
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
    """The response of a service; None where it was not there within READY_S or did not answer within `answer_s`."""
    if not await ready(node, client.service_is_ready):
        return None
    return await answer(node, client.call_async(request), answer_s)


class Turnstile:
    """Lets one coroutine of a node through at a time, in the order of their coming: `async with turnstile: ...`."""

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
            self._waiting.popleft().set_result(None)  # handed over: stays taken
        else:
            self._taken = False
