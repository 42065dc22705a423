"""Sentences come from lines, sounds and the microphone; the robot's own voice is no command."""

from __future__ import annotations

import asyncio
import os
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.run.voice_sources import Microphone, _Event, read_lines
from lupin_runtime.voice.dialog import Turn
from lupin_runtime.voice.endpointer import Edge, split_frames
from lupin_runtime.voice.speech import SpeechUnavailable

SPOKEN, PAUSE = b"\0\x10" * 8_000, b"\0" * 32_000


async def collect(turns: AsyncIterator[Turn]) -> list[str]:
    return [turn.sentence async for turn in turns]


async def until(condition: Callable[[], bool]) -> None:
    async def wait() -> None:
        while not condition():
            await asyncio.sleep(0.01)

    await asyncio.wait_for(wait(), 20.0)


def test_lines_of_a_pipe_are_read_as_they_come() -> None:
    source, target = os.pipe()
    os.write(target, b"lights blue\n\n  stop \nlast")
    os.close(target)
    with os.fdopen(source) as stream:
        assert asyncio.run(collect(read_lines(stream))) == ["lights blue", "stop", "last"]


def test_lines_of_a_file_are_read(tmp_path: Path) -> None:
    (tmp_path / "lines").write_text("lights blue\nstop")
    with (tmp_path / "lines").open() as stream:
        assert asyncio.run(collect(read_lines(stream))) == ["lights blue", "stop"]


class Heard:
    """A microphone that hears sounds, of which a recognizer makes texts; notes turns and stops."""

    def __init__(self, *texts: str) -> None:
        self.texts = list(texts)
        self.spotted = ""
        self.is_talking = False
        self.turns: list[tuple[str, bool]] = []
        self.stops: list[str] = []
        self.state: dict[str, Any] = {}
        self.problem: SpeechUnavailable | None = None
        self.may_transcribe = threading.Event()  # cleared, sentences take as long as the test wants
        self.may_transcribe.set()
        self.may_end = threading.Event()  # of a microphone that is silent until then

    def transcribe(self, sound: bytes) -> str:
        assert sound and self.may_transcribe.wait(60)
        return self.texts.pop(0)

    def transcribe_window(self, sound: bytes) -> str:
        return self.spotted if sound else ""

    def may_be_halt(self, word: bytes) -> bool:
        return not word

    async def announce_turn(self, identifier: str, by: str, *, ended: bool = True) -> None:
        assert by == "speech"
        self.turns.append((identifier, ended))

    async def call(self, tool: str, arguments: dict[str, Any]) -> dict[str, Any]:
        raise AssertionError(f"{tool} {arguments}")

    async def interrupt(self) -> None:
        raise AssertionError

    async def stop(self, turn: Turn) -> None:
        self.stops.append(turn.sentence)

    def frames(self, sound: bytes) -> Any:
        yield from split_frames(sound)
        if self.problem is not None:
            raise self.problem

    def hold(self) -> Iterator[bytes]:
        assert self.may_end.wait(60)
        yield from ()

    async def hear(self, sound: bytes) -> list[str]:
        microphone = Microphone(self.frames(sound), self, self, self.stop, lambda: self.is_talking)
        return await collect(microphone.turns())


def test_every_sentence_is_a_turn_with_begin_and_end() -> None:
    heard = Heard("lights blue", "")
    assert asyncio.run(heard.hear((SPOKEN + PAUSE) * 2)) == ["lights blue", ""]
    first, second = heard.turns[0][0], heard.turns[2][0]
    assert heard.turns == [(first, False), (first, True), (second, False), (second, True)] and first != second


def test_own_voice_of_the_robot_is_neither_turn_nor_sentence() -> None:
    heard = Heard("turn left ninety degrees")
    heard.is_talking = True
    assert asyncio.run(heard.hear(SPOKEN + PAUSE)) == [] and heard.turns == []


def test_stop_counts_also_while_the_robot_talks() -> None:
    heard = Heard("stop it")
    heard.is_talking = True
    assert asyncio.run(heard.hear(SPOKEN + PAUSE)) == ["stop it"]


def test_stop_is_reported_once_by_spotter_or_sentence() -> None:
    heard = Heard("stop")
    heard.spotted = "stop"
    sentences = asyncio.run(heard.hear(SPOKEN * 6 + PAUSE))
    assert [*sentences, *heard.stops] == ["stop"]


def test_second_stop_of_one_utterance_counts() -> None:
    async def test() -> None:
        heard = Heard()
        microphone = Microphone(iter(()), heard, heard, heard.stop, lambda: False)
        for _ in range(2):
            microphone._post_stop("1", "stop")
        await until(lambda: len(heard.stops) == 2)

    asyncio.run(test())


