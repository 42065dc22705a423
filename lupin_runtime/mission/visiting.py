"""A leg of INSPECTING or MONITORING: drive to a tag, look at it, read it, say so."""

from __future__ import annotations

from dataclasses import dataclass, field

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.approach import (
    Approach,
    Clearance,
    compute_approach,
    compute_discovered_approach,
    fit_approach,
)
from lupin_runtime.mission.context import INSPECTION, Context
from lupin_runtime.mission.driving import BLIND_WAIT_S, MAX_BLIND, Outcome
from lupin_runtime.mission.hsm import NAVIGATING, PUBLISHING, SCANNING, Trigger
from lupin_runtime.mission.missions import OK, SCAN_FAILED, SKIPPED, UNREACHABLE, TagWalk
from lupin_runtime.mission.ports import Confirmation, Reading

MAX_REFUNDS = 3  # goals that somebody else cancelled, or that went down with their server
FOREIGN_CANCEL_WAIT_S = 1.0  # a console cancels a moment before its e-stop arrives here


@dataclass
class _Visit:
    """One visit to a tag; `tag_id` None when nothing is left to visit."""

    tag_id: str | None
    attempts: int = 0
    refunds: int = 0
    blind: int = 0
    tried: list[tuple[float, float]] = field(default_factory=list)
    detail: str = ""
    not_before_s: float = 0.0
    unready_since_s: float | None = None
    arm_struck: bool = False
    confirm_asked_s: float | None = None
    confirmation: Confirmation | None = None
    read_asked_s: float | None = None
    reading: Reading | None = None
    status: int = OK
    closed: bool = False


