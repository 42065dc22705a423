"""A press of the e-stop that the e-stop bridge missed, because the bridge hung or was being replaced.

Somebody who presses and releases the button meanwhile expects what follows any other press: nothing moves until a newer
command. Another process therefore subscribes to button and consoles, too.
"""

from __future__ import annotations

# A working bridge answers within milliseconds; on a busy machine a press may also arrive this long before or after the answer.
ANSWER_S = 0.5
# The processes discover a new bridge one after the other; some would miss a shorter stop.
HOLD_S = 1.5


class MissedPress:
    """Whether a press was missed: the e-stop's state was not engaged from ANSWER_S before it until ANSWER_S after it.

    It counts as missed until the state has been engaged for HOLD_S. Times are nanoseconds of one monotonic clock.
    """

    def __init__(self) -> None:
        self._engaged_ns: int | None = None
        self._press_ns: int | None = None
        self._made_good_ns: int | None = None  # when the state was engaged after a missed press
        self._down = False
        self.missed = False

    def button(self, pressed: bool, now_ns: int) -> None:
        """Handle a message of the button. Its repeated value is one press."""
        if pressed and not self._down:
            self.press(now_ns)
        self._down = pressed

    def press(self, now_ns: int) -> None:
        """Handle a press, or a console's message that it holds the stop."""
        if self._press_ns is None and (self._engaged_ns is None or now_ns - self._engaged_ns > ANSWER_S * 1e9):
            self._press_ns = now_ns

    def state(self, engaged: bool, now_ns: int) -> None:
        """Handle a message of the e-stop's state."""
        if engaged:
            self._engaged_ns, self._press_ns = now_ns, None
            if self.missed and self._made_good_ns is None:
                self._made_good_ns = now_ns

    def tick(self, now_ns: int) -> bool:
        """Return whether a press is missed at `now_ns`."""
        if self._press_ns is not None and now_ns - self._press_ns > ANSWER_S * 1e9:
            self.missed = True
        if self._made_good_ns is not None and now_ns - self._made_good_ns >= HOLD_S * 1e9:
            self.missed, self._made_good_ns = False, None
        return self.missed
