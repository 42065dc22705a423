"""Whatever happens in whatever order: nothing raises, nothing moves while blocked, and the counters add up."""

from __future__ import annotations

from collections import Counter

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from lupin_runtime.mission.hsm import RETURNING, build_hsm_spec

TAGS = ("0", "1", "2")
PLACES = [leaf for leaf in build_hsm_spec().leaves() if leaf != "BOOT"]


def bring_to(rig, place):
    """The shortest way from READY to a leaf state; the search goes on from there."""
    family, _, leaf = place.partition(".")
    rig.greenhouse.answers = rig.gate.answers = False
    if family == "READY":
        return
    if family in ("PREPARE", "FAULT"):
        rig.localize(9.0)
    assert rig.orchestrator.start("ExplorationMission" if family in ("EXPLORING", "MONITORING") else "", (), 2).success
    rig.step(20.0 if family == "FAULT" else 1.5)
    if family == "MONITORING":
        rig.discover("1", "2")
        rig.step(4.5)  # as long as a goal may wait for one that was never accepted
    if leaf in ("SCANNING", "PUBLISHING"):
        rig.arrive()
    if leaf == "PUBLISHING" and family == "INSPECTING":
        rig.orchestrator.pause()
        rig.orchestrator.skip_current()
    elif leaf == "PUBLISHING":  # a sweep is held there only if a pause hits the very moment
        rig.orchestrator.pause()
        rig.orchestrator.hsm.fire("scan_done")
    if family in ("RETURNING", "DONE"):
        rig.orchestrator.abort()
        rig.step(1.5)
    if family == "DONE":
        rig.orchestrator.abort()
    assert rig.state == place


