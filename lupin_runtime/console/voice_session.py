"""One voice session: handles the client's messages, and carries out its calls one after the other; stops do not wait."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from lupin_runtime.console.authority import Session
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.command_era import Refusal
from lupin_runtime.console.encoding import json_frame, to_json
from lupin_runtime.console.outbox import Frame
from lupin_runtime.console.robot_watch import RobotWatch
from lupin_runtime.console.short_text import short_repr
from lupin_runtime.console.voice_hearing import Hearing
from lupin_runtime.console.voice_listener import VoiceListener
from lupin_runtime.console.voice_offline import OfflineAgent
from lupin_runtime.console.voice_robot import ChangeLocation, ConsoleRobot
from lupin_runtime.json_text import parse_json
from lupin_runtime.voice.dialog import names_in
from lupin_runtime.voice.envelope import Call, Envelope, Rejected
from lupin_runtime.voice.executor import Executor
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.tools import BY_NAME, Effect
from lupin_runtime.voice.turns import TurnKind
from lupin_runtime.voice.untrusted import clean

INTERRUPTED = "interrupted: the operator or a stop came before it was done; ask for the state before going on"
REFUSED_BY_PAGE = "by the page: {reason}"
PAGE_CLOSED = "this page may not move the robot yet: the operator must hold its release button first"
SAME_WORD_S = 5.0  # within which the spotter and the recognizer may both report one word for stopping
MAX_WAITING = 100  # calls; beyond that nothing more is read from the client
_KINDS = "turn, call, cancel, alive, closed, listen, say, answer, refused"
_MAX_ID = 200
_MAX_MESSAGE = 100_000


Answer = Callable[[dict[str, Any]], None]


class BadMessage(ValueError):
    """A message that the protocol does not have; the text says what is expected."""


class VoiceSession:
    """The agent of one connection. Used on the event loop; `put` queues a frame for the client."""

    def __init__(
        self,
        session: Session,
        bridge: Bridge,
        envelope: Envelope,
        watch: RobotWatch,
        settings: Callable[[], Mapping[str, Any]],
        change_location: ChangeLocation,
        put: Callable[[Frame], None],
        listener: VoiceListener,
    ) -> None:
        self._session = session
        self._bridge = bridge
        self._envelope = envelope
        self._put = put
        self._robot = ConsoleRobot(session, bridge, envelope, watch, settings, change_location, self.push_state)
        self._executor = Executor(self._robot)
        self._order = asyncio.Lock()
        self._tasks: dict[asyncio.Task[None], Call] = {}
        self._state: dict[str, Any] = {}
        self._told_stop = (-1, -math.inf)  # turn and time of the last spoken stop that the page was told
        self._is_closed = False  # whether the page may not move the robot, as its release button was not held
        self._hearing = Hearing(
            session, listener, self.push_state, self.stop_at_once, lambda identifier, text: self._offline.hear(identifier, text)
        )
        self._offline = OfflineAgent(self, self._hearing, self._send, lambda sound: put(Frame(sound, binary=True)))
        self.push_state()

    @property
    def is_overloaded(self) -> bool:
        """Whether so many calls are waiting that nothing more should be read."""
        return len(self._tasks) >= MAX_WAITING

    def close(self) -> None:
        """Drop what waits, end the burst, and leave the bridge."""
        self._hearing.close()
        self._offline.close()
        for task in self._tasks:
            task.cancel()
        self._robot.close()

    def handle(self, message: str | bytes) -> None:
        """Handle a message from the client, which is a frame of sound if it is binary. Never raises, whatever it contains."""
        try:
            if isinstance(message, bytes):
                self._hearing.take(message)
            else:
                self._handle(message)
        except ValueError as error:
            self._send({"error": str(error)})

    def _handle(self, text: str) -> None:
        if len(text) > _MAX_MESSAGE:
            raise BadMessage(f"a message may have {_MAX_MESSAGE} characters")
        message = parse_json(text)
        if not isinstance(message, dict) or len(message) != 1:
            raise BadMessage(f"a message must be an object with one of {_KINDS}")
        [(kind, body)] = message.items()
        if kind == "turn":
            self._announce_turn(body)
        elif kind == "call":
            self._receive_call(body)
        elif kind == "cancel":
            self._offline.drop()
            self.cancel()
        elif kind == "closed":
            if not isinstance(body, bool):
                raise BadMessage("closed must be true or false")
            self._is_closed = body
        elif kind == "listen":
            self._hearing.listen(body)
            if self._hearing.mode == "commands":
                self._offline.refresh_names()
        elif kind == "say":
            self._offline.say(_identifier(body), body)
        elif kind == "answer":
            self._offline.answer(_identifier(body), body)
        elif kind == "refused":
            self._note_refusal(body)
        elif kind != "alive":
            raise BadMessage(f"unknown message {short_repr(kind)}; expected one of {_KINDS}")

    def _announce_turn(self, body: Any) -> None:
        identifier, ended = _identifier(body), body.get("ended", True)
        kinds = {kind.value: kind for kind in TurnKind}
        by = body.get("by")
        if not isinstance(by, str) or by not in kinds or not isinstance(ended, bool):
            raise BadMessage(f"a turn must have by: one of {', '.join(kinds)}, and ended: true or false")
        before = self.turn
        self.announce(identifier, by, ended=ended)
        if kinds[by] is TurnKind.SPEECH and self.turn != before:
            self._offline.begin_speech(identifier)
        elif kinds[by] is not TurnKind.SPEECH:
            self._hearing.drop_turn()
        if kinds[by] is TurnKind.SPEECH and ended:
            self._offline.end_speech(identifier)

    def _note_refusal(self, body: Any) -> None:
        """Write in the journal what the page itself has refused."""
        name, reason = (body.get("name"), body.get("reason")) if isinstance(body, dict) else (None, None)
        if not isinstance(name, str) or not isinstance(reason, str):
            raise BadMessage("refused must be an object with a name and a reason, which are texts, and perhaps arguments")
        self._record(clean(name), body.get("arguments", {}), REFUSED_BY_PAGE.format(reason=clean(reason)))

    # -- SessionCalls ---------------------------------------------------------------------------------------------------
    @property
    def state(self) -> Mapping[str, Any]:
        """The state of the session, as the client has it."""
        return self._state

    @property
    def turn(self) -> int:
        """The number of the present turn."""
        return self._envelope.turns.number

    def announce(self, identifier: str, by: str, *, ended: bool) -> None:
        """Begin or end a turn of the operator."""
        self._envelope.turns.announce(identifier, TurnKind(by), ended=ended)
        self.push_state()

    def cancel(self) -> None:
        """End the burst, drop what waits, and forget what was read back, as the operator interrupts or says no."""
        self._bridge.record(self._session.name, "voice cancel")
        self._envelope.cancel()
        self._interrupt()
        self._robot.stop_wheels()
        self.push_state()

    def stop_at_once(self, text: str, turn: str) -> None:
        """Engage the stop, as a word for it was heard, in the turn with this id; empty if in none, or in several.

        The page is told once of a word that is reported twice.
        """
        self._offline.drop(stopped=turn)
        self._bridge.record(self._session.name, f"voice stop heard {short_repr(text)}")
        told_turn, told_s = self._told_stop
        now_s = asyncio.get_running_loop().time()
        if self.turn != told_turn or now_s - told_s > SAME_WORD_S:
            self._told_stop = self.turn, now_s
            self._send({"stop_heard": clean(text)})
        self.begin_call("engage_estop", {}, lambda _: None)

    async def read_names(self) -> Names:
        """Return the names that exist, without a call of a tool."""
        locations = await self._executor.carry_out("list_named_locations", {})
        return names_in(locations, await self._executor.carry_out("arm_list_library", {}))

    def log_failure(self, what: str) -> None:
        """Note a defect."""
        self._bridge.log_request(self._session, "error", f"voice: {what}")

    # -- calls --------------------------------------------------------------------------------------------------------
    def _receive_call(self, body: Any) -> None:
        identifier, name = _identifier(body), body.get("name")

        def answer(response: dict[str, Any]) -> None:
            self._send({"result": {"id": identifier, "name": clean(name), "response": response}})

        if isinstance(name, str) and name in BY_NAME and BY_NAME[name].effect is Effect.STOP:
            self._offline.drop()
        self.begin_call(name, body.get("arguments", {}), answer)

    def begin_call(self, name: Any, values: Any, answer: Answer) -> None:
        """Judge a call, and carry it out; `answer` is called once with its response."""
        call = self._envelope.admit(name, values)
        if isinstance(call, Rejected):
            self._reject(answer, name, values, call)
        else:
            if call.tool.effect is Effect.STOP:
                self._envelope.cancel()
                self._interrupt()
            elif call.tool.needs_control and self._envelope.turns.is_answerable:
                self._robot.take_control()
            self._start(answer, call, values)
        self.push_state()

    def _start(self, answer: Answer, call: Call, values: Any) -> None:
        def finish(done: asyncio.Task[None]) -> None:
            del self._tasks[done]
            if done.cancelled():  # perhaps before it began
                self._record(call.tool.name, values, INTERRUPTED)
                answer({"ok": False, "error": INTERRUPTED})
            elif (error := done.exception()) is not None:
                self._bridge.log_request(self._session, "error", f"voice {call.tool.name}: {error!r}")
                answer({"ok": False, "error": "the console failed; see its log"})
            self.push_state()

        task = asyncio.ensure_future(self._carry_out(answer, call, values, self._robot.command_refusal()))
        self._tasks[task] = call
        task.add_done_callback(finish)

    def _interrupt(self) -> None:
        """Drop the commands that wait or are being carried out, so that none moves the robot after a stop."""
        for task, call in self._tasks.items():
            if call.tool.needs_control:
                task.cancel()

    async def _carry_out(self, answer: Answer, call: Call, values: Any, arrived: Refusal) -> None:
        name = call.tool.name
        if call.tool.effect is Effect.STOP:
            self._record(name, call.arguments)
            answer(await self._executor.carry_out(name, call.arguments))
            return
        async with self._order:
            situation = await self._robot.situation(call.tool, arrived)
            if self._is_closed:
                situation = replace(situation, estop=(*situation.estop, PAGE_CLOSED))
            verdict = self._envelope.judge(call, situation)
            if isinstance(verdict, Rejected) and verdict.is_read_back:
                unknown = await self._executor.find_unknown_name(name, call.arguments)
                if unknown is not None:
                    self._envelope.cancel()
                    verdict = Rejected(unknown)
            if isinstance(verdict, Rejected):
                self._reject(answer, name, values, verdict)
            else:
                self._record(name, verdict)
                answer(await self._executor.carry_out(name, verdict))

    def _reject(self, answer: Answer, name: Any, values: Any, rejected: Rejected) -> None:
        self._record(name, values, rejected.reason)
        answer(rejected.result)
        if rejected.cut_off and not self._state["cut_off"]:
            if self._robot.is_driving:
                self._robot.stop_wheels()
            self._send({"cut_off": rejected.cut_off})

    def _record(self, name: Any, arguments: Any, refused: str = "") -> None:
        # The arguments belong to what was asked: the journal only counts what the same session repeats within a second.
        called = name if isinstance(name, str) else short_repr(name)
        self._bridge.record(self._session.name, f"voice {called[:_MAX_ID]} {short_repr(arguments)}", refused=refused)

    # -- to the client ------------------------------------------------------------------------------------------------
    def push_state(self) -> None:
        """Send the state of the session if it has changed."""
        turns = self._envelope.turns
        linear_mps, angular_rps = self._robot.speed_limits
        state = {
            "turn": turns.number,
            "is_speaking": turns.current is not None and not turns.current.ended,
            "cut_off": turns.cut_off,
            "speed_cap": self._envelope.speed_cap,
            "max_linear_mps": linear_mps,
            "max_angular_rps": angular_rps,
            "is_driving": self._robot.is_driving,
            "waiting": len(self._tasks),
            "listener": {"state": self._hearing.state.name, "reason": self._hearing.state.reason},
        }
        if state != self._state:
            self._state = state
            self._send({"state": state})

    def _send(self, message: dict[str, Any]) -> None:
        self._put(json_frame(to_json(message)))


def _identifier(body: Any) -> str:
    identifier = body.get("id") if isinstance(body, dict) else None
    if not isinstance(identifier, str) or not 0 < len(identifier) <= _MAX_ID or not identifier.isprintable():
        raise BadMessage(f"expected an object with an id: text of 1 to {_MAX_ID} printable characters")
    return identifier
