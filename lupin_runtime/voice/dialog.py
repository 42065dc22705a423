"""A dialog without a model: each sentence becomes a call, an answer to a read-back, or a question to the operator."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

from lupin_runtime.voice.envelope import CONFIRM_WITHIN_S
from lupin_runtime.voice.grammar import parse
from lupin_runtime.voice.language import Language
from lupin_runtime.voice.questions import ASK
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.tools import CONFIRMATION
from lupin_runtime.voice.utterance import Call, Confirmation, Context, Question

CANCELED = "canceled; nothing was done"
NOTHING_READ_BACK = "nothing waits for an answer any more"
_LONG_RESULT = 400
# What each tool with an action `start` is called in a sentence, and the actions that end it.
_ENDS = {"arm_record": ("save", "cancel"), "calibrate_arm": ("commit", "cancel")}
_CHANGES_NAMES = ("save_named_location", "arm_save_pose", "arm_record")


class Agent(Protocol):
    """The console, as the dialog uses it."""

    @property
    def state(self) -> Mapping[str, Any]:
        """The state of the session, as the console sent it."""

    async def announce_turn(self, identifier: str, by: str, *, ended: bool = True) -> None:
        """Announce that the operator begins a turn, or ends the one with this id."""

    async def call(self, tool: str, arguments: dict[str, Any]) -> dict[str, Any]:
        """Call a tool, and return its response."""

    async def interrupt(self) -> None:
        """Forget what was read back, and drop what waits."""


@dataclass(frozen=True)
class Turn:
    """A sentence of the operator: how it came, `text`, `speech` or `button`, and the id of its turn."""

    sentence: str
    by: str
    identifier: str


@dataclass(frozen=True)
class Reply:
    """What came of a sentence. `text` is for people, `read_back` what waits for a yes, `response` the console's answer."""

    sentence: str
    text: str
    is_done: bool
    call: Call | None = None
    response: Mapping[str, Any] | None = None
    read_back: str = ""
    nearest: tuple[str, ...] = ()

    def as_object(self) -> dict[str, Any]:
        """Return it for --json."""
        call = {"tool": self.call.tool, "arguments": dict(self.call.arguments)} if self.call else None
        return {
            "sentence": self.sentence,
            "done": self.is_done,
            "call": call,
            "read_back": self.read_back or None,
            "response": None if self.response is None else dict(self.response),
            "message": self.text,
            "nearest": list(self.nearest),
        }