def test_late_stop_does_not_hide_the_stop_of_the_next() -> None:
    async def test() -> None:
        heard = Heard("what is the battery", "stop it")
        heard.may_transcribe.clear()
        microphone = Microphone(heard.frames((SPOKEN + PAUSE) * 2), heard, heard, heard.stop, lambda: False)
        turns = microphone.turns()
        first = asyncio.ensure_future(anext(turns))
        await until(lambda: len(heard.turns) == 2)  # the first utterance is being recognized, and the second is heard
        microphone._post_stop(heard.turns[0][0], "stop")  # from the spotter, of the first
        heard.may_transcribe.set()
        assert (await first).sentence == "stop it" and heard.stops == ["stop"]

    asyncio.run(test())


@pytest.mark.parametrize("sound", [SPOKEN + PAUSE, SPOKEN * 2], ids=["recognized", "cut off"])
def test_stop_said_just_before_the_loss_is_carried_out(sound: bytes) -> None:
    async def test() -> None:
        heard = Heard("stop the robot")
        heard.may_transcribe.clear()
        heard.problem = SpeechUnavailable("the microphone is lost")
        microphone = Microphone(heard.frames(sound), heard, heard, heard.stop, lambda: False)
        turns = asyncio.ensure_future(collect(microphone.turns()))
        await until(microphone._lost.done)
        heard.may_transcribe.set()
        with pytest.raises(SpeechUnavailable, match="the microphone is lost"):
            await turns
        assert heard.stops == ["stop the robot"]

    asyncio.run(test())


def test_stop_whose_end_comes_with_the_loss_is_carried_out() -> None:
    async def test() -> None:
        heard = Heard("stop the robot")
        microphone = Microphone(heard.hold(), heard, heard, heard.stop, lambda: False)
        turns = asyncio.ensure_future(collect(microphone.turns()))
        microphone._post(_Event("1", Edge.BEGIN))
        await until(lambda: heard.turns == [("1", False)])
        # In one go, so that the loop sees both at once.
        microphone._post(_Event("1", Edge.END, SPOKEN))
        microphone._call(microphone._note_loss, SpeechUnavailable("the microphone is lost"))
        with pytest.raises(SpeechUnavailable, match="the microphone is lost"):
            await turns
        heard.may_end.set()
        assert heard.stops == ["stop the robot"]

    asyncio.run(test())


def test_sentence_that_was_cut_off_is_no_command() -> None:
    async def test() -> None:
        heard = Heard("drive forward")
        heard.problem = SpeechUnavailable("the microphone is lost")
        with pytest.raises(SpeechUnavailable):
            await heard.hear(SPOKEN * 2)
        assert heard.stops == []

    asyncio.run(test())


def test_stop_that_fails_ends_the_session() -> None:
    async def stop(_: Turn) -> None:
        raise OSError("no answer")

    async def test() -> None:
        heard = Heard("lights blue")
        heard.may_transcribe.clear()
        microphone = Microphone(heard.frames(SPOKEN + PAUSE), heard, heard, stop, lambda: False)
        turns = microphone.turns()
        first = asyncio.ensure_future(anext(turns))
        await until(lambda: len(heard.turns) == 2)
        microphone._post_stop("1", "stop")
        with pytest.raises(OSError, match="no answer"):
            await first
        heard.may_transcribe.set()

    asyncio.run(test())


def test_failed_spotter_ends_the_session(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: bytes) -> str:
        raise MemoryError("no memory")

    async def test() -> None:
        heard = Heard("drive forward")
        monkeypatch.setattr(heard, "transcribe_window", fail)
        with pytest.raises(SpeechUnavailable, match="no memory"):
            await collect(Microphone(endless(SPOKEN), heard, heard, heard.stop, lambda: False).turns())

    asyncio.run(test())


def endless(sound: bytes) -> Iterator[bytes]:
    """Yield the frames of a sound again and again, as a microphone does, but faster."""
    while True:
        yield from split_frames(sound)
        time.sleep(0.001)


def test_loss_of_the_microphone_waits_for_no_sentence() -> None:
    async def test() -> None:
        heard = Heard("turn left ninety degrees")
        heard.may_transcribe.clear()
        heard.problem = SpeechUnavailable("the microphone is lost")
        with pytest.raises(SpeechUnavailable, match="the microphone is lost"):
            await heard.hear(SPOKEN + PAUSE)  # while the sentence is still being recognized
        heard.may_transcribe.set()

    asyncio.run(test())


def test_stop_before_the_loss_of_the_microphone_is_carried_out() -> None:
    async def test() -> None:
        heard = Heard()
        microphone = Microphone(iter(()), heard, heard, heard.stop, lambda: False)
        microphone._post_stop("1", "stop")
        microphone._call(microphone._note_loss, SpeechUnavailable("the microphone is lost"))
        with pytest.raises(SpeechUnavailable):
            await collect(microphone.turns())
        assert heard.stops == ["stop"]

    asyncio.run(test())


def test_failure_of_the_microphone_is_raised() -> None:
    heard = Heard()
    heard.problem = SpeechUnavailable("arecord failed")
    with pytest.raises(SpeechUnavailable, match="arecord failed"):
        asyncio.run(heard.hear(b""))
