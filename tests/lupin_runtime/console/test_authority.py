"""One session has control, everybody may stop, and no client bypasses the drive bus."""

from __future__ import annotations

import pytest

from lupin_runtime import graph
from lupin_runtime.console.authority import LEASE_TIMEOUT_S, REQUEST_TIMEOUT_S, Authority, Refused, Role, Session

SECOND = 1_000_000_000
ANNE, BEN = Session("anne", Role.OPERATOR), Session("ben", Role.OPERATOR)
VIEWER = Session("visitor", Role.VIEWER)


@pytest.fixture
def log() -> list[str]:
    return []


@pytest.fixture
def authority(log: list[str]) -> Authority:
    return Authority(lambda event: log.append(event.text))


def test_first_command_takes_control_and_others_are_refused(authority: Authority) -> None:
    authority.check_publish(ANNE, "/cmd_vel_manual", 0)
    assert authority.lease(0).holder == "anne"
    with pytest.raises(Refused, match="anne has had control for 3 s"):
        authority.check_call(BEN, "/mission/start", 3 * SECOND)
    authority.check_call(ANNE, "/mission/start", 3 * SECOND)


def test_control_is_taken_over_only_on_request_and_logged(authority: Authority, log: list[str]) -> None:
    authority.take(ANNE, 0)
    with pytest.raises(Refused):
        authority.take(BEN, SECOND)
    authority.take(BEN, SECOND, take_over=True)
    assert authority.lease(SECOND).holder == "ben"
    assert log == ["anne has control", "ben has control, taken from anne"]


def test_silent_holder_loses_control(authority: Authority) -> None:
    authority.take(ANNE, 0)
    authority.note_alive(ANNE, 4 * SECOND)
    assert authority.holds(ANNE, int((4 + LEASE_TIMEOUT_S) * SECOND))
    assert not authority.holds(ANNE, int((4.1 + LEASE_TIMEOUT_S) * SECOND))
    authority.take(BEN, int((4.1 + LEASE_TIMEOUT_S) * SECOND))


def test_viewer_may_watch_and_stop_but_not_move_anything(authority: Authority) -> None:
    authority.check_call(VIEWER, "/rosapi/topics", 0)
    authority.check_call(VIEWER, "/twin/get_field", 0)
    authority.check_call(VIEWER, "/navigate_to_pose/_action/cancel_goal", 0)
    authority.check_call(VIEWER, "/lupin/arm/library/stop", 0)
    with pytest.raises(Refused, match="visitor is a viewer"):
        authority.check_publish(VIEWER, "/cmd_vel_manual", 0)
    with pytest.raises(Refused, match="visitor is a viewer"):
        authority.check_call(VIEWER, "/mission/start", 0)
    with pytest.raises(Refused, match="visitor is a viewer"):
        authority.check_send_goal(VIEWER, "/navigate_to_pose", 0)
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


@pytest.mark.parametrize("allow_unlisted", [False, True])
def test_no_client_bypasses_drive_bus_or_forges_estop(log: list[str], allow_unlisted: bool) -> None:
    authority = Authority(lambda event: log.append(event.text), allow_unlisted=allow_unlisted)
    for topic in FORBIDDEN_TOPICS:
        for name in (topic.name, topic.name.lstrip("/")):
            with pytest.raises(Refused, match="is not allowed to clients"):
                authority.check_publish(ANNE, name, 0)
            with pytest.raises(Refused):
                authority.check_advertise(name)
    for service in (graph.SWITCH_CONTROLLER, graph.VENDOR_TORQUE, graph.SIM_PRESS_ESTOP, graph.servo_set_angle("gripper")):
        with pytest.raises(Refused):
            authority.check_call(ANNE, service.name, 0)
    with pytest.raises(Refused):
        authority.check_send_goal(ANNE, graph.ARM_FOLLOW_TRAJECTORY.name, 0)


def test_unlisted_names_are_refused_except_in_development(authority: Authority, log: list[str]) -> None:
    with pytest.raises(Refused):
        authority.check_call(ANNE, "/io/motor/left_front/set_speed", 0)
    with pytest.raises(Refused):
        authority.check_provide("/greeting")
    development = Authority(lambda event: log.append(event.text), allow_unlisted=True)
    development.check_publish(ANNE, "/chatter", 0)
    development.check_provide("/greeting")
    for name in ("/mission/start", "mission/start", "navigate_to_pose"):
        with pytest.raises(Refused):
            development.check_provide(name)


def test_parameters_are_readable_by_all_and_writable_by_none(authority: Authority) -> None:
    authority.check_call(VIEWER, "/rosapi/get_param", 0)
    with pytest.raises(Refused):
        authority.check_call(ANNE, "/rosapi/set_param", 0)


def test_holder_hands_control_over_on_request(authority: Authority, log: list[str]) -> None:
    changes: list[tuple[str | None, str | None]] = []
    authority.on_change(lambda: changes.append((authority.lease(0).holder, authority.lease(0).requester)))
    assert authority.request(ANNE, 0), "free"
    assert not authority.request(BEN, 0)
    assert not authority.request(BEN, 1), "asked once"
    with pytest.raises(Refused, match="ben does not have control"):
        authority.answer(BEN, True, 1)
    authority.answer(ANNE, False, 2)
    with pytest.raises(Refused, match="nobody is asking"):
        authority.answer(ANNE, True, 3)
    assert not authority.request(BEN, 4)
    authority.answer(ANNE, True, 5)
    assert changes == [("anne", None), ("anne", "ben"), ("anne", None), ("anne", "ben"), ("ben", None)]
    assert log[-1] == "anne handed control to ben"


def test_unanswered_request_expires_and_next_one_may_ask(authority: Authority) -> None:
    carol = Session("carol", Role.OPERATOR)
    authority.take(ANNE, 0)
    authority.request(BEN, 0)
    with pytest.raises(Refused, match="ben is already asking for control"):
        authority.request(carol, 1)
    late_ns = int((REQUEST_TIMEOUT_S + 0.1) * SECOND)
    for second in range(1, 11):
        authority.note_alive(ANNE, second * SECOND)
    assert authority.lease(late_ns).requester is None
    assert not authority.request(carol, late_ns)


def test_viewer_cannot_ask_and_requester_inherits_control(authority: Authority) -> None:
    authority.take(ANNE, 0)
    with pytest.raises(Refused, match="visitor is a viewer"):
        authority.request(VIEWER, 0)
    authority.request(BEN, 0)
    authority.give_up(ANNE, 1)
    assert authority.lease(1).holder == "ben"
    authority.give_up(BEN, 2)
    assert authority.lease(2).holder is None


def test_requester_that_gives_up_is_forgotten(authority: Authority) -> None:
    authority.take(ANNE, 0)
    authority.request(BEN, 0)
    authority.give_up(BEN, 1)
    assert authority.lease(1).requester is None


def test_loss_of_the_last_connection_is_told_from_giving_up(authority: Authority, log: list[str]) -> None:
    authority.take(ANNE, 0)
    authority.give_up(ANNE, 1, left=True)
    authority.take(ANNE, 2)
    authority.request(BEN, 3)
    authority.give_up(BEN, 4)
    authority.give_up(ANNE, 5)
    assert log[1] == "anne left, so nobody has control"
    assert log[-2:] == ["ben no longer asks for control", "anne gave up control"]
    authority.give_up(ANNE, 6, left=True)
    assert len(log) == 6, "it had none"
