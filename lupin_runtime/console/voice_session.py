"""One voice session: handles the client's messages, and carries out its calls one after the other; stops do not wait."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

from lupin_runtime.console.authority import Session
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.command_era import Refusal
from lupin_runtime.console.encoding import json_frame, to_json
from lupin_runtime.console.outbox import Frame
from lupin_runtime.console.robot_watch import RobotWatch
from lupin_runtime.console.short_text import short_repr
from lupin_runtime.console.voice_robot import ChangeLocation, ConsoleRobot
from lupin_runtime.json_text import parse_json
from lupin_runtime.voice.envelope import Call, Envelope, Rejected
from lupin_runtime.voice.executor import Executor
from lupin_runtime.voice.tools import Effect
from lupin_runtime.voice.turns import TurnKind
from lupin_runtime.voice.untrusted import clean

INTERRUPTED = "interrupted: the operator or a stop came before it was done; ask for the state before going on"
MAX_WAITING = 100  # calls; beyond that nothing more is read from the client
_MAX_ID = 200
_MAX_MESSAGE = 100_000


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
        self.push_state()

    @property
    def is_overloaded(self) -> bool:
        """Whether so many calls are waiting that nothing more should be read."""
        return len(self._tasks) >= MAX_WAITING

    def close(self) -> None:
        """Drop what waits, end the burst, and leave the bridge."""
        for task in self._tasks:
            task.cancel()
        self._robot.close()

    def handle(self, text: str | bytes) -> None:
        """Handle a message from the client. Never raises, whatever it contains."""
        try:
            self._handle(text)
        except ValueError as error:
            self._send({"error": str(error)})

    def _handle(self, text: str | bytes) -> None:
        if len(text) > _MAX_MESSAGE:
            raise BadMessage(f"a message may have {_MAX_MESSAGE} characters")
        message = parse_json(text)
        if not isinstance(message, dict) or len(message) != 1:
            raise BadMessage("a message must be an object with one of turn, call, cancel, alive")
        [(kind, body)] = message.items()
        if kind == "turn":
            self._announce_turn(body)
        elif kind == "call":
            self._receive_call(body)
        elif kind == "cancel":
            self._bridge.record(self._session.name, "voice cancel")
            self._envelope.cancel()
            self._interrupt()
            self._robot.stop_wheels()
            self.push_state()
        elif kind != "alive":
            raise BadMessage(f"unknown message {short_repr(kind)}; expected turn, call, cancel or alive")

    def _announce_turn(self, body: Any) -> None:
        identifier, ended = _identifier(body), body.get("ended", True)
        kinds = {kind.value: kind for kind in TurnKind}
        by = body.get("by")
        if not isinstance(by, str) or by not in kinds or not isinstance(ended, bool):
            raise BadMessage(f"a turn must have by: one of {', '.join(kinds)}, and ended: true or false")
        self._envelope.turns.announce(identifier, kinds[by], ended=ended)
        self.push_state()

    # -- calls --------------------------------------------------------------------------------------------------------
    def _receive_call(self, body: Any) -> None:
        identifier, name, values = _identifier(body), body.get("name"), body.get("arguments", {})
        call = self._envelope.admit(name, values)
        if isinstance(call, Rejected):
            self._reject(identifier, name, values, call)
        else:
            if call.tool.effect is Effect.STOP:
                self._envelope.cancel()
                self._interrupt()
            elif call.tool.needs_control and self._envelope.turns.is_answerable:
                self._robot.take_control()
            self._start(identifier, call, values)
        self.push_state()

    def _start(self, identifier: str, call: Call, values: Any) -> None:
        def finish(done: asyncio.Task[None]) -> None:
            del self._tasks[done]
            if done.cancelled():  # perhaps before it began
                self._record(call.tool.name, values, INTERRUPTED)
                self._answer(identifier, call.tool.name, {"ok": False, "error": INTERRUPTED})
            elif (error := done.exception()) is not None:
                self._bridge.log_request(self._session, "error", f"voice {call.tool.name}: {error!r}")
                self._answer(identifier, call.tool.name, {"ok": False, "error": "the console failed; see its log"})
            self.push_state()

        task = asyncio.ensure_future(self._carry_out(identifier, call, values, self._robot.command_refusal()))
        self._tasks[task] = call
        task.add_done_callback(finish)

    def _interrupt(self) -> None:
        """Drop the commands that wait or are being carried out, so that none moves the robot after a stop."""
        for task, call in self._tasks.items():
            if call.tool.needs_control:
                task.cancel()

    async def _carry_out(self, identifier: str, call: Call, values: Any, arrived: Refusal) -> None:
        name = call.tool.name
        if call.tool.effect is Effect.STOP:
            self._record(name, call.arguments)
            self._answer(identifier, name, await self._executor.carry_out(name, call.arguments))
            return
        async with self._order:
            verdict = self._envelope.judge(call, await self._robot.situation(call.tool, arrived))
            if isinstance(verdict, Rejected) and verdict.is_read_back:
                unknown = await self._executor.find_unknown_name(name, call.arguments)
                if unknown is not None:
                    self._envelope.cancel()
                    verdict = Rejected(unknown)
            if isinstance(verdict, Rejected):
                self._reject(identifier, name, values, verdict)
            else:
                self._record(name, verdict)
                self._answer(identifier, name, await self._executor.carry_out(name, verdict))

    def _reject(self, identifier: str, name: Any, values: Any, rejected: Rejected) -> None:
        self._record(name, values, rejected.reason)
        self._answer(identifier, name, rejected.result)
        if rejected.cut_off and not self._state["cut_off"]:
            if self._robot.is_driving:
                self._robot.stop_wheels()
            self._send({"cut_off": rejected.cut_off})

    def _record(self, name: Any, arguments: Any, refused: str = "") -> None:
        # The arguments belong to what was asked: the journal only counts what the same session repeats within a second.
        called = name if isinstance(name, str) else short_repr(name)
        self._bridge.record(self._session.name, f"voice {called[:_MAX_ID]} {short_repr(arguments)}", refused=refused)

    # -- to the client ------------------------------------------------------------------------------------------------
    def _answer(self, identifier: str, name: Any, response: dict[str, Any]) -> None:
        self._send({"result": {"id": identifier, "name": clean(name), "response": response}})

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
