"""A voice session for tests of the envelope, with what a test says of the moment, and a complete call of each tool."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from lupin_runtime.voice.envelope import Envelope, Rejected, Situation
from lupin_runtime.voice.turns import TurnKind

# Whatever a rule needs is there: nothing is stopped, the session may command, and the pose is known.
FREE = Situation(now_ns=0, max_linear_mps=0.3, max_angular_rps=0.8, has_pose=True)

# A complete call of each tool.
CALLS: dict[str, dict[str, Any]] = {
    "drive": {"linear_x": 0.2, "duration_s": 1.0},
    "stop": {},
    "nav_goto": {"x": 1.0, "y": -2.0, "yaw": 0.5},
    "nav_forward": {"forward_m": 1.0},
    "rotate": {"angle_deg": 90.0},
    "set_speed_cap": {"value": 0.5},
    "nav_cancel": {},
    "nav_goto_named": {"name": "home"},
    "list_named_locations": {},
    "save_named_location": {"name": "here"},
    "gripper": {"action": "set", "percent": 40.0},
    "arm_preset": {"name": "tuck"},
    "arm_goto_pose": {"name": "wave"},
    "arm_save_pose": {"name": "wave"},
    "arm_list_library": {},
    "arm_run_sequence": {"name": "hello"},
    "arm_stop": {},
    "arm_record": {"action": "start"},
    "calibrate_arm": {"action": "start"},
    "query_state": {},
    "engage_estop": {},
    "speak": {"text": "Good morning."},
    "set_light": {"color": "red"},
}


class Session:
    """An envelope with its first turn begun, and the clock of the test."""

    def __init__(self, kind: TurnKind = TurnKind.SPEECH) -> None:
        self.envelope = Envelope()
        self.situation = FREE
        self._turns = 0
        self.turn(kind)

    def turn(self, kind: TurnKind = TurnKind.SPEECH, *, ended: bool = True) -> None:
        self._turns += 1
        self.envelope.turns.announce(f"turn {self._turns}", kind, ended=ended)

    def end_turn(self, kind: TurnKind = TurnKind.SPEECH) -> None:
        self.envelope.turns.announce(f"turn {self._turns}", kind, ended=True)

    def set(self, **changes: Any) -> None:
        self.situation = replace(self.situation, **changes)

    def wait(self, seconds: float) -> None:
        self.set(now_ns=self.situation.now_ns + int(seconds * 1e9))

    def call(self, name: Any, arguments: Any = None) -> dict[str, Any] | Rejected:
        admitted = self.envelope.admit(name, {} if arguments is None else arguments)
        return admitted if isinstance(admitted, Rejected) else self.envelope.judge(admitted, self.situation)

    def refusal(self, name: Any, arguments: Any = None) -> dict[str, Any]:
        """The result of a call, which must be refused."""
        outcome = self.call(name, arguments)
        assert isinstance(outcome, Rejected) and outcome.result["ok"] is False, outcome
        return outcome.result

    def approved(self, name: str, arguments: Any = None) -> dict[str, Any]:
        """The arguments of a call, which must be approved."""
        outcome = self.call(name, arguments)
        assert not isinstance(outcome, Rejected), outcome
        return outcome

    def read_back(self, name: str, arguments: Any) -> dict[str, Any]:
        """Call for the first time, and return the arguments with the confirmation."""
        result = self.refusal(name, arguments)
        assert result["confirm"], result
        return {**arguments, "confirmation": result["confirmation"]}

    def confirmed(self, name: str, arguments: Any, kind: TurnKind = TurnKind.SPEECH) -> dict[str, Any]:
        """Read back, and confirm in the next turn."""
        second = self.read_back(name, arguments)
        self.turn(kind)
        return self.approved(name, second)
