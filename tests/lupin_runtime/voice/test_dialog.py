"""The dialog calls, reads back, asks again, and stops."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import Mapping
from typing import Any

import pytest

from lupin_runtime.voice.dialog import CANCELED, NOTHING_READ_BACK, Dialog, Reply, Turn, describe
from lupin_runtime.voice.dutch import DUTCH
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.envelope import CONFIRM_WITHIN_S, Envelope, Rejected, Situation
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.turns import TurnKind
from lupin_runtime.voice.utterance import Confirmation

LOCATIONS = [{"name": {"untrusted": "sink"}, "x": 1.0, "y": 2.0, "yaw": 0.0}]
LIBRARY = {"ok": True, "poses": [{"untrusted": "high_look"}], "sequences": [{"untrusted": "water"}]}


class Console:
    """The console's envelope, behind the interface of the connection; it carries out nothing and says so."""

    def __init__(self) -> None:
        self.envelope = Envelope()
        self.situation = Situation(0, max_linear_mps=0.3, max_angular_rps=0.8, has_pose=True)
        self.done: list[tuple[str, dict[str, Any]]] = []

    @property
    def state(self) -> Mapping[str, Any]:
        return {"speed_cap": self.envelope.speed_cap}

    async def announce_turn(self, identifier: str, by: str, *, ended: bool = True) -> None:
        self.envelope.turns.announce(identifier, TurnKind(by), ended=ended)

    async def call(self, tool: str, arguments: dict[str, Any]) -> dict[str, Any]:
        admitted = self.envelope.admit(tool, arguments)
        verdict = admitted if isinstance(admitted, Rejected) else self.envelope.judge(admitted, self.situation)
        if isinstance(verdict, Rejected):
            return verdict.result
        if tool in ("list_named_locations", "arm_list_library"):
            return {"ok": True, "locations": LOCATIONS} if tool == "list_named_locations" else LIBRARY
        self.done.append((tool, verdict))
        return {"ok": True, "action": tool}

    async def interrupt(self) -> None:
        self.envelope.cancel()


class Operator:
    """Says sentences to a dialog."""

    def __init__(self, console: Console | None) -> None:
        self.now_s = 0.0
        self.dialog = Dialog(console, ENGLISH, Names(("sink",), ("high_look",), ("water",)), lambda: self.now_s)

    def say(self, sentence: str, by: str = "text") -> Reply:
        return asyncio.run(self.dialog.handle(Turn(sentence, by, uuid.uuid4().hex)))


@pytest.fixture
def console() -> Console:
    return Console()


@pytest.fixture
def operator(console: Console) -> Operator:
    return Operator(console)


def test_sentence_is_carried_out(operator: Operator, console: Console) -> None:
    reply = operator.say("lights blue")
    assert reply.is_done and reply.text == "set_light: done"
    assert console.done == [("set_light", {"color": "blue"})]


def test_motion_is_done_after_a_yes(operator: Operator, console: Console) -> None:
    asked = operator.say("go to the sink")
    assert not asked.is_done and asked.text == "Navigate to the location sink. Yes or no?" and console.done == []
    assert operator.dialog.waits_for_answer
    assert operator.say("yes").is_done and not operator.dialog.waits_for_answer
    assert console.done == [("nav_goto_named", {"name": "sink"})]


def test_no_forgets_what_was_read_back(operator: Operator, console: Console) -> None:
    operator.say("go to the sink")
    assert operator.say("no").text == CANCELED
    assert "nothing waits" in operator.say("yes").text.lower() and console.done == []


@pytest.mark.parametrize("agrees", [True, False])
def test_button_answers_what_was_read_back(operator: Operator, console: Console, agrees: bool) -> None:
    operator.say("go to the sink")
    reply = asyncio.run(operator.dialog.answer(Turn("", "button", "1"), Confirmation(agrees)))
    assert reply.is_done is agrees and not operator.dialog.waits_for_answer
    assert console.done == ([("nav_goto_named", {"name": "sink"})] if agrees else [])


