"""Runs the global costmap and the planner in a thread, since planning may take longer than a control cycle."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.navigation.costmap import BeamPoses, Costmap, GlobalCostmap, RangeScan
from lupin_runtime.navigation.planning import NoPath, Plan, PlannerParameters, plan

Job = Callable[[], None]


@dataclass
class PlanRequest:
    """A request for a path. The worker sets `answer`; it ignores a request that is `abandoned` before its turn."""

    answer: Plan | NoPath | None = None
    planning_time_s: float = 0.0
    abandoned: bool = field(default=False, repr=False)


class PlanWorker:
    """Owns the global costmap. Methods only queue work for its thread and return at once, except `close`.

    `failure` is the exception that ended the thread; the node checks it and raises it again.
    """

    def __init__(self, costmap: GlobalCostmap, parameters: PlannerParameters) -> None:
        self._costmap = costmap
        self._parameters = parameters
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._current: PlanRequest | None = None
        self._waiting: list[tuple[PlanRequest, Pose2, tuple[Pose2, ...], Pose2 | None]] = []
        self.failure: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="planner_server", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread, and wait up to 2 s for it."""
        self._jobs.put(None)
        self._thread.join(2.0)

    # -- map and scans -------------------------------------------------------------------------------------------------
    def set_map(self, decode: Callable[[], GridMap], on_invalid: Callable[[str], None]) -> None:
        """Set the map. The thread calls `decode` and, if that raises ValueError, `on_invalid` with the reason."""

        def job() -> None:
            try:
                grid = decode()
            except ValueError as error:
                on_invalid(str(error))
                return
            self._costmap.set_map(grid)
            waiting, self._waiting = self._waiting, []
            for arguments in waiting:
                self._plan(*arguments)

        self._jobs.put(job)

    def observe(self, scan: RangeScan, poses: BeamPoses) -> None:
        """Mark and clear obstacles with a scan; `poses` are those of the laser in the map frame."""

        def job() -> None:
            self._costmap.observe(scan, poses)

        self._jobs.put(job)

    @property
    def has_map(self) -> bool:
        """Whether a map has arrived."""
        return self._costmap.ready

    def snapshot(self, robot: Pose2 | None, deliver: Callable[[Costmap | None], None]) -> None:
        """Call `deliver` with the inflated costmap in the thread; None if there is no map yet."""

        def job() -> None:
            deliver(self._costmap.snapshot(robot) if self._costmap.ready else None)

        self._jobs.put(job)

    def clear_obstacles(self) -> None:
        """Forget the obstacles that are not in the map."""
        self._jobs.put(self._costmap.clear)

    # -- plans ---------------------------------------------------------------------------------------------------------
    def submit(self, start: Pose2, goals: Sequence[Pose2], robot: Pose2 | None) -> PlanRequest:
        """Request a path from any start. Obstacle marks under `robot` are cleared. The request waits for the first map."""
        request = PlanRequest()
        self._jobs.put(lambda: self._plan(request, start, tuple(goals), robot))
        return request

    def request(self, start: Pose2, goals: Sequence[Pose2]) -> None:
        """Request a path for the executive. It replaces the executive's last request."""
        self.drop()
        self._current = self.submit(start, goals, robot=start)

    def take(self) -> Plan | NoPath | None:
        """Return the answer to the executive's request, but only once; None before the answer and after it."""
        if self._current is None or self._current.answer is None:
            return None
        answer, self._current = self._current.answer, None
        return answer

    def drop(self) -> None:
        """Cancel the executive's request."""
        if self._current is not None:
            self._current.abandoned = True
        self._current = None

    def _plan(self, request: PlanRequest, start: Pose2, goals: tuple[Pose2, ...], robot: Pose2 | None) -> None:
        if request.abandoned:
            return
        if not self._costmap.ready:
            self._waiting.append((request, start, goals, robot))
            return
        started_s = time.perf_counter()
        answer = plan_through(self._costmap.snapshot(robot), start, goals, self._parameters)
        request.planning_time_s = time.perf_counter() - started_s
        request.answer = answer

    def _work(self) -> None:
        try:
            while (job := self._jobs.get()) is not None:
                job()
        except BaseException as error:  # raised again by the node's own thread
            self.failure = error


def plan_through(costmap: Costmap, start: Pose2, goals: Sequence[Pose2], parameters: PlannerParameters) -> Plan | NoPath:
    """Plan one path from the start through all goals, or return the reason why there is no path."""
    legs: list[NDArray[np.float64]] = []
    at = start.x, start.y
    try:
        for goal in goals:
            leg = plan(costmap, at, (goal.x, goal.y), parameters)
            legs.append(leg.points if not legs else leg.points[1:])
            at = leg.goal
    except NoPath as no_path:
        return no_path
    return Plan(np.vstack(legs))
