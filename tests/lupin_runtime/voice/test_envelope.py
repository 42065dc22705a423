"""The safety envelope, rule by rule."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.voice import envelope, turns
from lupin_runtime.voice.envelope import Rejected, limit_velocity
from lupin_runtime.voice.tools import BY_NAME, TOOLS, Effect, Gate
from lupin_runtime.voice.turns import FLOOD, MAX_CALLS, MAX_CUT_OFFS, MAX_SAME_CALLS, TOO_OFTEN, TurnKind
from tests.support.voice_session import CALLS, Session

BURST = {"linear_x": 0.2, "duration_s": 1.0}
GOAL = {"x": 1.0, "y": 2.0}
STOPS = [tool.name for tool in TOOLS if tool.effect is Effect.STOP]
CONTROLLED = [tool.name for tool in TOOLS if tool.needs_control]
READ_BACK = [name for name in CALLS if BY_NAME[name].sentence(BY_NAME[name].check(CALLS[name]))]


@pytest.fixture
def session() -> Session:
    return Session()


# -- the e-stop -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", [tool.name for tool in TOOLS if tool.gate is not Gate.NONE])
def test_gated_tool_is_blocked_while_estop_is_engaged(session: Session, name: str) -> None:
    session.set(estop=("phone-1 stopped the robot",))
    result = session.refusal(name, CALLS[name])
    assert result["blocked"] is True and result["reasons"] == [{"untrusted": "phone-1 stopped the robot"}]


@pytest.mark.parametrize("name", [tool.name for tool in TOOLS if tool.gate is Gate.NONE])
def test_ungated_tool_is_not_blocked_by_the_estop(session: Session, name: str) -> None:
    session.set(estop=("the button is pressed",))
    assert not isinstance(session.call(name, CALLS[name]), Rejected)


@pytest.mark.parametrize(
    ("name", "action"),
    [("arm_record", "save"), ("arm_record", "cancel"), ("calibrate_arm", "cancel"), ("calibrate_arm", "status")],
)
def test_estop_blocks_only_the_start_of_recovery_tools(session: Session, name: str, action: str) -> None:
    session.set(estop=("the button is pressed",))
    assert session.approved(name, {"action": action})["action"] == action


@pytest.mark.parametrize("name", ["release_estop", "reset_estop", "release", "estop", "/lupin/hmi/estop", "set_estop", "Stop"])
def test_no_name_releases_the_stop(session: Session, name: str) -> None:
    session.set(estop=("x",))
    assert "there is no tool" in session.refusal(name, {"engaged": False})["error"]


# -- what always passes -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", STOPS)
@pytest.mark.parametrize("arguments", [None, {}, {"force": True}, [1], "now", {"x": math.nan}])
def test_stop_passes_whatever_its_arguments(session: Session, name: str, arguments: Any) -> None:
    session.set(estop=("x",), control_refusal="phone-2 has control")
    assert session.approved(name, arguments) == {}


@pytest.mark.parametrize("name", STOPS)
def test_stop_passes_before_the_first_turn_and_after_a_cut_off(name: str) -> None:
    fresh = Session()
    fresh.envelope = envelope.Envelope()
    assert fresh.approved(name) == {}
    fresh.turn()
    for _ in range(MAX_CALLS + 5):
        fresh.call("query_state", {"fields": ["pose"]})
    assert fresh.envelope.turns.cut_off
    for _ in range(50):
        assert fresh.approved(name) == {}


# -- control ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", CONTROLLED)
def test_tool_is_refused_while_another_session_has_control(session: Session, name: str) -> None:
    session.set(control_refusal="phone-2 has had control for 3 s; ask for it or take it over")
    assert session.refusal(name, CALLS[name])["error"].startswith("phone-2 has had control")


def test_control_is_needed_also_to_confirm(session: Session) -> None:
    second = session.read_back("nav_goto", GOAL)
    session.turn()
    session.set(control_refusal="phone-2 has control")
    assert session.refusal("nav_goto", second)["error"] == "phone-2 has control"


# -- speed ------------------------------------------------------------------------------------------------------------
def test_burst_is_limited_in_its_direction(session: Session) -> None:
    velocity = session.approved("drive", {"linear_x": 30, "linear_y": -40, "angular_z": 9, "duration_s": 2})
    assert velocity == pytest.approx({"linear_x": 0.18, "linear_y": -0.24, "angular_z": 0.8, "duration_s": 2.0})


def test_speed_cap_scales_the_limits_of_the_session(session: Session) -> None:
    session.approved("set_speed_cap", {"value": 0.5})
    assert session.envelope.limits(session.situation) == (0.15, 0.4)
    assert session.approved("drive", {"linear_x": -1, "duration_s": 1})["linear_x"] == pytest.approx(-0.15)
    session.approved("set_speed_cap", {"value": 0})
    assert session.approved("drive", {"linear_x": 1, "angular_z": 1, "duration_s": 1}).items() >= {"linear_x": 0.0}.items()


def test_bursts_of_one_turn_are_bounded_together(session: Session) -> None:
    for number in range(5):
        session.approved("drive", {"angular_z": 0.1 * number, "duration_s": 2})
    assert session.refusal("drive", {"angular_z": 0.7, "duration_s": 0.1})["error"] == envelope.TOO_LONG
    session.turn()
    session.approved("drive", {"angular_z": 0.7, "duration_s": 0.1})


def test_limits_of_a_burst_do_not_apply_to_navigation(session: Session) -> None:
    session.approved("set_speed_cap", {"value": 0.1})
    assert session.confirmed("nav_forward", {"forward_m": 20.0})["forward_m"] == 20.0


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0.0, 0.6), st.floats(0.0, 1.9))
def test_no_velocity_exceeds_the_limits(x: float, y: float, turn: float, linear: float, angular: float) -> None:
    limited = limit_velocity({"linear_x": x, "linear_y": y, "angular_z": turn}, linear, angular)
    assert math.hypot(limited["linear_x"], limited["linear_y"]) <= linear + 1e-9
    assert abs(limited["angular_z"]) <= angular
    assert limited["linear_x"] * x >= 0.0 and limited["linear_y"] * y >= 0.0 and limited["angular_z"] * turn >= 0.0


# -- pose -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["nav_forward", "rotate", "save_named_location"])
def test_tool_that_needs_a_pose_is_refused_without_one(session: Session, name: str) -> None:
    session.set(has_pose=False)
    assert session.refusal(name, CALLS[name])["error"] == envelope.NO_POSE


# -- turns and confirmation -------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", CONTROLLED)
def test_nothing_moves_before_the_operator_has_said_anything(name: str) -> None:
    session = Session()
    session.envelope = envelope.Envelope()
    assert session.refusal(name, CALLS[name])["error"] == envelope.NO_TURN


@pytest.mark.parametrize("name", CONTROLLED)
def test_nothing_moves_while_the_operator_is_speaking(session: Session, name: str) -> None:
    session.turn(ended=False)
    assert session.refusal(name, CALLS[name])["error"] == envelope.IS_SPEAKING
    session.end_turn()
    assert "error" not in getattr(session.call(name, CALLS[name]), "result", {})


@pytest.mark.parametrize("name", READ_BACK)
@pytest.mark.parametrize("kind", list(TurnKind))
def test_motion_is_confirmed_in_the_next_turn(session: Session, name: str, kind: TurnKind) -> None:
    assert session.confirmed(name, CALLS[name], kind).items() >= CALLS[name].items()


@pytest.mark.parametrize("name", READ_BACK)
def test_motion_is_not_confirmed_in_the_same_turn(session: Session, name: str) -> None:
    second = session.read_back(name, CALLS[name])
    assert session.refusal(name, second)["error"] == envelope.NOT_CONFIRMED


@pytest.mark.parametrize("name", READ_BACK)
def test_confirmation_is_used_once(session: Session, name: str) -> None:
    second = session.read_back(name, CALLS[name])
    session.turn()
    session.approved(name, second)
    assert session.refusal(name, second)["error"] == envelope.UNKNOWN_CONFIRMATION


@pytest.mark.parametrize(
    ("name", "first", "changed"),
    [
        ("nav_goto", GOAL, {"x": 1.0, "y": 2.1}),
        ("nav_goto", GOAL, {**GOAL, "yaw": 0.1}),
        ("nav_forward", {"forward_m": 0.5}, {"forward_m": 5.0}),
        ("rotate", {"angle_deg": 10}, {"angle_deg": -10}),
        ("nav_goto_named", {"name": "home"}, {"name": "Home"}),
        ("arm_preset", {"name": "tuck"}, {"name": "pick"}),
        ("arm_goto_pose", {"name": "a"}, {"name": "b"}),
        ("arm_run_sequence", {"name": "a"}, {"name": "a", "speed": 2.0}),
        ("gripper", {"action": "open"}, {"action": "close"}),
        ("arm_record", {"action": "start"}, {"action": "start", "mode": "kinesthetic"}),
        ("calibrate_arm", {"action": "start"}, {"action": "commit"}),
    ],
)
def test_confirmation_counts_only_for_what_was_read_back(session: Session, name: str, first: Any, changed: Any) -> None:
    token = session.read_back(name, first)["confirmation"]
    session.turn()
    assert session.refusal(name, {**changed, "confirmation": token})["error"] == envelope.OTHER_ARGUMENTS
    assert session.refusal(name, {**first, "confirmation": token})["error"] == envelope.UNKNOWN_CONFIRMATION


def test_confirmation_counts_only_for_its_tool(session: Session) -> None:
    token = session.read_back("arm_goto_pose", {"name": "tuck"})["confirmation"]
    session.turn()
    assert session.refusal("arm_preset", {"name": "tuck", "confirmation": token})["error"] == envelope.OTHER_ARGUMENTS


@pytest.mark.parametrize("token", ["", "0", "yes", "true", "00000000", "null", "é", "x" * 64])
def test_invented_confirmation_is_refused(session: Session, token: str) -> None:
    session.read_back("rotate", {"angle_deg": 90})
    session.turn()
    assert "confirmation" in session.refusal("rotate", {"angle_deg": 90, "confirmation": token})["error"]


def test_confirmation_expires(session: Session) -> None:
    second = session.read_back("nav_goto", GOAL)
    session.wait(envelope.CONFIRM_WITHIN_S + 0.1)
    session.turn()
    assert session.refusal("nav_goto", second)["error"] == envelope.LATE_CONFIRMATION


def test_confirmation_counts_only_in_the_next_turn(session: Session) -> None:
    second = session.read_back("nav_goto", GOAL)
    session.turn()  # the operator says no
    session.turn()
    assert session.refusal("nav_goto", second)["error"] == envelope.LATE_CONFIRMATION


def test_confirmation_is_outdated_by_a_stop_meanwhile(session: Session) -> None:
    outdated: list[str] = []
    session.set(become_outdated=lambda: "".join(outdated))
    second = session.read_back("nav_goto", GOAL)
    outdated.append("the robot was stopped")
    session.turn()
    assert session.refusal("nav_goto", second)["error"] == "the robot was stopped"


def test_call_that_waited_over_a_stop_is_refused(session: Session) -> None:
    session.set(outdated="the robot was stopped since")
    assert session.refusal("drive", BURST)["error"] == "the robot was stopped since"
    assert session.approved("query_state")
    assert session.approved("stop") == {}


def test_cancel_forgets_what_was_read_back(session: Session) -> None:
    second = session.read_back("nav_goto", GOAL)
    session.envelope.cancel()
    session.turn()
    assert session.refusal("nav_goto", second)["error"] == envelope.UNKNOWN_CONFIRMATION


def test_call_of_an_earlier_turn_is_refused(session: Session) -> None:
    admitted = session.envelope.admit("drive", BURST)
    assert not isinstance(admitted, Rejected)
    session.turn()
    rejected = session.envelope.judge(admitted, session.situation)
    assert isinstance(rejected, Rejected) and rejected.reason == envelope.OLD_TURN


def test_turn_that_is_announced_again_does_not_begin_anew(session: Session) -> None:
    second = session.read_back("nav_goto", GOAL)
    session.end_turn()
    assert session.refusal("nav_goto", second)["error"] == envelope.NOT_CONFIRMED
    session.turn()
    session.envelope.turns.announce("turn 1", TurnKind.TEXT, ended=True)  # an id of an earlier turn
    assert session.envelope.turns.number == 2


def test_ids_of_turns_are_remembered_up_to_a_limit() -> None:
    known = turns.Turns()
    for number in range(turns._MAX_TURNS + 1):
        known.announce(str(number), TurnKind.TEXT, ended=True)
    known.announce("1", TurnKind.TEXT, ended=True)
    assert known.number == turns._MAX_TURNS + 1
    known.announce("0", TurnKind.TEXT, ended=True)
    assert known.number == turns._MAX_TURNS + 2


# -- calibration and recording ----------------------------------------------------------------------------------------
@pytest.mark.parametrize(("name", "action"), [("calibrate_arm", "commit"), ("arm_record", "save")])
@pytest.mark.parametrize("kind", list(TurnKind))
def test_start_is_not_completed_in_the_same_turn(session: Session, name: str, action: str, kind: TurnKind) -> None:
    session.confirmed(name, {"action": "start"}, kind)
    assert session.refusal(name, {"action": action})["error"] == envelope.SAME_TURN.format(action=action)


def test_calibration_is_committed_only_after_an_utterance(session: Session) -> None:
    session.confirmed("calibrate_arm", {"action": "start"})
    session.turn(TurnKind.BUTTON)
    assert session.refusal("calibrate_arm", {"action": "commit"})["error"] == envelope.NO_UTTERANCE
    session.turn(TurnKind.TEXT)
    assert session.confirmed("calibrate_arm", {"action": "commit"}, TurnKind.BUTTON) == {"action": "commit"}


def test_recording_is_saved_in_a_later_turn(session: Session) -> None:
    session.confirmed("arm_record", {"action": "start", "name": "wave"})
    session.turn()
    assert session.approved("arm_record", {"action": "save"})["action"] == "save"


# -- agents that loop -------------------------------------------------------------------------------------------------
def test_agent_that_repeats_a_call_is_cut_off(session: Session) -> None:
    for _ in range(MAX_SAME_CALLS):
        session.approved("drive", BURST)
    cut_off = session.call("drive", BURST)
    assert isinstance(cut_off, Rejected) and "drive with the same arguments" in cut_off.cut_off
    assert "cut off" in session.refusal("query_state")["error"]
    session.turn()
    session.approved("drive", BURST)


def test_agent_that_repeats_a_refused_call_is_cut_off(session: Session) -> None:
    session.set(estop=("x",))
    outcomes = [session.call("drive", BURST) for _ in range(3)]
    assert [bool(each.cut_off) for each in outcomes if isinstance(each, Rejected)] == [False, False, True]


def test_agent_that_floods_is_cut_off(session: Session) -> None:
    outcomes = [session.call("rotate", {"angle_deg": number}) for number in range(MAX_CALLS + 1)]
    assert isinstance(outcomes[-1], Rejected) and outcomes[-1].cut_off == FLOOD


def test_call_that_waited_for_a_cut_off_is_refused(session: Session) -> None:
    waiting = session.envelope.admit("drive", BURST)
    assert not isinstance(waiting, Rejected)
    for number in range(MAX_CALLS):
        session.call("rotate", {"angle_deg": number})
    rejected = session.envelope.judge(waiting, session.situation)
    assert isinstance(rejected, Rejected) and "cut off" in rejected.reason


@pytest.mark.parametrize("kind", [TurnKind.TEXT, TurnKind.BUTTON])
def test_agent_cut_off_too_often_waits_for_the_operator(session: Session, kind: TurnKind) -> None:
    for _ in range(MAX_CUT_OFFS):
        for number in range(MAX_CALLS + 1):
            session.call("rotate", {"angle_deg": number})
        session.turn()
    assert session.envelope.turns.cut_off == TOO_OFTEN
    assert "cut off" in session.refusal("drive", BURST)["error"]
    session.turn(kind)
    session.approved("drive", BURST)


# -- whatever a model sends -------------------------------------------------------------------------------------------
JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=10), inner, max_size=3),
    max_leaves=8,
)


@given(st.sampled_from([*CALLS, "release_estop", ""]), JUNK)
def test_junk_never_raises_and_never_moves(name: str, arguments: Any) -> None:
    outcome = Session().call(name, arguments)
    if name in CONTROLLED:
        assert isinstance(outcome, Rejected)


@given(JUNK)
def test_junk_as_a_name_is_refused(name: Any) -> None:
    if not isinstance(name, str) or name not in CALLS:
        assert "there is no tool" in Session().refusal(name)["error"]


WRONG = [
    math.nan, math.inf, -math.inf, True, False, "1.0", "", [], {}, 1e7, -1e308, 10**400, [1.0], {"value": 1},
]  # fmt: skip
NUMBERS = [
    (tool.name, argument.name)
    for tool in TOOLS
    for argument in tool.arguments
    if argument.kind.value == "number" and argument.fallback is None
]


@pytest.mark.parametrize("value", WRONG, ids=lambda value: str(value)[:10])
@pytest.mark.parametrize(("name", "argument"), NUMBERS)
def test_what_is_no_number_is_refused_and_moves_nothing(session: Session, name: str, argument: str, value: Any) -> None:
    error = session.refusal(name, {**CALLS[name], argument: value})["error"]
    assert error.startswith(f"{argument} must be a number from")
