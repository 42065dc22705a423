"""The agent without a model: typed and spoken sentences become calls of the session, and pass the same envelope."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from lupin_runtime import graph
from lupin_runtime.console import voice_offline
from lupin_runtime.console.voice_listener import ListenerState
from lupin_runtime.console.voice_offline import BAD_ANSWER, BAD_SAY, MAX_SENTENCES, MAX_TEXT, OUTDATED, TOO_MANY
from lupin_runtime.console.voice_session import VoiceSession
from lupin_runtime.voice.listener_protocol import Kind
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.speech import SpeechUnavailable
from tests.support.voice_rig import Rig, run, settle
from tests.support.voice_talk import FakeSpeaker, Talk, replace_parts

DRIVE = "drive forward for one second at 0.2 metres per second"
STOPPED = "stop of voice agent of phone-1"


@pytest.fixture(autouse=True)
def _parts(monkeypatch: pytest.MonkeyPatch) -> None:
    replace_parts(monkeypatch)


def test_typed_sentence_is_carried_out() -> None:
    async def test(rig: Rig) -> None:
        reply = await Talk(rig).type(DRIVE)
        assert reply["done"] and reply["call"]["tool"] == "drive" and 0.2 in rig.bridge.log
        assert rig.responses() == {}

    recorded = [what for what, _ in run(test).bridge.recorded]
    assert len(recorded) == 1 and recorded[0].startswith("voice drive")


def test_typed_dutch_is_understood_and_spoken_dutch_is_not() -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        rig.listen("commands")
        assert not (await talk.type("wat is de batterij"))["done"]
        assert (await talk.type("waar ben je", "nl"))["call"]["tool"] == "query_state"
        assert not (await talk.speak("waar ben je"))["done"]

    run(test)


@pytest.mark.parametrize("how", ["yes", "button", "spoken"])
def test_motion_is_done_after_a_yes_in_its_own_turn(how: str) -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        rig.listen("commands")
        asked = await talk.type("go to x 1 y 2")
        assert asked["read_back"] and graph.GOAL_POSE.name not in rig.bridge.log
        reply = await (talk.press(True) if how == "button" else talk.speak("yes") if how == "spoken" else talk.type("yes"))
        assert reply["done"] and graph.GOAL_POSE.name in rig.bridge.log

    run(test)


@pytest.mark.parametrize("agrees", [True, False])
def test_button_confirms_once_and_only_what_was_read_back(agrees: bool) -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        assert not (await talk.press(True))["done"]
        await talk.type("go to x 1 y 2")
        assert (await talk.press(agrees))["done"] is agrees
        assert not (await talk.press(True))["done"]
        assert rig.bridge.log.count(graph.GOAL_POSE.name) == int(agrees)

    run(test)


def test_yes_in_the_turn_of_the_read_back_confirms_nothing() -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        user = rig.listen("commands")
        identifier = talk.begin()
        talk.end(identifier, "go to x 1 y 2")
        await settle()
        assert rig.messages("reply")[-1]["read_back"]
        user.turn_heard(identifier, "yes")  # as a listener that hears a turn twice
        await settle()
        assert graph.GOAL_POSE.name not in rig.bridge.log

    run(test)


@pytest.mark.parametrize("between", ["turn", "stop", "cancel", "other id"])
def test_sentence_that_comes_late_is_dropped(between: str) -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        user = rig.listen("commands")
        identifier = talk.begin()
        if between == "turn":
            talk.begin()
        elif between == "stop":
            user.stop_heard("stop", identifier)
        elif between == "cancel":
            rig.send(cancel=True)
        user.turn_heard("unknown" if between == "other id" else identifier, DRIVE)
        await settle()
        assert 0.2 not in rig.bridge.log and rig.messages("heard")[-1]["problem"] == OUTDATED

    run(test)


def test_sentence_during_which_another_turn_begins_is_dropped() -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        rig.listen("commands")
        talk.end(talk.begin(), DRIVE)
        talk.begin()
        await settle()
        assert 0.2 not in rig.bridge.log and rig.messages("reply")[-1]["message"] == OUTDATED

    run(test)


def test_stop_in_a_late_sentence_still_stops() -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        user = rig.listen("commands")
        identifier = talk.begin()
        rig.send(cancel=True)
        talk.begin()
        user.turn_heard(identifier, "do not stop")
        await settle()
        assert rig.bridge.log.count(STOPPED) == 1

    run(test)


def test_stop_is_engaged_once_by_spotter_and_sentence() -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        user = rig.listen("commands")
        identifier = talk.begin()
        user.stop_heard("stop", identifier)
        talk.end(identifier, "stop")
        await settle()
        assert rig.bridge.log.count(STOPPED) == 1
        assert rig.messages("stop_heard") == ["stop"] and rig.messages("heard") == []

    run(test)


def test_stop_that_the_spotter_finds_last_is_told_once() -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        user = rig.listen("commands")
        identifier = talk.begin()
        talk.end(identifier, "Stop.")
        user.stop_heard("Stop.", identifier)
        await settle()
        assert rig.bridge.log.count(STOPPED) == 2, "each report engages the stop"
        assert rig.messages("stop_heard") == ["Stop."] and rig.messages("heard") == []
        user.stop_heard("Stop.", talk.begin())
        assert rig.messages("stop_heard") == ["Stop."] * 2, "that of another turn is told"

    run(test)


@pytest.mark.parametrize(("later_s", "told"), [(0.0, 1), (60.0, 2)])
def test_stop_outside_turns_is_told_once(monkeypatch: pytest.MonkeyPatch, later_s: float, told: int) -> None:
    async def test(rig: Rig) -> None:
        user = rig.listen("stops")
        user.stop_heard("stop", "")
        loop = asyncio.get_running_loop()
        now_s = loop.time()
        monkeypatch.setattr(loop, "time", lambda: now_s + later_s)
        user.stop_heard("stop", "")
        assert len(rig.messages("stop_heard")) == told

    run(test)


def test_late_stop_of_a_turn_is_not_that_of_the_next() -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        user = rig.listen("commands")
        first, second = talk.begin(), talk.begin()
        user.stop_heard("stop", first)
        assert rig.bridge.log.count(STOPPED) == 0
        await settle()
        assert rig.bridge.log.count(STOPPED) == 1
        user.turn_heard(first, "stop")  # the same one, in the whole sentence
        await settle()
        assert rig.bridge.log.count(STOPPED) == 1
        user.turn_heard(second, "stop")
        await settle()
        assert rig.bridge.log.count(STOPPED) == 2

    run(test)


def test_typed_stop_does_not_wait_and_drops_what_waits() -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        rig.send(say={"id": "a", "text": "lights blue"})
        for number in range(MAX_SENTENCES + 5):
            rig.send(say={"id": f"b{number}", "text": DRIVE})
        assert {"b24"} <= {reply["id"] for reply in rig.messages("reply") if reply["message"] == TOO_MANY}
        assert (await talk.type("stop"))["call"]["tool"] == "engage_estop"
        for _, done in rig.bridge.calls:
            done(True, {"status": True})
        await settle()
        assert STOPPED in rig.bridge.log and 0.2 not in rig.bridge.log
        assert [reply["id"] for reply in rig.messages("reply") if reply["message"] != TOO_MANY] == ["said 1"]

    run(test)


@pytest.mark.parametrize("after", [{"cancel": True}, {"call": {"id": "1", "name": "arm_stop"}}], ids=["cancel", "arm-stop"])
def test_typed_stop_survives_what_comes_with_it(after: dict[str, Any]) -> None:
    async def test(rig: Rig) -> None:
        rig.send(say={"id": "a", "text": "stop"})
        rig.send(**after)
        await settle()
        assert STOPPED in rig.bridge.log and rig.messages("reply")[0]["id"] == "a"

    run(test)


@pytest.mark.parametrize("is_spoken", [False, True], ids=["typed", "spoken"])
@pytest.mark.parametrize("text", ["press the e-stop", "freeze the arm"])
def test_sentence_that_stops_waits_for_no_other(text: str, is_spoken: bool) -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        rig.listen("commands")
        rig.send(say={"id": "waits", "text": "lights blue"})
        await settle()
        waiting = [service for service, _ in rig.bridge.calls]
        assert waiting == [graph.LEDS_SET.name]
        if is_spoken:
            talk.end(talk.begin(), text)
        else:
            rig.send(say={"id": "stops", "text": text})
        await settle()
        called = [service for service, _ in rig.bridge.calls][len(waiting) :]
        assert STOPPED in rig.bridge.log if "e-stop" in text else graph.ARM_LIBRARY_STOP.name in called

    run(test)


def test_stop_in_a_turn_ends_that_turn_for_the_listener() -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        user = rig.listen("commands")
        user.stop_heard("stop", talk.begin())
        assert rig.listener.sent[-1] == (Kind.BEGIN, b"")

    run(test)


@pytest.mark.parametrize("how", ["typed", "button"])
def test_yes_that_came_before_the_read_back_confirms_nothing(how: str) -> None:
    async def test(rig: Rig) -> None:
        rig.send(say={"id": "a", "text": "go to x 1 y 2"})
        rig.send(**({"say": {"id": "b", "text": "yes"}} if how == "typed" else {"answer": {"id": "b", "agrees": True}}))
        await settle()
        assert rig.messages("reply")[0]["read_back"] and graph.GOAL_POSE.name not in rig.bridge.log
        assert (await Talk(rig).press(True))["done"]

    run(test)


def test_typed_sentence_is_dropped_if_the_operator_speaks() -> None:
    async def test(rig: Rig) -> None:
        rig.listen("commands")
        rig.send(say={"id": "a", "text": DRIVE})
        Talk(rig).begin()
        await settle()
        assert 0.2 not in rig.bridge.log and rig.messages("reply")[-1]["message"] == OUTDATED

    run(test)


def test_turn_that_began_before_the_listener_is_reported() -> None:
    async def test(rig: Rig) -> None:
        rig.listener.state = ListenerState("starting")
        user = rig.listen("commands")
        rig.send(turn={"id": "x", "by": "speech", "ended": False})
        user.listener_changed(ListenerState("ready"))
        rig.send(turn={"id": "x", "by": "speech", "ended": True})
        assert rig.messages("heard")[-1]["problem"]

    run(test)


def test_turn_that_a_listener_takes_along_is_reported() -> None:
    async def test(rig: Rig) -> None:
        user = rig.listen("commands")
        rig.send(turn={"id": "x", "by": "speech", "ended": False})
        rig.send(turn={"id": "x", "by": "speech", "ended": True})
        user.listener_changed(ListenerState("failed", "a reason"))
        assert rig.messages("heard")[-1]["id"] == "x"

    run(test)


@pytest.mark.parametrize("state", ["starting", "failed", "missing"])
def test_speech_without_a_listener_says_why(state: str) -> None:
    async def test(rig: Rig) -> None:
        rig.listener.state = ListenerState(state, "a reason")
        rig.listen("commands")
        rig.send(turn={"id": "x", "by": "speech", "ended": False})
        rig.send(turn={"id": "x", "by": "speech", "ended": True})
        assert rig.messages("heard") == [{"id": "x", "text": "", "problem": "a reason"}]

    run(test)


def test_turns_in_speech_are_marked_for_the_listener() -> None:
    async def test(rig: Rig) -> None:
        rig.listen("commands")
        for ended in (False, True, False):
            rig.send(turn={"id": "x", "by": "speech", "ended": ended})
        assert [kind for kind, _ in rig.listener.sent if kind is not Kind.SETUP] == [Kind.BEGIN, Kind.END]

    run(test)


def test_turns_of_a_model_are_not_recognized() -> None:
    async def test(rig: Rig) -> None:
        rig.listen("stops")
        rig.send(turn={"id": "x", "by": "speech", "ended": False})
        rig.send(turn={"id": "x", "by": "speech", "ended": True})
        assert rig.messages("heard") == [] and Kind.END not in [kind for kind, _ in rig.listener.sent]

    run(test)


async def hear_reply(rig: Rig, text: str) -> list[bytes]:
    await Talk(rig).speak(text)
    while asyncio.all_tasks() - {asyncio.current_task()}:
        await asyncio.sleep(0.001)
    return rig.sounds


def test_reply_is_spoken_without_words_for_stopping() -> None:
    async def test(rig: Rig) -> None:
        rig.listen("commands")
        assert await hear_reply(rig, "go to x 1 y 2") == [rig.messages("reply")[-1]["message"].encode()]
        rig.sounds.clear()
        assert await hear_reply(rig, "speak all must stop here") == []

    run(test)


def test_computer_without_speech_output_shows_the_text(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(**_: float) -> FakeSpeaker:
        raise SpeechUnavailable("no espeak-ng")

    monkeypatch.setattr(voice_offline, "Speaker", fail)

    async def test(rig: Rig) -> None:
        rig.listen("commands")
        assert await hear_reply(rig, "go to x 1 y 2") == [] and rig.messages("reply")[-1]["message"]

    run(test)


@pytest.mark.parametrize(
    ("message", "problem"),
    [
        ({"say": {"id": "1"}}, BAD_SAY),
        ({"say": {"id": "1", "text": ""}}, BAD_SAY),
        ({"say": {"id": "1", "text": "x" * (MAX_TEXT + 1)}}, BAD_SAY),
        ({"say": {"id": "1", "text": "yes", "language": "xx"}}, BAD_SAY),
        ({"say": {"text": "yes"}}, "expected an object with an id"),
        ({"answer": {"id": "1", "agrees": "yes"}}, BAD_ANSWER),
        ({"answer": None}, "expected an object with an id"),
    ],
)
def test_malformed_sentence_is_refused(message: dict[str, Any], problem: str) -> None:
    async def test(rig: Rig) -> None:
        rig.send(**message)
        assert problem in rig.sent[-1]["error"]

    run(test)


def test_failure_to_read_names_is_logged(monkeypatch: pytest.MonkeyPatch) -> None:
    async def fail(_: VoiceSession) -> Names:
        raise KeyError("a defect")

    async def test(rig: Rig) -> None:
        monkeypatch.setattr(VoiceSession, "read_names", fail)
        assert (await Talk(rig).type(DRIVE))["done"]
        assert "a defect" in str(rig.bridge.log)

    run(test)
