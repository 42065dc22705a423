"""Runs the global costmap and the planner in a thread, since a plan may take longer than a control cycle."""

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
class Ticket:
    """A request; `answer` is set once, by the worker."""

    answer: Plan | NoPath | None = None
    planning_time_s: float = 0.0
    abandoned: bool = field(default=False, repr=False)


class PlanWorker:
    """Owns the global costmap. Every method returns at once; one thread does the work in order.

    `failed` is the exception that ended the thread: the node checks it and ends as well.
    """

    def __init__(self, costmap: GlobalCostmap, parameters: PlannerParameters) -> None:
        self._costmap = costmap
        self._parameters = parameters
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._current: Ticket | None = None
        self._waiting: list[tuple[Ticket, Pose2, tuple[Pose2, ...], Pose2 | None]] = []
        self.failed: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="planner_server", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread."""
        self._jobs.put(None)
        self._thread.join(2.0)

    # -- map and scans -------------------------------------------------------------------------------------------------
    def set_map(self, decode: Callable[[], GridMap], refused: Callable[[str], None]) -> None:
        """Set the map; it is decoded in the thread, and `refused` is called for one that is invalid."""

        def job() -> None:
            try:
                grid = decode()
            except ValueError as error:
                refused(str(error))
                return
            self._costmap.set_map(grid)
            waiting, self._waiting = self._waiting, []
            for request in waiting:
                self._plan(*request)

        self._jobs.put(job)

    def observe(self, scan: RangeScan, poses: BeamPoses) -> None:
        """Mark and clear with a scan, poses in the map frame."""

        def job() -> None:
            self._costmap.observe(scan, poses)

        self._jobs.put(job)

    def snapshot(self, robot: Pose2 | None, deliver: Callable[[Costmap], None]) -> None:
        """Call `deliver` with the inflated costmap, in the thread; not before the first map."""

        def job() -> None:
            if self._costmap.ready:
                deliver(self._costmap.snapshot(robot))

        self._jobs.put(job)

    # -- plans ---------------------------------------------------------------------------------------------------------
    def submit(self, start: Pose2, goals: Sequence[Pose2], robot: Pose2 | None) -> Ticket:
        """Request a path from any start; at `robot` there is no obstacle. Before the first map the request waits."""
        ticket = Ticket()
        self._jobs.put(lambda: self._plan(ticket, start, tuple(goals), robot))
        return ticket

    def request(self, start: Pose2, goals: Sequence[Pose2]) -> None:
        """Request a path for the executive, in place of its last request."""
        self.drop()
        self._current = self.submit(start, goals, robot=start)

    def take(self) -> Plan | NoPath | None:
        """Return the answer to the executive's request, once."""
        if self._current is None or self._current.answer is None:
            return None
        answer, self._current = self._current.answer, None
        return answer

    def drop(self) -> None:
        """Cancel the executive's request."""
        if self._current is not None:
            self._current.abandoned = True
        self._current = None

    def clear(self) -> None:
        """Forget the obstacles that are not in the map."""
        self._jobs.put(self._costmap.clear)

    def _plan(self, ticket: Ticket, start: Pose2, goals: tuple[Pose2, ...], robot: Pose2 | None) -> None:
        if ticket.abandoned:
            return
        if not self._costmap.ready:
            self._waiting.append((ticket, start, goals, robot))
            return
        began = time.perf_counter()
        answer = plan_through(self._costmap.snapshot(robot), start, goals, self._parameters)
        ticket.planning_time_s = time.perf_counter() - began
        ticket.answer = answer

    def _work(self) -> None:
        try:
            while (job := self._jobs.get()) is not None:
                job()
        except BaseException as error:  # logged and re-raised by the node's own thread
            self.failed = error


def plan_through(costmap: Costmap, start: Pose2, goals: Sequence[Pose2], parameters: PlannerParameters) -> Plan | NoPath:
    """Plan one path from the start through all goals, or return why there is none."""
    legs: list[NDArray[np.float64]] = []
    at = start.x, start.y
    try:
        for goal in goals:
            leg = plan(costmap, at, (goal.x, goal.y), parameters)
            legs.append(leg.points if not legs else leg.points[1:])
            at = leg.goal
    except NoPath as refusal:
        return refusal
    return Plan(np.vstack(legs))
