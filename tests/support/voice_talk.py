"""An operator who types and speaks to a voice session of `voice_rig`, and what speaks to them."""

from __future__ import annotations

from typing import Any

import pytest

from lupin_runtime.console import voice_offline
from lupin_runtime.console.voice_session import VoiceSession
from lupin_runtime.voice.slots import Names
from tests.support.voice_rig import Rig, settle


class FakeSpeaker:
    """Makes sound of a text without espeak-ng."""

    def __init__(self, *, timeout_s: float) -> None:
        assert timeout_s > 0.0

    def synthesize(self, text: str) -> bytes:
        return text.encode()


def replace_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every session have one location, "sink", and a speaker that needs no program."""

    async def read_names(_: VoiceSession) -> Names:
        return Names(("sink",), (), ())

    monkeypatch.setattr(VoiceSession, "read_names", read_names)
    monkeypatch.setattr(voice_offline, "Speaker", FakeSpeaker)


class Talk:
    """An operator who types and speaks to a session."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self._number = 0

    def _identifier(self) -> str:
        self._number += 1
        return f"said {self._number}"

    async def type(self, text: str, language: str = "en") -> dict[str, Any]:
        """Type a sentence; return the reply."""
        self.rig.send(say={"id": self._identifier(), "text": text, "language": language})
        return await self._reply()

    async def press(self, agrees: bool) -> dict[str, Any]:
        """Answer by a button; return the reply."""
        self.rig.send(answer={"id": self._identifier(), "agrees": agrees})
        return await self._reply()

    def begin(self) -> str:
        """Begin to speak; return the id of the turn."""
        identifier = self._identifier()
        self.rig.send(turn={"id": identifier, "by": "speech", "ended": False})
        return identifier

    def end(self, identifier: str, text: str) -> None:
        """End a turn in speech, of which the listener hears this."""
        self.rig.send(turn={"id": identifier, "by": "speech", "ended": True})
        assert self.rig.listener.user is not None
        self.rig.listener.user.turn_heard(identifier, text)

    async def speak(self, text: str) -> dict[str, Any]:
        """Speak a sentence; return the reply."""
        self.end(self.begin(), text)
        return await self._reply()

    async def _reply(self) -> dict[str, Any]:
        await settle()
        reply: dict[str, Any] = self.rig.messages("reply")[-1]
        assert reply["id"] == f"said {self._number}"
        return reply
