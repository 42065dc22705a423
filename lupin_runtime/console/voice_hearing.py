"""What a voice session hears of its page's microphone: it checks the sound, and passes it to the console's listener."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable, Iterable
from typing import Any

from lupin_runtime.console.authority import Role, Session
from lupin_runtime.console.voice_listener import ListenerState, VoiceListener
from lupin_runtime.voice.endpointer import FRAME_BYTES, EndpointerSettings
from lupin_runtime.voice.listener_protocol import Kind
from lupin_runtime.voice.slots import Names

MODES = ("off", "stops", "commands")
FRAMES_PER_S = 25.0  # a microphone sends 20
MAX_NAMES = 10_000  # characters
MAX_BURST = 60  # frames that may come at once, after a network that was away

# Reasons of refusals.
IS_VIEWER = "{name} is a viewer, whose microphone is not listened to; to be heard, pair this browser as operator"
NOT_LISTENING = "the console does not listen to this page; send listen first"
BAD_FRAME = f"a frame has {FRAME_BYTES} bytes: 50 ms of 16 kHz mono PCM-16; others are dropped"
FLOOD = "frames came faster than a microphone sends them, and are dropped"
BAD_LISTEN = f"listen must have mode: one of {', '.join(MODES)}, and start_level and end_level: numbers from 0 to 1, or neither"


class BadSound(ValueError):
    """Sound or a request to listen that is refused; the text says why."""


class Hearing:
    """The microphone of one session. For the event loop only.

    `changed` is called when `state` has changed, `stop` with what was heard when it had a word for stopping and with the id of
    its turn, and `turn` with the id and the text of a turn.
    """

    def __init__(
        self,
        session: Session,
        listener: VoiceListener,
        changed: Callable[[], None],
        stop: Callable[[str, str], None],
        turn: Callable[[str, str], None],
    ) -> None:
        self.session = session
        self.mode = "off"
        self.state = ListenerState()
        self._listener = listener
        self._changed = changed
        self._stop = stop
        self._turn = turn
        self._setup: dict[str, Any] = {"names": {}}
        self._begun = ""  # id of the turn in speech that the listener hears
        self._awaited = ""  # id of the turn in speech that it recognizes
        self._allowance = 0.0  # frames that may come now
        self._counted_s = 0.0
        self._problems: set[str] = set()  # that were reported since it listens: a flood must not be answered by another

    @property
    def hears_turns(self) -> bool:
        """Whether turns in speech are recognized."""
        return self.mode == "commands" and self.state.name == "ready"

    def close(self) -> None:
        """Stop listening."""
        self._listener.stop(self)
        self.mode = "off"

    def listen(self, body: Any) -> None:
        """Begin to listen, or stop, as a page asks. Raises BadSound."""
        fields = body if isinstance(body, dict) else {}
        mode, defaults = fields.get("mode"), EndpointerSettings()
        start, end = fields.get("start_level", defaults.start_level), fields.get("end_level", defaults.end_level)
        if mode not in MODES or not _is_level(start) or not _is_level(end):
            raise BadSound(BAD_LISTEN)
        if mode == "off":
            self.close()
            self.listener_changed(ListenerState())
            return
        if self.session.role is not Role.OPERATOR:
            raise BadSound(IS_VIEWER.format(name=self.session.name))
        self.mode = mode
        self._problems.clear()
        if self.state.name not in ("starting", "ready"):
            self._allowance, self._counted_s = float(MAX_BURST), asyncio.get_running_loop().time()
            self.listener_changed(self._listener.start(self))
        self._setup |= {"start_level": start, "end_level": min(start, end)}
        self._listener.send(self, Kind.SETUP, json.dumps(self._setup, ensure_ascii=False).encode())

    def expect(self, names: Names) -> None:
        """Let commands have these names."""
        kinds = {"locations": names.locations, "poses": names.poses, "sequences": names.sequences}
        setup = {**self._setup, "names": {kind: _some(each) for kind, each in kinds.items()}}
        if setup != self._setup:
            self._setup = setup
            self._listener.send(self, Kind.SETUP, json.dumps(setup, ensure_ascii=False).encode())

    def take(self, frame: bytes) -> None:
        """Take a frame of the page. Raises BadSound, once for each kind of problem."""
        if self.mode == "off":
            self._refuse(NOT_LISTENING)
        elif len(frame) != FRAME_BYTES:
            self._refuse(BAD_FRAME)
        elif not self._may_come():
            self._refuse(FLOOD)
        else:
            self._listener.send(self, Kind.SOUND, frame)

    def begin_turn(self, identifier: str) -> None:
        """Note that a turn in speech begins."""
        self._begun = identifier if self.hears_turns else ""
        if self.hears_turns:
            self._listener.send(self, Kind.BEGIN, identifier.encode())

    def drop_turn(self) -> None:
        """Note that the turn in speech does not count any more: what is said from now on belongs to none."""
        if self._begun:
            self._begun = ""
            self._listener.send(self, Kind.BEGIN, b"")

    def end_turn(self, identifier: str) -> bool:
        """Note that a turn in speech has ended; return whether it will be recognized."""
        is_heard = self.hears_turns and self._begun == identifier
        if is_heard:
            self._begun, self._awaited = "", identifier
            self._listener.send(self, Kind.END, identifier.encode())
        return is_heard

    # -- ListenerUser ---------------------------------------------------------------------------------------------------
    def listener_changed(self, state: ListenerState) -> None:
        """The listener is in another state."""
        self.state = state
        self._changed()
        if state.name not in ("starting", "ready") and self._awaited:
            self.turn_heard(self._awaited, "")

    def stop_heard(self, text: str, turn: str) -> None:
        """A word for stopping was heard, in the turn with this id; empty if in none, or in several."""
        self._stop(text, turn)

    def turn_heard(self, identifier: str, text: str) -> None:
        """A turn was recognized."""
        self._awaited = ""
        self._turn(identifier, text)

    def _may_come(self) -> bool:
        now_s = asyncio.get_running_loop().time()
        self._allowance = min(float(MAX_BURST), self._allowance + (now_s - self._counted_s) * FRAMES_PER_S)
        self._counted_s = now_s
        if self._allowance < 1.0:
            return False
        self._allowance -= 1.0
        return True

    def _refuse(self, problem: str) -> None:
        if problem not in self._problems:
            self._problems.add(problem)
            raise BadSound(problem)


def _some(names: Iterable[str]) -> list[str]:
    """Return as many names as one message may have."""
    kept: list[str] = []
    length = 0
    for name in names:
        length += len(name)
        if length > MAX_NAMES:
            break
        kept.append(name)
    return kept


def _is_level(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and 0.0 <= value <= 1.0
