"""Inputs in random order: nothing raises, nothing moves while the mission is blocked, and the counters add up."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from lupin_runtime.mission.hsm_spec import RETURNING, build_hsm_spec
from tests.support.mission_rig import Rig

TAGS = ("0", "1", "2")
EXAMPLES = 60
LEAVES = [leaf for leaf in build_hsm_spec().leaves() if leaf != "BOOT"]


def bring_to(rig: Rig, leaf_state: str) -> None:
    """Bring the mission from READY to a leaf state, where the random inputs start."""
    lifecycle, _, leaf = leaf_state.partition(".")
    rig.climate_bridge.replies = rig.confirmer.replies = False
    if lifecycle == "READY":
        return
    if lifecycle in ("PREPARE", "FAULT"):
        rig.localize(9.0)
    assert rig.requests.start("ExplorationMission" if lifecycle in ("EXPLORING", "MONITORING") else "", (), 2).success
    rig.step(20.0 if lifecycle == "FAULT" else 1.5)
    if lifecycle == "MONITORING":
        rig.discover("1", "2")
        rig.step(4.5)  # longer than a goal waits for the end of one that was never accepted
    if leaf in ("SCANNING", "PUBLISHING"):
        rig.arrive()
    if leaf == "PUBLISHING" and lifecycle == "INSPECTING":
        rig.requests.pause()
        rig.requests.skip_current()
    elif leaf == "PUBLISHING":  # monitoring stays here only if a pause comes at exactly this moment
        rig.requests.pause()
        rig.orchestrator.hsm.fire("scan_done")
    if lifecycle in ("RETURNING", "DONE"):
        rig.requests.abort()
        rig.step(1.5)
    if lifecycle == "DONE":
        rig.requests.abort()
    assert rig.state == leaf_state


@pytest.mark.parametrize("leaf_state", LEAVES)
def test_any_order_of_inputs_keeps_invariants(make_rig: type[Rig], leaf_state: str) -> None:
    class RandomInputs(RuleBasedStateMachine):
        @initialize(
            accepts=st.booleans(),
            confirm=st.booleans(),
            patrol=st.booleans(),
            rounds=st.integers(0, 2),
            dwell=st.sampled_from([0.0, 2.0]),
        )
        def build(self, accepts: bool, confirm: bool, patrol: bool, rounds: int, dwell: float) -> None:
            self.rig = make_rig(
                ready=False,
                require_visual_confirmation=confirm,
                arm_patrol_enabled=patrol,
                arm_travel_settle_s=1.0,
                monitoring_sweeps=rounds,
                flower_scan_dwell_s=dwell,
                nav_timeout_s=8.0,
                dock_timeout_s=8.0,
                exploration_timeout_s=40.0,
                coverage_enabled=False,
            )
            self.rig.show_map()
            self.rig.localize()
            self.rig.step()
            self.rig.navigation.answers_goals = accepts
            bring_to(self.rig, leaf_state)
            self.may_move = True
            self.sent_before = 0
            self.arm_moves_before = 0

        # -- topics and servers

        @rule(engaged=st.booleans())
        def estop(self, engaged: bool) -> None:
            self.rig.orchestrator.on_estop(engaged)
            if engaged:
                self.may_move = False
                self.sent_before = len(self.rig.navigation.goals)
                self.arm_moves_before = len(self.rig.arm.moves)

        @rule(percentage=st.sampled_from([0.1, 0.9, 15.0, float("nan")]))
        def battery(self, percentage: float) -> None:
            self.rig.orchestrator.on_battery(percentage)

        @rule(variance=st.sampled_from([0.01, 0.01, 0.01, 0.9, float("nan")]))
        def localized(self, variance: float) -> None:
            self.rig.localize(variance)

        @rule(seconds=st.sampled_from([0.1, 0.1, 1.0, 5.0]))
        def time_passes(self, seconds: float) -> None:
            self.rig.step(seconds)

        @rule()
        def servers_recover_and_succeed(self) -> None:
            """Without this rule, random failures of the servers let few missions proceed."""
            rig = self.rig
            rig.navigation.ready = rig.navigation.answers_goals = rig.navigation.answers_cancels = True
            rig.climate_bridge.replies, rig.climate_bridge.status = True, 0
            rig.confirmer.replies = rig.confirmer.detected = True
            rig.climate_bridge.reply()
            rig.confirmer.reply()
            rig.localize()
            for goal in rig.navigation.open:
                if not goal.accepted:
                    rig.navigation.accept(goal)
            for goal in rig.navigation.open:
                rig.navigation.end(goal, 5 if goal.cancel_requests else 4)
            rig.step(1.2)

        @rule(tags=st.sets(st.sampled_from(TAGS)))
        def discovered(self, tags: set[str]) -> None:
            self.rig.discover(*tags)

        @rule(up=st.booleans())
        def navigation_server(self, up: bool) -> None:
            self.rig.navigation.ready = up

        @rule(answers=st.booleans(), acknowledges=st.booleans())
        def navigation_behavior(self, answers: bool, acknowledges: bool) -> None:
            self.rig.navigation.answers_goals, self.rig.navigation.answers_cancels = answers, acknowledges

        @rule(answers=st.booleans(), status=st.sampled_from([0, 0, 1]), detected=st.booleans())
        def service_behavior(self, answers: bool, status: int, detected: bool) -> None:
            rig = self.rig
            rig.climate_bridge.replies, rig.climate_bridge.status = answers, status
            rig.confirmer.replies, rig.confirmer.detected = answers, detected

        @rule()
        def late_answers(self) -> None:
            self.rig.climate_bridge.reply()
            self.rig.confirmer.reply()

        @rule(data=st.data(), status=st.sampled_from([4, 4, 4, 5, 6]))
        def goal_ends(self, data: st.DataObject, status: int) -> None:
            accepted = [goal for goal in self.rig.navigation.open if goal.accepted]
            if accepted:
                self.rig.navigation.end(data.draw(st.sampled_from(accepted)), status)

        @rule(data=st.data(), accept=st.booleans())
        def goal_is_answered(self, data: st.DataObject, accept: bool) -> None:
            waiting = [goal for goal in self.rig.navigation.open if not goal.accepted]
            if waiting:
                goal = data.draw(st.sampled_from(waiting))
                (self.rig.navigation.accept if accept else self.rig.navigation.reject)(goal)

        # -- requests

        @rule(
            kind=st.sampled_from(["", "InspectionMission", "ExplorationMission", "Nonsense"]),
            tags=st.lists(st.sampled_from(TAGS), unique=True),
            goal=st.sampled_from([0, 1, 3, 65535]),
        )
        def start(self, kind: str, tags: list[str], goal: int) -> None:
            if self.rig.requests.start(kind, tags, goal).success:
                assert not self.rig.snapshot.estop_engaged
                self.may_move = True

        @rule()
        def resume(self) -> None:
            if self.rig.requests.resume().success:
                assert not self.rig.snapshot.estop_engaged
                self.may_move = True

        @rule(request=st.sampled_from(["pause", "abort", "skip_current", "dock", "reset"]))
        def request(self, request: str) -> None:
            assert getattr(self.rig.requests, request)().message

        # -- invariants

        @invariant()
        def every_fired_trigger_is_declared(self) -> None:
            if hasattr(self, "rig"):
                assert self.rig.orchestrator.hsm.ignored == []

        @invariant()
        def no_goal_is_active_while_blocked(self) -> None:
            if hasattr(self, "rig") and self.rig.orchestrator.mission_runner.blocked:
                # A goal that is not accepted yet cannot be cancelled: this happens on acceptance.
                expected = [goal for goal in self.rig.navigation.driving if goal.accepted]
                assert expected == []

        @invariant()
        def nothing_moves_after_e_stop_without_resume_or_start(self) -> None:
            if hasattr(self, "rig") and not self.may_move:
                assert len(self.rig.navigation.goals) == self.sent_before
                assert len(self.rig.arm.moves) == self.arm_moves_before

        @invariant()
        def at_most_one_goal_is_wanted(self) -> None:
            if hasattr(self, "rig"):
                assert len([goal for goal in self.rig.navigation.driving if goal.accepted]) <= 1

        @invariant()
        def snapshot_is_consistent(self) -> None:
            if not hasattr(self, "rig"):
                return
            s = self.rig.snapshot
            assert s.lifecycle_state == self.rig.state.split(".")[0]
            assert all(0 <= n <= 65535 for n in (s.targets_total, s.targets_completed, s.targets_failed))
            if s.mission_type == "InspectionMission":
                closed = s.targets_completed + s.targets_failed + s.targets_unreachable + s.targets_skipped
                assert closed <= s.targets_total
                assert s.tags_discovered == s.discovery_goal == 0
                mine = [r for r in self.rig.publisher.records if r.mission_id == s.mission_id]
                assert len(mine) == closed
                assert len({r.tag_id for r in mine}) == closed
                if s.lifecycle_state == "DONE" and closed != s.targets_total:
                    raise AssertionError("an inspection ended with tags that were not closed")
            if s.lifecycle_state in ("BOOT", "READY", "DONE", "FAULT"):
                assert s.current_target == ""
            if s.battery_low and s.lifecycle_state != RETURNING:
                assert self.rig.orchestrator.mission_runner.blocked

    # Each state is a start of its own, because random inputs alone reach some of them rarely.
    run_state_machine_as_test(
        RandomInputs,
        settings=settings(
            max_examples=EXAMPLES,
            stateful_step_count=50,
            suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
        ),
    )
