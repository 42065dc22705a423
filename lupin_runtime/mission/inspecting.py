"""INSPECTING and MONITORING: drive to each tag, confirm it, read it, publish the result."""

from __future__ import annotations

from dataclasses import dataclass, field

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.activity import Activity
from lupin_runtime.mission.approach import Approach, compute_approach, compute_discovered_approach
from lupin_runtime.mission.approach_fitting import fit_approach
from lupin_runtime.mission.clearance import ClearanceMap
from lupin_runtime.mission.context import INSPECTION, Context
from lupin_runtime.mission.driving import MAX_SENSOR_LOSSES, SENSORS_LOST_WAIT_S
from lupin_runtime.mission.goal_runner import DriveResult
from lupin_runtime.mission.hsm_spec import NAVIGATING, PUBLISHING, SCANNING, Trigger
from lupin_runtime.mission.missions import OK, SCAN_FAILED, SKIPPED, UNREACHABLE, VisitPlan
from lupin_runtime.mission.records import ClimateReading, Confirmation

MAX_REFUNDS = 3  # per visit: attempts that do not count, since another client cancelled them or the server disappeared
FOREIGN_CANCEL_WAIT_S = 1.0  # a console cancels the goal a moment before its e-stop is received
REVISIT_FAILED_S = 10.0  # from a visit without a reading to the next of the same tag: a refused goal takes no time at all


@dataclass
class _Visit:
    """One visit to a tag. `tag_id` is None when nothing is left to visit; `tried` are the goals (x, y) of past attempts.

    It is `closed` once its result is published and recorded in `plan`. A read tag stays in SCANNING until the dwell ends.
    """

    tag_id: str | None
    plan: VisitPlan | None = None
    attempts: int = 0
    refunds: int = 0
    sensor_losses: int = 0
    tried: list[tuple[float, float]] = field(default_factory=list)
    detail: str = ""
    not_before_s: float = 0.0
    unready_since_s: float | None = None
    arm_moved: bool = False
    confirm_sent_s: float | None = None
    confirmation: Confirmation | None = None
    read_sent_s: float | None = None
    reading: ClimateReading | None = None
    status: int = OK
    closed: bool = False


