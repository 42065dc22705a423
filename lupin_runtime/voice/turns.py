"""Turns of the operator, and how often a model may call tools in one.

A turn begins when a person speaks, types or presses a button. Only the browser knows that, so only it announces turns; a model
cannot. A call is judged by the turn in which it arrived.
"""

from __future__ import annotations

import enum
from collections import Counter, deque
from collections.abc import Hashable
from dataclasses import dataclass

MAX_CALLS = 20  # in one turn
MAX_SAME_CALLS = 4  # of one tool with the same arguments, in one turn
MAX_REFUSED_CALLS = 2  # the same, if it was refused before
MAX_CUT_OFFS = 3  # until the operator acts by hand
_MAX_TURNS = 1000  # whose ids are remembered

# Reasons of a cut-off.
FLOOD = f"it called more than {MAX_CALLS} tools in one turn"
LOOP = "it called {tool} with the same arguments again and again"
INSISTS = "it repeated a refused call of {tool}"
TOO_OFTEN = f"it was cut off {MAX_CUT_OFFS} times; type something or press a button to go on"


class TurnKind(enum.Enum):
    """How a turn began; the value is its name in messages."""

    SPEECH = "speech"
    TEXT = "text"
    BUTTON = "button"


@dataclass(frozen=True)
class Turn:
    """A turn: its number in this session, how it began, and whether the operator has finished, so that a model may answer."""

    number: int
    kind: TurnKind
    ended: bool

    @property
    def is_utterance(self) -> bool:
        """Whether the operator said or typed something."""
        return self.kind is not TurnKind.BUTTON


class Turns:
    """The turns of a voice session, and the calls in the present one."""

    def __init__(self) -> None:
        self.current: Turn | None = None
        self.cut_off = ""  # why calls are refused for the rest of the turn; empty if they are not
        self._ids: deque[str] = deque(maxlen=_MAX_TURNS)
        self._calls = self._cut_offs = 0
        self._same: Counter[Hashable] = Counter()
        self._refused: Counter[Hashable] = Counter()

    @property
    def number(self) -> int:
        """The number of the present turn; 0 before the first."""
        return self.current.number if self.current is not None else 0

    @property
    def is_answerable(self) -> bool:
        """Whether the operator has begun a turn and finished it, so that a model may act on it."""
        return self.current is not None and self.current.ended

    def announce(self, identifier: str, kind: TurnKind, *, ended: bool) -> None:
        """Begin a turn, or end the present one, which is announced again with its id. The id of an earlier one is ignored."""
        current = self.current
        if current is not None and self._ids[-1] == identifier:
            self.current = Turn(current.number, current.kind, ended or current.ended)
        elif identifier not in self._ids:
            self._ids.append(identifier)
            self.current = Turn(self.number + 1, kind, ended)
            self._begin(kind)

    def _begin(self, kind: TurnKind) -> None:
        self._calls = 0
        self._same.clear()
        self._refused.clear()
        if kind is not TurnKind.SPEECH:  # a microphone also hears the robot's own voice, and noise
            self._cut_offs = 0
        self.cut_off = TOO_OFTEN if self._cut_offs >= MAX_CUT_OFFS else ""

    def count_call(self, tool: str, call: Hashable) -> str:
        """Count a call, and return why the agent is cut off; empty if it is not."""
        if self.cut_off:
            return self.cut_off
        self._calls += 1
        self._same[call] += 1
        if self._calls > MAX_CALLS:
            return self._cut(FLOOD)
        if self._refused[call] >= MAX_REFUSED_CALLS:
            return self._cut(INSISTS.format(tool=tool))
        if self._same[call] > MAX_SAME_CALLS:
            return self._cut(LOOP.format(tool=tool))
        return ""

    def count_refusal(self, call: Hashable) -> None:
        """Note that a call was refused."""
        self._refused[call] += 1

    def _cut(self, reason: str) -> str:
        self._cut_offs += 1
        self.cut_off = reason
        return reason
