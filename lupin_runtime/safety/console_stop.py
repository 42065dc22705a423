"""The stop buttons of any number of consoles, which publish on one topic without identifying themselves.

A console publishes true (engaged) or false (released) on every change and twice a second. rclpy does not report the sender of a
message, and consoles behind one rosbridge are one publisher, so this works on the combined stream:

* Any true engages the stop at once.
* A release needs evidence from all consoles: no true for longer than a live console could be silent, and as many falses as
  there are consoles. Their number follows from the message rate at the last true. Two consoles therefore combine with OR. When
  one dies while it holds the stop, the falses of the others are too few to release it, and the stop stays engaged until a
  person presses and releases it. One case cannot be distinguished from a press and release by one console: another console
  that joins, presses and dies within two seconds.
* Silence of all consoles engages the stop once one was received, because a released state that is not repeated is stale. This
  stop ends when a console publishes released again.
* If several consoles all publish released, one may leave without effect.
* If no console was ever received (a headless run), nothing is engaged.
"""

from __future__ import annotations

from collections import deque

PERIOD_S = 0.5
EXPIRY_S = 1.5
# A live console that holds the stop repeats true within one period; nearly two must pass before it can have released.
QUIET_PERIODS = 1.8
# Consoles are counted over this many periods: n periods contain n or n + 1 messages of each console, and for up to four
# consoles the quotient rounds to their number.
COUNTED_PERIODS = 8
# Periods per console that are evaluated to distinguish k consoles from k - 1 by the number of their falses.
RELEASE_PERIODS = 2

# Reasons of a stop.
CONSOLE_HOLDS_STOP = "a console holds the stop"
LOST_HOLDING = "the console that held the stop was lost: press stop on a console, then release it"
LOST = "no message from any console for {seconds:g} s"


class ConsoleStop:
    """Derives one stop state from the messages of all consoles.

    Times are nanoseconds of real time, because consoles are browsers that do not follow a simulation's speed.
    """

    def __init__(self, period_s: float = PERIOD_S, expiry_s: float = EXPIRY_S, *, silence_engages: bool = True) -> None:
        if expiry_s <= period_s:
            raise ValueError(f"consoles expire after {expiry_s} s, expected more than their period of {period_s} s")
        self._silence_engages = silence_engages
        self._period_ns = int(period_s * 1e9)
        self._expiry_ns = int(expiry_s * 1e9)
        self._recent: deque[tuple[int, bool]] = deque()
        self._received_ns: int | None = None
        self._held_ns: int | None = None  # the time of the last true, or when silence engaged the stop; None while released
        self._held_by_silence = False
        self._consoles = 1

    def update(self, engaged: bool, now_ns: int) -> None:
        """Handle a console's message."""
        self._engage_on_silence(now_ns)
        self._received_ns = now_ns
        self._recent.append((now_ns, engaged))
        while self._recent[0][0] <= now_ns - COUNTED_PERIODS * self._period_ns:
            self._recent.popleft()
        if engaged:
            self._held_ns, self._held_by_silence = now_ns, False
            self._consoles = self._count(now_ns)
        elif self._held_ns is not None and self._released(self._held_ns, now_ns):
            self._held_ns = None

    def reason(self, now_ns: int) -> str | None:
        """Return why the consoles engage the stop, or None."""
        self._engage_on_silence(now_ns)
        if self._held_ns is None or self._received_ns is None:
            return None
        if self._held_by_silence:
            return LOST.format(seconds=self._expiry_ns / 1e9)
        return CONSOLE_HOLDS_STOP if now_ns - self._held_ns <= self._expiry_ns else LOST_HOLDING

    def is_lost(self, now_ns: int) -> bool:
        """Return whether a stop is engaged that no console repeats, of which a new process would not hear."""
        return self.reason(now_ns) not in (None, CONSOLE_HOLDS_STOP)

    def _count(self, now_ns: int) -> int:
        """Return the number of consoles, from the messages of the last few periods."""
        of_each = 1 + int((now_ns - self._recent[0][0]) / self._period_ns + 0.25)
        return max(1, int(len(self._recent) / of_each + 0.5))

    def _released(self, held_ns: int, now_ns: int) -> bool:
        if now_ns - held_ns < QUIET_PERIODS * self._period_ns:
            return False
        periods = RELEASE_PERIODS * self._consoles
        start_ns = max(held_ns, now_ns - periods * self._period_ns)
        falses = sum(not engaged and time_ns > start_ns for time_ns, engaged in self._recent)
        return falses >= (self._consoles - 0.5) * periods

    def _engage_on_silence(self, now_ns: int) -> None:
        if self._received_ns is None or not self._silence_engages or self._held_ns is not None:
            return
        if now_ns - self._received_ns > self._expiry_ns:
            self._held_ns, self._held_by_silence = self._received_ns + self._expiry_ns, True
            self._consoles = 1