class Inspecting(Activity):
    """Visits the tags of the mission's plan. One instance serves both states, which differ only in their plan."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._visit = _Visit(None)
        self._failed_at_s: dict[str | None, float] = {}  # when the last visit to a tag ended, if it ended without a reading
        self._substate = ""
        self._tick_substate = {NAVIGATING: self._navigate, SCANNING: self._scan, PUBLISHING: self._advance}

    @property
    def target(self) -> str:
        """The tag being visited; "" if none."""
        return self._visit.tag_id or ""

    @property
    def confirming(self) -> bool:
        """Whether the visit waits for the visual confirmation."""
        visit = self._visit
        return self._substate == SCANNING and visit.confirm_sent_s is not None and visit.confirmation is None

    def enter(self, substate: str) -> None:
        self._substate = substate
        if substate == NAVIGATING:
            self._begin_visit(self._plan)
        elif substate == PUBLISHING:
            self._publish(self._visit)

    def _begin_visit(self, plan: VisitPlan) -> None:
        tag_id = None if plan.is_complete else plan.current
        self._visit = _Visit(tag_id, plan)
        if tag_id in self._failed_at_s:
            self._visit.not_before_s = self._failed_at_s[tag_id] + REVISIT_FAILED_S

    def leave(self) -> None:
        self._context.driver.stop()
        self._substate = ""
        self._visit = _Visit(None)
        self._failed_at_s.clear()

    def stop_motion(self) -> None:
        """Stop moving. Completed steps of the visit stay completed; an interrupted drive does not count as an attempt.

        The arm's move to its inspection pose is repeated, because the e-stop may have interrupted it.
        """
        self._visit.arm_moved = False
        if self._context.driver.busy:
            self._context.driver.stop()
            self._refund_attempt()

    def tick(self) -> None:
        self._tick_substate[self._substate]()

    def skip(self) -> bool:
        """Close the visit to the current tag as skipped; return False if it is already closed."""
        if self._visit.closed or self._visit.tag_id is None:
            return False
        self._context.driver.stop()
        self._close(SKIPPED, "skipped_by_operator")
        return True

    # -- navigating ----------------------------------------------------------------------------------------------------

    @property
    def _plan(self) -> VisitPlan:
        mission = self._context.mission
        assert mission is not None and mission.visits is not None, "INSPECTING and MONITORING need a plan of visits"
        return mission.visits

    def _navigate(self) -> None:
        context, visit, now = self._context, self._visit, self._context.now_s
        if visit.tag_id is None:  # resumed at the dock after the last tag: PUBLISHING decides what comes next
            context.fire("nav_unreachable")
            return
        if context.driver.busy:
            if context.driver.age_s >= context.config.nav_timeout_s:
                context.driver.stop()
                self._attempt_failed("nav_timeout")
            return
        if now < visit.not_before_s:
            return
        if visit.attempts >= context.config.nav_max_attempts:
            self._close(UNREACHABLE, visit.detail)
            return
        refusal = self._navigation_refusal()
        if refusal:
            self._close(UNREACHABLE, refusal)
            return
        if not context.ports.navigation.is_ready():
            self._wait_for_navigation(now)
            return
        approach = self._approach(visit.tag_id)
        if approach is None:
            self._close(UNREACHABLE, "unknown_tag")
            return
        visit.unready_since_s = None
        visit.attempts += 1
        visit.tried.append((approach.goal_x, approach.goal_y))
        context.ports.publisher.log(
            f"tag {visit.tag_id}: to ({approach.goal_x:.2f}, {approach.goal_y:.2f}), {approach.derived_from},"
            f" attempt {visit.attempts} of {context.config.nav_max_attempts}"
        )
        context.driver.drive(Pose2(approach.goal_x, approach.goal_y, approach.goal_yaw), self._on_drive_end)

    def _wait_for_navigation(self, now: float) -> None:
        visit = self._visit
        if visit.unready_since_s is None:
            visit.unready_since_s = now
        elif now - visit.unready_since_s >= self._context.config.nav_timeout_s:
            visit.unready_since_s = None
            visit.attempts += 1
            visit.tried.append((float("nan"), float("nan")))
            self._attempt_failed("nav_unavailable")

    def _navigation_refusal(self) -> str:
        """Return why no goal may be sent now; "" if one may."""
        world_model, mission = self._context.world_model, self._context.mission
        if mission is not None and mission.kind == INSPECTION:
            if world_model.largest_variance is None:
                return "amcl_drift_var=unknown"
            if world_model.largest_variance > self._context.config.nav_localization_cov_threshold:
                return f"amcl_drift_var={world_model.largest_variance:.4f}"
            return ""
        # SLAM's pose has no measured drift: the only requirement is that a pose was received.
        return "" if world_model.has_pose else "no_pose"

    def _approach(self, tag_id: str) -> Approach | None:
        context, config = self._context, self._context.config
        discovered = context.world_model.discovered.get(tag_id)
        override = context.overrides.get(tag_id)
        robot = context.ports.map_source.robot_pose()
        if discovered is not None:  # preferred: its pose has improved with every sighting on the way
            tag_xy = (discovered.x, discovered.y)
            robot_xy = (robot.x, robot.y) if robot is not None else None
            approach = compute_discovered_approach(
                tag_id, discovered, robot_xy, config.approach_standoff_m, config.approach_yaw, override
            )
        elif tag_id in context.layout.tags:
            tag_xy = (context.layout.tags[tag_id].x, context.layout.tags[tag_id].y)
            approach = compute_approach(tag_id, context.layout, config.approach_standoff_m, config.approach_yaw, override)
        else:
            return None
        newest = context.ports.map_source.map()
        if newest is None or config.approach_room_m <= 0.0:
            return approach
        clearance = ClearanceMap.from_grid(newest[1], config.frontier_free_thresh, config.frontier_occupied_thresh)
        return fit_approach(approach, tag_xy, clearance, config.approach_room_m, tuple(self._visit.tried))

    def _on_drive_end(self, result: DriveResult) -> None:
        if result.end == "succeeded":
            self._context.fire("nav_succeeded")
        elif result.end in ("canceled", "lost") and self._visit.refunds < MAX_REFUNDS:
            self._refund_attempt()
            self._visit.refunds += 1
            self._visit.not_before_s = self._context.now_s + FOREIGN_CANCEL_WAIT_S
        elif result.end == "sensors_lost" and self._visit.sensor_losses < MAX_SENSOR_LOSSES:
            self._attempt_failed(result.detail)
            self._refund_attempt()
            self._visit.sensor_losses += 1
            self._visit.not_before_s = self._context.now_s + SENSORS_LOST_WAIT_S
        else:
            self._attempt_failed(result.detail)

    def _refund_attempt(self) -> None:
        if self._substate == NAVIGATING and self._visit.attempts > 0:
            self._visit.attempts -= 1
            self._visit.tried.pop()

    def _attempt_failed(self, detail: str) -> None:
        self._visit.detail = detail
        self._context.last_error = detail
        self._context.ports.publisher.log(f"tag {self._visit.tag_id}: {detail}", warning=True)

    # -- scanning ------------------------------------------------------------------------------------------------------

    def _scan(self) -> None:
        context, visit, config = self._context, self._visit, self._context.config
        assert visit.tag_id is not None, "SCANNING needs a tag"
        if not visit.arm_moved:
            visit.arm_moved = True
            context.driver.move_arm(config.arm_inspect_preset)
        if config.require_visual_confirmation and not self._is_confirmed(visit, visit.tag_id):
            return
        if visit.read_sent_s is None:
            visit.read_sent_s = context.now_s
            context.ports.climate_bridge.read(visit.tag_id, lambda reply: self._on_reading(visit, reply))
        elif visit.reading is None:
            if context.now_s - visit.read_sent_s >= config.scan_timeout_s:
                self._close(SCAN_FAILED, "scan_timeout")
        elif visit.reading.status != 0:
            self._close(SCAN_FAILED, visit.reading.error or f"bridge_status_{visit.reading.status}")
        elif context.now_s - visit.read_sent_s >= config.flower_scan_dwell_s:
            self._close(OK, "")

    def _is_confirmed(self, visit: _Visit, tag_id: str) -> bool:
        context = self._context
        if visit.confirm_sent_s is None:
            visit.confirm_sent_s = context.now_s
            context.ports.confirmer.confirm(tag_id, lambda answer: self._on_confirmation(visit, answer))
            context.ports.publisher.state_changed()
        elif visit.confirmation is None:
            if context.now_s - visit.confirm_sent_s >= context.config.visual_confirmation_timeout_s:
                self._close(SCAN_FAILED, "confirm_timeout")
        elif visit.confirmation.detected:
            return True
        else:
            self._close(SCAN_FAILED, visit.confirmation.error or "visual_confirm_missed")
        return False

    # Answers that arrive while the mission is paused are stored and used after the resume, so nothing is requested twice.

    def _on_confirmation(self, visit: _Visit, answer: Confirmation) -> None:
        if visit is self._visit and not visit.closed:
            visit.confirmation = answer

    def _on_reading(self, visit: _Visit, reply: ClimateReading) -> None:
        """Publish a reading at once, also during a pause and on the way to the dock: what ends the dwell must not lose it."""
        mission = self._context.mission
        if visit.closed or mission is None or mission.visits is not visit.plan:
            return
        if visit is self._visit:
            visit.reading = reply
        # The robot was sent to the dock before the reply came: the tag is still the next one, unless it was skipped.
        interrupted = self._visit.tag_id is None and not self._plan.is_complete and self._plan.current == visit.tag_id
        if reply.status == 0 and (visit is self._visit or interrupted):
            visit.reading, visit.status, visit.detail = reply, OK, ""
            self._publish(visit)

    # -- publishing ----------------------------------------------------------------------------------------------------

    def _close(self, status: int, detail: str) -> None:
        visit = self._visit
        visit.status, visit.detail = status, detail
        self._failed_at_s.pop(visit.tag_id, None)
        if status in (SCAN_FAILED, UNREACHABLE):
            self._failed_at_s[visit.tag_id] = self._context.now_s
            self._context.last_error = f"scan_failed: {detail}" if status == SCAN_FAILED else detail
        trigger: Trigger = "nav_unreachable" if self._substate == NAVIGATING else "scan_done"
        self._context.fire(trigger)

    def _publish(self, visit: _Visit) -> None:
        if visit.tag_id is None or visit.closed:
            return
        visit.closed = True
        reading = visit.reading if visit.status == OK else None
        self._context.publish_observation(self._plan.source, visit.tag_id, visit.status, visit.detail, reading)
        self._plan.record(visit.status)

    def _advance(self) -> None:
        self._context.fire("inspection_complete" if self._plan.is_complete else "next_tag")
