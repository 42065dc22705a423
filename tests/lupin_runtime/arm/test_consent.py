"""The arm is moved for a remote computer only if that answers when it is asked."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from lupin_runtime import graph
from lupin_runtime.arm.consent import ANSWER, QUESTION, Consent

if TYPE_CHECKING:
    from tests.conftest import GraphHost


def answered(*data: bytes) -> tuple[Consent, int]:
    """Return the consent after the pieces `data` have arrived, and the descriptor to write more to."""
    reading, writing = os.pipe()
    consent = Consent(reading)
    consent.ask()
    for piece in data:
        os.write(writing, piece)
        consent.is_given()
    return consent, writing


def test_answer_counts_whole_and_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert answered(ANSWER)[0].is_given()
    assert answered(ANSWER[:2], ANSWER[2:])[0].is_given()
    for wrong in (b"", b"y", b"no\n", ANSWER * 2, b"x" * 1000):
        assert not answered(wrong)[0].is_given()
    assert capsys.readouterr().out.splitlines()[0] == QUESTION


def test_answer_before_the_question_counts_nothing() -> None:
    consent, writing = answered(b"no\n")
    os.write(writing, ANSWER)
    consent.ask()
    assert not consent.is_given() and not consent.is_refused
    os.write(writing, ANSWER)
    assert consent.is_given()


def test_end_of_input_refuses_at_once_and_for_good() -> None:
    consent, writing = answered(ANSWER)
    assert consent.is_given()
    os.close(writing)
    consent.ask()
    assert consent.is_refused and not consent.is_given()


@pytest.mark.graph
@pytest.mark.parametrize("answers", [True, False])
def test_arm_moves_only_for_a_computer_that_answers(
    graph_host: GraphHost, monkeypatch: pytest.MonkeyPatch, answers: bool
) -> None:
    from lupin_runtime.arm.auto_home import AutoHome, LeftAlone, Limits
    from lupin_runtime.ros import LupinNode
    from tests.lupin_runtime.arm.test_auto_home import SHORT, Manager

    monkeypatch.setattr("lupin_runtime.arm.auto_home.ANSWER_LIMIT_S", 0.3)
    reading, writing = os.pipe()
    consent = Consent(reading)
    ask = consent.ask

    def asked() -> None:
        ask()
        if answers:
            os.write(writing, ANSWER)

    monkeypatch.setattr(consent, "ask", asked)
    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(**SHORT), say=lambda _: None, consent=consent)
    if answers:
        home.run()
    else:
        with pytest.raises(LeftAlone, match="does not answer"):
            home.run()
    assert manager.presets == ["home"] * answers
    home.close()
    node.destroy_node()
