"""The bus as a whole: arbitration, hard limits, and a zero that is said aloud.

A base that hears nothing may keep its last velocity (the simulated drive does) or stop after a time-out of its own (the
robot's does). Neither is left to chance: when the flow of commands ends, for whatever reason, zero goes out

* at once, on the edge;
* then with every tick (20 Hz) for `HOLD_S`, since the sink is best effort and a packet may be lost;
* then with every tick for as long as a lock holds, so that nobody publishes past a locked bus unopposed, else twice a
  second, which a base that starts late or joins again hears soon.
"""

from __future__ import annotations

from lupin_runtime.drive.arbiter import INPUTS, Arbiter, Decision, Input
from lupin_runtime.drive.twist import ZERO, HardLimits, Twist

HOLD_S = 1.0
IDLE_PERIOD_S = 0.5


class Bus:
    """Every method returns what the sink must get now, or None for nothing."""

    def __init__(
        self,
        inputs: tuple[Input, ...] = INPUTS,
        *,
        limits: HardLimits | None = None,
        require_heartbeat: bool = True,
        heartbeat_timeout_s: float = 1.0,
    ) -> None:
        self._arbiter = Arbiter(inputs, require_heartbeat=require_heartbeat, heartbeat_timeout_s=heartbeat_timeout_s)
        self._limits = limits or HardLimits()
        self._flowing: str | None = None  # whose command the sink obeys; None while it is held at zero
        self._stopped_ns = 0
        self._zero_ns: int | None = None
        self.rejected = {item.key: 0 for item in inputs}  # commands that were not finite

    def command(self, key: str, twist: Twist | None, now_ns: int) -> Twist | None:
        """Take a command of input `key`; None stands for one that was malformed or not finite, which counts as zero."""
        if twist is None or not twist.is_finite():
            self.rejected[key] += 1
            twist = ZERO
        passed = self._arbiter.command(key, twist, now_ns)
        if passed is None:
            return None
        self._flowing = key
        return self._limits.clamp(passed)

    def estop(self, engaged: bool, now_ns: int) -> Twist | None:
        """Take a message of the e-stop state; the edge into the lock is answered with zero at once."""
        self._arbiter.estop(engaged, now_ns)
        return self._stop(now_ns) if self._flowing is not None and self._arbiter.locked(now_ns) else None

    def tick(self, now_ns: int) -> Twist | None:
        """To be called at 20 Hz."""
        locked = self._arbiter.locked(now_ns)
        winner = self._arbiter.winner(now_ns)
        if self._flowing is not None:
            # The last word of an input that fell silent must not outlive it, even where another one takes over.
            return None if winner == self._flowing else self._stop(now_ns)
        if self._zero_ns is None:
            return self._stop(now_ns)  # the first word of a bus that just started
        idle_s = (now_ns - self._zero_ns) / 1e9
        held_s = (now_ns - self._stopped_ns) / 1e9
        if locked or held_s <= HOLD_S or not 0 <= idle_s < IDLE_PERIOD_S:
            self._zero_ns = now_ns
            return ZERO
        return None

    def close(self, now_ns: int) -> Twist:
        """Lock for good; the zero must be sent several times before the process ends."""
        self._arbiter.close(now_ns)
        return self._stop(now_ns)

    def decision(self, now_ns: int) -> Decision:
        """Who has the bus and why, for people."""
        return self._arbiter.decision(now_ns)

    def _stop(self, now_ns: int) -> Twist:
        self._flowing = None
        self._stopped_ns = self._zero_ns = now_ns
        return ZERO