class Visiting:
    """Walks the run's tags; one instance serves both families, since they differ in their walk alone."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._visit = _Visit(None)
        self._leaf = ""
        self._step = {NAVIGATING: self._navigate, SCANNING: self._scan, PUBLISHING: self._advance}

    @property
    def target(self) -> str:
        """The tag being visited, "" for none."""
        return self._visit.tag_id or ""

    @property
    def confirming(self) -> bool:
        """Whether the visual gate is being waited for."""
        visit = self._visit
        return self._leaf == SCANNING and visit.confirm_asked_s is not None and visit.confirmation is None

    def enter(self, leaf: str) -> None:
        """A state of the family begins."""
        self._leaf = leaf
        if leaf == NAVIGATING:
            walk = self._walk
            self._visit = _Visit(None if walk.is_complete else walk.current)
        elif leaf == PUBLISHING:
            self._publish()

    def leave(self) -> None:
        """The family is left."""
        self._context.driver.stop()
        self._leaf = ""
        self._visit = _Visit(None)

    def hold(self) -> None:
        """Stop moving; what is done stays done, and a goal that was cut short was no attempt."""
        if self._context.driver.busy:
            self._context.driver.stop()
            self._refund()

    def tick(self) -> None:
        """Go on; never called while blocked."""
        self._step[self._leaf]()

    def skip(self) -> bool:
        """Close the current tag as skipped; False if it is closed already."""
        if self._visit.closed or self._visit.tag_id is None:
            return False
        self._context.driver.stop()
        self._close(SKIPPED, "skipped_by_operator")
        return True

    # -- driving there -------------------------------------------------------------------------------------------------

    @property
    def _walk(self) -> TagWalk:
        run = self._context.run
        assert run is not None and run.walk is not None, "a family of visits is only entered with a walk"
        return run.walk

    def _navigate(self) -> None:
        context, visit, now = self._context, self._visit, self._context.now_s
        if visit.tag_id is None:  # resumed at a dock after the last tag: publishing decides what is next
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
        refusal = self._gate()
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
        context.ports.outlet.log(
            f"tag {visit.tag_id}: to ({approach.goal_x:.2f}, {approach.goal_y:.2f}), {approach.derived_from},"
            f" attempt {visit.attempts} of {context.config.nav_max_attempts}"
        )
        context.driver.drive(Pose2(approach.goal_x, approach.goal_y, approach.goal_yaw), self._arrived)

    def _wait_for_navigation(self, now: float) -> None:
        visit = self._visit
        if visit.unready_since_s is None:
            visit.unready_since_s = now
        elif now - visit.unready_since_s >= self._context.config.nav_timeout_s:
            visit.unready_since_s = None
            visit.attempts += 1
            visit.tried.append((float("nan"), float("nan")))
            self._attempt_failed("nav_unavailable")

    def _gate(self) -> str:
        """Why no goal may be sent now, "" if one may."""
        beliefs, run = self._context.beliefs, self._context.run
        if run is not None and run.kind == INSPECTION:
            if beliefs.covariance is None:
                return "amcl_drift_var=unknown"
            if beliefs.covariance > self._context.config.nav_localization_cov_threshold:
                return f"amcl_drift_var={beliefs.covariance:.4f}"
            return ""
        # Where SLAM localizes, nobody measures a drift: that somebody vouches for a pose at all is what can be asked.
        return "" if beliefs.has_pose else "no_pose"

    def _approach(self, tag_id: str) -> Approach | None:
        context, config = self._context, self._context.config
        seen = context.beliefs.discovered.get(tag_id)
        override = context.overrides.get(tag_id)
        robot = context.ports.world.robot_pose()
        if seen is not None:  # newest first: every sighting on the way has made its pose better
            tag_xy = (seen.x, seen.y)
            robot_xy = (robot.x, robot.y) if robot is not None else None
            approach = compute_discovered_approach(
                tag_id, seen, robot_xy, config.approach_standoff_m, config.approach_yaw, override
            )
        elif tag_id in context.layout.tags:
            tag_xy = (context.layout.tags[tag_id].x, context.layout.tags[tag_id].y)
            approach = compute_approach(tag_id, context.layout, config.approach_standoff_m, config.approach_yaw, override)
        else:
            return None
        newest = context.ports.world.map()
        if newest is None or config.approach_room_m <= 0.0:
            return approach
        clearance = Clearance.of(newest[1], config.frontier_free_thresh, config.frontier_occupied_thresh)
        return fit_approach(approach, tag_xy, clearance, config.approach_room_m, tuple(self._visit.tried))

    def _arrived(self, outcome: Outcome) -> None:
        if outcome.end == "succeeded":
            self._context.fire("nav_succeeded")
        elif outcome.end in ("canceled", "lost") and self._visit.refunds < MAX_REFUNDS:
            self._refund()
            self._visit.refunds += 1
            self._visit.not_before_s = self._context.now_s + FOREIGN_CANCEL_WAIT_S
        elif outcome.end == "blind" and self._visit.blind < MAX_BLIND:
            self._attempt_failed(outcome.detail)
            self._refund()
            self._visit.blind += 1
            self._visit.not_before_s = self._context.now_s + BLIND_WAIT_S
        else:
            self._attempt_failed(outcome.detail)

    def _refund(self) -> None:
        if self._leaf == NAVIGATING and self._visit.attempts > 0:
            self._visit.attempts -= 1
            self._visit.tried.pop()

    def _attempt_failed(self, detail: str) -> None:
        self._visit.detail = detail
        self._context.note(detail)
        self._context.ports.outlet.log(f"tag {self._visit.tag_id}: {detail}", warning=True)

    # -- looking and reading -------------------------------------------------------------------------------------------

    def _scan(self) -> None:
        context, visit, config = self._context, self._visit, self._context.config
        assert visit.tag_id is not None, "only a tag is scanned"
        if not visit.arm_struck:
            visit.arm_struck = True
            context.driver.strike(config.arm_inspect_preset)
        if config.require_visual_confirmation and not self._is_confirmed(visit, visit.tag_id):
            return
        if visit.read_asked_s is None:
            visit.read_asked_s = context.now_s
            context.ports.greenhouse.read(visit.tag_id, lambda reading: self._read(visit, reading))
        elif visit.reading is None:
            if context.now_s - visit.read_asked_s >= config.scan_timeout_s:
                self._close(SCAN_FAILED, "scan_timeout")
        elif visit.reading.status != 0:
            self._close(SCAN_FAILED, visit.reading.error or f"bridge_status_{visit.reading.status}")
        elif context.now_s - visit.read_asked_s >= config.flower_scan_dwell_s:
            self._close(OK, "")

    def _is_confirmed(self, visit: _Visit, tag_id: str) -> bool:
        context = self._context
        if visit.confirm_asked_s is None:
            visit.confirm_asked_s = context.now_s
            context.ports.gate.confirm(tag_id, lambda answer: self._confirmed(visit, answer))
            context.ports.outlet.changed()
        elif visit.confirmation is None:
            if context.now_s - visit.confirm_asked_s >= context.config.visual_confirmation_timeout_s:
                self._close(SCAN_FAILED, "confirm_timeout")
        elif visit.confirmation.detected:
            return True
        else:
            self._close(SCAN_FAILED, visit.confirmation.error or "visual_confirm_missed")
        return False

    # Answers are kept also while paused, and acted on later: what is done need not be done again.

    def _confirmed(self, visit: _Visit, answer: Confirmation) -> None:
        if visit is self._visit and not visit.closed:
            visit.confirmation = answer

    def _read(self, visit: _Visit, reading: Reading) -> None:
        if visit is self._visit and not visit.closed:
            visit.reading = reading

    # -- closing -------------------------------------------------------------------------------------------------------

    def _close(self, status: int, detail: str) -> None:
        self._visit.status, self._visit.detail = status, detail
        if status == SCAN_FAILED:
            self._context.note(f"scan_failed: {detail}")
        elif status == UNREACHABLE:
            self._context.note(detail)
        trigger: Trigger = "nav_unreachable" if self._leaf == NAVIGATING else "scan_done"
        self._context.fire(trigger)

    def _publish(self) -> None:
        visit = self._visit
        if visit.tag_id is None or visit.closed:
            return
        visit.closed = True
        reading = visit.reading if visit.status == OK else None
        self._context.observe(self._walk.source, visit.tag_id, visit.status, visit.detail, reading)
        self._walk.close(visit.status)

    def _advance(self) -> None:
        self._context.fire("inspection_complete" if self._walk.is_complete else "next_tag")
