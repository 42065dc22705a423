"""The safety envelope: the rules that every call of a tool must pass on the server, whatever the browser or the model says.

It knows nothing of ROS or of connections. `admit` counts a call when it arrives, `judge` decides when it is its turn, with the
facts of that moment. What stops the robot passes always.
"""

from __future__ import annotations

import math
import secrets
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

from lupin_runtime.voice.arguments import BadArgument, shown
from lupin_runtime.voice.questions import ASK, question
from lupin_runtime.voice.tools import BY_NAME, CONFIRMATION, Effect, Tool
from lupin_runtime.voice.turns import Turns
from lupin_runtime.voice.untrusted import quote_all

CONFIRM_WITHIN_S = 30.0
BURSTS_S = 10.0  # how long an agent may drive in one turn, in bursts, which are not read back

# Reasons of refusals.
CUT_OFF = "cut off for this turn: {reason}"
NO_TURN = "the operator has not spoken, typed or pressed anything yet"
OLD_TURN = "the operator has begun a new turn since; answer that one"
IS_SPEAKING = "the operator is speaking; wait for the end"
ESTOPPED = "the e-stop is engaged; do not try again before the operator has released it"
SAME_TURN = "{action} must not follow start in the same turn; wait for the operator"
NO_UTTERANCE = "commit needs an utterance of the operator after the start, such as: I have posed the arm"
TOO_LONG = f"the bursts of one turn may last {BURSTS_S:g} s; use nav_forward, or wait for the operator"
NO_POSE = "the robot's pose on the map is not known"
READ_BACK = "read this back to the operator; if they agree, call it again in their next turn with this confirmation"
NOT_CONFIRMED = "the operator has not answered yet; wait for their next turn"
UNKNOWN_CONFIRMATION = "this confirmation is not known, or was used; call with the confirmation 'ask' to read back again"
OTHER_ARGUMENTS = "the call differs from what was read back; call with the confirmation 'ask' to read back again"
LATE_CONFIRMATION = f"the confirmation did not come in the next turn within {CONFIRM_WITHIN_S:g} s; read back again"


@dataclass(frozen=True)
class Situation:
    """What the envelope must know of the moment. `now_ns` is monotonic.

    `estop` are the reasons of an engaged e-stop. `control_refusal` is why this session may not command, and `outdated` why a
    command that arrived with the call must not be carried out any more; empty if they do not apply. `become_outdated` returns,
    later, the latter for a command of now. Speeds are the settings' maximum.
    """

    now_ns: int
    estop: tuple[str, ...] = ()
    control_refusal: str = ""
    max_linear_mps: float = 0.0
    max_angular_rps: float = 0.0
    has_pose: bool = False
    outdated: str = ""
    become_outdated: Callable[[], str] = str


@dataclass(frozen=True)
class Call:
    """A call that was admitted in a turn. Its arguments are checked; `confirmation` is the token that was given, or ASK."""

    tool: Tool
    arguments: dict[str, Any]
    turn: int
    confirmation: str | None = None
    key: Hashable = field(default=None, repr=False)

    @property
    def is_unconfirmed(self) -> bool:
        """Whether nothing was read back for it yet."""
        return self.confirmation in (None, ASK)


@dataclass(frozen=True)
class Rejected:
    """A call that is not carried out: the result for the model, and why the agent is cut off, if it is."""

    result: dict[str, Any]
    cut_off: str = ""

    @property
    def is_read_back(self) -> bool:
        """Whether the operator must confirm it."""
        return "confirm" in self.result

    @property
    def reason(self) -> str:
        """Why it is not carried out, in words, with what engages the e-stop."""
        error = str(self.result.get("error") or f"read back: {self.result.get('confirm')}")
        stops = "; ".join(each["untrusted"] for each in self.result.get("reasons", ()))
        return f"{error} ({stops})" if stops else error


@dataclass(frozen=True)
class _ReadBack:
    token: str
    tool: Tool
    arguments: dict[str, Any]
    turn: int
    begun_ns: int
    outdated: Callable[[], str]


