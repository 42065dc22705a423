"""The console's listener is a process that may be missing, hang or die: the console goes on, and the page is told."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from lupin_runtime.console import voice_listener
from lupin_runtime.console.authority import Role, Session
from lupin_runtime.console.voice_listener import (
    MAX_DROPPED,
    MAX_ENDING,
    MAX_EVENTS_PER_S,
    MAX_MARKS,
    NOT_READY,
    STILL_ENDING,
    TAKES_NOTHING,
    ListenerState,
    VoiceListener,
)
from lupin_runtime.voice.listener_protocol import Kind
from lupin_runtime.voice.recognizer import MISSING_PACKAGES
from tests.support.fake_listener import COMMAND, sound_of

READS_NOTHING = (sys.executable, "-c", "import time; print('{\"ready\": true}', flush=True); time.sleep(600)")
DIES = (sys.executable, "-c", "raise SystemExit('out of memory')")
FLOODS = (sys.executable, "-c", 'while True: print(\'{"stop": ""}\')')
NEVER_READY = (sys.executable, "-c", "import time; time.sleep(600)")
TALKS_NONSENSE = (sys.executable, "-c", "print('hello')")


class User:
    """The page that is listened to; notes what it is told."""

    def __init__(self, name: str = "phone-1") -> None:
        self.session = Session(name, Role.OPERATOR)
        self.states: list[ListenerState] = []
        self.heard: list[Any] = []
        self.changed = asyncio.Event()

    def listener_changed(self, state: ListenerState) -> None:
        self.states.append(state)
        self.changed.set()

    def stop_heard(self, text: str, turn: str) -> None:
        self.heard.append((text, turn) if turn else text)
        self.changed.set()

    def turn_heard(self, identifier: str, text: str) -> None:
        self.heard.append((identifier, text))
        self.changed.set()

    async def until(self, condition: Callable[[], Any]) -> None:
        while not condition():
            await self.changed.wait()
            self.changed.clear()

    async def until_state(self, name: str) -> ListenerState:
        await self.until(lambda: self.states and self.states[-1].name == name)
        return self.states[-1]


def run(command: tuple[str, ...] | None, test: Callable[[VoiceListener, User], Awaitable[None]]) -> None:
    async def main() -> None:
        listener = VoiceListener(command)
        try:
            await test(listener, User())
        finally:
            await listener.close()

    asyncio.run(main())


def test_listener_hears_a_turn_and_a_stop() -> None:
    async def test(listener: VoiceListener, user: User) -> None:
        assert listener.start(user) == ListenerState("starting")
        await user.until_state("ready")
        listener.send(user, Kind.BEGIN, b"1")
        for _ in range(4):
            listener.send(user, Kind.SOUND, sound_of("yes"))
        listener.send(user, Kind.END, b"1")
        await user.until(lambda: ("1", "yes") in user.heard)
        while "stop" not in user.heard:
            listener.send(user, Kind.SOUND, sound_of("stop"))
            await asyncio.sleep(0.01)

    run(COMMAND, test)


def test_second_page_is_told_who_is_listened_to() -> None:
    async def test(listener: VoiceListener, user: User) -> None:
        other = User("phone-2")
        listener.start(user)
        assert listener.start(other) == ListenerState("busy", "the console listens to phone-1")
        listener.stop(other)
        await user.until_state("ready")
        listener.stop(user)
        assert listener.start(other).name == "starting"
        await other.until_state("ready")

    run(COMMAND, test)


def test_new_connection_of_a_browser_replaces_its_old_one() -> None:
    async def test(listener: VoiceListener, user: User) -> None:
        listener.start(user)
        again = User()
        assert listener.start(again).name == "starting"
        await again.until_state("ready")
        assert user.states == []

    run(COMMAND, test)


def test_process_that_dies_is_reported_and_can_be_started_again() -> None:
    async def test(listener: VoiceListener, user: User) -> None:
        listener.start(user)
        assert "out of memory" in (await user.until_state("failed")).reason
        listener.send(user, Kind.SOUND, sound_of("yes"))
        assert listener.start(user).name == "starting"
        await user.until(lambda: [state.name for state in user.states] == ["failed"] * 2)

    run(DIES, test)


def test_page_that_asks_again_and_again_starts_few_processes() -> None:
    async def test(listener: VoiceListener, user: User) -> None:
        states = [listener.start(user) for _ in range(100)]
        assert states.count(ListenerState("starting")) == MAX_ENDING + 1
        assert states[-1] == ListenerState("failed", STILL_ENDING)

    run(COMMAND, test)


def test_process_that_floods_is_ended() -> None:
    async def test(listener: VoiceListener, user: User) -> None:
        listener.start(user)
        assert "lines in a second" in (await user.until_state("failed")).reason
        assert len(user.heard) <= MAX_EVENTS_PER_S
        listener.stop(user)
        while listener._ending:
            await asyncio.sleep(0.01)

    run(FLOODS, test)


def test_process_that_never_becomes_ready_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(voice_listener, "START_TIMEOUT_S", 0.1)

    async def test(listener: VoiceListener, user: User) -> None:
        listener.start(user)
        assert (await user.until_state("failed")).reason == NOT_READY

    run(NEVER_READY, test)


def test_process_that_takes_nothing_is_ended() -> None:
    async def test(listener: VoiceListener, user: User) -> None:
        listener.start(user)
        await user.until_state("ready")
        for _ in range(3 * MAX_DROPPED):
            listener.send(user, Kind.SOUND, sound_of("yes"))
            await asyncio.sleep(0)
        assert await user.until_state("failed") == ListenerState("failed", TAKES_NOTHING)

    run(READS_NOTHING, test)


def test_marks_that_nobody_takes_are_limited() -> None:
    async def test(listener: VoiceListener, user: User) -> None:
        listener.start(user)
        for number in range(MAX_MARKS + 1):
            listener.send(user, Kind.BEGIN, str(number).encode())
        assert (await user.until_state("failed")).reason == TAKES_NOTHING

    run(READS_NOTHING, test)


@pytest.mark.parametrize("command", [TALKS_NONSENSE, ("/nowhere/lupin",)])
def test_command_that_is_no_listener_fails(command: tuple[str, ...]) -> None:
    async def test(listener: VoiceListener, user: User) -> None:
        listener.start(user)
        assert (await user.until_state("failed")).reason

    run(command, test)


def test_missing_packages_start_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(voice_listener, "missing_packages", lambda: MISSING_PACKAGES)

    async def test(listener: VoiceListener, user: User) -> None:
        assert listener.start(user) == ListenerState("missing", MISSING_PACKAGES)

    run(None, test)


def test_closed_listener_starts_nothing() -> None:
    async def test(listener: VoiceListener, user: User) -> None:
        await listener.close()
        assert listener.start(user) == ListenerState("off")

    run(COMMAND, test)
