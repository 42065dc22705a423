"""The stop buttons of any number of consoles, which share one topic and do not say who they are.

A console says true (engaged) or false (released) on every change and twice a second. rclpy does not tell who sent a
message, and consoles behind one rosbridge are one publisher anyway, so this works on the mixed stream:

* Any true engages at once.
* A release needs evidence from everybody: no true for longer than a console could keep quiet, and as many falses as there
  are consoles. How many there are is read off the message rate at the last true. So two consoles OR together; and when one
  dies while it holds the stop, the falses of the others are too few to release it. It then stays engaged until somebody
  presses stop and releases it: a deliberate act. (A console that joins, presses and dies within two seconds, beside another
  that says released, is the one case that cannot be told from a press and a release of the other.)
* Silence of all, once one was heard, engages too: a "released" of which nobody knows whether it still holds is stale. It
  ends when a console says released again.
* Of several consoles that all say released, one may leave: the others still speak for the operator.
* Where no console was ever heard (a headless run) there is nobody to lose, and nothing is engaged.
"""

from __future__ import annotations

from collections import deque

PERIOD_S = 0.5
EXPIRY_S = 1.5
# A holder that is alive repeats itself within one period; nearly two must pass without a true before it may have let go.
QUIET_PERIODS = 1.8
# Consoles are counted over this many periods: a window of n periods holds n or n + 1 messages of each, which for up to
# four consoles rounds to the right number.
COUNTED_PERIODS = 8
# To tell k consoles from k - 1 by their falses, so many periods per console are looked at.
RELEASE_PERIODS = 2

HOLDS = "a console holds the stop"
LOST_HOLDING = "the console that held the stop was lost: press stop on a console, then release it"
LOST = "no console has been heard for"


class ConsoleLane:
    """Folds the consoles' stream into one verdict. Times are nanoseconds of real time, since a console is a person's
    browser and lives in it whatever a simulation's pace."""

    def __init__(self, period_s: float = PERIOD_S, expiry_s: float = EXPIRY_S, *, silence_engages: bool = True) -> None:
        if expiry_s <= period_s:
            raise ValueError(f"consoles expire after {expiry_s} s, expected more than their period of {period_s} s")
        self._silence_engages = silence_engages
        self._period_ns = int(period_s * 1e9)
        self._expiry_ns = int(expiry_s * 1e9)
        self._recent: deque[tuple[int, bool]] = deque()
        self._heard_ns: int | None = None
        self._held_ns: int | None = None  # the last true, or when silence engaged; None while released
        self._held_by_silence = False
        self._consoles = 1

    def heard(self, engaged: bool, now_ns: int) -> None:
        """Take a console's message."""
        self._notice_silence(now_ns)
        self._heard_ns = now_ns
        self._recent.append((now_ns, engaged))
        while self._recent[0][0] <= now_ns - COUNTED_PERIODS * self._period_ns:
            self._recent.popleft()
        if engaged:
            self._held_ns, self._held_by_silence = now_ns, False
            self._consoles = self._count(now_ns)
        elif self._held_ns is not None and self._released(self._held_ns, now_ns):
            self._held_ns = None

    def reason(self, now_ns: int) -> str | None:
        """Why the consoles engage the stop; None while they do not."""
        self._notice_silence(now_ns)
        if self._held_ns is None or self._heard_ns is None:
            return None
        if self._held_by_silence:
            return f"{LOST} {self._expiry_ns / 1e9:g} s"
        return HOLDS if now_ns - self._held_ns <= self._expiry_ns else LOST_HOLDING

    def _count(self, now_ns: int) -> int:
        """How many consoles speak, from the messages of the last few periods."""
        of_each = 1 + int((now_ns - self._recent[0][0]) / self._period_ns + 0.25)
        return max(1, int(len(self._recent) / of_each + 0.5))

    def _released(self, held_ns: int, now_ns: int) -> bool:
        if now_ns - held_ns < QUIET_PERIODS * self._period_ns:
            return False
        periods = RELEASE_PERIODS * self._consoles
        start_ns = max(held_ns, now_ns - periods * self._period_ns)
        falses = sum(not engaged and time_ns > start_ns for time_ns, engaged in self._recent)
        return falses >= (self._consoles - 0.5) * periods

    def _notice_silence(self, now_ns: int) -> None:
        if self._heard_ns is None or not self._silence_engages or self._held_ns is not None:
            return
        if now_ns - self._heard_ns > self._expiry_ns:
            self._held_ns, self._held_by_silence = self._heard_ns + self._expiry_ns, True
            self._consoles = 1
