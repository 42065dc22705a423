"""The drive bus: selects the input that moves the base, limits its commands, and sends zero when no input may move it.

The sink is the output topic to the base. A base that receives no command may keep its last velocity (the simulated drive) or
stop after its own timeout (the robot). The bus relies on neither. It sends zero

* when the input in effect times out or a lock begins: immediately for an engaged e-stop, else with the next tick (20 Hz);
* then with every tick for `ZERO_REPEAT_S`, because the sink is best effort and a packet may be lost;
* then, while the bus is locked, with every tick, to override any other publisher on the sink; while the bus is idle, twice a
  second, for a base that starts late or is restarted.
"""

from __future__ import annotations

from collections.abc import Callable

from lupin_runtime.drive.arbiter import ESTOP_TIMEOUT_S, INPUTS, Arbiter, Decision, Input
from lupin_runtime.drive.ramp import Ramp
from lupin_runtime.drive.twist import ZERO, HardLimits, Twist

ALWAYS_ZERO = "zero"  # the input that stops the base while no other one commands it
ZERO_REPEAT_S = 1.0
IDLE_PERIOD_S = 0.5


class Bus:
    """The drive bus. Methods that return a twist return the command to send to the sink now, or None."""

    def __init__(
        self,
        inputs: tuple[Input, ...] = INPUTS,
        *,
        limits: HardLimits | None = None,
        require_heartbeat: bool = True,
        heartbeat_timeout_s: float = ESTOP_TIMEOUT_S,
        count_estop_publishers: Callable[[], int] = lambda: 1,
    ) -> None:
        """Create a bus that is locked. `count_estop_publishers` returns the number of publishers of the e-stop state."""
        self._arbiter = Arbiter(
            inputs,
            require_heartbeat=require_heartbeat,
            heartbeat_timeout_s=heartbeat_timeout_s,
            count_estop_publishers=count_estop_publishers,
        )
        self._limits = limits or HardLimits()
        self._ramp = Ramp()
        self._active_input: str | None = None  # the input whose command was sent last; None while the bus is stopped
        self._stop_began_ns = 0
        self._last_zero_ns: int | None = None
        self.rejected = {item.key: 0 for item in inputs}  # number of malformed or non-finite commands, by input

    def handle_command(self, key: str, twist: Twist | None, now_ns: int) -> Twist | None:
        """Handle a command of input `key`; None stands for a malformed one.

        Malformed and non-finite commands count as zero, and so does motion on the input ALWAYS_ZERO.
        """
        if twist is None or not twist.is_finite() or (key == ALWAYS_ZERO and twist != ZERO):
            self.rejected[key] += 1
            twist = ZERO
        passed = self._arbiter.handle_command(key, twist, now_ns)
        if passed is None:
            return None
        self._active_input = key
        return self._ramp.limit(self._limits.clamp(passed), now_ns)

    def handle_estop_state(self, engaged: bool, now_ns: int) -> Twist | None:
        """Handle a message of the e-stop state; returns zero if this locks the bus while a command is in effect."""
        self._arbiter.handle_estop_state(engaged, now_ns)
        return self._stop(now_ns) if self._active_input is not None and self._arbiter.locked(now_ns) else None

    def tick(self, now_ns: int, lock_reason: str = "") -> Twist | None:
        """Begin or continue a stop; call it at 20 Hz. `lock_reason` says why nothing may move, or is ""."""
        self._arbiter.set_lock(lock_reason, now_ns)
        locked = self._arbiter.locked(now_ns)
        winner = self._arbiter.winner(now_ns)
        if self._active_input is not None:
            # The last command of a silent input must not stay in effect, even if another input takes over.
            return None if winner == self._active_input else self._stop(now_ns)
        if self._last_zero_ns is None:
            return self._stop(now_ns)  # the first message of a bus that has just started
        idle_s = (now_ns - self._last_zero_ns) / 1e9
        stopped_s = (now_ns - self._stop_began_ns) / 1e9
        if locked or stopped_s <= ZERO_REPEAT_S or not 0 <= idle_s < IDLE_PERIOD_S:
            self._last_zero_ns = now_ns
            return ZERO
        return None

    def close(self, now_ns: int) -> Twist:
        """Lock permanently; the caller sends the zero several times before the process ends."""
        self._arbiter.close(now_ns)
        return self._stop(now_ns)

    def decision(self, now_ns: int) -> Decision:
        """Return the state of the bus for the log and the status topic."""
        return self._arbiter.decision(now_ns)

    def _stop(self, now_ns: int) -> Twist:
        self._active_input = None
        self._ramp.reset()
        self._stop_began_ns = self._last_zero_ns = now_ns
        return ZERO