def test_no_order_of_events_raises_moves_a_stopped_robot_or_miscounts(make_rig):
    seen: Counter[str] = Counter()

    class Anything(RuleBasedStateMachine):
        @initialize(
            place=st.sampled_from(PLACES),
            accepts=st.booleans(),
            gate=st.booleans(),
            patrol=st.booleans(),
            sweeps=st.integers(0, 2),
            dwell=st.sampled_from([0.0, 2.0]),
        )
        def build(self, place, accepts, gate, patrol, sweeps, dwell):
            self.rig = make_rig(
                booted=False,
                require_visual_confirmation=gate,
                arm_patrol_enabled=patrol,
                arm_travel_settle_s=1.0,
                monitoring_sweeps=sweeps,
                flower_scan_dwell_s=dwell,
                nav_timeout_s=8.0,
                dock_timeout_s=8.0,
                exploration_timeout_s=40.0,
                coverage_enabled=False,
            )
            self.rig.show_map()
            self.rig.localize()
            self.rig.step()
            self.rig.navigation.answers = accepts
            bring_to(self.rig, place)
            self.may_move = True
            self.sent_before = 0
            self.struck_before = 0

        # -- the world

        @rule(engaged=st.booleans())
        def estop(self, engaged):
            self.rig.orchestrator.heard_estop(engaged)
            if engaged:
                self.may_move = False
                self.sent_before = len(self.rig.navigation.goals)
                self.struck_before = len(self.rig.arm.struck)

        @rule(percentage=st.sampled_from([0.1, 0.9, 15.0, float("nan")]))
        def battery(self, percentage):
            self.rig.orchestrator.heard_battery(percentage)

        @rule(variance=st.sampled_from([0.01, 0.01, 0.01, 0.9, float("nan")]))
        def localized(self, variance):
            self.rig.localize(variance)

        @rule(seconds=st.sampled_from([0.1, 0.1, 1.0, 5.0]))
        def time_passes(self, seconds):
            self.rig.step(seconds)

        @rule()
        def all_goes_well(self):
            """Without this, random manners of the servers let few missions get far."""
            rig = self.rig
            rig.navigation.ready = rig.navigation.answers = rig.navigation.acknowledges = True
            rig.greenhouse.answers, rig.greenhouse.status = True, 0
            rig.gate.answers = rig.gate.detected = True
            rig.greenhouse.answer()
            rig.gate.answer()
            rig.localize()
            for goal in rig.navigation.open:
                if not goal.accepted:
                    rig.navigation.accept(goal)
            for goal in rig.navigation.open:
                rig.navigation.end(goal, 5 if goal.cancel_asked else 4)
            rig.step(1.2)

        @rule(tags=st.sets(st.sampled_from(TAGS)))
        def discovered(self, tags):
            self.rig.discover(*tags)

        @rule(up=st.booleans())
        def navigation_server(self, up):
            self.rig.navigation.ready = up

        @rule(answers=st.booleans(), acknowledges=st.booleans())
        def navigation_manners(self, answers, acknowledges):
            self.rig.navigation.answers, self.rig.navigation.acknowledges = answers, acknowledges

        @rule(answers=st.booleans(), status=st.sampled_from([0, 0, 1]), detected=st.booleans())
        def service_manners(self, answers, status, detected):
            rig = self.rig
            rig.greenhouse.answers, rig.greenhouse.status = answers, status
            rig.gate.answers, rig.gate.detected = answers, detected

        @rule()
        def late_answers(self):
            self.rig.greenhouse.answer()
            self.rig.gate.answer()

        @rule(data=st.data(), status=st.sampled_from([4, 4, 4, 5, 6]))
        def a_goal_ends(self, data, status):
            accepted = [goal for goal in self.rig.navigation.open if goal.accepted]
            if accepted:
                self.rig.navigation.end(data.draw(st.sampled_from(accepted)), status)

        @rule(data=st.data(), take=st.booleans())
        def a_goal_is_answered(self, data, take):
            waiting = [goal for goal in self.rig.navigation.open if not goal.accepted]
            if waiting:
                goal = data.draw(st.sampled_from(waiting))
                (self.rig.navigation.accept if take else self.rig.navigation.reject)(goal)

        # -- the operator

        @rule(
            kind=st.sampled_from(["", "InspectionMission", "ExplorationMission", "Nonsense"]),
            tags=st.lists(st.sampled_from(TAGS), unique=True),
            goal=st.sampled_from([0, 1, 3, 65535]),
        )
        def start(self, kind, tags, goal):
            if self.rig.orchestrator.start(kind, tags, goal).success:
                assert not self.rig.snapshot.estop_engaged
                self.may_move = True

        @rule()
        def resume(self):
            if self.rig.orchestrator.resume().success:
                assert not self.rig.snapshot.estop_engaged
                self.may_move = True

        @rule(request=st.sampled_from(["pause", "abort", "skip_current", "dock", "reset"]))
        def request(self, request):
            assert getattr(self.rig.orchestrator, request)().message

        # -- what always holds

        @invariant()
        def no_trigger_was_fired_where_it_is_not_declared(self):
            if hasattr(self, "rig"):
                seen[self.rig.state] += 1
                assert self.rig.orchestrator.hsm.ignored == []

        @invariant()
        def nothing_is_under_way_while_blocked(self):
            if hasattr(self, "rig") and self.rig.orchestrator.blocked:
                # A goal that is not accepted yet cannot be cancelled: it is on acceptance.
                wanted = [goal for goal in self.rig.navigation.wanted if goal.accepted]
                assert wanted == []

        @invariant()
        def after_an_e_stop_nothing_moves_without_a_resume_or_a_start(self):
            if hasattr(self, "rig") and not self.may_move:
                assert len(self.rig.navigation.goals) == self.sent_before
                assert len(self.rig.arm.struck) == self.struck_before

        @invariant()
        def at_most_one_goal_is_wanted(self):
            if hasattr(self, "rig"):
                assert len([goal for goal in self.rig.navigation.wanted if goal.accepted]) <= 1

        @invariant()
        def the_snapshot_is_consistent(self):
            if not hasattr(self, "rig"):
                return
            s = self.rig.snapshot
            assert s.lifecycle_state == self.rig.state.split(".")[0]
            assert all(0 <= n <= 65535 for n in (s.targets_total, s.targets_completed, s.targets_failed))
            if s.mission_type == "InspectionMission":
                closed = s.targets_completed + s.targets_failed + s.targets_unreachable + s.targets_skipped
                assert closed <= s.targets_total
                assert s.tags_discovered == s.discovery_goal == 0
                mine = [r for r in self.rig.outlet.records if r.mission_id == s.mission_id]
                assert len(mine) == closed
                assert len({r.tag_id for r in mine}) == closed
                if s.lifecycle_state == "DONE" and closed != s.targets_total:
                    raise AssertionError("an inspection ended with tags that nobody closed")
            if s.lifecycle_state in ("BOOT", "READY", "DONE", "FAULT"):
                assert s.current_target == ""
            if s.battery_low and s.lifecycle_state != RETURNING:
                assert self.rig.orchestrator.blocked

    run_state_machine_as_test(
        Anything,
        settings=settings(
            max_examples=250,
            stateful_step_count=50,
            deadline=None,
            suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
        ),
    )
    # A search that never gets anywhere proves nothing.
    assert {leaf for leaf in build_hsm_spec().leaves() if not seen[leaf]} <= {"BOOT"}
