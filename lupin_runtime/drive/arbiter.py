"""Who drives: the highest-priority input that is fresh, unless a lock holds.

Two things are stricter here than in a plain multiplexer, because people stand next to the robot:

* A lock holds while the e-stop is engaged and also while its state is unknown: before the first message and after a second
  of silence. A dead e-stop bridge is not a released e-stop.
* The end of a lock starts nothing. An input that was commanding motion into the lock must be seen at rest once (neutral, or
  silent for `NEUTRAL_SILENCE_S` with the bus unlocked) before its motion passes again. Until then it still holds the bus by
  its priority, at zero: somebody is pushing that stick. For autonomy the rule holds after an engaged e-stop; after a mere
  loss of the e-stop's heartbeat (its process restarted) new commands pass, so that a mission goes on.

Nothing here keeps a command: what passes is the message just received, so nothing older can.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from lupin_runtime.drive.twist import ZERO, Twist

NEUTRAL_SILENCE_S = 2.0
# Messages that were already queued in the process when a lock ended are handled within this time, and count as older.
DRAIN_S = 0.1

ESTOP_ENGAGED = "e-stop engaged"
ESTOP_UNHEARD = "e-stop state never heard"
ESTOP_SILENT = "e-stop state not heard for"
CLOSED = "shutting down"


@dataclass(frozen=True)
class Input:
    """One source of the bus. `operator`: a person's hand is on it, so every lock, however short, asks for neutral."""

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
class _Heard:
    """What is remembered of an input: when it last spoke, and whether motion from it may pass."""

    armed: bool
    last_ns: int | None = None


@dataclass(frozen=True)
class Decision:
    """Who has the bus, and why the others have not. `locks` is empty when nothing is locked."""

    winner: str | None
    locks: tuple[str, ...]
    why: dict[str, str] = field(default_factory=dict)
    age_s: dict[str, float | None] = field(default_factory=dict)


class Arbiter:
    """Decides per message. Times are nanoseconds of one clock; where that jumps back, everything older is stale."""

    def __init__(
        self,
        inputs: tuple[Input, ...] = INPUTS,
        *,
        require_heartbeat: bool = True,
        heartbeat_timeout_s: float = 1.0,
        neutral_silence_s: float = NEUTRAL_SILENCE_S,
        drain_s: float = DRAIN_S,
    ) -> None:
        self.inputs = tuple(sorted(inputs, key=lambda item: -item.priority))
        self._timeout_ns = {item.key: int(item.timeout_s * 1e9) for item in inputs}
        self._by_key = {item.key: item for item in inputs}
        self._heard = {item.key: _Heard(armed=not item.operator) for item in inputs}
        self._require_heartbeat = require_heartbeat
        self._heartbeat_ns = int(heartbeat_timeout_s * 1e9)
        self._neutral_ns = int(neutral_silence_s * 1e9)
        self._drain_ns = int(drain_s * 1e9)
        self._engaged = False
        self._estop_heard_ns: int | None = None
        self._closed = False
        self._locked = True  # until the first look at the clock; with no heartbeat asked for, that look unlocks
        self._unlocked_ns = 0

    # -- events -------------------------------------------------------------------------------------------------------
    def estop(self, engaged: bool, now_ns: int) -> None:
        """Take a message of the e-stop state."""
        self._follow_locks(now_ns)  # a silence that this message ends was a lock
        if engaged and not self._engaged:
            for heard in self._heard.values():
                heard.armed = False
        self._engaged = engaged
        self._estop_heard_ns = now_ns
        self._follow_locks(now_ns)

    def close(self, now_ns: int) -> None:
        """Lock for good: the process is going away."""
        self._closed = True
        self._follow_locks(now_ns)

    def command(self, key: str, twist: Twist, now_ns: int) -> Twist | None:
        """Take a command (finite). Returns what the sink must get for it now: the command, zero, or None for nothing."""
        locked = self._follow_locks(now_ns)
        heard = self._heard[key]
        neutral = twist.is_neutral()
        if neutral:
            heard.armed = True
        elif not heard.armed and not locked:
            since = self._unlocked_ns if heard.last_ns is None else max(self._unlocked_ns, heard.last_ns)
            heard.armed = now_ns - since >= self._neutral_ns
        elif locked and (self._engaged or self._by_key[key].operator):
            heard.armed = False  # pushed again while locked: whatever rest was seen before no longer counts
        heard.last_ns = now_ns
        if locked or self.winner(now_ns) != key:
            return None
        draining = 0 <= now_ns - self._unlocked_ns < self._drain_ns
        return twist if heard.armed and not draining else ZERO

    # -- reading ------------------------------------------------------------------------------------------------------
    def locked(self, now_ns: int) -> bool:
        """Whether nothing may pass."""
        return self._follow_locks(now_ns)

    def winner(self, now_ns: int) -> str | None:
        """The key of the highest-priority fresh input; None when all are silent or a lock holds."""
        if self._locked:
            return None
        for item in self.inputs:
            last_ns = self._heard[item.key].last_ns
            if last_ns is not None and 0 <= now_ns - last_ns <= self._timeout_ns[item.key]:
                return item.key
        return None

    def locks(self, now_ns: int) -> tuple[str, ...]:
        """Every reason why the bus is locked now."""
        reasons = []
        if self._closed:
            reasons.append(CLOSED)
        if self._engaged:
            reasons.append(ESTOP_ENGAGED)
        if self._require_heartbeat:
            if self._estop_heard_ns is None:
                reasons.append(ESTOP_UNHEARD)
            elif not self._heartbeat(now_ns):
                reasons.append(f"{ESTOP_SILENT} {self._heartbeat_ns / 1e9:.1f} s")
        return tuple(reasons)

    def decision(self, now_ns: int) -> Decision:
        """Who has the bus and why the others have not, for people."""
        self._follow_locks(now_ns)
        locks = self.locks(now_ns)
        winner = self.winner(now_ns)
        why: dict[str, str] = {}
        age_s: dict[str, float | None] = {}
        for item in self.inputs:
            heard = self._heard[item.key]
            age_ns = None if heard.last_ns is None else now_ns - heard.last_ns
            age_s[item.key] = None if age_ns is None else round(age_ns / 1e9, 2)
            if age_ns is None:
                why[item.key] = "never heard"
            elif not 0 <= age_ns <= self._timeout_ns[item.key]:
                why[item.key] = f"silent for more than {item.timeout_s:g} s"
            elif locks:
                why[item.key] = "locked out"
            elif winner != item.key:
                why[item.key] = f"outranked by {winner}"
            else:
                why[item.key] = "holds the bus" if heard.armed else "held at zero: it must come to rest once"
        return Decision(winner, locks, why, age_s)

    # -- inside -------------------------------------------------------------------------------------------------------
    def _follow_locks(self, now_ns: int) -> bool:
        """Notice that a lock began or ended by `now_ns`; returns whether one holds."""
        locked = self._closed or self._engaged or (self._require_heartbeat and not self._heartbeat(now_ns))
        if locked and not self._locked:
            for item in self.inputs:
                if item.operator:
                    self._heard[item.key].armed = False
        elif self._locked and not locked:
            self._unlocked_ns = now_ns
        self._locked = locked
        return locked

    def _heartbeat(self, now_ns: int) -> bool:
        return self._estop_heard_ns is not None and 0 <= now_ns - self._estop_heard_ns <= self._heartbeat_ns
