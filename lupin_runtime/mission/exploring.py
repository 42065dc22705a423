"""EXPLORING: drive to what is unknown or unseen until the tags are found, or until nothing is left to look at."""

from __future__ import annotations

import math
from functools import partial

from lupin_runtime.mission.context import EXPLORATION, Context, Run
from lupin_runtime.mission.coverage import CameraModel, Coverage
from lupin_runtime.mission.driving import Outcome
from lupin_runtime.mission.explorer import ExplorationGoal, Explorer
from lupin_runtime.mission.missions import OK
from lupin_runtime.mission.ports import Reading

SELECT_EVERY_S = 1.0
SAMPLE_EVERY_S = 0.2
FOV_MARGIN_RAD = math.radians(3.0)  # a tag on the edge of the picture is cut


class Exploring:
    """Chooses goals through an Explorer, and asks the bridge once for each tag as it is discovered."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.reset()

    def reset(self) -> None:
        """Forget everything: a new mission may be in a new map."""
        config = self._context.config
        coverage = None
        if config.coverage_enabled:
            camera = CameraModel(
                x_m=config.coverage_camera_x_m,
                max_range_m=config.coverage_range_m,
                half_fov_rad=config.coverage_hfov_rad / 2.0 - FOV_MARGIN_RAD,
            )
            coverage = Coverage(
                camera,
                config.coverage_min_view_s,
                config.coverage_wall_weight,
                occupied_thresh=config.frontier_occupied_thresh,
                free_thresh=config.frontier_free_thresh,
            )
        self._explorer = Explorer(config.frontiers, coverage)
        self._goal: ExplorationGoal | None = None
        self._explored_s = 0.0
        self._tick_s: float | None = None
        self._sample_s = -math.inf
        self._selected_s = -math.inf
        self._nothing_since: tuple[float, int] | None = None

    def enter(self, leaf: str) -> None:
        """EXPLORING begins, or is resumed at the dock."""
        self._nothing_since = None
        self.seed()

    def leave(self) -> None:
        """EXPLORING ends."""
        self.hold()

    def hold(self) -> None:
        """Stop moving; the time until the next tick was no exploring."""
        self._context.driver.stop()
        self._give_up()
        self._tick_s = None

    def _give_up(self) -> None:
        if self._goal is not None:
            self._explorer.forgotten(self._goal)
            self._goal = None

    def sample(self) -> None:
        """Remember where the camera looks from; call it in EXPLORING, paused or not."""
        now = self._context.now_s
        elapsed = now - self._sample_s
        if elapsed < SAMPLE_EVERY_S:
            return
        self._sample_s = now
        robot = self._context.ports.world.robot_pose()
        if robot is not None:
            self._explorer.note_pose(robot, min(elapsed, 2.0 * SAMPLE_EVERY_S))

    def tick(self) -> None:
        """Go on; never called while blocked."""
        context, config, now = self._context, self._context.config, self._context.now_s
        assert context.run is not None and context.run.exploration is not None, "only an exploration explores"
        if self._tick_s is not None:
            self._explored_s += now - self._tick_s
        self._tick_s = now
        if context.run.exploration.is_complete:
            context.fire("tags_discovered")
        elif self._explored_s >= config.exploration_timeout_s:
            context.note("exploration_timeout")
            context.fire("no_frontiers")
        elif context.driver.busy:
            self._watch(now)
        elif now - self._selected_s >= SELECT_EVERY_S:
            self._selected_s = now
            self._select(now)

    def _watch(self, now: float) -> None:
        """Give a goal up that takes too long, or that shows nothing new any more."""
        newest = self._context.ports.world.map()
        if self._goal is None or newest is None:
            return
        if self._context.driver.age_s >= self._context.config.nav_timeout_s:
            self._context.driver.stop()
            self._failed("nav_timeout")
        elif now - self._selected_s >= SELECT_EVERY_S:
            self._selected_s = now
            if not self._explorer.is_useful(self._goal, newest[1]):
                self._context.driver.stop()
                self._give_up()
                self._select(now)

    def _select(self, now: float) -> None:
        context = self._context
        newest = context.ports.world.map()
        if newest is None or not context.beliefs.has_pose or not context.ports.navigation.is_ready():
            self._nothing_since = None
            return
        number, grid = newest
        goal = self._explorer.choose(grid, number, context.ports.world.robot_pose(), now)
        if goal is None:
            self._nothing_left(now, number)
            return
        self._nothing_since = None
        self._goal = goal
        context.ports.outlet.log(f"{goal.kind}: to ({goal.pose.x:.2f}, {goal.pose.y:.2f})")
        context.driver.drive(goal.pose, self._ended)

    def _nothing_left(self, now: float, number: int) -> None:
        """Believe that nothing is left when it has been so for a while: the map lags behind the robot."""
        if self._nothing_since is None:
            self._nothing_since = (now, number)
            return
        since, _ = self._nothing_since
        if now - since < self._context.config.exploration_exhausted_s:
            return
        exploration = self._context.run.exploration if self._context.run is not None else None
        if exploration is not None and not exploration.wants_all:
            self._context.note(f"exploration_exhausted: {exploration.discovered} of {exploration.goal} tags")
        self._context.ports.outlet.log("nothing is left to explore")
        self._context.fire("no_frontiers")

    def _ended(self, outcome: Outcome) -> None:
        if self._goal is None:
            return
        if outcome.end == "succeeded":
            newest = self._context.ports.world.map()
            self._explorer.arrived(self._goal, newest[0] if newest is not None else 0)
            if self._goal.kind == "viewpoint":
                self._selected_s = self._context.now_s  # stay for a look
            self._goal = None
        elif outcome.end in ("canceled", "lost", "blind"):
            if outcome.end == "blind":
                self._context.note(outcome.detail)
            self._selected_s = self._context.now_s
            self._give_up()
        else:
            self._failed(outcome.detail)

    def _failed(self, detail: str) -> None:
        newest = self._context.ports.world.map()
        self._context.note(detail)
        if self._goal is not None:
            self._context.ports.outlet.log(
                f"{self._goal.kind} at ({self._goal.pose.x:.2f}, {self._goal.pose.y:.2f}): {detail}", warning=True
            )
            self._explorer.failed(self._goal, newest[0] if newest is not None else 0, self._context.now_s)
            self._goal = None

    # -- the first reading of each tag ---------------------------------------------------------------------------------

    def seed(self) -> None:
        """Ask the bridge, once, for every tag that has not been asked for in this mission; never waits."""
        context, run = self._context, self._context.run
        if run is None or not context.config.seed_climate_on_discovery or not context.ports.greenhouse.is_ready():
            return
        for tag_id in context.beliefs.discovered.keys() - run.seeded:
            run.seeded.add(tag_id)
            context.ports.greenhouse.read(tag_id, partial(self._seeded, run, tag_id))

    def _seeded(self, run: Run, tag_id: str, reading: Reading) -> None:
        if run is self._context.run and reading.status == 0:
            self._context.observe(EXPLORATION, tag_id, OK, "", reading)
