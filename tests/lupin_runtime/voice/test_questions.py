"""What the operator is asked of a call that its sender doubts, and that only a yes to it carries it out."""

from __future__ import annotations

import pytest

from lupin_runtime.voice import envelope
from lupin_runtime.voice.questions import ASK, QUESTIONS, question
from lupin_runtime.voice.tools import BY_NAME, TOOLS, Effect
from lupin_runtime.voice.turns import TurnKind
from tests.support.voice_session import CALLS, Session

BURST = {"linear_x": 0.2, "duration_s": 1.0}
STOPS = [tool.name for tool in TOOLS if tool.effect is Effect.STOP]


@pytest.fixture
def session() -> Session:
    return Session()


@pytest.mark.parametrize("name", [name for name in CALLS if name not in STOPS])
def test_doubted_call_is_read_back_whatever_it_is(session: Session, name: str) -> None:
    first = session.read_back(name, {**CALLS[name], "confirmation": ASK})
    assert session.refusal(name, first)["error"] == envelope.NOT_CONFIRMED
    session.turn()
    session.approved(name, first)
    session.turn()
    assert session.refusal(name, first)["error"] == envelope.UNKNOWN_CONFIRMATION


@pytest.mark.parametrize("name", STOPS)
def test_doubt_delays_no_stop(session: Session, name: str) -> None:
    assert session.approved(name, {"confirmation": ASK}) == {}


def test_yes_to_a_burst_is_for_that_burst(session: Session) -> None:
    first = session.read_back("drive", {**BURST, "confirmation": ASK})
    session.turn()
    assert session.refusal("drive", {**first, "linear_x": 0.3})["error"] == envelope.OTHER_ARGUMENTS


def test_burst_is_read_back_as_fast_as_it_would_be(session: Session) -> None:
    asked = session.refusal("drive", {**BURST, "linear_x": 100, "confirmation": ASK})
    assert "drive +0.3 m/s forward" in asked["confirm"]


def test_yes_to_a_burst_is_for_its_speed(session: Session) -> None:
    session.approved("set_speed_cap", {"value": 0.5})
    first = session.read_back("drive", {**BURST, "linear_x": 100, "confirmation": ASK})
    session.turn()
    session.approved("set_speed_cap", {"value": 1})
    assert session.refusal("drive", first)["error"] == envelope.OTHER_ARGUMENTS


@pytest.mark.parametrize("name", ["drive", "set_light", "set_speed_cap"])
def test_yes_is_outdated_by_a_stop_that_was_released(session: Session, name: str) -> None:
    outdated: list[str] = []
    session.set(become_outdated=lambda: "".join(outdated))
    first = session.read_back(name, {**CALLS[name], "confirmation": ASK})
    session.turn()
    outdated.append("the robot was stopped")
    assert session.refusal(name, first)["error"] == "the robot was stopped"


@pytest.mark.parametrize("name", ["drive", "set_light", "set_speed_cap"])
def test_yes_counts_once_its_speaker_has_finished(session: Session, name: str) -> None:
    first = session.read_back(name, {**CALLS[name], "confirmation": ASK})
    session.turn(ended=False)
    assert session.refusal(name, first)["error"] == envelope.IS_SPEAKING
    session.end_turn()
    session.approved(name, first)


def test_commit_that_is_doubted_needs_an_utterance_too(session: Session) -> None:
    session.confirmed("calibrate_arm", {"action": "start"})
    session.turn(TurnKind.BUTTON)
    refused = session.refusal("calibrate_arm", {"action": "commit", "confirmation": ASK})
    assert refused["error"] == envelope.NO_UTTERANCE


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("rotate", {"angle_deg": 90.0}, "turn in place by +90 degrees, counter-clockwise if positive"),
        ("drive", {"angular_z": -0.5, "duration_s": 1}, "turning by -0.5 rad/s, for 1 s"),
        ("set_light", {"color": "blue"}, "set the light strip to blue"),
        ("set_light", {"mode": "auto", "color": "red"}, "let the light strip show the robot's state (auto)"),
        ("set_light", {"mode": "auto"}, "let the light strip show the robot's state (auto)"),
        ("arm_record", {"action": "save"}, "save the recording"),
        ("arm_record", {"action": "save", "name": "wave"}, "save the recording as wave"),
        ("arm_list_library", {}, "arm list library"),
    ],
)
def test_question_says_what_would_be_done(name: str, arguments: dict[str, object], expected: str) -> None:
    assert expected in question(BY_NAME[name], BY_NAME[name].check(arguments))


def test_questions_are_of_actions_that_are_not_read_back_anyway() -> None:
    for name, questions in QUESTIONS.items():
        assert not questions.keys() & BY_NAME[name].read_back.keys()
