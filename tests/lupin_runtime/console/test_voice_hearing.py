"""Of a page's microphone only well-formed sound of an operator, at the rate of a microphone, reaches the listener."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any, cast

import pytest

from lupin_runtime.console.authority import Role, Session
from lupin_runtime.console.voice_hearing import BAD_FRAME, BAD_LISTEN, FLOOD, MAX_BURST, NOT_LISTENING, BadSound, Hearing
from lupin_runtime.console.voice_listener import ListenerState, VoiceListener
from lupin_runtime.voice.listener_protocol import Kind
from tests.support.fake_listener import SILENCE


class FakeListener:
    """Notes what is asked of it and sent to it."""

    def __init__(self, state: str = "ready") -> None:
        self.state = state
        self.sent: list[tuple[Kind, bytes]] = []
        self.log: list[str] = []

    def start(self, _user: Any) -> ListenerState:
        self.log.append("start")
        return ListenerState(self.state)

    def stop(self, _user: Any) -> None:
        self.log.append("stop")

    def send(self, _user: Any, kind: Kind, payload: bytes) -> None:
        self.sent.append((kind, payload))

    def kinds(self) -> list[Kind]:
        return [kind for kind, _ in self.sent if kind is not Kind.SETUP]


def run(test: Callable[[Hearing, FakeListener], None], role: Role = Role.OPERATOR, state: str = "ready") -> FakeListener:
    listener = FakeListener(state)

    async def main() -> None:
        session = Session("phone-1", role)
        test(Hearing(session, cast(VoiceListener, listener), lambda: None, lambda *_: None, lambda *_: None), listener)

    asyncio.run(main())
    return listener


def test_viewer_is_not_listened_to() -> None:
    def test(hearing: Hearing, _: FakeListener) -> None:
        with pytest.raises(BadSound, match="phone-1 is a viewer"):
            hearing.listen({"mode": "stops"})
        with pytest.raises(BadSound, match=NOT_LISTENING):
            hearing.take(SILENCE)

    assert run(test, Role.VIEWER).log == []


def test_sound_before_listen_is_refused_once() -> None:
    def test(hearing: Hearing, _: FakeListener) -> None:
        with pytest.raises(BadSound, match=NOT_LISTENING):
            hearing.take(SILENCE)
        hearing.take(SILENCE)

    assert run(test).sent == []


def test_frames_of_another_size_are_dropped() -> None:
    def test(hearing: Hearing, _: FakeListener) -> None:
        hearing.listen({"mode": "stops"})
        with pytest.raises(BadSound, match=BAD_FRAME.split(":")[0]):
            hearing.take(SILENCE + b"\0")
        hearing.take(b"")
        hearing.take(SILENCE)

    assert run(test).kinds() == [Kind.SOUND]


def send_flood(hearing: Hearing) -> None:
    for _ in range(1000):
        hearing.take(SILENCE)


def test_flood_of_frames_is_dropped() -> None:
    def test(hearing: Hearing, _: FakeListener) -> None:
        hearing.listen({"mode": "stops"})
        with pytest.raises(BadSound, match=FLOOD):
            send_flood(hearing)
        send_flood(hearing)

    assert len(run(test).kinds()) <= MAX_BURST + 25


@pytest.mark.parametrize(
    "body",
    [
        None,
        [],
        "stops",
        {},
        {"mode": "all"},
        {"mode": "stops", "start_level": "1"},
        {"mode": "stops", "end_level": float("nan")},
    ],
)
def test_malformed_request_to_listen_is_refused(body: Any) -> None:
    def test(hearing: Hearing, _: FakeListener) -> None:
        with pytest.raises(BadSound, match=BAD_LISTEN.split(":")[0]):
            hearing.listen(body)

    assert run(test).log == []


def test_levels_of_the_page_are_passed_on() -> None:
    def test(hearing: Hearing, _: FakeListener) -> None:
        hearing.listen({"mode": "stops", "start_level": 0.01})

    [(kind, payload)] = run(test).sent
    assert kind is Kind.SETUP and json.loads(payload) == {"names": {}, "start_level": 0.01, "end_level": 0.01}


def test_turns_are_marked_only_where_they_are_recognized() -> None:
    def test(hearing: Hearing, _: FakeListener) -> None:
        hearing.listen({"mode": "stops"})
        hearing.begin_turn("1")
        assert not hearing.end_turn("1")
        hearing.listen({"mode": "commands"})
        hearing.begin_turn("2")
        assert hearing.end_turn("2")

    listener = run(test)
    assert listener.kinds() == [Kind.BEGIN, Kind.END] and listener.log == ["start"]


def test_listener_that_failed_is_started_by_the_next_request() -> None:
    def test(hearing: Hearing, listener: FakeListener) -> None:
        hearing.listen({"mode": "stops"})
        hearing.listener_changed(ListenerState("failed", "it ended"))
        hearing.take(SILENCE)
        assert listener.log == ["start"]
        hearing.listen({"mode": "stops"})

    assert run(test).log == ["start", "start"]


def test_page_that_needs_it_no_more_ends_the_listener() -> None:
    def test(hearing: Hearing, _: FakeListener) -> None:
        hearing.listen({"mode": "stops"})
        hearing.listen({"mode": "off"})
        assert hearing.state == ListenerState()

    assert run(test).log == ["start", "stop"]