def test_button_without_a_read_back_does_nothing(operator: Operator, console: Console) -> None:
    assert asyncio.run(operator.dialog.answer(Turn("", "button", "1"), Confirmation(True))).text == NOTHING_READ_BACK
    assert console.done == []


def test_another_command_replaces_what_was_read_back(operator: Operator, console: Console) -> None:
    operator.say("go to the sink")
    assert "Turn in place by +90 degrees" in operator.say("turn left ninety degrees").text
    operator.say("yes")
    assert console.done == [("rotate", {"angle_deg": 90.0})]


def test_unclear_typed_answer_leaves_the_read_back_open(operator: Operator, console: Console) -> None:
    operator.say("go to the sink")
    assert not operator.say("perhaps").is_done
    operator.say("yes")
    assert console.done == [("nav_goto_named", {"name": "sink"})]


def test_unclear_spoken_answer_is_read_back_again(operator: Operator, console: Console) -> None:
    # It was a turn for the console, which takes a confirmation only in the next one.
    operator.say("go to the sink", "speech")
    assert operator.say("perhaps", "speech").text.endswith("Navigate to the location sink. Yes or no?")
    operator.say("yes", "speech")
    assert console.done == [("nav_goto_named", {"name": "sink"})]


# -- what may have been meant ------------------------------------------------------------------------------------------
DRIVE = {"linear_x": 0.2, "linear_y": 0.0, "angular_z": 0.0, "duration_s": 1.0}


@pytest.mark.parametrize(
    ("sentence", "asked", "call"),
    [
        ("lights blue?", "Set the light strip to blue. Yes or no?", ("set_light", {"color": "blue"})),
        ("go to the sink?", "Navigate to the location sink. Yes or no?", ("nav_goto_named", {"name": "sink"})),
        (
            "drive forward at 0.2 metres per second for one second?",
            "Drive +0.2 m/s forward and +0 m/s to the left",
            ("drive", DRIVE),
        ),
        ("speed cap fifty percent?", "Set the speed cap to 0.5. Yes or no?", ("set_speed_cap", {"value": 0.5})),
    ],
)
def test_command_that_sounds_like_a_question_waits_for_a_yes(
    operator: Operator, console: Console, sentence: str, asked: str, call: tuple[str, dict[str, Any]]
) -> None:
    reply = operator.say(sentence, "speech")
    assert not reply.is_done and reply.text.startswith(asked) and console.done == [] and operator.dialog.waits_for_answer
    assert operator.say("yes", "speech").is_done and console.done == [call]
    assert operator.say("yes", "speech").text.lower().startswith("nothing waits") and console.done == [call]


def test_doubtful_command_is_dropped_by_a_no_and_by_another_one(operator: Operator, console: Console) -> None:
    operator.say("lights blue?")
    assert operator.say("no").text == CANCELED and "nothing waits" in operator.say("yes").text.lower()
    operator.say("lights blue?")
    operator.say("go to the sink")
    operator.say("yes")
    assert console.done == [("nav_goto_named", {"name": "sink"})]


@pytest.mark.parametrize("by", ["text", "speech"])
def test_doubtful_command_replaces_nothing_that_was_read_back(operator: Operator, console: Console, by: str) -> None:
    operator.say("go to the sink", by)
    assert "strip" not in operator.say("lights blue?", by).text
    operator.say("yes", by)
    assert console.done == [("nav_goto_named", {"name": "sink"})]


@pytest.mark.parametrize("by", ["text", "speech"])
def test_what_nobody_has_answered_in_time_is_forgotten(operator: Operator, console: Console, by: str) -> None:
    operator.say("go to the sink", by)
    operator.now_s = CONFIRM_WITHIN_S + 0.1
    assert operator.say("yes", by).text.lower().startswith("nothing waits")
    operator.say("go to the sink", by)
    operator.now_s *= 2.1
    assert operator.say("lights blue?", by).text.startswith("Set the light strip to blue.")
    operator.say("yes", by)
    assert console.done == [("set_light", {"color": "blue"})]


