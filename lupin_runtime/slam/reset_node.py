"""Service `/lupin/nav/clear_map`: clears both costmaps and starts a new map."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.task import Future

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.interfaces import interface

COSTMAP_WAIT_S = 0.5
RESET_WAIT_S = 2.0
ACKNOWLEDGE_S = 5.0
_POLL_S = 0.02


class SlamResetNode(LupinNode):
    """Calls the services of SLAM and the costmaps without blocking; success means that SLAM has acknowledged its reset."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("slam_reset_node", parameters)
        # Timeouts use the monotonic clock: a paused simulation must not hold a caller for ever.
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        # The timers and responses that a call awaits run while it does; a mutually exclusive group would never run them.
        self._group = ReentrantCallbackGroup()
        self._costmaps = [self.client(row, self._group) for row in (graph.CLEAR_LOCAL_COSTMAP, graph.CLEAR_GLOBAL_COSTMAP)]
        self._slam = self.client(graph.SLAM_RESET, self._group)
        self.service(graph.CLEAR_MAP, self._clear_map, self._group)

    async def _clear_map(self, _request: Any, response: Any) -> Any:
        cleared = 0
        for costmap in self._costmaps:
            if await self._until(costmap.service_is_ready, COSTMAP_WAIT_S):
                costmap.call_async(interface(graph.CLEAR_LOCAL_COSTMAP.type).Request())
                cleared += 1
        if not await self._until(self._slam.service_is_ready, RESET_WAIT_S):
            response.success = False
            response.message = f"service {graph.SLAM_RESET.name} does not exist: SLAM does not run; see: lupin status"
            return response
        answer = self._ask(self._slam)
        if not await self._until(answer.done, ACKNOWLEDGE_S):
            response.success = False
            response.message = f"{graph.SLAM_RESET.name} did not answer within {ACKNOWLEDGE_S:.0f} s; see: lupin logs slam"
            return response
        result = answer.result()
        response.success = result is not None and result.result == 0
        response.message = f"a new map starts; clearing was requested from {cleared} of {len(self._costmaps)} costmaps"
        return response

    @staticmethod
    def _ask(client: Client) -> Future:
        return client.call_async(interface(graph.SLAM_RESET.type).Request())

    async def _until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until a condition holds; returns whether it did in time. Other callbacks run meanwhile."""
        if condition():
            return True
        done: Future = Future(executor=self.executor)
        end = self._steady.now().nanoseconds + int(timeout_s * 1e9)

        def check() -> None:
            if done.done():
                return
            if condition():
                done.set_result(True)
            elif self._steady.now().nanoseconds >= end:
                done.set_result(False)

        timer = self.create_timer(_POLL_S, check, callback_group=self._group, clock=self._steady)
        try:
            return bool(await done)
        finally:
            self.destroy_timer(timer)
