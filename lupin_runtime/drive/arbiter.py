"""Arbitration of the drive bus: the fresh input of the highest priority drives, unless the bus is locked.

Two rules are stricter than in a plain multiplexer, because people stand next to the robot:

* The bus is locked while the e-stop is engaged and also while its state is unknown: before the first message and after
  `ESTOP_TIMEOUT_S` of silence. A dead e-stop bridge is not a released e-stop.
* The bus is locked while the supervisor forbids motion, because a process does not respond.
* The end of a lock starts no motion. An input that commanded motion during the lock must be seen at rest once (neutral, or
  silent for `NEUTRAL_SILENCE_S` while the bus is unlocked) before its motion passes again. Until then it wins the bus by its
  priority, but at zero, because a person may be pushing that stick. Autonomy must rest only after an engaged e-stop. After a
  mere loss of the e-stop's heartbeat (its process was restarted) its new commands pass, so that a mission continues. A rest
  before that loss counts, too.

Several publishers may share an input, such as the sticks of two consoles, and their messages do not name them. A neutral
message therefore counts as rest only if no motion arrived on its input within the input's timeout.

The arbiter stores no command. It passes on only the message that it has just received, so no older one can reach the base.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from lupin_runtime.drive.twist import ZERO, Twist
from lupin_runtime.safety.estop_monitor import (
    DRAIN_S,
    ESTOP_ENGAGED,
    ESTOP_NOT_RECEIVED,
    ESTOP_SILENT,
    EStopEdge,
    EStopMonitor,
)

NEUTRAL_SILENCE_S = 2.0
# Three periods of the e-stop bridge.
ESTOP_TIMEOUT_S = 0.6

CLOSED = "shutting down"


@dataclass(frozen=True)
class Input:
    """A command source of the bus. `operator`: a person holds its stick, so it must return to neutral after every lock."""

    key: str
    priority: int
    timeout_s: float
    operator: bool = False


INPUTS = (
    Input("joy", 100, 0.3, operator=True),
    Input("manual", 50, 0.5, operator=True),
    Input("auto", 10, 0.5),
    Input("zero", 1, 1.0),
)


@dataclass
class _InputState:
    """State of an input: the times of its last message and its last motion, and whether its motion may pass."""

    armed: bool
    last_ns: int | None = None
    moved_ns: int | None = None
    was_neutral: bool = False  # whether the last message was neutral

    def rested(self, now_ns: int, timeout_ns: int) -> bool:
        """Return whether the last message was neutral, and no publisher of this input commanded motion within its timeout."""
        return self.was_neutral and (self.moved_ns is None or not 0 <= now_ns - self.moved_ns <= timeout_ns)


@dataclass(frozen=True)
class Decision:
    """The input that wins the bus, the reasons for locks, and for each input why it does or does not pass, and its age."""

    winner: str | None
    locks: tuple[str, ...]
    why: dict[str, str] = field(default_factory=dict)
    age_s: dict[str, float | None] = field(default_factory=dict)


class Arbiter:
    """Decides on each message. Times are nanoseconds of one clock; after a jump back, earlier messages are stale."""

    def __init__(
        self,
        inputs: tuple[Input, ...] = INPUTS,
        *,
        require_heartbeat: bool = True,
        heartbeat_timeout_s: float = ESTOP_TIMEOUT_S,
        neutral_silence_s: float = NEUTRAL_SILENCE_S,
        drain_s: float = DRAIN_S,
        count_estop_publishers: Callable[[], int] = lambda: 1,
    ) -> None:
        self.inputs = tuple(sorted(inputs, key=lambda item: -item.priority))
        self._timeout_ns = {item.key: int(item.timeout_s * 1e9) for item in inputs}
        self._by_key = {item.key: item for item in inputs}
        self._inputs = {item.key: _InputState(armed=not item.operator) for item in inputs}
        self._require_heartbeat = require_heartbeat
        self._heartbeat_ns = int(heartbeat_timeout_s * 1e9)
        self._neutral_ns = int(neutral_silence_s * 1e9)
        self._drain_ns = int(drain_s * 1e9)
        self._estop = EStopMonitor(count_estop_publishers)
        self._estop_received_ns: int | None = None
        self._closed = False
        self._lock_reason = ""
        self._locked = True  # until the first call with a time, which unlocks the bus if no heartbeat is required
        self._unlocked_ns = 0

    # -- events -------------------------------------------------------------------------------------------------------
    def handle_estop_state(self, engaged: bool, now_ns: int) -> None:
        """Handle a message of the e-stop state."""
        self._update_lock(now_ns)  # the silence before this message was a lock
        if self._estop.update(engaged, now_ns) is EStopEdge.ENGAGED:
            for state in self._inputs.values():
                state.armed = False
        self._estop_received_ns = now_ns
        self._update_lock(now_ns)

    def set_lock(self, reason: str, now_ns: int) -> None:
        """Lock the bus for `reason` until this is called with an empty one."""
        self._lock_reason = reason
        self._update_lock(now_ns)

    def close(self, now_ns: int) -> None:
        """Lock the bus permanently, because the process is shutting down."""
        self._closed = True
        self._update_lock(now_ns)

    def handle_command(self, key: str, twist: Twist, now_ns: int) -> Twist | None:
        """Handle a finite command. Returns what to send to the base now: the command, zero, or None."""
        locked = self._update_lock(now_ns)
        state = self._inputs[key]
        neutral = twist.is_neutral()
        state.was_neutral = state.was_neutral or neutral
        rested = state.rested(now_ns, self._timeout_ns[key])
        if neutral:
            state.armed = state.armed or rested
        else:
            if not state.armed and not locked:
                state.armed = rested or self._was_silent(state, now_ns)
            elif locked and (self._estop.engaged or self._by_key[key].operator):
                state.armed = False  # motion was commanded during the lock: an earlier rest no longer counts
            state.moved_ns, state.was_neutral = now_ns, False
        state.last_ns = now_ns
        if locked or self.winner(now_ns) != key:
            return None
        draining = 0 <= now_ns - self._unlocked_ns < self._drain_ns
        return twist if state.armed and not draining else ZERO

    # -- reading ------------------------------------------------------------------------------------------------------
    def locked(self, now_ns: int) -> bool:
        """Return whether the bus is locked."""
        return self._update_lock(now_ns)

    def winner(self, now_ns: int) -> str | None:
        """Return the key of the highest-priority fresh input; None when all are silent or the bus is locked."""
        if self._locked:
            return None
        for item in self.inputs:
            last_ns = self._inputs[item.key].last_ns
            if last_ns is not None and 0 <= now_ns - last_ns <= self._timeout_ns[item.key]:
                return item.key
        return None

    def locks(self, now_ns: int) -> tuple[str, ...]:
        """Return every reason why the bus is locked now."""
        reasons = []
        if self._closed:
            reasons.append(CLOSED)
        if self._estop.engaged:
            reasons.append(ESTOP_ENGAGED)
        if self._lock_reason:
            reasons.append(self._lock_reason)
        if self._require_heartbeat:
            if self._estop_received_ns is None:
                reasons.append(ESTOP_NOT_RECEIVED)
            elif not self._has_heartbeat(now_ns):
                reasons.append(f"{ESTOP_SILENT} {self._heartbeat_ns / 1e9:.1f} s")
        return tuple(reasons)

    def decision(self, now_ns: int) -> Decision:
        """Return the state of the bus for the log and the status topic."""
        self._update_lock(now_ns)
        locks = self.locks(now_ns)
        winner = self.winner(now_ns)
        why: dict[str, str] = {}
        age_s: dict[str, float | None] = {}
        for item in self.inputs:
            state = self._inputs[item.key]
            age_ns = None if state.last_ns is None else now_ns - state.last_ns
            age_s[item.key] = None if age_ns is None else round(age_ns / 1e9, 2)
            if age_ns is None:
                why[item.key] = "no message received"
            elif not 0 <= age_ns <= self._timeout_ns[item.key]:
                why[item.key] = f"silent for more than {item.timeout_s:g} s"
            elif locks:
                why[item.key] = "locked out"
            elif winner != item.key:
                why[item.key] = f"outranked by {winner}"
            else:
                why[item.key] = "wins the bus" if state.armed else "held at zero until it has been at rest once"
        return Decision(winner, locks, why, age_s)

    # -- inside -------------------------------------------------------------------------------------------------------
    def _update_lock(self, now_ns: int) -> bool:
        """Record whether a lock began or ended by `now_ns`; return whether the bus is locked."""
        silent = self._require_heartbeat and not self._has_heartbeat(now_ns)
        locked = self._closed or self._estop.engaged or bool(self._lock_reason) or silent
        if locked and not self._locked:
            # A silence counts as long as messages could be received: this process may have been suspended since.
            heard_ns = min(now_ns, (self._estop_received_ns or 0) + self._heartbeat_ns)
            for item in self.inputs:
                state = self._inputs[item.key]
                was_at_rest = state.armed or (not self._estop.engaged and self._was_silent(state, heard_ns))
                state.armed = was_at_rest and not item.operator
        elif self._locked and not locked:
            self._unlocked_ns = now_ns
        self._locked = locked
        return locked

    def _was_silent(self, state: _InputState, now_ns: int) -> bool:
        """Return whether an input was silent long enough to be at rest, since the bus is unlocked."""
        since_ns = self._unlocked_ns if state.last_ns is None else max(self._unlocked_ns, state.last_ns)
        return now_ns - since_ns >= self._neutral_ns

    def _has_heartbeat(self, now_ns: int) -> bool:
        return self._estop_received_ns is not None and 0 <= now_ns - self._estop_received_ns <= self._heartbeat_ns