def test_unclear_answer_leaves_a_doubtful_command_unconfirmed(operator: Operator, console: Console) -> None:
    operator.say("lights blue?", "speech")
    assert operator.say("perhaps", "speech").text.endswith("Set the light strip to blue. Yes or no?") and console.done == []
    operator.say("yes", "speech")
    assert console.done == [("set_light", {"color": "blue"})]


def test_question_that_only_reads_is_answered_at_once(operator: Operator, console: Console) -> None:
    assert operator.say("what is the battery?").is_done and [tool for tool, _ in console.done] == ["query_state"]


def test_stop_word_engages_the_estop_and_forgets(operator: Operator, console: Console) -> None:
    operator.say("go to the sink")
    assert asyncio.run(operator.dialog.stop(Turn("stop", "speech", "1"))).is_done
    assert console.done == [("engage_estop", {})] and not operator.dialog.waits_for_answer
    operator.say("do not stop")
    assert console.done == [("engage_estop", {})] * 2


def test_another_language_is_understood_once_chosen(operator: Operator, console: Console) -> None:
    assert not operator.say("lampen blauw").is_done
    operator.dialog.language = DUTCH
    assert operator.say("lampen blauw").is_done and console.done == [("set_light", {"color": "blue"})]


def test_unknown_sentence_is_asked_again(operator: Operator, console: Console) -> None:
    reply = operator.say("dance with me")
    assert not reply.is_done and reply.text.startswith("I did not understand that.") and console.done == []


def test_refusal_names_its_reasons(operator: Operator, console: Console) -> None:
    console.situation = Situation(0, estop=("button pressed",), has_pose=True)
    assert operator.say("go to the sink").text.endswith("(button pressed)")


def test_calibration_is_committed_by_its_own_word(operator: Operator, console: Console) -> None:
    operator.say("start calibration")
    operator.say("yes")
    assert "write the new zero offsets" in operator.say("commit").text.lower()
    operator.say("commit")
    assert [arguments["action"] for _, arguments in console.done] == ["start", "commit"]


def test_cancel_ends_a_recording_that_was_started(operator: Operator, console: Console) -> None:
    operator.say("start recording")
    operator.say("yes")
    operator.say("cancel")
    operator.say("cancel")
    assert [(tool, arguments.get("action")) for tool, arguments in console.done] == [
        ("arm_record", "start"),
        ("arm_record", "cancel"),
        ("nav_cancel", None),
    ]


def test_slower_halves_the_cap_of_the_session(operator: Operator, console: Console) -> None:
    operator.say("slower")
    operator.say("slower")
    assert console.envelope.speed_cap == 0.25


def test_names_come_from_the_console(console: Console) -> None:
    operator = Operator(console)
    asyncio.run(operator.dialog.load_names())
    assert operator.dialog.names == Names(("sink",), ("high_look",), ("water",))


def test_dry_run_shows_the_call_and_sends_nothing() -> None:
    operator = Operator(None)
    assert operator.say("go to the sink").text == 'would call nav_goto_named {"name": "sink"}'
    assert asyncio.run(operator.dialog.stop(Turn("stop", "text", "1"))).text == "would call engage_estop {}"
    doubtful = operator.say("lights blue?")
    assert doubtful.text == 'would ask before it calls set_light {"color": "blue"}' and not doubtful.is_done


def test_response_is_described_with_its_fields() -> None:
    battery = {"voltage": 12.1, "percentage": 0.5}
    assert describe("query_state", {"ok": True, "battery": battery}) == "query_state: battery voltage 12.1 percentage 0.5"
    assert describe("arm_list_library", LIBRARY) == "arm_list_library: poses high_look, sequences water"
    assert describe("stop", {"ok": True, "action": "stop"}) == "stop: done"
    assert describe("drive", {"ok": False}) == "drive was not done: no reason was given"