class Envelope:
    """The rules for one voice session, with what they must remember of it."""

    def __init__(self) -> None:
        self.turns = Turns()
        self.speed_cap = 1.0  # share of the settings' maximum
        self._read_back: _ReadBack | None = None
        self._driven_s = (0, 0.0)  # the turn of the last burst, and how long those of this turn last
        self._started: dict[str, int] = {}  # by tool: the turn in which its action `start` was last carried out

    def cancel(self) -> None:
        """Forget what was read back: the operator has said no or interrupts, or nothing can be confirmed."""
        self._read_back = None

    def admit(self, name: Any, values: Any) -> Call | Rejected:
        """Count a call that has arrived, and check its arguments."""
        tool = BY_NAME.get(name) if isinstance(name, str) else None
        if tool is not None and tool.effect is Effect.STOP:
            return Call(tool, {}, self.turns.number)  # whatever its arguments are: none may keep it from stopping
        problem, arguments = "", {}
        if tool is None:
            problem = f"there is no tool {shown(name)}"
        else:
            try:
                arguments = tool.check(values)
            except BadArgument as error:
                problem = str(error)
        confirmation = arguments.pop(CONFIRMATION.name, None)
        key = (shown(name), problem or repr(sorted(arguments.items())), confirmation)
        if cut_off := self.turns.count_call(shown(name) if tool is None else tool.name, key):
            return Rejected(_failure(CUT_OFF.format(reason=cut_off)), cut_off)
        if tool is None or problem:
            return self._refuse(key, _failure(problem))
        return Call(tool, arguments, self.turns.number, confirmation, key)

    def judge(self, call: Call, situation: Situation) -> dict[str, Any] | Rejected:
        """Return the arguments with which a call is carried out now, or the refusal."""
        tool = call.tool
        if tool.effect is Effect.STOP:
            return {}
        if tool.is_blocked_by_estop(call.arguments) and situation.estop:
            reasons = {"blocked": True, "reasons": quote_all(situation.estop)}
            return self._refuse(call.key, {**_failure(ESTOPPED), **reasons})
        problem = self._turn_problem(call) or situation.outdated or situation.control_refusal
        if tool.needs_control and problem:
            return self._refuse(call.key, _failure(problem))
        if tool.needs_pose and not situation.has_pose:
            return self._refuse(call.key, _failure(NO_POSE))
        if tool.name == "drive" and self._burst_time_s(call) > BURSTS_S:
            return self._refuse(call.key, _failure(TOO_LONG))
        if call.confirmation is not None and (problem := self._turn_problem(call)):
            return self._refuse(call.key, _failure(problem))
        needs_confirmation = tool.sentence(call.arguments) or call.confirmation is not None
        if needs_confirmation and (pending := self._check_confirmation(call, situation)):
            return pending
        return self._approve(call, situation)

    def limits(self, situation: Situation) -> tuple[float, float]:
        """Return the maximum speed of a burst in m/s and rad/s, with the session's cap."""
        return situation.max_linear_mps * self.speed_cap, situation.max_angular_rps * self.speed_cap

    # -- rules --------------------------------------------------------------------------------------------------------
    def _turn_problem(self, call: Call) -> str:
        turn = self.turns.current
        if self.turns.cut_off:
            return CUT_OFF.format(reason=self.turns.cut_off)
        if turn is None:
            return NO_TURN
        if call.turn != turn.number:
            return OLD_TURN
        if not turn.ended:
            return IS_SPEAKING
        action = call.arguments.get("action")
        if action in ("commit", "save") and self._started.get(call.tool.name) == turn.number:
            return SAME_TURN.format(action=action)
        if action == "commit" and call.is_unconfirmed and not turn.is_utterance:
            return NO_UTTERANCE
        return ""

    def _check_confirmation(self, call: Call, situation: Situation) -> Rejected | None:
        """Return the read-back of a call that is not confirmed, or why its confirmation is refused; None if it is confirmed."""
        arguments = self._limited(call, situation)
        if call.confirmation is None or call.confirmation == ASK:
            sentence, token = question(call.tool, arguments), secrets.token_hex(4)
            self._read_back = _ReadBack(token, call.tool, arguments, call.turn, situation.now_ns, situation.become_outdated)
            return Rejected({"ok": False, "confirm": sentence, CONFIRMATION.name: token, "note": READ_BACK})
        read_back = self._read_back
        if read_back is None or not secrets.compare_digest(read_back.token.encode(), call.confirmation.encode()):
            return self._refuse(call.key, _failure(UNKNOWN_CONFIRMATION))
        if call.turn == read_back.turn:
            return self._refuse(call.key, _failure(NOT_CONFIRMED))
        self._read_back = None
        problem = ""
        if (read_back.tool, read_back.arguments) != (call.tool, arguments):
            problem = OTHER_ARGUMENTS
        elif call.turn != read_back.turn + 1 or situation.now_ns - read_back.begun_ns > CONFIRM_WITHIN_S * 1e9:
            problem = LATE_CONFIRMATION
        if problem := problem or read_back.outdated():
            return self._refuse(call.key, _failure(problem))
        return None

    def _burst_time_s(self, call: Call) -> float:
        """Return how long all bursts of a call's turn last, with this one."""
        turn, driven_s = self._driven_s
        return float(call.arguments["duration_s"]) + (driven_s if turn == call.turn else 0.0)

    def _approve(self, call: Call, situation: Situation) -> dict[str, Any]:
        arguments = self._limited(call, situation)
        if call.tool.name == "set_speed_cap":
            self.speed_cap = arguments["value"]
        elif call.tool.name == "drive":
            self._driven_s = call.turn, self._burst_time_s(call)
        elif arguments.get("action") == "start":
            self._started[call.tool.name] = call.turn
        return arguments

    def _limited(self, call: Call, situation: Situation) -> dict[str, Any]:
        """Return the arguments of a call, of a burst with the velocity within the limits."""
        velocity = limit_velocity(call.arguments, *self.limits(situation)) if call.tool.name == "drive" else {}
        return {**call.arguments, **velocity}

    def _refuse(self, key: Hashable, result: dict[str, Any]) -> Rejected:
        self.turns.count_refusal(key)
        return Rejected(result)


def limit_velocity(velocity: dict[str, Any], max_linear_mps: float, max_angular_rps: float) -> dict[str, float]:
    """Return `linear_x`, `linear_y` (m/s) and `angular_z` (rad/s) within the limits, in the same direction."""
    x, y, turn = (float(velocity[name]) for name in ("linear_x", "linear_y", "angular_z"))
    speed = math.hypot(x, y)
    scale = max_linear_mps / speed if speed > max_linear_mps else 1.0
    return {
        "linear_x": x * scale,
        "linear_y": y * scale,
        "angular_z": max(-max_angular_rps, min(max_angular_rps, turn)),
    }


def _failure(error: str) -> dict[str, Any]:
    return {"ok": False, "error": error}
