"""Who may do what: one session has control, everybody may stop, and nothing bypasses the drive bus."""

from __future__ import annotations

import pytest

from lupin_runtime import graph
from lupin_runtime.console.authority import LEASE_SILENCE_S, REQUEST_S, Authority, Refused, Role, Session

SECOND = 1_000_000_000
ANNE, BEN = Session("anne", Role.OPERATOR), Session("ben", Role.OPERATOR)
VIEWER = Session("visitor", Role.VIEWER)


@pytest.fixture
def journal() -> list[str]:
    return []


@pytest.fixture
def authority(journal: list[str]) -> Authority:
    return Authority(journal.append)


def test_first_command_takes_free_control_and_others_are_refused(authority: Authority) -> None:
    authority.publish(ANNE, "/cmd_vel_manual", 0)
    assert authority.lease(0).holder == "anne"
    with pytest.raises(Refused, match="anne has had control for 3 s"):
        authority.call(BEN, "/mission/start", 3 * SECOND)
    authority.call(ANNE, "/mission/start", 3 * SECOND)


def test_control_is_taken_over_only_on_purpose_and_journalled(authority: Authority, journal: list[str]) -> None:
    authority.take(ANNE, 0)
    with pytest.raises(Refused):
        authority.take(BEN, SECOND)
    authority.take(BEN, SECOND, from_holder=True)
    assert authority.lease(SECOND).holder == "ben"
    assert journal == ["anne has control", "ben has control, taken from anne"]


def test_silent_holder_loses_control(authority: Authority) -> None:
    authority.take(ANNE, 0)
    authority.seen(ANNE, 4 * SECOND)
    assert authority.holds(ANNE, int((4 + LEASE_SILENCE_S) * SECOND))
    assert not authority.holds(ANNE, int((4.1 + LEASE_SILENCE_S) * SECOND))
    authority.take(BEN, int((4.1 + LEASE_SILENCE_S) * SECOND))


def test_viewer_looks_and_stops_but_moves_nothing(authority: Authority) -> None:
    authority.call(VIEWER, "/rosapi/topics", 0)
    authority.call(VIEWER, "/twin/get_field", 0)
    authority.call(VIEWER, "/navigate_to_pose/_action/cancel_goal", 0)
    authority.call(VIEWER, "/lupin/arm/library/stop", 0)
    with pytest.raises(Refused, match="visitor is a viewer"):
        authority.publish(VIEWER, "/cmd_vel_manual", 0)
    with pytest.raises(Refused, match="visitor is a viewer"):
        authority.call(VIEWER, "/mission/start", 0)
    with pytest.raises(Refused, match="visitor is a viewer"):
        authority.send_goal(VIEWER, "/navigate_to_pose", 0)
    assert authority.lease(0).holder is None


FORBIDDEN_TOPICS = [
    graph.CMD_VEL_SINK_ROBOT,
    graph.CMD_VEL_SINK_SIM,
    graph.CMD_VEL_AUTO,
    graph.CMD_VEL_NAV,
    graph.CMD_VEL_JOY,
    graph.ESTOP_STATE,
    graph.ESTOP_BUTTON,
    graph.ARM_TRAJECTORY,
    graph.TF,
    graph.CLOCK,
    graph.SIM_FAULT,
]


@pytest.mark.parametrize("unlisted", [False, True])
def test_nobody_bypasses_the_drive_bus_or_forges_the_estop(journal: list[str], unlisted: bool) -> None:
    authority = Authority(journal.append, unlisted=unlisted)
    for topic in FORBIDDEN_TOPICS:
        for name in (topic.name, topic.name.lstrip("/")):
            with pytest.raises(Refused, match="is not allowed to clients"):
                authority.publish(ANNE, name, 0)
            with pytest.raises(Refused):
                authority.advertise(name)
    for service in (graph.SWITCH_CONTROLLER, graph.VENDOR_TORQUE, graph.SIM_PRESS_ESTOP, graph.servo_set_angle("gripper")):
        with pytest.raises(Refused):
            authority.call(ANNE, service.name, 0)
    with pytest.raises(Refused):
        authority.send_goal(ANNE, graph.ARM_FOLLOW_TRAJECTORY.name, 0)


def test_what_the_table_lacks_is_refused_but_in_development(authority: Authority, journal: list[str]) -> None:
    with pytest.raises(Refused):
        authority.call(ANNE, "/io/motor/left_front/set_speed", 0)
    with pytest.raises(Refused):
        authority.provide("/greeting")
    development = Authority(journal.append, unlisted=True)
    development.publish(ANNE, "/chatter", 0)
    development.provide("/greeting")
    for name in ("/mission/start", "mission/start", "navigate_to_pose"):
        with pytest.raises(Refused):
            development.provide(name)


def test_parameters_are_read_by_all_and_written_by_nobody(authority: Authority) -> None:
    authority.call(VIEWER, "/rosapi/get_param", 0)
    with pytest.raises(Refused):
        authority.call(ANNE, "/rosapi/set_param", 0)


def test_holder_hands_control_over_to_one_who_asks(authority: Authority, journal: list[str]) -> None:
    changes: list[tuple[str | None, str | None]] = []
    authority.on_change(lambda: changes.append((authority.lease(0).holder, authority.lease(0).requester)))
    assert authority.request(ANNE, 0), "free"
    assert not authority.request(BEN, 0)
    assert not authority.request(BEN, 1), "asked once"
    with pytest.raises(Refused, match="ben does not have control"):
        authority.answer(BEN, True, 1)
    authority.answer(ANNE, False, 2)
    with pytest.raises(Refused, match="nobody asks"):
        authority.answer(ANNE, True, 3)
    assert not authority.request(BEN, 4)
    authority.answer(ANNE, True, 5)
    assert changes == [("anne", None), ("anne", "ben"), ("anne", None), ("anne", "ben"), ("ben", None)]
    assert journal[-1] == "anne handed control to ben"


def test_request_without_an_answer_is_refused_and_the_next_may_ask(authority: Authority) -> None:
    carol = Session("carol", Role.OPERATOR)
    authority.take(ANNE, 0)
    authority.request(BEN, 0)
    with pytest.raises(Refused, match="ben asks for control already"):
        authority.request(carol, 1)
    late_ns = int((REQUEST_S + 0.1) * SECOND)
    for second in range(1, 11):
        authority.seen(ANNE, second * SECOND)
    assert authority.lease(late_ns).requester is None
    assert not authority.request(carol, late_ns)


def test_viewer_may_not_ask_and_one_who_asks_gets_what_the_holder_leaves(authority: Authority) -> None:
    authority.take(ANNE, 0)
    with pytest.raises(Refused, match="visitor is a viewer"):
        authority.request(VIEWER, 0)
    authority.request(BEN, 0)
    authority.give_up(ANNE, 1)
    assert authority.lease(1).holder == "ben"
    authority.give_up(BEN, 2)
    assert authority.lease(2).holder is None


def test_one_who_asks_and_leaves_is_forgotten(authority: Authority) -> None:
    authority.take(ANNE, 0)
    authority.request(BEN, 0)
    authority.give_up(BEN, 1)
    assert authority.lease(1).requester is None
