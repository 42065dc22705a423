"""EXPLORING: drive to frontiers and viewpoints until enough tags are found or nothing is left to explore."""

from __future__ import annotations

import math
from functools import partial

from lupin_runtime.mission.activity import Activity
from lupin_runtime.mission.context import EXPLORATION, ActiveMission, Context
from lupin_runtime.mission.coverage import Coverage
from lupin_runtime.mission.explorer import ExplorationGoal, Explorer
from lupin_runtime.mission.goal_runner import DriveResult
from lupin_runtime.mission.kernels import CameraModel
from lupin_runtime.mission.missions import OK
from lupin_runtime.mission.records import ClimateReading

SELECT_EVERY_S = 1.0
SAMPLE_EVERY_S = 0.2
FOV_MARGIN_RAD = math.radians(3.0)  # a tag on the image's edge is cut off


class Exploring(Activity):
    """Drives to the goals of an Explorer, and reads every tag's climate once when it is discovered."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.reset()

    def reset(self) -> None:
        """Forget the previous search: a new mission may start on a new map."""
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
        self._last_tick_s: float | None = None
        self._last_sample_s = -math.inf
        self._last_selection_s = -math.inf
        self._nothing_left_since_s: float | None = None

    def enter(self, substate: str) -> None:
        self._nothing_left_since_s = None
        self.request_first_readings()

    def leave(self) -> None:
        self.stop_motion()

    def stop_motion(self) -> None:
        self._context.driver.stop()
        self._abandon_goal()
        self._last_tick_s = None  # time until the next tick does not count as exploring

    def _abandon_goal(self) -> None:
        if self._goal is not None:
            self._explorer.record_abandonment(self._goal)
            self._goal = None

    def record_camera_pose(self) -> None:
        """Record the camera's pose. Called in EXPLORING, paused or not."""
        now = self._context.now_s
        elapsed = now - self._last_sample_s
        if elapsed < SAMPLE_EVERY_S:
            return
        self._last_sample_s = now
        robot = self._context.ports.map_source.robot_pose()
        if robot is not None:
            self._explorer.note_pose(robot, min(elapsed, 2.0 * SAMPLE_EVERY_S))

    def tick(self) -> None:
        context, config, now = self._context, self._context.config, self._context.now_s
        assert context.mission is not None and context.mission.exploration is not None, "EXPLORING needs an exploration"
        if self._last_tick_s is not None:
            self._explored_s += now - self._last_tick_s
        self._last_tick_s = now
        if context.mission.exploration.is_complete:
            context.fire("tags_discovered")
        elif self._explored_s >= config.exploration_timeout_s:
            context.last_error = "exploration_timeout"
            context.fire("no_frontiers")
        elif context.driver.busy:
            self._check_goal(now)
        elif now - self._last_selection_s >= SELECT_EVERY_S:
            self._last_selection_s = now
            self._select_goal(now)

    def _check_goal(self, now: float) -> None:
        """Give up a goal that takes too long or no longer shows anything new."""
        newest = self._context.ports.map_source.map()
        if self._goal is None or newest is None:
            return
        if self._context.driver.age_s >= self._context.config.nav_timeout_s:
            self._context.driver.stop()
            self._on_failure("nav_timeout")
        elif now - self._last_selection_s >= SELECT_EVERY_S:
            self._last_selection_s = now
            if not self._explorer.is_useful(self._goal, newest[1]):
                self._context.driver.stop()
                self._abandon_goal()
                self._select_goal(now)

    def _select_goal(self, now: float) -> None:
        context = self._context
        newest = context.ports.map_source.map()
        if newest is None or not context.world_model.has_pose or not context.ports.navigation.is_ready():
            self._nothing_left_since_s = None
            return
        number, grid = newest
        goal = self._explorer.choose(grid, number, context.ports.map_source.robot_pose(), now)
        if goal is None:
            self._on_nothing_left(now)
            return
        self._nothing_left_since_s = None
        self._goal = goal
        context.ports.publisher.log(f"{goal.kind}: to ({goal.pose.x:.2f}, {goal.pose.y:.2f})")
        context.driver.drive(goal.pose, self._on_drive_end)

    def _on_nothing_left(self, now: float) -> None:
        """End the exploration once nothing has been left for a while, since the map lags behind the robot."""
        if self._nothing_left_since_s is None:
            self._nothing_left_since_s = now
            return
        if now - self._nothing_left_since_s < self._context.config.exploration_exhausted_s:
            return
        exploration = self._context.mission.exploration if self._context.mission is not None else None
        if exploration is not None and not exploration.seeks_all_tags:
            self._context.last_error = f"exploration_exhausted: {exploration.discovered} of {exploration.goal} tags"
        self._context.ports.publisher.log("nothing is left to explore")
        self._context.fire("no_frontiers")

    def _on_drive_end(self, result: DriveResult) -> None:
        if self._goal is None:
            return
        if result.end == "succeeded":
            self._explorer.record_arrival(self._goal, self._map_number())
            if self._goal.kind == "viewpoint":
                self._last_selection_s = self._context.now_s  # stay until the camera has looked
            self._goal = None
        elif result.end in ("canceled", "lost", "sensors_lost"):
            if result.end == "sensors_lost":
                self._context.last_error = result.detail
            self._last_selection_s = self._context.now_s
            self._abandon_goal()
        else:
            self._on_failure(result.detail)

    def _on_failure(self, detail: str) -> None:
        self._context.last_error = detail
        if self._goal is not None:
            goal, self._goal = self._goal, None
            self._context.ports.publisher.log(f"{goal.kind} at ({goal.pose.x:.2f}, {goal.pose.y:.2f}): {detail}", warning=True)
            self._explorer.record_failure(goal, self._map_number(), self._context.now_s)

    def _map_number(self) -> int:
        newest = self._context.ports.map_source.map()
        return newest[0] if newest is not None else 0

    # -- the first reading of each tag ---------------------------------------------------------------------------------

    def request_first_readings(self) -> None:
        """Request a reading of every discovered tag for which this mission has not requested one yet."""
        context, mission = self._context, self._context.mission
        if mission is None or not context.config.seed_climate_on_discovery or not context.ports.climate_bridge.is_ready():
            return
        for tag_id in context.world_model.discovered.keys() - mission.requested_tags:
            mission.requested_tags.add(tag_id)
            context.ports.climate_bridge.read(tag_id, partial(self._on_first_reading, mission, tag_id))

    def _on_first_reading(self, mission: ActiveMission, tag_id: str, reply: ClimateReading) -> None:
        if mission is self._context.mission and reply.status == 0:
            self._context.publish_observation(EXPLORATION, tag_id, OK, "", reply)