class Dialog:
    """Handles the sentences of one operator in a language. Without an agent, calls are shown and not sent."""

    def __init__(
        self, agent: Agent | None, language: Language, names: Names, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._agent = agent
        self._now_s = now_s
        self._asked_s = 0.0  # when something was read back
        self.language = language
        self._context = Context(names)
        self._token = ""

    @property
    def names(self) -> Names:
        """The names that sentences may use."""
        return self._context.names

    @property
    def waits_for_answer(self) -> bool:
        """Whether a call was read back, and waits for a yes."""
        return self._context.pending is not None

    @property
    def read_back(self) -> str:
        """The token of what was read back; empty if nothing was."""
        return self._token

    def understand(self, sentence: str, language: Language | None = None) -> Call | Confirmation | Question:
        """Return what a sentence asks for, in the dialog's language or another one."""
        return parse(sentence, self._context, language or self.language)

    async def handle(self, turn: Turn, answers: str | None = None) -> Reply:
        """Do what a sentence asks for. A yes counts only for what was read back with the token `answers`, if that is given."""
        self._forget_in_time()
        if self._agent is not None:
            self._context = replace(self._context, speed_cap=float(self._agent.state.get("speed_cap", 1.0)))
        understood = self.understand(turn.sentence)
        if isinstance(understood, Question):
            return await self._ask(turn, understood)
        if isinstance(understood, Call):
            self.forget()
            return await self._send(turn, understood)
        return await self.answer(turn, understood, answers)

    async def stop(self, turn: Turn) -> Reply:
        """Engage the e-stop, and forget what was read back. Another sentence may be in work meanwhile."""
        self.forget()
        call = Call("engage_estop")
        if self._agent is None:
            return _show_call(turn, call)
        response = await self._agent.call(call.tool, {})
        return Reply(turn.sentence, describe(call.tool, response), bool(response.get("ok")), call, response)

    async def _ask(self, turn: Turn, question: Question) -> Reply:
        pending = self._context.pending
        if pending is not None and turn.by == "speech":
            # The sentence was a turn, and a confirmation must come in the next one: read back again.
            again = await self._send(turn, pending, ASK)
            return replace(again, text=f"{_sentence(question.reason)} {again.text}")
        if pending is None and question.meant is not None:
            return await self._send(turn, question.meant, ASK)
        hint = f" Say, for example: {'; '.join(question.nearest)}." if question.nearest else ""
        return Reply(turn.sentence, f"{_sentence(question.reason)}{hint}", False, nearest=question.nearest)

    async def answer(self, turn: Turn, answer: Confirmation, answers: str | None = None) -> Reply:
        """Carry out what was read back, or forget it. A yes counts only for the token `answers`, if that is given."""
        self._forget_in_time()
        pending, token = self._context.pending, self._token
        if pending is None or (answer.agrees and answers not in (None, token)):
            return Reply(turn.sentence, NOTHING_READ_BACK, False)
        self.forget()
        if answer.agrees:
            return await self._send(turn, pending, token)
        if self._agent is not None:
            await self._agent.interrupt()
        return Reply(turn.sentence, CANCELED, False, pending)

    def forget(self) -> None:
        """Forget what was read back, as the console does at a stop."""
        self._context, self._token = replace(self._context, pending=None), ""

    def _forget_in_time(self) -> None:
        if self._now_s() - self._asked_s > CONFIRM_WITHIN_S:
            self.forget()

    async def _send(self, turn: Turn, call: Call, confirmation: str = "") -> Reply:
        """Send a call with a confirmation, which is ASK for one that must be read back."""
        if self._agent is None:
            return _show_call(turn, call, is_asked=confirmation == ASK)
        await self._agent.announce_turn(turn.identifier, turn.by)
        given = {CONFIRMATION.name: confirmation} if confirmation else {}
        response = await self._agent.call(call.tool, {**call.arguments, **given})
        if response.get("confirm"):
            self._context, self._asked_s = replace(self._context, pending=call), self._now_s()
            self._token = str(response[CONFIRMATION.name])
            sentence = str(response["confirm"])
            return Reply(turn.sentence, f"{_sentence(sentence)} Yes or no?", False, call, response, sentence)
        if response.get("ok"):
            self._note(call)
            if call.tool in _CHANGES_NAMES:
                await self.load_names()
        return Reply(turn.sentence, describe(call.tool, response), bool(response.get("ok")), call, response)

    def _note(self, call: Call) -> None:
        action = call.arguments.get("action")
        if action == "start":
            self._context = replace(self._context, running=call.tool)
        elif action in _ENDS.get(call.tool, ()):
            self._context = replace(self._context, running="")

    async def load_names(self) -> None:
        """Ask the console for the names that exist. Those of the arm are missing without its library."""
        assert self._agent is not None, "names of a dry run are given"
        locations = await self._agent.call("list_named_locations", {})
        self.use_names(names_in(locations, await self._agent.call("arm_list_library", {})))

    def use_names(self, names: Names) -> None:
        """Let sentences use these names from now on."""
        self._context = replace(self._context, names=names)


def names_in(locations: Mapping[str, Any], library: Mapping[str, Any]) -> Names:
    """Return the names in the responses of `list_named_locations` and `arm_list_library`."""
    return Names(
        tuple(_plain(each["name"]) for each in locations.get("locations", ())),
        tuple(_plain(name) for name in library.get("poses", ())),
        tuple(_plain(name) for name in library.get("sequences", ())),
    )


def _show_call(turn: Turn, call: Call, *, is_asked: bool = False) -> Reply:
    arguments = json.dumps(dict(call.arguments), ensure_ascii=False)
    what = "would ask before it calls" if is_asked else "would call"
    return Reply(turn.sentence, f"{what} {call.tool} {arguments}", not is_asked, call)


def describe(tool: str, response: Mapping[str, Any]) -> str:
    """Return the response to a call in words."""
    if not response.get("ok"):
        reasons = "; ".join(_plain(reason) for reason in response.get("reasons", ()))
        return (
            f"{tool} was not done: {_plain(response.get('error', 'no reason was given'))}{f' ({reasons})' if reasons else ''}"
        )
    fields = ", ".join(f"{name} {_plain(value)}" for name, value in response.items() if name not in ("ok", "action"))
    return f"{tool}: {fields or 'done'}"[:_LONG_RESULT]


def _plain(value: Any) -> str:
    """Return a value of a response as text; a text of the robot is `{"untrusted": TEXT}`."""
    if isinstance(value, dict) and "untrusted" in value:
        return str(value["untrusted"])
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, dict):
        return " ".join(f"{name} {_plain(each)}" for name, each in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(_plain(each) for each in value) or "none"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('?') else '.'}"
