"""What the Live server of tests answers with: minds that follow a script, or a small grammar, in place of a model."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol


@dataclass(frozen=True)
class Say:
    """The mind speaks: its words come as a transcript, with a tone as their sound."""

    text: str


@dataclass(frozen=True)
class Call:
    """The mind calls a tool, and goes on with its response."""

    name: str
    arguments: dict[str, Any] = field(default_factory=dict)


Action = Say | Call
Answer = Generator[Action, dict[str, Any], None]


class Mind(Protocol):
    """Answers the turns of one conversation."""

    def answer(self, heard: str) -> Answer:
        """Yield what to say and to call; the response to a call is the value of its `yield`."""


class ScriptedMind:
    """Answers each turn with the next list of actions, and the last one again after that."""

    def __init__(self, *turns: Iterable[Action]) -> None:
        self._turns: Iterator[list[Action]] = iter([list(turn) for turn in turns])
        self._last: list[Action] = []
        self.heard: list[str] = []
        self.responses: list[dict[str, Any]] = []

    def answer(self, heard: str) -> Answer:
        """Yield the actions of the next turn."""
        self.heard.append(heard)
        self._last = next(self._turns, self._last)
        for action in self._last:
            response = yield action
            if isinstance(action, Call):
                self.responses.append(response)


_METERS = re.compile(r"(?P<number>\d+(?:\.\d+)?|one|two|half a) meters?")
_WORDS = {"one": 1.0, "two": 2.0, "half a": 0.5}
_ASK_BATTERY = Call("query_state", {"fields": ["battery"]})
_AGREES = re.compile(r"\b(yes|ja|do it|confirm)\b")


class GrammarMind:
    """Understands some sentences by their words, and obeys the rules that the page tells a model."""

    def __init__(self) -> None:
        self._pending: Call | None = None  # what was read back
        self._rules: tuple[tuple[re.Pattern[str], Callable[[re.Match[str]], list[Call]]], ...] = (
            (re.compile(r"\b(stop|halt)\b"), lambda _: [Call("stop"), Call("nav_cancel")]),
            (re.compile(r"\bemergency\b"), lambda _: [Call("engage_estop")]),
            (re.compile(r"\bbattery\b"), lambda _: [_ASK_BATTERY]),
            (re.compile(r"\b(where|state)\b"), lambda _: [Call("query_state")]),
            (
                re.compile(r"\bsave here as (?P<name>[\w ]+)"),
                lambda m: [Call("save_named_location", {"name": m["name"].strip()})],
            ),
            (re.compile(r"\brun the sequence (?P<name>[\w-]+)"), lambda m: [Call("arm_run_sequence", {"name": m["name"]})]),
            (re.compile(r"\bdrive\b"), lambda _: [Call("drive", {"linear_x": 0.2, "duration_s": 1.0})]),
            (re.compile(r"\bgo to (?P<name>[\w ]+)"), lambda m: [Call("nav_goto_named", {"name": m["name"].strip()})]),
            (re.compile(r"\bforward\b"), lambda m: [Call("nav_forward", {"forward_m": _meters(m.string)})]),
            (re.compile(r"\b(red|green|blue|white)\b"), lambda m: [Call("set_light", {"color": m[0]})]),
        )

    def answer(self, heard: str) -> Answer:
        """Yield the calls of the first rule that fits, and say what came of them."""
        text = heard.lower()
        pending, self._pending = self._pending, None
        if pending is not None and _AGREES.search(text):
            calls = [pending]
        else:
            calls = next((make(found) for rule, make in self._rules if (found := rule.search(text))), [])
        if not calls:
            yield Say("I did not understand that.")
            return
        for call in calls:
            response = yield call
            if response.get("ok"):
                if call == _ASK_BATTERY and (battery := response.get("battery")):
                    yield Say(f"The battery is at {100.0 * battery['percentage']:.0f} percent, {battery['voltage']:.1f} volts.")
                    return
                continue
            if confirm := response.get("confirm"):
                self._pending = Call(call.name, {**call.arguments, "confirmation": response["confirmation"]})
                yield Say(f"Shall I {confirm}?")
            else:
                yield Say(f"That was refused: {response.get('error')}.")
            return
        yield Say("Done.")


def _meters(text: str) -> float:
    found = _METERS.search(text)
    return 1.0 if found is None else _WORDS.get(found["number"]) or float(found["number"])
