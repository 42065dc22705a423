"""A bounded burst of velocity that the server itself sends and ends, so that no client needs to be alive for the zero.

If this process dies or hangs, the drive bus sends zero once its input `manual` is silent for its timeout.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

PERIOD_S = 0.05  # 20 velocities a second, as pages send
ZEROS = 3  # sent at the end, one a period: one could be overtaken by the motion of another publisher

Velocity = tuple[float, float, float]  # forward and to the left in m/s, counter-clockwise in rad/s
_ZERO: Velocity = (0.0, 0.0, 0.0)


class DriveBurst:
    """Sends one velocity until its time is over, or until `problem` returns why it may not go on. For the event loop only.

    `ended` is called when a burst has ended by either.
    """

    def __init__(self, send: Callable[[Velocity], None], problem: Callable[[], str], ended: Callable[[], None]) -> None:
        self._send = send
        self._problem = problem
        self._ended = ended
        self._velocity = _ZERO
        self._end_s = 0.0
        self._zeros_due = 0
        self._timer: asyncio.TimerHandle | None = None

    @property
    def is_running(self) -> bool:
        """Whether a velocity is being sent that is not zero."""
        return self._velocity != _ZERO

    def start(self, velocity: Velocity, duration_s: float) -> None:
        """Begin a burst, which replaces the one before."""
        loop = asyncio.get_running_loop()
        self._stop_timer()
        # The bus lets motion of a stick pass only once the stick was at rest after a lock.
        self._send(_ZERO)
        self._velocity, self._end_s, self._zeros_due = velocity, loop.time() + duration_s, ZEROS
        self._step()

    def end(self) -> None:
        """End the burst: send zero now, and again with the next periods."""
        self._stop_timer()
        self._velocity, self._zeros_due = _ZERO, ZEROS
        self._step()

    def close(self) -> None:
        """End the burst with one zero, after which nothing is sent any more."""
        self._stop_timer()
        if self._zeros_due:
            self._velocity, self._zeros_due = _ZERO, 0
            self._send(_ZERO)

    def _step(self) -> None:
        loop = asyncio.get_running_loop()
        self._timer = None
        has_ended = self.is_running and (loop.time() >= self._end_s or bool(self._problem()))
        if has_ended:
            self._velocity = _ZERO
        if not self.is_running:
            self._zeros_due -= 1
        self._send(self._velocity)
        if has_ended:
            self._ended()
        if self.is_running or self._zeros_due > 0:
            self._timer = loop.call_later(PERIOD_S, self._step)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
