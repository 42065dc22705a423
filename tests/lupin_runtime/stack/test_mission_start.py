"""The start of a run's mission, with answers that are lost, late, or refusals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from lupin_runtime.stack.mission_start import ANSWER_TIMEOUT_S, RELEASE_S, SOURCES_TIMEOUT_S, MissionStart


@dataclass
class State:
    mission_id: str
    lifecycle_state: str


class Rig:
    """A start, with a service that answers when the test calls `answer`."""

    def __init__(self) -> None:
        self.ready, self.pressed, self.estop_waits, self.all_up = True, False, False, True
        self.state: State | None = State("", "READY")
        self.requests: list[Callable[[bool, str], None]] = []
        self.now_s = 100.0
        self.start = MissionStart(lambda: self.ready, self.requests.append)

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            self.start.step(self.now_s, self.state, self.pressed, self.estop_waits, self.all_up)
            self.now_s += 0.1

    def answer(self, accepted: bool, text: str) -> None:
        self.requests[0](accepted, text)
        self.wait(0.3)

    @property
    def end(self) -> tuple[str, str]:
        return self.start.mission_id, self.start.refusal


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_accepted_mission_is_followed(rig: Rig) -> None:
    rig.wait(1.0)
    assert len(rig.requests) == 1 and rig.end == ("", "")
    rig.answer(True, "lupin-1")
    rig.wait(20.0)
    assert rig.end == ("lupin-1", "") and len(rig.requests) == 1


def test_request_waits_for_its_service(rig: Rig) -> None:
    rig.ready = False
    rig.wait(5.0)
    assert rig.requests == []
    rig.ready = True
    rig.wait(0.3)
    rig.answer(True, "lupin-1")
    assert rig.end == ("lupin-1", "")


@pytest.mark.parametrize("ready", [True, False])
def test_missing_answer_ends_the_start_with_a_reason(rig: Rig, ready: bool) -> None:
    rig.ready = ready
    rig.wait(ANSWER_TIMEOUT_S - 0.5)
    assert rig.end == ("", "")
    rig.wait(1.0)
    assert rig.end == ("", "/mission/start did not answer within 10 s; see: lupin logs mission")


def test_mission_whose_start_was_not_answered_is_followed(rig: Rig) -> None:
    rig.wait(2.0)
    rig.state = State("lupin-1", "PREPARE")
    rig.wait(20.0)
    assert rig.end == ("lupin-1", "") and len(rig.requests) == 1


def test_mission_of_another_operator_is_followed(rig: Rig) -> None:
    rig.state = State("browser-1", "EXPLORING")
    rig.wait(1.0)
    assert rig.end == ("browser-1", "") and rig.requests == []


def test_refusal_for_a_running_mission_follows_that_one(rig: Rig) -> None:
    rig.wait(0.5)
    rig.answer(False, "mission already running; abort it first: lupin mission abort")
    rig.state = State("browser-1", "PREPARE")  # its state arrives after the answer
    rig.wait(0.3)
    assert rig.end == ("browser-1", "")


def test_refused_start_gives_the_missions_reason(rig: Rig) -> None:
    rig.wait(0.5)
    rig.answer(False, "battery low (12%): charge it, then start again")
    rig.wait(1.5)
    assert rig.end == ("", "battery low (12%): charge it, then start again")


def test_press_before_the_request_starts_nothing(rig: Rig) -> None:
    rig.ready = False
    rig.wait(1.0)
    rig.ready = rig.pressed = True
    rig.wait(1.0)
    assert rig.requests == [] and "e-stop was pressed" in rig.start.refusal


def test_request_waits_until_the_estop_has_heard_every_source(rig: Rig) -> None:
    rig.estop_waits = True
    rig.wait(SOURCES_TIMEOUT_S - 1.0)
    rig.estop_waits = False
    rig.wait(RELEASE_S - 0.5)
    assert rig.requests == [] and rig.end == ("", "")
    rig.wait(1.0)
    rig.answer(True, "lupin-1")
    assert rig.end == ("lupin-1", "")


def test_request_waits_also_after_a_release_before_all_are_up(rig: Rig) -> None:
    rig.estop_waits, rig.all_up = True, False
    rig.wait(SOURCES_TIMEOUT_S + 5.0)
    assert rig.requests == []
    rig.estop_waits = False
    rig.wait(0.1)
    rig.all_up = True
    rig.wait(RELEASE_S - 0.5)
    assert rig.requests == [], "the mission would refuse it: the e-stop was released just now"
    rig.wait(1.0)
    rig.answer(True, "lupin-1")
    assert rig.end == ("lupin-1", "")


def test_source_that_is_never_heard_ends_the_start_refused(rig: Rig) -> None:
    rig.estop_waits = True
    rig.wait(SOURCES_TIMEOUT_S + RELEASE_S + 0.5)
    rig.answer(False, "e-stop engaged")
    rig.wait(1.5)
    assert rig.end == ("", "e-stop engaged")


@pytest.mark.parametrize("changes", [{"pressed": True}, {"state": State("browser-1", "EXPLORING")}])
def test_wait_for_the_estop_hides_no_press_and_no_mission(rig: Rig, changes: dict[str, object]) -> None:
    rig.estop_waits = True
    vars(rig).update(changes)
    rig.wait(0.5)
    assert rig.requests == [] and rig.end != ("", "")
